//! What has to hold for every plot, whatever it is given.

use proptest::prelude::*;
use roxmltree::{Document, Node};

use super::*;

fn parse(svg: &str) -> Document<'_> {
    Document::parse(svg).unwrap_or_else(|error| panic!("{error}\n{svg}"))
}

fn attribute(node: Node<'_, '_>, name: &str) -> f64 {
    let text = node
        .attribute(name)
        .unwrap_or_else(|| panic!("no {name} in {node:?}"));
    text.parse()
        .unwrap_or_else(|_| panic!("{name} is {text:?}"))
}

fn by_class<'a>(document: &'a Document<'_>, class: &str) -> Vec<Node<'a, 'a>> {
    let nodes = document.descendants();
    nodes
        .filter(|node| node.attribute("class") == Some(class))
        .collect()
}

/// The corners of a path of `M` and `l` commands.
fn corners(path: &str) -> Vec<(f64, f64)> {
    let mut pen = (0.0, 0.0);
    let starts: Vec<_> = path.match_indices(['M', 'l']).map(|(at, _)| at).collect();
    let ends = starts.iter().skip(1).copied().chain([path.len()]);
    let commands = starts
        .iter()
        .zip(ends)
        .map(|(&start, end)| path[start..end].split_at(1));
    let step = |(name, numbers): (&str, &str)| {
        let (x, y) = numbers.split_once(',').expect("two numbers");
        let (x, y): (f64, f64) = (x.parse().expect("x"), y.parse().expect("y"));
        pen = if name == "M" {
            (x, y)
        } else {
            (pen.0 + x, pen.1 + y)
        };
        pen
    };
    commands.map(step).collect()
}

/// The estimated extents of the labels beside dots: left, top, right and bottom.
fn label_boxes(document: &Document<'_>) -> Vec<[f64; 4]> {
    let groups = by_class(document, "labels").into_iter();
    let extents = groups.flat_map(|group| group.children()).map(|label| {
        let width = text::width(label.text().unwrap_or_default().trim(), layout::TICK);
        let (x, y) = (attribute(label, "x"), attribute(label, "y"));
        let left = match label.attribute("text-anchor") {
            Some("start") => x,
            Some("middle") => x - width / 2.0,
            _ => x - width,
        };
        let [top, bottom] = [y - 0.7 * layout::TICK, y + 0.2 * layout::TICK];
        [left, top, left + width, bottom]
    });
    extents.collect()
}

/// Checks all that needs no knowledge of what was drawn.
fn check(svg: &str) {
    let document = parse(svg);
    let root = document.root_element();
    assert_eq!(root.attribute("role"), Some("img"));
    let first = root.first_element_child().expect("a first element");
    assert_eq!(first.tag_name().name(), "title");
    let second = first.next_sibling_element().expect("a second element");
    assert_eq!(second.tag_name().name(), "desc");
    let view = root.attribute("viewBox").expect("a viewBox");
    let view: Vec<f64> = view
        .split(' ')
        .map(|n| n.parse().expect("a number"))
        .collect();
    assert!(view[2] > 0.0 && view[3] > 0.0);

    let words = svg.split(|c: char| !c.is_ascii_alphanumeric());
    for word in words {
        assert!(
            !["NaN", "inf", "Infinity"].contains(&word),
            "{word} in {svg}"
        );
    }
    for text in document
        .descendants()
        .filter(|node| node.has_tag_name("text"))
    {
        for (name, from, length) in [("x", view[0], view[2]), ("y", view[1], view[3])] {
            if text.attribute(name).is_some() {
                let at = attribute(text, name);
                assert!(
                    (from..=from + length).contains(&at),
                    "{name}={at} outside {view:?}"
                );
            }
        }
    }
    let Some(&area) = by_class(&document, "area").first() else {
        assert_eq!(by_class(&document, "no-data").len(), 1);
        return;
    };
    let (left, top) = (attribute(area, "x"), attribute(area, "y"));
    let right = left + attribute(area, "width");
    let bottom = top + attribute(area, "height");
    let inside = |x: f64, y: f64| {
        let room = 0.02;
        let within = (left - room..=right + room).contains(&x);
        assert!(
            within && (top - room..=bottom + room).contains(&y),
            "{x},{y} in {svg}"
        );
    };
    let family = by_class(&document, "family")
        .into_iter()
        .flat_map(|node| node.children());
    for line in by_class(&document, "line").into_iter().chain(family) {
        for (x, y) in corners(line.attribute("d").unwrap_or_default()) {
            inside(x, y);
        }
    }
    let dots = by_class(&document, "dots")
        .into_iter()
        .flat_map(|group| group.children());
    for dot in dots.filter(|node| node.has_tag_name("circle")) {
        inside(attribute(dot, "cx"), attribute(dot, "cy"));
    }
    let bars = by_class(&document, "bars")
        .into_iter()
        .flat_map(|group| group.children());
    for bar in bars {
        let (x, y) = (attribute(bar, "x"), attribute(bar, "y"));
        inside(x, y);
        inside(x + attribute(bar, "width"), y + attribute(bar, "height"));
    }
    for [left, top, right, bottom] in label_boxes(&document) {
        inside(left, top);
        inside(right, bottom);
    }
    for (class, name, sign) in [("x-ticks", "x", 1.0), ("y-ticks", "y", -1.0)] {
        let ticks = by_class(&document, class)
            .into_iter()
            .flat_map(|group| group.children());
        let places: Vec<_> = ticks
            .filter(|tick| tick.attribute(name).is_some())
            .collect();
        let places: Vec<_> = places
            .iter()
            .map(|&tick| sign * attribute(tick, name))
            .collect();
        assert!(places.is_sorted(), "{class} at {places:?}");
    }
}

