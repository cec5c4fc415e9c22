//! A picture in memory.

use crate::ToneCurve;

/// A rendered picture: linear RGB, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` linear RGB values; 1 is diffuse white in full light.
    pub pixels: Vec<[f32; 3]>,
    /// How the values are to be brought to a display.
    pub tone_curve: ToneCurve,
}
