//! Where a foot goes in a gait.

use glam::DVec3;

use super::curve::hermite;

/// The path of a toe relative to where it stands at rest, for one gait cycle
/// that begins at touchdown.
pub(super) struct FootPath {
    /// Part of the cycle that the foot is on the ground.
    pub(super) duty: f64,
    /// Where it touches down and lifts off, ahead of its rest position, metres.
    pub(super) touchdown: f64,
    pub(super) liftoff: f64,
    /// Highest point of the toe in swing, metres.
    pub(super) lift: f64,
}

impl FootPath {
    /// Offset from rest at `phase` turns after touchdown.
    pub(super) fn at(&self, phase: f64) -> DVec3 {
        let phase = phase - phase.floor();
        let sweep = self.liftoff - self.touchdown;
        if phase < self.duty {
            return DVec3::new(self.touchdown + sweep * phase / self.duty, 0.0, 0.0);
        }
        let t = (phase - self.duty) / (1.0 - self.duty);
        // Leaving and meeting the ground at half its speed looks unhurried
        // and keeps the overshoot within reach.
        let slope = 0.5 * sweep * (1.0 - self.duty) / self.duty;
        let x = hermite(self.liftoff, slope, self.touchdown, slope, t);
        // Leaves and meets the ground without a jolt, and rises faster than
        // it comes down: t^2 (1 - t)^3 is highest at 2/5, where it is 108/3125.
        let down = 1.0 - t;
        let y = self.lift * t * t * down * down * down * 3125.0 / 108.0;
        DVec3::new(x, y, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foot_stands_still_relative_to_moving_ground_and_swings_smoothly() {
        let path = FootPath {
            duty: 0.3,
            touchdown: 0.5,
            liftoff: -0.4,
            lift: 0.2,
        };
        let step = 1e-4;
        for phase in [0.05, 0.15, 0.25] {
            let speed = (path.at(phase + step) - path.at(phase)) / step;
            assert!(speed.distance(DVec3::new(-3.0, 0.0, 0.0)) < 1e-6);
        }
        for phase in (0..1000).map(|index| f64::from(index) / 1000.0) {
            let point = path.at(phase);
            assert!(point.y >= 0.0 && point.y <= 0.2 + 1e-12);
            assert!(
                path.at(phase + 0.001).distance(point) < 0.02,
                "jump at {phase}"
            );
        }
    }
}
