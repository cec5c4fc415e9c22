//! Sample points: Owen-scrambled Sobol points, numbered along a Z-order curve
//! of pixels.
//!
//! All pixels of a block share one long (0, 2)-sequence, and each takes the
//! run of points that its place on the curve gives it (Ahmed & Wonka 2020,
//! "Screen-space blue-noise diffusion of Monte Carlo sampling error via
//! hierarchical ordering of pixels"). Any aligned run of 2ᵏ points is
//! stratified, hence so is each pixel, each quad of pixels, and so on:
//! neighbours err in opposite directions, which the eye averages away.
//!
//! Scrambling is the hash of Laine & Karras ("Stratified sampling for
//! stochastic transparency", 2011) in the way of Burley ("Practical
//! hash-based Owen scrambling", 2020), with the constants of Vegdahl
//! ("Building a better LK hash", 2021).
//!
//! A point depends on the pixel, the number of the sample, the dimension and
//! the seed, and on nothing else: not on tiles, threads, or frames.

use glam::{Vec2, Vec3};

/// Blocks of 2⁸ by 2⁸ pixels share a sequence.
const BLOCK_BITS: u32 = 8;

/// The points of one pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelSamples {
    /// Place of the pixel on its block's curve.
    code: u32,
    /// Differs between blocks and seeds.
    seed: u32,
    /// A pixel's run of points has this many bits.
    sample_bits: u32,
}

impl PixelSamples {
    /// The points of pixel (`x`, `y`), of which `samples` will be used.
    pub(crate) fn new(x: u32, y: u32, samples: u32, seed: u32) -> Self {
        let mask = (1 << BLOCK_BITS) - 1;
        Self {
            code: interleave(x & mask, y & mask),
            seed: hash(x >> BLOCK_BITS, hash(y >> BLOCK_BITS, seed)),
            sample_bits: samples.next_power_of_two().trailing_zeros(),
        }
    }

    /// Point `sample` of the sequence for `dimension`, in [0, 1)². Sequences
    /// of different dimensions are independent of each other.
    pub(crate) fn point(&self, sample: u32, dimension: u32) -> Vec2 {
        let seed = hash(dimension, self.seed);
        // Aligned to the top, the index's leading bits decide first: a nested scramble then swaps
        // halves, halves of halves, and so on, and keeps aligned runs together.
        let unused = 32 - (2 * BLOCK_BITS + self.sample_bits);
        let index = (self.code << self.sample_bits) | sample;
        let index = nested_scramble(index << unused, seed) >> unused;
        let x = nested_scramble(van_der_corput(index), hash(1, seed));
        let y = nested_scramble(sobol_second(index), hash(2, seed));
        Vec2::new(to_unit(x), to_unit(y))
    }
}

/// Interleaves the low 16 bits of both: the Z-order of a grid.
pub(crate) fn interleave(x: u32, y: u32) -> u32 {
    let spread = |mut v: u32| {
        v &= 0xffff;
        v = (v | v << 8) & 0x00ff_00ff;
        v = (v | v << 4) & 0x0f0f_0f0f;
        v = (v | v << 2) & 0x3333_3333;
        (v | v << 1) & 0x5555_5555
    };
    spread(x) | spread(y) << 1
}

/// A tent over the pixel and half of its neighbours, the filter of bilinear
/// interpolation, as an offset from the pixel's middle: points are spread as
/// the filter weighs them, so that all samples count the same (Ernst,
/// Stamminger & Greiner 2006, "Filter importance sampling").
pub(crate) fn tent(point: Vec2) -> Vec2 {
    let warp = |u: f32| {
        if u < 0.5 {
            (2.0 * u).sqrt() - 1.0
        } else {
            1.0 - (2.0 - 2.0 * u).sqrt()
        }
    };
    Vec2::new(warp(point.x), warp(point.y))
}