fn value() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -100.0..100.0f64,
        2 => any::<f64>(),
        1 => prop::sample::select(vec![
            0.0, -0.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN,
            f64::MIN_POSITIVE, 5e-324, 1e300, -1e300, 1e-290, 1e9, 1e9 + 1e-6,
        ]),
    ]
}

fn axis() -> impl Strategy<Value = Axis> {
    let range = prop::option::of((value(), value()));
    let include = prop::collection::vec(value(), 0..2);
    (any::<bool>(), any::<bool>(), range, include).prop_map(|(log, whole, range, include)| Axis {
        label: "label".into(),
        unit: "unit".into(),
        log,
        whole,
        include,
        range,
    })
}

// Names have no `i`, or one of them would be `inf` some day.
fn series() -> impl Strategy<Value = Series> {
    let points = prop::collection::vec((value(), value()), 0..12);
    (0..4, points, "[a-hj-z<&\"\0]{0,40}").prop_map(|(kind, points, name)| match kind {
        0 => Series::line(name, points),
        1 => {
            let labels = vec![name.clone(); points.len() / 2];
            Series::dots(name, points).role(Role::S1).labels(labels)
        }
        2 => Series::step(name, points).dash(Dash::Dotted),
        _ => Series::bars(name, points.into_iter().map(|p| p.1)),
    })
}

