//! From light to display: a film-like curve, then the sRGB transfer curve,
//! then bytes.
//!
//! The curve is Stephen Hill's fit of the ACES reference rendering and
//! output transforms for sRGB displays (published with "Baking Lab", Pettineo
//! & Hill 2016): a matrix into a space in which bright colours pale as they do on
//! film, a rational curve with toe and shoulder on each channel, and a matrix
//! back. It has neither logarithms nor powers, so its values are the same on
//! every platform.

use fearless_simd::{Simd, f32x8};
use glam::Vec3;
use rayon::prelude::*;
use splitcast::{Kernel, dispatch};

use crate::lanes::{LANES, Lanes, Vector};
use crate::{Image, srgb};

/// sRGB primaries to those of the curve, with the desaturation of the
/// reference rendering transform; the rows of the matrix.
const TO_CURVE: [Vec3; 3] = [
    Vec3::new(0.597_19, 0.354_58, 0.048_23),
    Vec3::new(0.076_00, 0.908_34, 0.015_66),
    Vec3::new(0.028_40, 0.133_83, 0.837_77),
];

/// The way back, with the output transform's desaturation.
const FROM_CURVE: [Vec3; 3] = [
    Vec3::new(1.604_75, -0.531_08, -0.073_67),
    Vec3::new(-0.102_08, 1.108_13, -0.006_05),
    Vec3::new(-0.003_27, -0.072_76, 1.076_02),
];

/// Brings diffuse white in full light to 0.8 on the display, which leaves the
/// shoulder for highlights; the fit alone is made for darker scenes.
const EXPOSURE: f32 = 1.6;

/// Above this the curve is flat in single precision; keeps its square finite.
const BRIGHTEST: f32 = 1e6;

/// Pixels that one task converts, at least.
const CHUNK: usize = 1 << 14;

/// How the values of an [`Image`] are brought to a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ToneCurve {
    /// Values are light in a scene of any brightness: contrast and highlights
    /// as on film.
    #[default]
    Filmic,
    /// Values are colours to be shown exactly, such as those of a heat map;
    /// values outside 0 to 1 are clipped.
    Exact,
}

impl ToneCurve {
    /// The display's linear light, 0 to 1, for a pixel's value. NaN and
    /// negative values count as 0.
    pub fn apply(self, pixel: [f32; 3]) -> [f32; 3] {
        Vec3::from(self.apply_lanes(Vector::from(Vec3::from(pixel)))).into()
    }

    /// [`ToneCurve::apply`] for many pixels.
    #[inline(always)]
    fn apply_lanes<L: Lanes>(self, pixel: Vector<L>) -> Vector<L> {
        let Vector { x, y, z } = pixel;
        let pixel = Vector {
            x: bounded(x),
            y: bounded(y),
            z: bounded(z),
        };
        let Vector { x, y, z } = match self {
            Self::Filmic => {
                let Vector { x, y, z } = transformed(&TO_CURVE, pixel * x.splat(EXPOSURE));
                let curved = Vector {
                    x: film(x),
                    y: film(y),
                    z: film(z),
                };
                transformed(&FROM_CURVE, curved)
            }
            Self::Exact => pixel,
        };
        Vector {
            x: x.within(0.0, 1.0),
            y: y.within(0.0, 1.0),
            z: z.within(0.0, 1.0),
        }
    }

    /// The bytes of pixels at columns `x` and rows `y`.
    #[inline(always)]
    pub(crate) fn shown<S: Simd>(
        self,
        light: Vector<f32x8<S>>,
        x: &[u32; LANES],
        y: &[u32; LANES],
    ) -> [[u8; 3]; LANES] {
        let mut thresholds = [0.5; LANES];
        if self == Self::Filmic {
            for lane in 0..LANES {
                thresholds[lane] = dither(x[lane], y[lane]);
            }
        }
        let rows = self.apply_lanes(light).rows();
        let mut bytes = [[0; 3]; LANES];
        let tables = srgb::tables();
        for lane in 0..LANES {
            for channel in 0..3 {
                bytes[lane][channel] = tables.encode(rows[channel][lane], thresholds[lane]);
            }
        }
        bytes
    }
}

/// The image as 8-bit sRGB: `3 * width * height` bytes, red first, in the
/// order of its pixels. Values of [`ToneCurve::Filmic`] that lie between two
/// bytes become one or the other in a fine pattern, the same for every picture,
/// so that soft gradients show no bands. Runs on the current rayon thread pool.
#[must_use]
pub fn to_srgb8(image: &Image) -> Vec<u8> {
    let width = image.width.max(1) as usize;
    let mut bytes = vec![[0; 3]; image.pixels.len()];
    let rows = bytes.par_chunks_mut(width);
    rows.zip(image.pixels.par_chunks(width))
        .with_min_len(CHUNK.div_ceil(width))
        .enumerate()
        .for_each(|(y, (bytes, pixels))| {
            dispatch(Row {
                curve: image.tone_curve,
                y,
                pixels,
                bytes,
            });
        });
    bytes.into_flattened()
}

/// Brings a row of pixels to the display.
struct Row<'i> {
    curve: ToneCurve,
    y: usize,
    pixels: &'i [[f32; 3]],
    bytes: &'i mut [[u8; 3]],
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let y = [self.y as u32; LANES];
        let octets = self.bytes.chunks_mut(LANES);
        for (octet, (bytes, pixels)) in octets.zip(self.pixels.chunks(LANES)).enumerate() {
            let mut light = [[0.0; LANES]; 3];
            for (lane, pixel) in pixels.iter().enumerate() {
                for channel in 0..3 {
                    light[channel][lane] = pixel[channel];
                }
            }
            let mut x = [0; LANES];
            for lane in 0..LANES {
                x[lane] = (octet * LANES + lane) as u32;
            }
            let shown = self.curve.shown(Vector::load(simd, &light), &x, &y);
            bytes.copy_from_slice(&shown[..bytes.len()]);
        }
    }
}