/// The unit square to the unit disk, areas and neighbourhoods kept (Shirley &
/// Chiu 1997, "A low distortion map between disk and square").
pub(crate) fn disk(point: Vec2) -> Vec2 {
    let centred = 2.0 * point - Vec2::ONE;
    let (radius, ratio, swap) = if centred.x.abs() > centred.y.abs() {
        (centred.x, centred.y / centred.x, false)
    } else if centred.y != 0.0 {
        (centred.y, centred.x / centred.y, true)
    } else {
        return Vec2::ZERO;
    };
    let sine = sin_octant(ratio * std::f32::consts::FRAC_PI_4);
    let cosine = (1.0 - sine * sine).sqrt();
    if swap {
        radius * Vec2::new(sine, cosine)
    } else {
        radius * Vec2::new(cosine, sine)
    }
}

/// A unit direction around the unit vector `normal`, as dense as its cosine
/// with it.
pub(crate) fn cosine_hemisphere(point: Vec2, normal: Vec3) -> Vec3 {
    let on_disk = disk(point);
    let height = (1.0 - on_disk.length_squared()).max(0.0).sqrt();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    tangent * on_disk.x + bitangent * on_disk.y + normal * height
}

/// Moves bit `i` to bit `31 - i`: the first dimension of Sobol's sequence.
fn van_der_corput(index: u32) -> u32 {
    index.reverse_bits()
}

/// The second dimension of Sobol's sequence. Its generator matrix is Pascal's
/// triangle modulo 2, that is, the bits of the index are the coefficients of a
/// polynomial over GF(2) that is shifted from x to x + 1. As
/// `(x + 1)^(2^k) = x^(2^k) + 1`, halves can be shifted on their own and the
/// upper half then added to the lower one.
fn sobol_second(index: u32) -> u32 {
    let mut v = index.reverse_bits();
    v ^= v << 16;
    v ^= (v & 0x00ff_00ff) << 8;
    v ^= (v & 0x0f0f_0f0f) << 4;
    v ^= (v & 0x3333_3333) << 2;
    v ^ (v & 0x5555_5555) << 1
}

/// Owen's scrambling: flips each bit depending on the seed and on all higher bits.
fn nested_scramble(value: u32, seed: u32) -> u32 {
    let mut v = value.reverse_bits();
    v ^= v.wrapping_mul(0x3d20_adea);
    v = v.wrapping_add(seed);
    v = v.wrapping_mul((seed >> 16) | 1);
    v ^= v.wrapping_mul(0x0552_6c56);
    v ^= v.wrapping_mul(0x53a2_2864);
    v.reverse_bits()
}

/// A hash of both words (Wellons 2018, "lowbias32" of the hash prospector).
fn hash(word: u32, seed: u32) -> u32 {
    let mut v = word ^ seed.wrapping_mul(0x9e37_79b9).wrapping_add(0x85eb_ca6b);
    v = (v ^ (v >> 16)).wrapping_mul(0x7feb_352d);
    v = (v ^ (v >> 15)).wrapping_mul(0x846c_a68b);
    v ^ (v >> 16)
}

