//! Pages as a strict parser sees them.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;
use roxmltree::{Document, ParsingOptions};
use splitcast_report::{Axis, Cell, Column, Figure, Image, Page, Plot, Section, Series, Table};

fn parse(html: &str) -> Document<'_> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(html, options).unwrap_or_else(|error| panic!("{error}\n{html}"))
}

/// The smallest PNG file there is to make.
fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = png::Encoder::new(&mut bytes, 3, 2);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&[0; 6]).expect("six grey pixels");
    writer.finish().expect("an end");
    bytes
}

/// A page with `text` everywhere that text can go.
fn page(text: &str) -> Page {
    let plot = Plot::new(text)
        .description(text)
        .x(Axis::new(text).unit(text))
        .y(Axis::new(text).unit(text))
        .categories([text, text])
        .series(Series::bars(text, [1.0, 2.0]))
        .series(Series::line(text, [(0.0, 1.0), (1.0, 2.0)]));
    let empty = Plot::new(text).no_data(text);
    let table = Table::new([
        Column::left(text),
        Column::center(text),
        Column::right(text),
    ])
    .caption(text)
    .row::<Cell>([
        text.into(),
        Cell::good(text),
        Cell::short(text),
        Cell::muted(text),
        Cell::strong(text),
    ])
    .row([text]);
    let section = Section::new(text)
        .paragraph(text)
        .table(table)
        .figure(Figure::new(plot.clone()).caption(text))
        .figures([Figure::new(plot), Figure::new(empty).caption(text)])
        .images([Image::png(&png(), text).expect("a PNG file")])
        .definitions([(text, text)])
        .code(text);
    let page = Page::new(text).lead(text).section(section);
    (1..4).fold(page, |page, _| page.section(Section::new(text)))
}

#[test]
fn markup_in_text_comes_out_as_text() {
    let name = "scene/<script>alert('1')</script>&amp;\"x\".ply";
    let html = page(name).to_html();
    let document = parse(&html);
    assert!(
        !document
            .descendants()
            .any(|node| node.has_tag_name("script"))
    );
    assert!(!html.contains("<script"));
    let heading = document
        .descendants()
        .find(|node| node.tag_name().name() == "h1");
    assert_eq!(heading.and_then(|node| node.text()), Some(name));
    let alt = document
        .descendants()
        .find_map(|node| node.attribute("alt"));
    assert_eq!(alt, Some(name));
}

#[test]
fn nothing_is_fetched_and_nothing_runs() {
    let html = page("plain").to_html();
    let document = parse(&html);
    for node in document.descendants().filter(|node| node.is_element()) {
        for attribute in node.attributes() {
            let (name, value) = (attribute.name(), attribute.value());
            assert!(!name.starts_with("on"), "{name}");
            assert!(!value.contains("://"), "{name}={value}");
            if name == "src" || name == "href" {
                assert!(
                    value.starts_with("data:") || value.starts_with('#'),
                    "{value}"
                );
            }
        }
    }
    let style = document
        .descendants()
        .find(|node| node.tag_name().name() == "style");
    let style = style.and_then(|node| node.text()).expect("a style sheet");
    assert!(!style.contains("url(") && !style.contains("@import"));
    for needed in [
        "prefers-color-scheme",
        "@media print",
        "color-scheme: light dark",
    ] {
        assert!(style.contains(needed), "{needed}");
    }
}

#[test]
fn pictures_come_back_byte_for_byte() {
    let html = page("plain").to_html();
    let document = parse(&html);
    let image = document
        .descendants()
        .find(|node| node.tag_name().name() == "img");
    let image = image.expect("a picture");
    assert_eq!(
        (image.attribute("width"), image.attribute("height")),
        (Some("3"), Some("2"))
    );
    let source = image.attribute("src").expect("a source");
    let data = source
        .strip_prefix("data:image/png;base64,")
        .expect("a data URI");
    assert_eq!(STANDARD.decode(data).expect("base64"), png());
}

#[test]
fn what_is_not_png_is_refused() {
    for bytes in [
        &b""[..],
        b"\x89PNG\r\n\x1a\n",
        b"GIF89a and then some more bytes",
    ] {
        let error = Image::png(bytes, "frame 3").unwrap_err();
        assert!(error.to_string().contains("frame 3"));
    }
}

#[test]
fn rows_are_filled_to_the_same_width() {
    let html = page("plain").to_html();
    let document = parse(&html);
    let rows = document
        .descendants()
        .filter(|node| node.tag_name().name() == "tr");
    let widths: Vec<_> = rows
        .map(|row| row.children().filter(|c| c.is_element()).count())
        .collect();
    assert_eq!(widths, [5, 5, 5]);
}

#[test]
fn contents_lead_to_every_section() {
    let html = page("plain").to_html();
    let document = parse(&html);
    let links: Vec<_> = document
        .descendants()
        .filter_map(|node| node.attribute("href"))
        .collect();
    assert_eq!(links.len(), 4);
    for link in links {
        let id = link.trim_start_matches('#');
        assert!(
            document
                .descendants()
                .any(|node| node.attribute("id") == Some(id))
        );
    }
    let short = Page::new("short").section(Section::new("only")).to_html();
    assert!(!short.contains("<nav"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_page_is_well_formed(text in any::<String>()) {
        let page = page(&text);
        let html = page.to_html();
        parse(&html);
        prop_assert_eq!(html, page.to_html());
    }
}
