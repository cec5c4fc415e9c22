//! Colours, by the part they play, for light and dark paper.
//!
//! Plots name custom properties (`--series-1` to `--series-8`, `--ramp-0` to
//! `--ramp-4`, `--muted`), so that the page decides what they look like.
//!
//! The series colours were found by search: every pair is at least 0.07 apart in
//! OKLab (Ottosson 2020) as seen with normal vision, protanopia, deuteranopia and
//! tritanopia (simulated as in Machado et al. 2009), the first
//! four at least 0.11, and every colour has a contrast of at least 3.2 to 1 with
//! its paper. The ramp is the two thirds of viridis (van der Walt & Smith 2015)
//! that stand out from the paper.

use std::fmt::{self, Display, Formatter, Write};

/// The part that a colour plays in a plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// First series: blue.
    S1,
    /// Second series: orange.
    S2,
    /// Third series: green.
    S3,
    /// Fourth series: purple.
    S4,
    /// Fifth series: sky blue.
    S5,
    /// Sixth series: ochre.
    S6,
    /// Seventh series: rose.
    S7,
    /// Eighth series: violet.
    S8,
    /// Context that should stand back: grey.
    Muted,
}

impl Role {
    /// The roles of series, in order.
    pub const SERIES: [Role; 8] = [
        Role::S1,
        Role::S2,
        Role::S3,
        Role::S4,
        Role::S5,
        Role::S6,
        Role::S7,
        Role::S8,
    ];

    /// The role of series `index`, counted from 0; the ninth begins again with the first.
    pub fn nth(index: usize) -> Self {
        Self::SERIES[index % Self::SERIES.len()]
    }

    fn color(self) -> &'static Themed {
        &COLORS[self as usize]
    }
}

/// What paints a mark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Paint {
    Role(Role),
    /// A place on the sequential ramp, from 0 to 1.
    Ramp(f64),
}

impl Paint {
    /// The attributes that paint `property` (`fill` or `stroke`).
    ///
    /// The colour stands there twice: as a CSS variable with a default for
    /// browsers, and as an attribute for viewers that know no variables.
    pub(crate) fn attributes(self, property: &str) -> String {
        match self {
            Paint::Role(role) => {
                let color = role.color();
                let (name, light) = (color.name, color.light);
                format!(r#"{property}="{light}" style="{property}:var(--{name},{light})""#)
            }
            Paint::Ramp(place) => {
                let scaled = place.clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
                let below = (scaled as usize).min(RAMP.len() - 2);
                let (a, b) = (&RAMP[below], &RAMP[below + 1]);
                let share = ((1.0 - (scaled - below as f64)) * 100.0).round();
                let light = b.light.mix(a.light, share / 100.0);
                format!(
                    r#"{property}="{light}" style="{property}:color-mix(in srgb,var(--{},{}) {share}%,var(--{},{}))""#,
                    a.name, a.light, b.name, b.light
                )
            }
        }
    }
}

/// Declarations of all custom properties for light paper.
pub(crate) fn light_properties() -> String {
    properties(|color| color.light)
}

/// Declarations of all custom properties for dark paper.
pub(crate) fn dark_properties() -> String {
    properties(|color| color.dark)
}

/// The ink and the paper of standalone plots and of pages.
pub(crate) const INK: Themed = themed("ink", 0x1b1f24, 0xe4e7eb);
pub(crate) const PAPER: Themed = themed("paper", 0xffffff, 0x14171b);

/// In the order of [`Role`].
const COLORS: [Themed; 9] = [
    themed("series-1", 0x2672c9, 0x5a9dff),
    themed("series-2", 0xae6307, 0xef792f),
    themed("series-3", 0x004b26, 0x9debca),
    themed("series-4", 0x8c2c77, 0xa46189),
    themed("series-5", 0x3095b7, 0x64c8fa),
    themed("series-6", 0xbb8500, 0xffd15b),
    themed("series-7", 0xd45a72, 0xea979d),
    themed("series-8", 0x8d80f0, 0x8163cf),
    themed("muted", 0x5e6873, 0x9aa4af),
];

/// From the lowest value to the highest.
const RAMP: [Themed; 5] = [
    themed("ramp-0", 0x440154, 0x31688e),
    themed("ramp-1", 0x443983, 0x21918c),
    themed("ramp-2", 0x31688e, 0x35b779),
    themed("ramp-3", 0x21918c, 0x90d743),
    themed("ramp-4", 0x35b779, 0xfde725),
];

/// A colour on light and on dark paper, and the custom property that carries it.
pub(crate) struct Themed {
    pub(crate) name: &'static str,
    pub(crate) light: Rgb,
    pub(crate) dark: Rgb,
}

/// 8 bits each for red, green and blue, from the highest.
#[derive(Clone, Copy)]
pub(crate) struct Rgb(u32);

impl Rgb {
    fn mix(self, other: Rgb, share: f64) -> Rgb {
        let channel = |shift: u32| {
            let (a, b) = (
                f64::from(self.0 >> shift & 255),
                f64::from(other.0 >> shift & 255),
            );
            ((a + (b - a) * share).round() as u32) << shift
        };
        Rgb(channel(16) | channel(8) | channel(0))
    }
}

impl Display for Rgb {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "#{:06x}", self.0)
    }
}

const fn themed(name: &'static str, light: u32, dark: u32) -> Themed {
    Themed {
        name,
        light: Rgb(light),
        dark: Rgb(dark),
    }
}

fn properties(color: impl Fn(&Themed) -> Rgb) -> String {
    let mut css = String::new();
    for themed in [&INK, &PAPER].into_iter().chain(&COLORS).chain(&RAMP) {
        // Writing to a string cannot fail.
        let _ = write!(css, "--{}:{};", themed.name, color(themed));
    }
    css
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance (WCAG 2.2).
    fn luminance(color: Rgb) -> f64 {
        let linear = |shift: u32| {
            let c = f64::from((color.0 >> shift) & 255) / 255.0;
            if c <= 0.04045 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        };
        0.2126 * linear(16) + 0.7152 * linear(8) + 0.0722 * linear(0)
    }

    fn contrast(a: Rgb, b: Rgb) -> f64 {
        let (a, b) = (luminance(a) + 0.05, luminance(b) + 0.05);
        a.max(b) / a.min(b)
    }

    #[test]
    fn colours_stand_out_from_their_paper() {
        let both = |color: &Themed| {
            let (light, dark) = (color.light, color.dark);
            contrast(light, PAPER.light).min(contrast(dark, PAPER.dark))
        };
        for role in Role::SERIES {
            assert!(both(role.color()) >= 3.2, "{role:?}");
        }
        // Text: the level AA of WCAG 2.2.
        assert!(both(&INK) >= 4.5 && both(Role::Muted.color()) >= 4.5);
        assert!(RAMP.iter().all(|color| both(color) >= 2.4));
    }

    #[test]
    fn the_ramp_passes_through_its_colours() {
        for (at, color) in RAMP.iter().enumerate() {
            let paint = Paint::Ramp(at as f64 / 4.0).attributes("fill");
            assert!(
                paint.starts_with(&format!("fill=\"{}\"", color.light)),
                "{paint}"
            );
        }
    }
}