/// The upper 24 bits as a number in [0, 1).
fn to_unit(value: u32) -> f32 {
    (value >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// The sine of an angle of at most π/4, by the first terms of its series: the
/// first one left out is below 2⁻²⁴ of it. The same on every platform, unlike
/// the libraries' sines.
fn sin_octant(angle: f32) -> f32 {
    let square = angle * angle;
    let series = 1.0
        + square
            * (-1.0 / 6.0 + square * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square / 362_880.0)));
    angle * series
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Whether every elementary interval of area 1/n holds one of n = 2ᵏ points.
    fn is_net(points: &[Vec2]) -> bool {
        let bits = points.len().trailing_zeros();
        (0..=bits).all(|split| {
            let (columns, rows) = (1u32 << split, 1u32 << (bits - split));
            let mut cells: Vec<u32> = points
                .iter()
                .map(|point| {
                    let column = (point.x * columns as f32) as u32;
                    column * rows + (point.y * rows as f32) as u32
                })
                .collect();
            cells.sort_unstable();
            cells.iter().copied().eq(0..points.len() as u32)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn points_of_a_pixel_are_stratified(
            x in 0u32..65_536, y in 0u32..65_536, bits in 0u32..9, dimension in 0u32..9, seed: u32,
        ) {
            let samples = PixelSamples::new(x, y, 1 << bits, seed);
            let points: Vec<Vec2> = (0..1 << bits).map(|s| samples.point(s, dimension)).collect();
            prop_assert!(is_net(&points));
        }

        #[test]
        fn points_of_a_block_of_pixels_are_stratified(
            x in 0u32..16_384, y in 0u32..16_384, dimension in 0u32..9, seed: u32,
        ) {
            let pixels = (0..4).flat_map(|dx| (0..4).map(move |dy| (4 * x + dx, 4 * y + dy)));
            let points: Vec<Vec2> = pixels
                .flat_map(|(x, y)| {
                    let samples = PixelSamples::new(x, y, 4, seed);
                    (0..4).map(move |sample| samples.point(sample, dimension))
                })
                .collect();
            prop_assert!(is_net(&points));
        }

        #[test]
        fn warps_stay_in_their_domains(x in 0.0f32..1.0, y in 0.0f32..1.0) {
            let point = Vec2::new(x, y);
            prop_assert!(disk(point).length() <= 1.0 + 1e-6);
            prop_assert!(tent(point).abs().max_element() <= 1.0);
            let normal = Vec3::new(0.36, -0.48, 0.8);
            let direction = cosine_hemisphere(point, normal);
            prop_assert!((direction.length() - 1.0).abs() < 1e-5);
            prop_assert!(direction.dot(normal) > -1e-6);
        }
    }

    #[test]
    fn dimensions_pixels_and_seeds_have_points_of_their_own() {
        let first = |x, dimension, seed| PixelSamples::new(x, 5, 16, seed).point(0, dimension);
        let base = first(7, 0, 0);
        for other in [
            first(8, 0, 0),
            first(7, 1, 0),
            first(7, 0, 1),
            first(263, 0, 0),
        ] {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn the_fast_second_dimension_is_that_of_sobols_matrix() {
        for index in (0..10_000u32).map(|i| i.wrapping_mul(429_493)) {
            let mut column = 1u32 << 31;
            let mut expected = 0;
            for bit in 0..32 {
                if index >> bit & 1 == 1 {
                    expected ^= column;
                }
                column ^= column >> 1;
            }
            assert_eq!(sobol_second(index), expected, "{index}");
        }
    }

    #[test]
    fn the_sine_is_exact_to_a_few_units_in_the_last_place() {
        for step in 0..=1000 {
            let angle = std::f32::consts::FRAC_PI_4 * step as f32 / 1000.0;
            let exact = f64::from(angle).sin();
            assert!(
                (f64::from(sin_octant(angle)) - exact).abs() < 1.2e-7,
                "{angle}"
            );
        }
    }

    #[test]
    fn the_hemisphere_is_weighted_by_the_cosine() {
        let points = PixelSamples::new(0, 0, 4096, 1);
        let mean: Vec3 = (0..4096)
            .map(|sample| cosine_hemisphere(points.point(sample, 0), Vec3::Z))
            .sum::<Vec3>()
            / 4096.0;
        // The mean cosine of a distribution proportional to the cosine is 2/3.
        assert!(
            (mean - Vec3::new(0.0, 0.0, 2.0 / 3.0)).length() < 1e-3,
            "{mean}"
        );
    }

    #[test]
    fn the_tent_weighs_as_a_tent() {
        let points = PixelSamples::new(0, 0, 4096, 1);
        let inner = (0..4096)
            .filter(|&sample| tent(points.point(sample, 0)).x.abs() < 0.5)
            .count();
        // Three quarters of a tent's area lie in its inner half.
        assert!((inner as f32 / 4096.0 - 0.75).abs() < 0.01, "{inner}");
    }
}
