//! Plots: what to draw, and the SVG it becomes.
//!
//! The input is never refused. Values that are not finite, or beyond 1e300, leave
//! gaps; a logarithmic axis leaves out what is not above 0 and says how many values
//! those were; a plot without anything to draw says so, with the caller's reason.

mod describe;
mod draw;
mod label;
mod layout;
mod marks;
mod number;
mod scale;
#[cfg(test)]
mod tests;
mod text;

use crate::palette::Role;

/// A plot of any number of series over common axes.
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    description: String,
    no_data: String,
    x: Axis,
    y: Axis,
    categories: Vec<String>,
    series: Vec<Series>,
    family: Option<Family>,
    width: f64,
    area_height: f64,
}

impl Plot {
    /// An empty plot. An empty title leaves no gap.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            description: String::new(),
            no_data: String::new(),
            x: Axis::new(""),
            y: Axis::new(""),
            categories: Vec::new(),
            series: Vec::new(),
            family: None,
            width: 460.0,
            area_height: 230.0,
        }
    }

    /// The horizontal axis.
    pub fn x(mut self, axis: Axis) -> Self {
        self.x = axis;
        self
    }

    /// The vertical axis.
    pub fn y(mut self, axis: Axis) -> Self {
        self.y = axis;
        self
    }

    /// Names for 0, 1, 2 and so on along the horizontal axis, for bars above all.
    pub fn categories<T: Into<String>>(mut self, names: impl IntoIterator<Item = T>) -> Self {
        self.categories = names.into_iter().map(Into::into).collect();
        self
    }

    /// Adds a series. Unless it has a [role](Series::role), the n-th series takes the n-th.
    pub fn series(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Draws a family of curves, below every series.
    pub fn family(mut self, family: Family) -> Self {
        self.family = Some(family);
        self
    }

    /// What the plot shows, for those who cannot see it; the ranges of the
    /// series are added.
    pub fn description(mut self, text: impl Into<String>) -> Self {
        self.description = text.into();
        self
    }

    /// Why there may be nothing to draw: shown in place of the data.
    pub fn no_data(mut self, reason: impl Into<String>) -> Self {
        self.no_data = reason.into();
        self
    }

    /// Width of the whole plot and height of the area that data is drawn in, in units
    /// of which a label is 13 high. At least 200 by 60, at most 4000 each; 460 by 230
    /// if never set. The height of the whole follows from titles and legend.
    pub fn size(mut self, width: f64, area_height: f64) -> Self {
        if width.is_finite() {
            self.width = width.clamp(200.0, 4000.0);
        }
        if area_height.is_finite() {
            self.area_height = area_height.clamp(60.0, 4000.0);
        }
        self
    }

    /// The plot as an `<svg>` element for a page: its text takes the page's font and
    /// colour, and its colours are custom properties with defaults for light paper.
    pub fn to_svg(&self) -> String {
        draw::svg(self, "")
    }

    /// The plot as a file of its own, for light and for dark surroundings.
    pub fn to_standalone_svg(&self) -> String {
        draw::svg(self, &draw::standalone_style())
    }
}

/// An axis: its label, its scale and what it has to cover.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    label: String,
    unit: String,
    log: bool,
    whole: bool,
    include: Vec<f64>,
    range: Option<(f64, f64)>,
}

impl Axis {
    /// A linear axis that covers the data.
    pub fn new(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            ..Self::default()
        }
    }

    /// The unit, shown behind the label in parentheses.
    pub fn unit(mut self, unit: impl Into<String>) -> Self {
        self.unit = unit.into();
        self
    }

    /// Makes the scale logarithmic. Values that are not above 0 are left out, and
    /// the plot says how many.
    pub fn log(mut self) -> Self {
        self.log = true;
        self
    }

    /// Ticks at whole numbers only, for counts and frame numbers.
    pub fn whole(mut self) -> Self {
        self.whole = true;
        self
    }

    /// Stretches the axis to `value`. Has no effect if the scale cannot hold it.
    pub fn include(mut self, value: f64) -> Self {
        self.include.push(value);
        self
    }

    /// Shows just this range; what is outside is cut off. Has no effect unless
    /// `from` is less than `to`, both are finite, and on a logarithmic axis above 0.
    pub fn range(mut self, from: f64, to: f64) -> Self {
        self.range = Some((from, to));
        self
    }

    fn text(&self) -> String {
        match (self.label.is_empty(), self.unit.is_empty()) {
            (_, true) => self.label.clone(),
            (true, false) => self.unit.clone(),
            (false, false) => format!("{} ({})", self.label, self.unit),
        }
    }
}

