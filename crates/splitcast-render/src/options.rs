//! What to render and how well: the options, their presets, and their bounds.

use std::fmt;
use std::str::FromStr;

use crate::RenderError;
use crate::shade::Detail;

/// Longest side of a picture: what AV1 and most picture formats can hold.
pub const MAX_SIDE: u32 = 65_535;

/// Most pixels of a picture, 8192 x 8192: 3 GB while it is rendered.
pub const MAX_PIXELS: u64 = 1 << 26;

/// Most samples in a pixel: the sampler numbers 2³² points, 2¹⁶ of them for
/// the pixels of a block.
pub const MAX_SAMPLES_PER_PIXEL: u32 = 1 << 16;

/// Coordinates beyond this cannot be traced in single precision.
const MAX_COORDINATE: f32 = 1e12;

/// Gives an enum of names `ALL`, `name`, `Display` and `FromStr`.
macro_rules! named {
    ($type:ident, $kind:literal, $($variant:ident => $name:literal),+ $(,)?) => {
        impl $type {
            /// Every one of them, in the order of their declaration.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// The name used on command lines.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name),+
                }
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }

        impl FromStr for $type {
            type Err = RenderError;

            fn from_str(name: &str) -> Result<Self, Self::Err> {
                Self::ALL
                    .iter()
                    .copied()
                    .find(|value| value.name() == name)
                    .ok_or_else(|| RenderError::UnknownName {
                        kind: $kind,
                        name: name.into(),
                        expected: [$($name),+].join(", "),
                    })
            }
        }
    };
}

/// How much light is traced for a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Quality {
    /// One sample, in the middle of the pixel, and one ray from there to the
    /// middle of the sun: shadows are hard, and sky and ground light every
    /// surface as if nothing stood between. No noise; edges show their pixels
    /// unless more samples are asked for. For playing a motion at its own speed.
    Preview,
    /// Up to 4 samples a pixel; light that surfaces pass on to each other is a
    /// constant. For looking at a motion.
    Draft,
    /// Up to 16 samples a pixel, one bounce between surfaces and ground. For videos.
    #[default]
    Good,
    /// Up to 64 samples a pixel, two bounces. For stills.
    Best,
}

named!(Quality, "quality", Preview => "preview", Draft => "draft", Good => "good", Best => "best");

impl Quality {
    /// Samples per pixel, unless the options say otherwise.
    pub fn samples_per_pixel(self) -> u32 {
        match self {
            Self::Preview => 1,
            Self::Draft => 4,
            Self::Good => 16,
            Self::Best => 64,
        }
    }

    /// How closely light is looked at.
    pub(crate) fn detail(self) -> Detail {
        match self {
            Self::Preview => Detail::Sun,
            Self::Draft => Detail::Bounces(0),
            Self::Good => Detail::Bounces(1),
            Self::Best => Detail::Bounces(2),
        }
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum View {
    /// The mesh in sun and sky light.
    #[default]
    Beauty,
    /// Nodes of the tree that each pixel's rays visit, as a heat map.
    Steps,
    /// Depth of the leaf that holds the visible point.
    LeafDepth,
    /// The planes of the tree's top levels, drawn where they cut the surface.
    SplitPlanes,
    /// Shading normals as colours: x, y, z from -1 to 1 are red, green, blue.
    Normals,
}

named!(
    View, "view",
    Beauty => "beauty",
    Steps => "steps",
    LeafDepth => "leaf-depth",
    SplitPlanes => "split-planes",
    Normals => "normals",
);

/// How normals run across a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Shading {
    /// Interpolated between vertices: from the frame if it has normals,
    /// otherwise averaged over the triangles around each vertex.
    #[default]
    Smooth,
    /// One normal a triangle: shows the facets.
    Flat,
}

named!(Shading, "shading", Smooth => "smooth", Flat => "flat");

/// Everything about a picture but the mesh and the camera. Start from the
/// default and change what matters:
///
/// ```
/// use splitcast_render::{Quality, RenderOptions};
/// let options = RenderOptions {
///     width: 480,
///     height: 270,
///     quality: Quality::Draft,
///     ..RenderOptions::default()
/// };
/// assert!(options.validate().is_ok());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Pixels in a row, 1 to [`MAX_SIDE`].
    pub width: u32,
    /// Rows, 1 to [`MAX_SIDE`].
    pub height: u32,
    /// Samples per pixel, 1 to [`MAX_SAMPLES_PER_PIXEL`]; powers of two are
    /// spread best. Where a quarter of them, and at least 4, show no
    /// difference, the rest is saved. `None` leaves the number to `quality`.
    pub samples_per_pixel: Option<u32>,
    /// How much light is traced.
    pub quality: Quality,
    /// What the picture shows.
    pub view: View,
    /// Smooth or faceted surfaces.
    pub shading: Shading,
    /// Whether a ground lies at the lowest point of the motion.
    pub ground: bool,
    /// Where the sky is; of any length but zero.
    pub up: [f32; 3],
    /// The direction towards the sun, of any length but zero, above the
    /// horizon. `None` stands for a sun that suits the default camera.
    pub sun: Option<[f32; 3]>,
    /// Brightness in photographic stops: every step doubles it. -16 to 16.
    pub exposure: f32,
    /// Split planes are drawn down to this many levels of the tree, 1 to 32.
    pub split_levels: u32,
    /// Nodes visited by a ray that the hottest colour of [`View::Steps`]
    /// stands for, at least 1. The same for all frames, so that frames and
    /// builders can be compared.
    pub steps_scale: u32,
    /// Changes the noise and nothing else. Keep it the same for the frames of
    /// an animation: noise that stands still is seen less and compresses better.
    pub seed: u32,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            width: 960,
            height: 540,
            samples_per_pixel: None,
            quality: Quality::default(),
            view: View::default(),
            shading: Shading::default(),
            ground: true,
            up: [0.0, 1.0, 0.0],
            sun: None,
            exposure: 0.0,
            split_levels: 8,
            steps_scale: 60,
            seed: 0,
        }
    }
}

