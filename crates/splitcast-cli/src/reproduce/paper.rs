//! What the paper reports, and what is to be reached.

use serde::Serialize;

/// A tree's cost may be this much of the same frame's normal build.
pub(crate) const SAH_GOAL: f64 = 1.05;

/// A row of Table I of Hussain & Grahn 2008, measured on an Intel Core 2 of
/// 2.16 GHz; the numbers of frames are those of their Figure 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct PaperRow {
    pub(crate) scene: &'static str,
    /// The built-in scene that stands in for it.
    pub(crate) stands_for: &'static str,
    pub(crate) triangles: usize,
    pub(crate) frames: usize,
    pub(crate) normal_ms: f64,
    pub(crate) initial_ms: f64,
    pub(crate) running_ms: f64,
    /// As printed, in whole percent, as a share.
    pub(crate) reduction: f64,
}

/// Table I.
pub(crate) const TABLE_1: [PaperRow; 4] = [
    row("Horse", "horse", (16_800, 48), [135.0, 30.0], 0.78),
    row("Elephant", "elephant", (84_600, 48), [710.0, 105.0], 0.85),
    row(
        "ClothBall",
        "cloth-ball",
        (92_200, 73),
        [802.0, 120.0],
        0.85,
    ),
    row(
        "Bunny Dragon",
        "collision",
        (252_500, 16),
        [1610.0, 210.0],
        0.87,
    ),
];

/// The row to compare a scene with: that of the built-in scene of this name, also
/// where more follows that is not a letter, as in `horse_gallop` or `horse-2`.
pub(crate) fn row_for(scene: &str) -> Option<&'static PaperRow> {
    let name = scene.to_ascii_lowercase();
    let stands_for = |row: &&PaperRow| {
        let rest = name.strip_prefix(row.stands_for);
        rest.is_some_and(|rest| !rest.starts_with(char::is_alphabetic))
    };
    TABLE_1.iter().find(stands_for)
}

/// Normal and initial times are the same in the paper.
const fn row(
    scene: &'static str,
    stands_for: &'static str,
    (triangles, frames): (usize, usize),
    [normal_ms, running_ms]: [f64; 2],
    reduction: f64,
) -> PaperRow {
    PaperRow {
        scene,
        stands_for,
        triangles,
        frames,
        normal_ms,
        initial_ms: normal_ms,
        running_ms,
        reduction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reductions_are_those_of_the_times() {
        for row in TABLE_1 {
            let reduction = 1.0 - row.running_ms / row.normal_ms;
            assert!((reduction - row.reduction).abs() < 0.01, "{row:?}");
        }
    }

    #[test]
    fn scenes_find_their_row() {
        assert_eq!(row_for("Horse_gallop").map(|row| row.scene), Some("Horse"));
        assert_eq!(
            row_for("collision").map(|row| row.scene),
            Some("Bunny Dragon")
        );
        assert_eq!(row_for("waves"), None);
        assert_eq!(row_for("horsefly"), None);
        for name in splitcast_scene::builtin::names() {
            assert!(row_for(name).is_some(), "{name}");
        }
    }
}