fn family() -> impl Strategy<Value = Family> {
    let points = prop::collection::vec((value(), value()), 0..8);
    let curves = prop::collection::vec((value(), points), 0..4);
    curves.prop_map(|curves| Family {
        label: "frame".into(),
        curves,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn every_plot_is_sound(
        axes in (axis(), axis()),
        all in prop::collection::vec(series(), 0..5),
        family in prop::option::of(family()),
        categories in prop::collection::vec("[a-hj-z ]{0,30}", 0..4),
        size in (value(), value()),
    ) {
        let mut plot = Plot::new("title").x(axes.0).y(axes.1).categories(categories);
        plot = all.into_iter().fold(plot, Plot::series).size(size.0, size.1);
        plot.family = family;
        check(&plot.to_svg());
        check(&plot.to_standalone_svg());
        prop_assert_eq!(plot.to_svg(), plot.clone().to_svg());
    }

    #[test]
    fn ticks_rise_within_the_scale(axis in axis(), values in prop::collection::vec(value(), 1..5)) {
        for margin in [scale::Margin::Tight, scale::Margin::Narrow, scale::Margin::Ticks(6)] {
            let Some(scale) = scale::Scale::new(&axis, values.iter().copied(), margin) else {
                continue;
            };
            prop_assert!(scale.lo < scale.hi, "{:?}", scale);
            let ticks = scale.ticks(8, |_| true);
            prop_assert!(ticks.len() >= 2);
            prop_assert!(ticks.windows(2).all(|pair| pair[0].value < pair[1].value), "{:?}", ticks);
            for tick in &ticks {
                let place = scale.place(tick.value);
                prop_assert!(place.is_some_and(|p| (-1e-9..=1.0 + 1e-9).contains(&p)), "{:?}", ticks);
            }
        }
    }
}

#[test]
fn points_stand_where_their_values_say() {
    let svg = Plot::new("")
        .y(Axis::new("").range(0.0, 10.0))
        .series(Series::line("", [(0.0, 0.0), (5.0, 10.0), (10.0, 5.0)]))
        .to_svg();
    let document = parse(&svg);
    let area = by_class(&document, "area")[0];
    let [x, y, width, height] = ["x", "y", "width", "height"].map(|name| attribute(area, name));
    let line = by_class(&document, "line")[0];
    let expected = [
        (x, y + height),
        (x + width / 2.0, y),
        (x + width, y + height / 2.0),
    ];
    for (corner, place) in corners(line.attribute("d").expect("a path"))
        .iter()
        .zip(expected)
    {
        assert!((corner.0 - place.0).abs() < 0.02 && (corner.1 - place.1).abs() < 0.02);
    }
}

#[test]
fn ticks_are_round_numbers() {
    let labels = |axis: Axis, values: [f64; 2]| -> Vec<String> {
        let scale = scale::Scale::new(&axis, values, scale::Margin::Tight).expect("a scale");
        scale
            .ticks(6, |_| true)
            .into_iter()
            .map(|tick| tick.label)
            .collect()
    };
    assert_eq!(
        labels(Axis::new(""), [0.0, 1.0]),
        ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]
    );
    assert_eq!(labels(Axis::new("").whole(), [0.0, 2.0]), ["0", "1", "2"]);
    assert_eq!(
        labels(Axis::new(""), [-7.0, 21.0]),
        ["\u{2212}5", "0", "5", "10", "15", "20"]
    );
    assert_eq!(
        labels(Axis::new("").log(), [1.0, 100.0]),
        ["1", "2", "5", "10", "20", "50", "100"]
    );
    assert_eq!(
        labels(Axis::new("").log(), [1e-6, 1.0])[..2],
        ["10⁻⁶", "10⁻⁵"]
    );
}

#[test]
fn tick_labels_do_not_collide() {
    let far = Plot::new("")
        .series(Series::line("", [(0.0, 0.0), (987_654.0, 1.0)]))
        .to_svg();
    let log = Plot::new("").x(Axis::new("").log());
    let log = log
        .series(Series::line("", [(1e-9, 0.0), (3e12, 1.0)]))
        .to_svg();
    for svg in [far, log] {
        let document = parse(&svg);
        let ticks: Vec<_> = by_class(&document, "x-ticks")[0].children().collect();
        for pair in ticks.windows(2) {
            let width = |tick: Node<'_, '_>| text::width(tick.text().unwrap_or(""), layout::TICK);
            let room = attribute(pair[1], "x") - attribute(pair[0], "x");
            assert!(room >= (width(pair[0]) + width(pair[1])) / 2.0, "{svg}");
        }
    }
}

#[test]
fn gaps_and_lone_points_are_seen() {
    let points = [
        (0.0, 1.0),
        (1.0, 2.0),
        (2.0, f64::NAN),
        (3.0, 1.0),
        (4.0, f64::INFINITY),
    ];
    let svg = Plot::new("").series(Series::line("a", points)).to_svg();
    let document = parse(&svg);
    assert_eq!(
        corners(
            by_class(&document, "line")[0]
                .attribute("d")
                .expect("a path")
        )
        .len(),
        2
    );
    assert_eq!(by_class(&document, "dots")[0].children().count(), 1);
}

#[test]
fn a_plot_without_data_says_why() {
    let svg = Plot::new("t")
        .no_data("peers <not> built")
        .series(Series::line("a", []))
        .to_svg();
    check(&svg);
    assert!(svg.contains("No data") && svg.contains("peers &lt;not&gt; built"));

    let zeros = Plot::new("t")
        .y(Axis::new("").log())
        .series(Series::dots("a", [(1.0, 0.0)]));
    assert!(zeros.to_svg().contains("One point at or below 0"));
}

#[test]
fn left_out_points_are_counted() {
    let points = [(1.0, 0.0), (2.0, -1.0), (3.0, 5.0), (4.0, f64::NAN)];
    let svg = Plot::new("t")
        .y(Axis::new("").log())
        .series(Series::dots("a", points))
        .to_svg();
    assert!(svg.contains("2 points at or below 0"));
}

#[test]
fn hundreds_of_curves_stay_small() {
    let curve = |frame: u32| {
        let point = move |i: u32| (f64::from(i), f64::from(i * frame).sin());
        (0..200).map(point)
    };
    let family = (0..300).fold(Family::new("frame"), |f, i| f.curve(f64::from(i), curve(i)));
    let svg = Plot::new("t").family(family).to_svg();
    check(&svg);
    assert_eq!(by_class(&parse(&svg), "family")[0].children().count(), 300);
    assert!(svg.len() < 300 * 200 * 14, "{} bytes", svg.len());
    assert!(svg.contains("frame 0") && svg.contains(">299<"));
}

#[test]
fn bars_share_their_place_and_stand_on_zero() {
    let svg = Plot::new("")
        .categories(["a", "b"])
        .series(Series::bars("one", [1.0, -2.0]))
        .series(Series::bars("two", [3.0, f64::NAN]))
        .to_svg();
    check(&svg);
    let document = parse(&svg);
    let bars: Vec<_> = by_class(&document, "bars")
        .iter()
        .flat_map(|g| g.children())
        .collect();
    assert_eq!(bars.len(), 3);
    let end = |bar: Node<'_, '_>| attribute(bar, "x") + attribute(bar, "width");
    assert!(end(bars[0]) <= attribute(bars[2], "x"));
    let foot = attribute(bars[0], "y") + attribute(bars[0], "height");
    assert!((foot - attribute(bars[1], "y")).abs() < 0.02);
}

#[test]
fn labels_of_a_crowd_cover_neither_each_other_nor_dots() {
    // A spiral: dense in the middle.
    let point = |i: u32| {
        let (angle, radius) = (f64::from(i) * 0.9, f64::from(i * i));
        (500.0 + radius * angle.cos(), 500.0 + radius * angle.sin())
    };
    let plot = Plot::new("")
        .size(460.0, 300.0)
        .series(
            Series::dots("crowd", (0..25).map(point))
                .role(Role::S1)
                .labels((0..25).map(|i| format!("system number {i}"))),
        )
        .series(Series::line("line", [(0.0, 500.0), (1000.0, 500.0)]));
    let svg = plot.to_svg();
    check(&svg);
    assert_eq!(svg, plot.to_svg());
    let document = parse(&svg);
    let boxes = label_boxes(&document);
    assert!(boxes.len() >= 12, "{} labels", boxes.len());
    let overlap =
        |a: &[f64; 4], b: &[f64; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    for (at, a) in boxes.iter().enumerate() {
        assert!(boxes[at + 1..].iter().all(|b| !overlap(a, b)), "{svg}");
        for dot in by_class(&document, "dots")[0].children() {
            let (x, y) = (attribute(dot, "cx"), attribute(dot, "cy"));
            assert!(!overlap(a, &[x - 3.4, y - 3.4, x + 3.4, y + 3.4]), "{svg}");
        }
    }
}

#[test]
fn labels_are_text_and_begin_their_tooltips() {
    let svg = Plot::new("")
        .series(Series::dots("group", [(1.0, 1.0), (2.0, 2.0)]).labels(["<a> & b"]))
        .to_svg();
    check(&svg);
    assert!(svg.contains(">&lt;a&gt; &amp; b</text>"));
    assert!(svg.contains("<title>&lt;a&gt; &amp; b, group: 1, 1</title>"));
    assert!(svg.contains("<title>group: 2, 2</title>"));
    assert_eq!(label_boxes(&parse(&svg)).len(), 1);

    let many = (0..301).map(|i| (f64::from(i), 0.0));
    let svg = Plot::new("")
        .series(Series::dots("group", many).labels(["label"]))
        .to_svg();
    assert!(!svg.contains("label"));
}