impl RenderOptions {
    /// Checks every field against its bounds.
    ///
    /// # Errors
    /// [`RenderError`] names the first field that is out of bounds.
    pub fn validate(&self) -> Result<(), RenderError> {
        let &Self { width, height, .. } = self;
        let side = 1..=MAX_SIDE;
        if !side.contains(&width) || !side.contains(&height) {
            return Err(RenderError::ImageSize { width, height });
        }
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(RenderError::TooManyPixels { width, height });
        }
        let samples = self.effective_samples_per_pixel();
        if !(1..=MAX_SAMPLES_PER_PIXEL).contains(&samples) {
            return Err(RenderError::SamplesPerPixel { value: samples });
        }
        check_direction("up", self.up)?;
        if let Some(sun) = self.sun {
            check_direction("sun", sun)?;
        }
        check_range("exposure", self.exposure, -16.0..=16.0, "-16 to 16 stops")?;
        check_range(
            "split levels",
            self.split_levels as f32,
            1.0..=32.0,
            "1 to 32",
        )?;
        check_range(
            "steps scale",
            self.steps_scale as f32,
            1.0..=f32::MAX,
            "1 or more",
        )
    }

    /// The samples per pixel asked for, or those of the quality.
    pub fn effective_samples_per_pixel(&self) -> u32 {
        self.samples_per_pixel
            .unwrap_or(self.quality.samples_per_pixel())
    }
}

/// Refuses coordinates that cannot be traced.
pub(crate) fn check_coordinates(field: &'static str, value: [f32; 3]) -> Result<(), RenderError> {
    if value.iter().all(|x| x.abs() <= MAX_COORDINATE) {
        Ok(())
    } else {
        Err(RenderError::Coordinates { field, value })
    }
}

/// Refuses directions without a length.
pub(crate) fn check_direction(field: &'static str, value: [f32; 3]) -> Result<(), RenderError> {
    check_coordinates(field, value)?;
    if value == [0.0; 3] {
        return Err(RenderError::ZeroDirection { field });
    }
    Ok(())
}

/// Refuses numbers out of range, NaN among them.
pub(crate) fn check_range(
    field: &'static str,
    value: f32,
    range: std::ops::RangeInclusive<f32>,
    expected: &'static str,
) -> Result<(), RenderError> {
    if range.contains(&value) {
        Ok(())
    } else {
        Err(RenderError::OutOfRange {
            field,
            value,
            expected,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_out_of_bounds_is_named() {
        type Case = (fn(&mut RenderOptions), &'static str);
        let cases: [Case; 14] = [
            (|o| o.width = 0, "image size is 0x540"),
            (|o| o.height = 0, "image size is 960x0"),
            (|o| o.width = 65_536, "image size is 65536x540"),
            (
                |o| (o.width, o.height) = (60_000, 60_000),
                "3600 million pixels",
            ),
            (|o| o.samples_per_pixel = Some(0), "samples per pixel is 0"),
            (
                |o| o.samples_per_pixel = Some(65_537),
                "samples per pixel is 65537",
            ),
            (|o| o.up = [0.0; 3], "up is (0, 0, 0)"),
            (|o| o.up = [f32::NAN, 1.0, 0.0], "up is (NaN, 1, 0)"),
            (|o| o.sun = Some([0.0; 3]), "sun is (0, 0, 0)"),
            (
                |o| o.sun = Some([f32::INFINITY; 3]),
                "sun is (inf, inf, inf)",
            ),
            (|o| o.exposure = f32::NAN, "exposure is NaN"),
            (|o| o.exposure = 40.0, "exposure is 40"),
            (|o| o.split_levels = 0, "split levels is 0"),
            (|o| o.steps_scale = 0, "steps scale is 0"),
        ];
        for (change, expected) in cases {
            let mut options = RenderOptions::default();
            change(&mut options);
            let message = options.validate().unwrap_err().to_string();
            assert!(
                message.starts_with(expected) || message.contains(expected),
                "{message}"
            );
            assert!(!message.contains('\n'));
        }
        assert_eq!(RenderOptions::default().validate(), Ok(()));
    }

    #[test]
    fn names_are_read_back_and_unknown_ones_listed() {
        for &view in View::ALL {
            assert_eq!(view.to_string().parse(), Ok(view));
        }
        for &quality in Quality::ALL {
            assert_eq!(quality.to_string().parse(), Ok(quality));
        }
        for &shading in Shading::ALL {
            assert_eq!(shading.to_string().parse(), Ok(shading));
        }
        let message = "ultra".parse::<Quality>().unwrap_err().to_string();
        assert_eq!(
            message,
            "no quality is called 'ultra', expected one of: preview, draft, good, best"
        );
    }
}
