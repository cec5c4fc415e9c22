//! Adaptive sampling: a first few samples everywhere, the rest where they
//! disagree.
//!
//! The first samples of a pixel and of its eight neighbours are compared as
//! they would appear on a display. If all are nearly the same, as in the sky
//! and on open ground, further ones would not change the picture. Neighbours
//! count, so that an edge or a thin shadow that slips between the samples of
//! one pixel is still seen. The decision rests on whole first pictures, hence
//! neither on tiles nor on threads.

use glam::Vec3;

use crate::{ToneCurve, srgb};

/// A pixel whose samples differ by fewer levels of the display, of 255, in
/// every channel is done.
const VISIBLE: u8 = 3;

/// Of this many samples, one is taken in the first picture.
const FIRST_SHARE: u32 = 4;

/// The first picture takes this many samples, if there are as many.
const FEWEST: u32 = 4;

/// What the first samples of a pixel say.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    sum: [f32; 3],
    /// Range of the samples in levels of the display.
    low: [u8; 3],
    high: [u8; 3],
}

impl Default for Estimate {
    /// No sample yet.
    fn default() -> Self {
        Self {
            sum: [0.0; 3],
            low: [u8::MAX; 3],
            high: [u8::MIN; 3],
        }
    }
}

impl Estimate {
    /// Adds a sample that `curve` will bring to the display.
    pub(crate) fn add(&mut self, sample: Vec3, curve: ToneCurve) {
        self.sum = (Vec3::from(self.sum) + sample).into();
        let shown = srgb::encode(curve.apply(sample.into()));
        self.widen(shown, shown);
    }

    /// The sum of all samples.
    pub(crate) fn sum(&self) -> Vec3 {
        self.sum.into()
    }

    fn widen(&mut self, low: [u8; 3], high: [u8; 3]) {
        for channel in 0..3 {
            self.low[channel] = self.low[channel].min(low[channel]);
            self.high[channel] = self.high[channel].max(high[channel]);
        }
    }
}

/// Samples a pixel in the first picture, of `samples` in all.
pub(crate) fn first_samples(samples: u32) -> u32 {
    (samples / FIRST_SHARE).max(FEWEST).min(samples)
}

/// Whether the samples around pixel (`x`, `y`) of a first picture of the given
/// width differ visibly.
pub(crate) fn is_uneven(first: &[Estimate], width: u32, x: u32, y: u32) -> bool {
    let height = (first.len() / width as usize) as u32;
    let mut around = Estimate::default();
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        for column in x.saturating_sub(1)..(x + 2).min(width) {
            let neighbour = &first[row as usize * width as usize + column as usize];
            around.widen(neighbour.low, neighbour.high);
        }
    }
    (0..3).any(|channel| around.high[channel].saturating_sub(around.low[channel]) >= VISIBLE)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of 4 x 3 grey pixels with one odd sample in pixel (1, 1).
    fn picture(grey: f32, odd: f32) -> Vec<Estimate> {
        let mut first = vec![Estimate::default(); 12];
        for estimate in &mut first {
            estimate.add(Vec3::splat(grey), ToneCurve::Exact);
        }
        first[5].add(Vec3::splat(odd), ToneCurve::Exact);
        first
    }

    #[test]
    fn an_even_picture_is_done() {
        let first = picture(0.5, 0.5);
        for (x, y) in (0..4).flat_map(|x| (0..3).map(move |y| (x, y))) {
            assert!(!is_uneven(&first, 4, x, y));
        }
    }

    #[test]
    fn an_odd_sample_makes_its_pixel_and_its_neighbours_uneven() {
        let first = picture(0.5, 0.6);
        for (x, y) in (0..4).flat_map(|x| (0..3).map(move |y| (x, y))) {
            assert_eq!(is_uneven(&first, 4, x, y), x < 3, "({x}, {y})");
        }
    }

    #[test]
    fn first_samples_are_some_but_never_more_than_all() {
        assert_eq!([1, 3, 4, 16, 64].map(first_samples), [1, 3, 4, 4, 16]);
    }
}
