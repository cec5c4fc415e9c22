//! Writes a plot as SVG.

use std::fmt::Write;

use super::label::{self, Dot};
use super::layout::{self, Key, Layout, Line, SAMPLE, SLOPE, Style, TICK};
use super::marks::{self, Num};
use super::scale::Scale;
use super::{Dash, Kind, Plot, Series, describe, number, text};
use crate::escape::Escaped;
use crate::palette::{self, INK, PAPER, Paint, Role};

/// Dots of a plot that have tooltips and labels: more would be most of the file.
const MAX_TOOLTIPS: usize = 300;

/// The plot as an `<svg>` element that holds `style` after its description.
pub(super) fn svg(plot: &Plot, style: &str) -> String {
    let layout = Layout::new(plot);
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = draw(plot, &layout, style, &mut out);
    out
}

/// The style of a plot that stands alone, with both sets of colours.
pub(super) fn standalone_style() -> String {
    let (light, dark) = (palette::light_properties(), palette::dark_properties());
    format!(
        "<style>svg{{{light}color:var(--ink);background:var(--paper);\
         font-family:system-ui,sans-serif}}\
         @media screen and (prefers-color-scheme:dark){{svg{{{dark}}}}}</style>"
    )
}

fn draw(plot: &Plot, layout: &Layout, style: &str, out: &mut String) -> std::fmt::Result {
    // On a page, the page has margins.
    let margin = if style.is_empty() { 0.0 } else { 14.0 };
    write!(
        out,
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="{} {} {} {}" role="img""#,
        Num(-margin),
        Num(-margin),
        Num(layout.width + 2.0 * margin),
        Num(layout.height + 2.0 * margin)
    )?;
    if !style.is_empty() {
        // For viewers without CSS variables.
        write!(out, r#" color="{}" font-family="sans-serif""#, INK.light)?;
    }
    write!(out, ">")?;
    write!(out, "<title>{}</title>", Escaped(describe::title(plot)))?;
    write!(
        out,
        "<desc>{}</desc>{style}",
        Escaped(&describe::description(plot))
    )?;
    match layout.scales {
        Some((x, y)) => {
            let view = View { plot, layout, x, y };
            view.frame(out)?;
            view.family(out)?;
            view.bars(out)?;
            for (index, series) in plot.series.iter().enumerate() {
                view.series(series, role(series, index), out)?;
            }
            view.labels(out)?;
            view.legend(out)?;
        }
        None => no_data(plot, layout, out)?,
    }
    write!(out, r#"<g fill="currentColor">"#)?;
    for line in &layout.lines {
        text_line(line, out)?;
    }
    if let Some(key) = &layout.key {
        color_key(key, out)?;
    }
    write!(out, "</g></svg>")
}

/// What the drawing steps share.
struct View<'a> {
    plot: &'a Plot,
    layout: &'a Layout,
    x: Scale,
    y: Scale,
}

impl View<'_> {
    /// Grid, base line and tick labels.
    fn frame(&self, out: &mut String) -> std::fmt::Result {
        let area = self.layout.area;
        let (left, right) = (Num(area.left), Num(area.right));
        write!(
            out,
            r#"<rect class="area" x="{left}" y="{}" width="{}" height="{}" fill="none"/>"#,
            Num(area.top),
            Num(area.right - area.left),
            Num(area.bottom - area.top)
        )?;
        let categorical = !self.plot.categories.is_empty();
        let mut grid = String::new();
        for tick in &self.layout.y_ticks {
            write!(grid, "M{left},{}H{right}", Num(self.at_y(tick.value)))?;
        }
        for tick in self.layout.x_ticks.iter().filter(|_| !categorical) {
            let (top, bottom) = (Num(area.top), Num(area.bottom));
            write!(grid, "M{},{top}V{bottom}", Num(self.at_x(tick.value)))?;
        }
        write!(
            out,
            r#"<path d="{grid}" fill="none" stroke="currentColor" stroke-opacity=".14"/>"#
        )?;
        let base = Num(self.at_y(self.y.base()));
        write!(
            out,
            r#"<path d="M{left},{base}H{right}" fill="none" stroke="currentColor" stroke-opacity=".6"/>"#
        )?;
        self.tick_labels(out)
    }

    fn tick_labels(&self, out: &mut String) -> std::fmt::Result {
        let area = self.layout.area;
        let edge = Num(area.left - 8.0);
        write!(
            out,
            r#"<g class="y-ticks" fill="currentColor" font-size="{TICK}" text-anchor="end">"#
        )?;
        for tick in &self.layout.y_ticks {
            let (y, label) = (
                Num(self.at_y(tick.value) + TICK * 0.35),
                Escaped(&tick.label),
            );
            write!(out, r#"<text x="{edge}" y="{y}">{label}</text>"#)?;
        }
        let anchor = if self.layout.sloped { "end" } else { "middle" };
        write!(
            out,
            r#"</g><g class="x-ticks" fill="currentColor" font-size="{TICK}" text-anchor="{anchor}">"#
        )?;
        for tick in &self.layout.x_ticks {
            let (x, y) = (Num(self.at_x(tick.value)), area.bottom + TICK + 5.0);
            if self.layout.sloped {
                let (y, label) = (Num(y - 3.0), Escaped(&tick.label));
                write!(
                    out,
                    r#"<text transform="translate({x} {y}) rotate(-{SLOPE})">{label}</text>"#
                )?;
                continue;
            }
            for (at, line) in self.layout.tick_lines(self.plot, tick).iter().enumerate() {
                let (y, line) = (Num(y + at as f64 * TICK * 1.25), Escaped(line));
                write!(out, r#"<text x="{x}" y="{y}">{line}</text>"#)?;
            }
        }
        write!(out, "</g>")
    }

    fn family(&self, out: &mut String) -> std::fmt::Result {
        let Some(family) = &self.plot.family else {
            return Ok(());
        };
        let (lo, hi) = family.extent().unwrap_or((0.0, 0.0));
        write!(
            out,
            r#"<g class="family" fill="none" stroke-width="1.1" stroke-linejoin="round">"#
        )?;
        for (value, points) in &family.curves {
            let share = (value - lo) / (hi - lo);
            let paint = Paint::Ramp(if share.is_finite() { share } else { 0.0 });
            let places = self.places(points);
            let path = marks::polyline(&places, self.layout.area);
            if !path.is_empty() {
                write!(out, r#"<path {} d="{path}"/>"#, paint.attributes("stroke"))?;
            }
            for point in self.visible(marks::lone_points(&places)) {
                let (x, y, fill) = (Num(point.0), Num(point.1), paint.attributes("fill"));
                write!(out, r#"<circle cx="{x}" cy="{y}" r="2" {fill}/>"#)?;
            }
        }
        write!(out, "</g>")
    }

    /// All bars: they share out the place of a category.
    fn bars(&self, out: &mut String) -> std::fmt::Result {
        let all = self.plot.series.iter().enumerate();
        let groups: Vec<_> = all
            .filter(|(_, series)| series.kind == Kind::Bars)
            .collect();
        let slot = self.at_x(1.0) - self.at_x(0.0);
        let bar = slot * 0.78 / groups.len().max(1) as f64;
        let base = self.at_y(self.y.base());
        let area = self.layout.area;
        for (place, (index, series)) in groups.iter().enumerate() {
            let fill = Paint::Role(role(series, *index)).attributes("fill");
            write!(out, r#"<g class="bars" {fill}>"#)?;
            for &(at, value) in &series.points {
                let Some((center, end)) = self.place((at, value)) else {
                    continue;
                };
                let end = end.clamp(area.top, area.bottom);
                let left = center - slot * 0.39 + bar * place as f64;
                // A sliver of paper between neighbours, and never a bar of no width.
                let width = (bar - 1.0).max(bar * 0.5);
                let (top, height) = (end.min(base), (end - base).abs());
                let category = self.plot.categories.get(at as usize);
                let parts = [series.name.as_str(), category.map_or("", String::as_str)];
                write!(
                    out,
                    r#"<rect x="{}" y="{}" width="{}" height="{}">{}</rect>"#,
                    Num(left),
                    Num(top),
                    Num(width),
                    Num(height),
                    tooltip(parts, &number::short(value))
                )?;
            }
            write!(out, "</g>")?;
        }
        Ok(())
    }

    fn series(&self, series: &Series, role: Role, out: &mut String) -> std::fmt::Result {
        if series.kind == Kind::Dots {
            return self.dots(series, role, out);
        }
        let Some(corners) = self.corners(series) else {
            return Ok(());
        };
        let paint = Paint::Role(role);
        let path = marks::polyline(&corners, self.layout.area);
        if !path.is_empty() {
            write!(
                out,
                r#"<path class="line" {} {} d="{path}"/>"#,
                paint.attributes("stroke"),
                stroke(series.dash)
            )?;
        }
        let places = self.places(&series.points);
        let mut lone = self.visible(marks::lone_points(&places)).peekable();
        if lone.peek().is_some() {
            write!(out, r#"<g class="dots" {}>"#, paint.attributes("fill"))?;
            for (x, y) in lone {
                write!(out, r#"<circle cx="{}" cy="{}" r="2.6"/>"#, Num(x), Num(y))?;
            }
            write!(out, "</g>")?;
        }
        Ok(())
    }

    fn dots(&self, series: &Series, role: Role, out: &mut String) -> std::fmt::Result {
        let tooltips = self.has_tooltips();
        write!(out, r#"<g class="dots" {}>"#, marker_paint(role))?;
        for ((x, y), label) in series.labelled() {
            let Some(place) = self.visible_place((x, y)) else {
                continue;
            };
            let values = format!("{}, {}", number::short(x), number::short(y));
            let tooltip = tooltips.then(|| tooltip([label, series.name.as_str()], &values));
            write!(
                out,
                "{}",
                marks::marker(role, place, &tooltip.unwrap_or_default())
            )?;
        }
        write!(out, "</g>")
    }

    /// The labels of all dots, above everything that is drawn, on a rim of paper.
    fn labels(&self, out: &mut String) -> std::fmt::Result {
        let series = || self.plot.series.iter();
        if !self.has_tooltips() || series().all(|series| series.labels.is_empty()) {
            return Ok(());
        }
        let dots = series().filter(|series| series.kind == Kind::Dots);
        let dots = dots.flat_map(Series::labelled);
        let dot = |(point, text)| Some((self.visible_place(point)?, text));
        let dots: Vec<_> = (dots.filter_map(dot))
            .map(|(at, text)| Dot { at, text })
            .collect();
        let lines = series().filter_map(|series| self.corners(series));
        let labels = label::place(&dots, &lines.collect::<Vec<_>>(), self.layout.area);
        let (name, light) = (PAPER.name, PAPER.light);
        write!(
            out,
            r#"<g class="labels" fill="currentColor" font-size="{TICK}" stroke="{light}" stroke-width="3" stroke-linejoin="round" paint-order="stroke" style="stroke:var(--{name},{light})" pointer-events="none">"#
        )?;
        for (dot, label) in dots.iter().zip(labels) {
            let Some(label) = label else { continue };
            let (x, y, text) = (Num(label.x), Num(label.y), Escaped(dot.text));
            let anchor = label.anchor.name();
            write!(
                out,
                r#"<text x="{x}" y="{y}" text-anchor="{anchor}">{text}</text>"#
            )?;
        }
        write!(out, "</g>")
    }

    fn has_tooltips(&self) -> bool {
        let dots = self.plot.series.iter();
        let dots = dots.filter(|series| series.kind == Kind::Dots);
        dots.map(|series| series.points.len()).sum::<usize>() <= MAX_TOOLTIPS
    }

    fn legend(&self, out: &mut String) -> std::fmt::Result {
        write!(out, r#"<g class="legend">"#)?;
        for (index, line) in &self.layout.legend {
            let series = &self.plot.series[*index];
            let role = role(series, *index);
            let (x, y) = (line.x, line.y - 4.5);
            let paint = |property| Paint::Role(role).attributes(property);
            match series.kind {
                Kind::Line | Kind::Step => write!(
                    out,
                    r#"<path {} {} d="M{},{}h{SAMPLE}"/>"#,
                    paint("stroke"),
                    stroke(series.dash),
                    Num(x),
                    Num(y)
                )?,
                Kind::Dots => write!(
                    out,
                    "<g {}>{}</g>",
                    marker_paint(role),
                    marks::marker(role, (x + SAMPLE / 2.0, y), "")
                )?,
                Kind::Bars => write!(
                    out,
                    r#"<rect x="{}" y="{}" width="14" height="10" {}/>"#,
                    Num(x + 4.0),
                    Num(y - 5.0),
                    paint("fill")
                )?,
            }
            let (at, y, name) = (Num(x + SAMPLE + 6.0), Num(line.y), Escaped(&line.text));
            let size = layout::LABEL;
            write!(
                out,
                r#"<text x="{at}" y="{y}" font-size="{size}" fill="currentColor">{name}"#
            )?;
            if line.text != series.name {
                write!(out, "<title>{}</title>", Escaped(&series.name))?;
            }
            write!(out, "</text>")?;
        }
        write!(out, "</g>")
    }

    /// The corners of a line, `None` for what is not one.
    fn corners(&self, series: &Series) -> Option<Vec<Option<(f64, f64)>>> {
        let places = self.places(&series.points);
        match series.kind {
            Kind::Line => Some(places),
            Kind::Step => Some(marks::steps(&places)),
            Kind::Dots | Kind::Bars => None,
        }
    }

    fn places(&self, points: &[(f64, f64)]) -> Vec<Option<(f64, f64)>> {
        points.iter().map(|&point| self.place(point)).collect()
    }

    /// Where a point stands, `None` if it cannot be drawn; perhaps outside the area.
    fn place(&self, (x, y): (f64, f64)) -> Option<(f64, f64)> {
        let area = self.layout.area;
        let (x, y) = (self.x.place(x)?, self.y.place(y)?);
        let across = area.left + (area.right - area.left) * x;
        Some((across, area.bottom - (area.bottom - area.top) * y))
    }

    /// Where a point stands in the area, `None` if it is not seen.
    fn visible_place(&self, point: (f64, f64)) -> Option<(f64, f64)> {
        let area = self.layout.area;
        self.place(point)
            .filter(|&place| marks::is_inside(place, area))
    }

    fn at_x(&self, value: f64) -> f64 {
        self.place((value, self.y.lo))
            .map_or(self.layout.area.left, |place| place.0)
    }

    fn at_y(&self, value: f64) -> f64 {
        self.place((self.x.lo, value))
            .map_or(self.layout.area.bottom, |place| place.1)
    }

    fn visible(
        &self,
        points: impl Iterator<Item = (f64, f64)>,
    ) -> impl Iterator<Item = (f64, f64)> {
        points.filter(|&point| marks::is_inside(point, self.layout.area))
    }
}

fn role(series: &Series, index: usize) -> Role {
    series.role.unwrap_or_else(|| Role::nth(index))
}

fn marker_paint(role: Role) -> String {
    let paint = Paint::Role(role);
    if marks::is_outline(role) {
        format!(
            r#"fill="none" stroke-width="1.7" {}"#,
            paint.attributes("stroke")
        )
    } else {
        paint.attributes("fill")
    }
}

fn stroke(dash: Dash) -> &'static str {
    match dash {
        Dash::Solid => r#"fill="none" stroke-width="2" stroke-linejoin="round""#,
        Dash::Dashed => r#"fill="none" stroke-width="2" stroke-dasharray="7 4""#,
        Dash::Dotted => {
            r#"fill="none" stroke-width="2.4" stroke-linecap="round" stroke-dasharray="0.1 4.5""#
        }
    }
}

fn tooltip(parts: [&str; 2], values: &str) -> String {
    let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    let separator = if parts.is_empty() { "" } else { ": " };
    let text = format!("{}{separator}{values}", parts.join(", "));
    format!("<title>{}</title>", Escaped(&text))
}

fn text_line(line: &Line, out: &mut String) -> std::fmt::Result {
    let (size, extra) = match line.style {
        Style::Title => (layout::TITLE, r#" font-weight="600""#),
        Style::Label => (layout::LABEL, ""),
        Style::XLabel => (layout::LABEL, r#" text-anchor="middle""#),
        Style::Note => (TICK, r#" font-style="italic""#),
    };
    let (x, y, text) = (Num(line.x), Num(line.y), Escaped(&line.text));
    write!(
        out,
        r#"<text x="{x}" y="{y}" font-size="{size}"{extra}>{text}</text>"#
    )
}

/// The bar of the colour key, in pieces: a gradient would need an identifier, and those
/// of two plots on a page must differ.
fn color_key(key: &Key, out: &mut String) -> std::fmt::Result {
    const PIECES: usize = 24;
    let width = (key.right - key.left) / PIECES as f64;
    write!(out, r#"<g class="key" shape-rendering="crispEdges">"#)?;
    for piece in 0..PIECES {
        let paint = Paint::Ramp(piece as f64 / (PIECES - 1) as f64);
        write!(
            out,
            r#"<rect x="{}" y="{}" width="{}" height="{}" {}/>"#,
            Num(key.left + width * piece as f64),
            Num(key.top),
            // Overlap, so that no seam of paper shines through.
            Num(width + 0.4),
            Key::HEIGHT,
            paint.attributes("fill")
        )?;
    }
    write!(out, "</g>")
}

fn no_data(plot: &Plot, layout: &Layout, out: &mut String) -> std::fmt::Result {
    let area = layout.area;
    let (width, height) = (area.right - area.left, area.bottom - area.top);
    write!(
        out,
        r#"<rect x="{}" y="{}" width="{}" height="{}" rx="4" fill="none" stroke="currentColor" stroke-opacity=".35" stroke-dasharray="4 4"/>"#,
        Num(area.left),
        Num(area.top),
        Num(width),
        Num(height)
    )?;
    let reason = text::wrap(&describe::reason(plot), layout::LABEL, width - 40.0, 3);
    let center = Num((area.left + area.right) / 2.0);
    let top = (area.top + area.bottom) / 2.0 - 10.0 * reason.len() as f64 + 4.0;
    write!(
        out,
        r#"<g class="no-data" fill="currentColor" text-anchor="middle"><text x="{center}" y="{}" font-size="{}" font-weight="600">No data</text>"#,
        Num(top),
        layout::TITLE
    )?;
    for (at, line) in reason.iter().enumerate() {
        let (y, size) = (Num(top + 20.0 + 18.0 * at as f64), layout::LABEL);
        let line = Escaped(line);
        write!(
            out,
            r#"<text x="{center}" y="{y}" font-size="{size}">{line}</text>"#
        )?;
    }
    write!(out, "</g>")
}