/// A threshold between 0 and 1 for a pixel, evenly spread among its
/// neighbours: interleaved gradient noise (Jimenez 2014, "Next generation post
/// processing in Call of Duty: Advanced Warfare").
#[inline(always)]
fn dither(x: u32, y: u32) -> f32 {
    // Sides of pictures fit, and a machine converts from these in one step.
    let [x, y] = [x, y].map(|side| f64::from(side as i32));
    let gradient = 0.067_110_56 * x + 0.005_837_15 * y;
    // Both are positive and small; a machine's general `fract` may be a call.
    let fraction = |x: f64| x - f64::from(x as i32);
    fraction(52.982_918_9 * fraction(gradient)) as f32
}

/// Positive and finite; NaN counts as 0.
#[inline(always)]
fn bounded<L: Lanes>(x: L) -> L {
    let zero = x.splat(0.0);
    x.min(x.splat(BRIGHTEST)).or(zero.is_below(x), zero)
}

/// The fit's curve: nearly a square at the dark end, level at the bright one.
#[inline(always)]
fn film<L: Lanes>(v: L) -> L {
    let above = v * (v + 0.024_578_6) - 0.000_090_537;
    let below = v * (v * 0.983_729 + 0.432_951) + 0.238_081;
    above / below
}

/// `vector`, multiplied by a matrix of the given rows.
#[inline(always)]
fn transformed<L: Lanes>(rows: &[Vec3; 3], vector: Vector<L>) -> Vector<L> {
    Vector {
        x: vector.dot_with(rows[0]),
        y: vector.dot_with(rows[1]),
        z: vector.dot_with(rows[2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(pixels: Vec<[f32; 3]>, tone_curve: ToneCurve) -> Image {
        Image {
            width: pixels.len() as u32,
            height: 1,
            pixels,
            tone_curve,
        }
    }

    #[test]
    fn brighter_greys_are_shown_brighter() {
        let greys: Vec<_> = (0..4000).map(|i| [i as f32 * i as f32 * 1e-6; 3]).collect();
        let shown: Vec<_> = greys
            .iter()
            .map(|&grey| ToneCurve::Filmic.apply(grey))
            .collect();
        for pair in shown.windows(2) {
            for channel in 0..3 {
                assert!(pair[0][channel] <= pair[1][channel], "{pair:?}");
            }
        }
        assert!(shown[0][0] < 0.001);
        assert!(shown[3999][0] > 0.97);
    }

    #[test]
    fn pixels_come_out_the_same_one_by_one_and_together() {
        let value = |i: u32| match i % 97 {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 => -1.0,
            _ => (i % 89) as f32 * (i % 89) as f32 * 4e-4,
        };
        let pixels: Vec<_> = (0..3 * 501)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(value))
            .collect();
        for curve in [ToneCurve::Filmic, ToneCurve::Exact] {
            let mut picture = image(pixels.clone(), curve);
            (picture.width, picture.height) = (501, 3);
            let alone = pixels.iter().enumerate().map(|(index, &pixel)| {
                let threshold = match curve {
                    ToneCurve::Filmic => dither(index as u32 % 501, index as u32 / 501),
                    ToneCurve::Exact => 0.5,
                };
                srgb::encode_at(curve.apply(pixel), threshold)
            });
            let alone: Vec<[u8; 3]> = alone.collect();
            assert_eq!(to_srgb8(&picture), alone.concat());
        }
    }

    #[test]
    fn greys_stay_grey() {
        for grey in [0.0, 0.02, 0.18, 0.7, 3.0] {
            let [r, g, b] = ToneCurve::Filmic.apply([grey; 3]);
            assert!((r - g).abs() < 2e-4 && (g - b).abs() < 2e-4, "{r} {g} {b}");
        }
    }

    #[test]
    fn no_value_gives_anything_but_a_colour() {
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -3.0, f32::MAX] {
            for curve in [ToneCurve::Filmic, ToneCurve::Exact] {
                let shown = curve.apply([odd, 0.5, odd]);
                assert!(shown.iter().all(|x| (0.0..=1.0).contains(x)), "{shown:?}");
            }
        }
    }

    #[test]
    fn values_between_two_bytes_become_both_in_proportion() {
        let mut picture = image(vec![[0.2; 3]; 64 * 64], ToneCurve::Filmic);
        (picture.width, picture.height) = (64, 64);
        let bytes = to_srgb8(&picture);
        let mean = bytes
            .iter()
            .map(|&byte| srgb::decode([byte; 3])[0])
            .sum::<f32>()
            / bytes.len() as f32;
        assert!((mean - ToneCurve::Filmic.apply([0.2; 3])[0]).abs() < 2e-4);
        assert!(bytes.iter().max().unwrap() - bytes.iter().min().unwrap() <= 1);
    }

    #[test]
    fn exact_colours_come_out_as_they_went_in() {
        let colors = [[12, 200, 255], [0, 1, 99]];
        let picture = image(
            colors.iter().copied().map(srgb::decode).collect(),
            ToneCurve::Exact,
        );
        assert_eq!(to_srgb8(&picture), colors.concat());
    }
}