/// Points that belong together, with a name for the legend.
///
/// An empty name keeps a series out of the legend.
#[derive(Clone, Debug)]
pub struct Series {
    name: String,
    kind: Kind,
    points: Vec<(f64, f64)>,
    labels: Vec<String>,
    role: Option<Role>,
    dash: Dash,
}

impl Series {
    /// Points joined by straight lines in the order given. A point that stands alone
    /// between gaps is drawn as a dot.
    pub fn line(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self::new(name, Kind::Line, points.into_iter().collect())
    }

    /// Points on their own. Their shape follows the role, so that colour is not
    /// the only difference.
    pub fn dots(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self::new(name, Kind::Dots, points.into_iter().collect())
    }

    /// A line that keeps each value until the next point, then jumps.
    pub fn step(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self::new(name, Kind::Step, points.into_iter().collect())
    }

    /// A bar for each value, at 0, 1, 2 and so on along the horizontal axis (see
    /// [`Plot::categories`]). All series of bars in a plot stand side by side.
    pub fn bars(name: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        let values = values.into_iter().enumerate();
        let points = values.map(|(at, value)| (at as f64, value)).collect();
        Self::new(name, Kind::Bars, points)
    }

    /// Writes a text beside each dot, in the order of the points. A label that would
    /// cover dots or other labels wherever it stood is left out; the tooltips, which
    /// begin with it, remain. Has no effect on anything but dots, and none in a plot
    /// with so many of them that they have no tooltips either (over 300).
    pub fn labels<T: Into<String>>(mut self, labels: impl IntoIterator<Item = T>) -> Self {
        self.labels = labels.into_iter().map(Into::into).collect();
        self
    }

    /// Chooses the colour.
    pub fn role(mut self, role: Role) -> Self {
        self.role = Some(role);
        self
    }

    /// Chooses the stroke. Has no effect on dots and bars.
    pub fn dash(mut self, dash: Dash) -> Self {
        self.dash = dash;
        self
    }

    /// The points with their labels, which are empty where there is none.
    fn labelled(&self) -> impl Iterator<Item = ((f64, f64), &str)> {
        let labels = self.labels.iter().map(String::as_str);
        let labels = labels.chain(std::iter::repeat(""));
        self.points.iter().copied().zip(labels)
    }

    fn new(name: impl Into<String>, kind: Kind, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            kind,
            points,
            labels: Vec::new(),
            role: None,
            dash: Dash::Solid,
        }
    }
}

/// How a line is stroked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dash {
    /// Without gaps.
    #[default]
    Solid,
    /// In dashes.
    Dashed,
    /// In dots.
    Dotted,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Line,
    Dots,
    Step,
    Bars,
}

/// Curves that differ in one number, such as the frame, and take their colour
/// from it, with a colour key in place of a legend.
#[derive(Clone, Debug)]
pub struct Family {
    label: String,
    curves: Vec<(f64, Vec<(f64, f64)>)>,
}

impl Family {
    /// An empty family. The label says what the number is.
    pub fn new(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            curves: Vec::new(),
        }
    }

    /// Adds the curve of one value, drawn above those before. Curves whose value is
    /// not finite are drawn in the colour of the lowest.
    pub fn curve(mut self, value: f64, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        self.curves.push((value, points.into_iter().collect()));
        self
    }

    /// The least and the greatest finite value, `None` without any.
    fn extent(&self) -> Option<(f64, f64)> {
        scale::extent(self.curves.iter().map(|curve| curve.0))
    }
}
