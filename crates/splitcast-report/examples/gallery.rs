//! Writes a page with every block and every kind of plot, from made-up data.
//!
//! ```text
//! cargo run --release -p splitcast-report --example gallery -- gallery.html
//! ```
//!
//! A second path takes the first plot as an SVG file of its own.

use std::process::ExitCode;
use std::{env, fs};

use splitcast_report::{
    Axis, Cell, Column, Dash, Family, Figure, Image, Page, Plot, Provenance, Role, Section, Series,
    Table,
};

fn main() -> ExitCode {
    let mut arguments = env::args_os().skip(1);
    let Some(path) = arguments.next() else {
        eprintln!("usage: gallery PAGE.html [PLOT.svg]");
        return ExitCode::from(2);
    };
    let plot = arguments
        .next()
        .map(|path| (path, frames().to_standalone_svg()));
    for (path, content) in [(path, page().to_html())].into_iter().chain(plot) {
        if let Err(error) = fs::write(&path, content) {
            eprintln!("{}: {error}", path.to_string_lossy());
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

fn page() -> Page {
    let provenance = Provenance::collect("gallery", env!("CARGO_PKG_VERSION"));
    Page::new("Gallery of a report’s parts")
        .lead(
            "Every block that a page can hold and every kind of plot, filled with made-up \
             data. Nothing here was measured.",
        )
        .section(text_and_tables())
        .section(lines_and_families())
        .section(scatters_and_bars())
        .section(hard_cases())
        .section(pictures())
        .section(
            Section::new("How this page was made")
                .definitions(provenance.definitions())
                .code(provenance.command.clone()),
        )
}

fn text_and_tables() -> Section {
    let header = [
        "update (ms)",
        "goal (ms)",
        "trace (Mray/s)",
        "expected cost",
        "node visits",
    ];
    let columns = header.map(Column::right);
    let rows = [
        (
            "cloth-ball, 92 160 triangles",
            Cell::good("4.21"),
            "5.00",
            "31.4",
            "104.72",
        ),
        (
            "horse <script>alert(1)</script>",
            Cell::short("7.90"),
            "5.00",
            "28.0",
            "98.10",
        ),
        ("elephant", Cell::strong("11.02"), "15.00", "19.6", "121.55"),
        ("collision", Cell::muted("not run"), "20.00", "–", "–"),
    ];
    let mut table = Table::new([Column::left("scene")].into_iter().chain(columns))
        .caption("Update time against its goal, with what the trees are worth.");
    for (scene, update, goal, rate, cost) in rows {
        let visits = Cell::muted("212 004");
        let cells = [
            scene.into(),
            update,
            goal.into(),
            rate.into(),
            cost.into(),
            visits,
        ];
        table = table.row::<Cell>(cells);
    }
    Section::new("Text and tables")
        .paragraph(
            "A paragraph of running text, set to a width that reads well. Names from outside, \
             such as file names, come out as they are: scene/<b>frame</b> & 'co'.ply.",
        )
        .table(table)
        .table(
            Table::new([
                Column::left("setting"),
                Column::center("on"),
                Column::right("value"),
            ])
            .row(["leaf width", "yes", "8"])
            .row(["empty bonus", "no", "0.0"]),
        )
}

fn lines_and_families() -> Section {
    Section::new("Lines and families of curves")
        .figure(Figure::new(frames()).caption(
            "One line for each system over the frames of an animation; a gap where a frame \
             was not measured.",
        ))
        .figure(
            Figure::new(root_costs(73))
                .caption("A family of 73 curves with 200 points each, coloured by frame."),
        )
        .figures([
            Figure::new(root_costs(48).size(460.0, 180.0)).caption("The same with 48 curves."),
            Figure::new(convergence()).caption("Both axes logarithmic."),
            Figure::new(jumps()).caption("A line that jumps."),
            Figure::new(many_names()).caption("A legend of several rows."),
        ])
}

fn scatters_and_bars() -> Section {
    let groups = Plot::new("Time by phase")
        .x(Axis::new("builder"))
        .y(Axis::new("time per frame").unit("ms"))
        .categories(["sweep", "binned", "track", "refit"])
        .series(Series::bars("top tree", [9.1, 1.2, 0.4, 0.0]))
        .series(Series::bars("distribute", [12.0, 2.9, 0.9, f64::NAN]))
        .series(Series::bars("subtrees", [31.0, 4.4, 2.2, 1.1]));
    let many = Plot::new("Names that have no room")
        .y(Axis::new("speed-up over one thread").unit("×"))
        .categories((1..=14).map(|i| format!("configuration {i}")))
        .series(Series::bars(
            "",
            (1..=14).map(|i| f64::from(i).sqrt() - 1.8),
        ));
    let logarithmic = Plot::new("Bars on a logarithmic axis")
        .y(Axis::new("rays").log())
        .categories(["primary rays", "shadow rays", "ambient occlusion"])
        .series(Series::bars("horse", [1.0e6, 2.3e6, 6.4e7]))
        .series(Series::bars("elephant", [1.0e6, 1.9e6, 0.0]));
    Section::new("Scatter plots and bars")
        .figure(Figure::new(systems()).caption(
            "Time to update against the speed of tracing, with a label beside each dot that has \
             room for one. The dashed line is the Pareto front: no system is better in both.",
        ))
        .figures([
            Figure::new(groups).caption("Bars in groups, one missing."),
            Figure::new(logarithmic),
            Figure::new(many),
        ])
}

fn hard_cases() -> Section {
    let small = |title: &str| Plot::new(title).size(460.0, 110.0);
    let line = |points: &[(f64, f64)]| Series::line("series", points.iter().copied());
    Section::new("Hard cases").figures([
        Figure::new(
            small("Nothing to draw")
                .no_data("the peer libraries were not built on this machine")
                .series(line(&[])),
        ),
        Figure::new(small("A single point").series(line(&[(3.0, 4.0)]))),
        Figure::new(small("Constant").series(line(&[(0.0, 5.0), (9.0, 5.0)]))),
        Figure::new(
            small("Huge numbers close together")
                .y(Axis::new("references"))
                .series(line(&[(0.0, 1e9), (1.0, 1e9 + 3.0), (2.0, 1e9 + 1.0)])),
        ),
        Figure::new(
            small("Tiny and negative")
                .x(Axis::new("offset").unit("m"))
                .series(line(&[(-2e-7, -1e-9), (0.0, 2e-9), (3e-7, -4e-9)])),
        ),
        Figure::new(
            small("Cut to a range")
                .y(Axis::new("value").range(0.0, 10.0))
                .series(Series::line("peaks", wave(120, |t| 14.0 * (t * 9.0).sin()))),
        ),
        Figure::new(
            small(
                "A title that is much longer than a title should be and therefore has to go on \
                 in a second line",
            )
            .x(Axis::new("x").log())
            .y(Axis::new("<y> & more").log())
            .series(Series::dots(
                "an <i>odd</i> name",
                [(1.0, 1.0), (1e9, 1e-9), (5.0, 0.0)],
            )),
        ),
    ])
}

fn pictures() -> Section {
    let images = (0..4).map(|i| Image::png(&gradient(i * 60), format!("frame {i}: made up")));
    let images: Result<Vec<_>, _> = images.collect();
    Section::new("Pictures").images(images.unwrap_or_default())
}

fn frames() -> Plot {
    let time = |base: f64, swing: f64, phase: f64| {
        (0..96).map(move |frame| {
            let t = f64::from(frame) / 15.0;
            let gap = (40..46).contains(&frame) && phase == 0.0;
            let value = base + swing * (t + phase).sin() + 0.3 * (t * 7.0 + phase).cos();
            (f64::from(frame), if gap { f64::NAN } else { value })
        })
    };
    Plot::new("Update time by frame")
        .description("Four ways to bring the tree up to date.")
        .x(Axis::new("frame").whole())
        .y(Axis::new("update time").unit("ms").include(0.0))
        .series(Series::line("binned", time(8.0, 1.0, 0.0)))
        .series(Series::line("tracked", time(4.0, 1.4, 2.0)))
        .series(Series::line("sweep", time(13.0, 1.2, 4.0)).dash(Dash::Dashed))
        .series(
            Series::line("goal: 30 frames per second", [(0.0, 6.0), (95.0, 6.0)])
                .role(Role::Muted)
                .dash(Dash::Dotted),
        )
}

fn root_costs(curves: u32) -> Plot {
    let mut family = Family::new("frame");
    for frame in 0..curves {
        let phase = f64::from(frame) / f64::from(curves);
        family = family.curve(
            f64::from(frame),
            wave(200, move |t| {
                let dip = |at: f64, width: f64| (-((t - at) / width).powi(2)).exp();
                2.0 - 0.9 * dip(0.35 + 0.2 * phase, 0.22) - 0.3 * dip(0.75 - 0.1 * phase, 0.06)
            }),
        );
    }
    Plot::new("Cost of splitting the root")
        .x(Axis::new("position of the plane along x"))
        .y(Axis::new("expected cost, relative to a leaf"))
        .family(family)
        .series(Series::dots("minimum", [(0.36, 1.087)]).role(Role::S2))
}

fn convergence() -> Plot {
    let error = |scale: f64| (0..24).map(move |i| (1.7f64.powi(i), scale / 1.7f64.powi(i).sqrt()));
    Plot::new("Error by samples")
        .x(Axis::new("samples per pixel").log())
        .y(Axis::new("mean squared error").log())
        .series(Series::line("random", error(0.4)))
        .series(Series::line("stratified", error(0.1)))
        .series(Series::line("exact", [(1.0, 0.0), (100.0, 0.0)]))
}

fn jumps() -> Plot {
    let rebuilt = [0, 0, 1, 1, 1, 2, 2, 3, 3, 3, 3, 4].into_iter().enumerate();
    Plot::new("Rebuilt subtrees")
        .x(Axis::new("frame").whole())
        .y(Axis::new("subtrees").whole())
        .series(Series::step(
            "so far",
            rebuilt.map(|(i, n)| (i as f64, f64::from(n))),
        ))
}

fn many_names() -> Plot {
    let mut plot = Plot::new("Eight series")
        .x(Axis::new("frame").whole())
        .y(Axis::new("value"));
    for i in 0..8 {
        let offset = f64::from(i);
        let curve = wave(48, move |t| offset + (t * 6.0 + offset).sin());
        let curve = curve.map(|(t, value)| (t * 47.0, value));
        plot = plot.series(Series::line(format!("series {}", i + 1), curve));
    }
    plot
}

fn systems() -> Plot {
    let ours: &[(&str, (f64, f64))] = &[
        ("tracked", (3.1, 24.0)),
        ("binned", (7.4, 29.5)),
        ("sweep", (420.0, 33.0)),
    ];
    let peers: &[(&str, (f64, f64))] = &[
        ("peer A", (5.2, 21.0)),
        ("peer B", (16.0, 30.2)),
        ("peer C", (62.0, 22.4)),
        ("peer C, refitted", (6.6, 29.0)),
        ("peer D, high quality", (160.0, 31.0)),
        ("peer E", (2.2, 9.0)),
    ];
    let front = [
        (2.2, 9.0),
        (3.1, 24.0),
        (7.4, 29.5),
        (16.0, 30.2),
        (160.0, 31.0),
        (420.0, 33.0),
    ];
    let front = Series::step("Pareto front", front)
        .role(Role::Muted)
        .dash(Dash::Dashed);
    let plot = Plot::new("Update time against tracing speed")
        .x(Axis::new("update time").unit("ms, less is better").log())
        .y(Axis::new("rays traced")
            .unit("Mray/s, more is better")
            .include(0.0));
    let dots = |name: &str, systems: &[(&str, (f64, f64))]| {
        Series::dots(name, systems.iter().map(|system| system.1))
            .labels(systems.iter().map(|system| system.0))
    };
    plot.series(front)
        .series(dots("Splitcast", ours).role(Role::S1))
        .series(dots("peers", peers).role(Role::S2))
}

/// `count` points of a function of 0 to 1.
fn wave(count: u32, f: impl Fn(f64) -> f64) -> impl Iterator<Item = (f64, f64)> {
    (0..count).map(move |i| {
        let t = f64::from(i) / f64::from(count - 1);
        (t, f(t))
    })
}

/// The bytes of a small PNG file.
fn gradient(blue: u8) -> Vec<u8> {
    const SIZE: u32 = 96;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, SIZE, SIZE * 3 / 4);
    encoder.set_color(png::ColorType::Rgb);
    let pixels: Vec<u8> = (0..SIZE * 3 / 4)
        .flat_map(|y| (0..SIZE).flat_map(move |x| [(x * 2) as u8, (y * 3) as u8, blue]))
        .collect();
    // A failure leaves bytes that `Image::png` refuses.
    if let Ok(mut writer) = encoder.write_header() {
        let _ = writer.write_image_data(&pixels);
    }
    bytes
}
