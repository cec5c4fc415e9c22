//! Periodic motion: a sine of our own, so that every machine plays the same
//! frames to the bit, and closed curves through key values.

/// Sine and cosine of an angle in turns, to better than 1e-10.
pub(super) fn sin_cos(turns: f64) -> (f64, f64) {
    // Reduced to an eighth of a turn, where the Taylor series are short.
    let quarter = (turns * 4.0).round();
    let x = (turns - quarter * 0.25) * std::f64::consts::TAU;
    let square = x * x;
    let series = |last: f64, coefficients: [f64; 5]| {
        coefficients
            .iter()
            .fold(last, |sum, coefficient| coefficient + square * sum)
    };
    // 1 / n!, odd for the sine and even for the cosine.
    let sin = x * series(
        -1.0 / 39_916_800.0,
        [
            1.0 / 362_880.0,
            -1.0 / 5_040.0,
            1.0 / 120.0,
            -1.0 / 6.0,
            1.0,
        ],
    );
    let cos = series(
        -1.0 / 3_628_800.0,
        [1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -1.0 / 2.0, 1.0],
    );
    match (quarter as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Cosine of an angle in turns.
pub(super) fn cos(turns: f64) -> f64 {
    sin_cos(turns).1
}

/// The value at `phase` (in turns) of a closed curve through `keys`, pairs of
/// phase and value by rising phase in 0 to 1. It never overshoots: what rests
/// between two equal keys rests (monotone cubic interpolation; Fritsch and
/// Butland, "A Method for Constructing Local Monotone Piecewise Cubic
/// Interpolants", 1984).
pub(super) fn cycle(keys: &[(f64, f64)], phase: f64) -> f64 {
    let phase = phase - phase.floor();
    let count = keys.len();
    let key = |index: isize| {
        let wrapped = index.rem_euclid(count as isize) as usize;
        let turns = index.div_euclid(count as isize) as f64;
        (keys[wrapped].0 + turns, keys[wrapped].1)
    };
    let after = keys.partition_point(|(at, _)| *at <= phase) as isize;
    let [before, from, to, beyond] = [after - 2, after - 1, after, after + 1].map(key);
    let span = to.0 - from.0;
    let t = (phase - from.0) / span;
    let rise = |a: (f64, f64), b: (f64, f64)| (b.1 - a.1) / (b.0 - a.0);
    let slope = |a, b, c| harmonic_mean(rise(a, b), rise(b, c)) * span;
    let slope_from = slope(before, from, to);
    let slope_to = slope(from, to, beyond);
    hermite(from.1, slope_from, to.1, slope_to, t)
}

/// Zero where the signs differ.
fn harmonic_mean(a: f64, b: f64) -> f64 {
    if a * b > 0.0 {
        2.0 * a * b / (a + b)
    } else {
        0.0
    }
}

/// The cubic through `from` and `to` with the given slopes, for `t` in 0 to 1.
pub(super) fn hermite(from: f64, slope_from: f64, to: f64, slope_to: f64, t: f64) -> f64 {
    let square = t * t;
    let cube = square * t;
    from * (2.0 * cube - 3.0 * square + 1.0)
        + slope_from * (cube - 2.0 * square + t)
        + to * (3.0 * square - 2.0 * cube)
        + slope_to * (cube - square)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_agree_with_the_standard_library() {
        for step in -1000..1000 {
            let turns = f64::from(step) * 0.003_7;
            let (sin, cos) = sin_cos(turns);
            let angle = turns * std::f64::consts::TAU;
            assert!((sin - angle.sin()).abs() < 1e-9, "sine of {turns} turns");
            assert!((cos - angle.cos()).abs() < 1e-9, "cosine of {turns} turns");
        }
    }

    #[test]
    fn cycle_stays_within_neighboring_keys() {
        let keys = [(0.0, 0.0), (0.5, 0.0), (0.6, 40.0), (0.8, 50.0)];
        for phase in (0..500).map(|index| f64::from(index) / 1000.0) {
            assert_eq!(cycle(&keys, phase), 0.0, "a pause at {phase}");
        }
        for phase in (600..800).map(|index| f64::from(index) / 1000.0) {
            assert!((40.0..=50.0).contains(&cycle(&keys, phase)));
        }
    }

    #[test]
    fn cycle_meets_its_keys_and_closes_smoothly() {
        let keys = [(0.1, 2.0), (0.4, -1.0), (0.7, 0.5)];
        for (phase, value) in keys {
            assert!((cycle(&keys, phase) - value).abs() < 1e-12);
            assert!((cycle(&keys, phase + 3.0) - value).abs() < 1e-12);
        }
        let step = 1e-6;
        for phase in [0.0, 0.1, 0.4, 0.7] {
            let slope = |at: f64| (cycle(&keys, at + step) - cycle(&keys, at)) / step;
            assert!((slope(phase) - slope(phase - step)).abs() < 1e-2);
        }
    }
}
