//! One figure over many frames.

use serde::Serialize;
use splitcast_console::median;

/// A value and the number of its frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Extreme {
    pub(crate) value: f64,
    pub(crate) frame: usize,
}

/// The middle and the greatest value of a figure; absent where no frame has it.
pub(crate) struct Column {
    pub(crate) median: Option<f64>,
    pub(crate) most: Option<Extreme>,
}

impl Column {
    /// Of frames' numbers and values, in the order of the frames.
    pub(crate) fn new(frames: impl Iterator<Item = (usize, Option<f64>)>) -> Self {
        let known = frames.filter_map(|(frame, value)| {
            let value = value.filter(|value| value.is_finite())?;
            Some(Extreme { value, frame })
        });
        let mut known: Vec<Extreme> = known.collect();
        // Stable, so that of equal values the last frame's counts as the most.
        known.sort_by(|a, b| a.value.total_cmp(&b.value));
        let values: Vec<f64> = known.iter().map(|extreme| extreme.value).collect();
        Self {
            median: (!values.is_empty()).then(|| median(&values)),
            most: known.last().copied(),
        }
    }
}
