//! What sorted values amount to.

/// The middle of sorted values, or the mean of the two in the middle.
///
/// # Panics
/// If there is no value.
pub fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 {
        sorted[middle]
    } else {
        (sorted[middle - 1] + sorted[middle]) / 2.0
    }
}

/// The percentile of sorted values by the nearest-rank method: the smallest
/// value such that at least `share` of all values are not above it. It is
/// always one of the values, 0 giving the least and 1 the greatest.
///
/// Shares are compared as quotients, since a product such as 0.07 · 100 can be
/// rounded to more than the 7 values it stands for.
///
/// # Panics
/// If there is no value, or `share` is not from 0 to 1.
pub fn percentile(sorted: &[f64], share: f64) -> f64 {
    assert!((0.0..=1.0).contains(&share), "{share} is no share");
    let reaches = |rank: usize| rank as f64 / sorted.len() as f64 >= share;
    let rank = (1..=sorted.len()).find(|&rank| reaches(rank));
    sorted[rank.expect("there is a value") - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median(&[7.0]), 7.0);
        assert_eq!(median(&[1.0, 2.0, 9.0]), 2.0);
        assert_eq!(median(&[1.0, 2.0, 4.0, 9.0]), 3.0);
    }

    #[test]
    fn percentiles_are_of_the_nearest_rank() {
        let five = [15.0, 20.0, 35.0, 40.0, 50.0];
        for (share, value) in [
            (0.0, 15.0),
            (0.05, 15.0),
            (0.2, 15.0),
            (0.3, 20.0),
            (0.4, 20.0),
            (0.5, 35.0),
            (0.95, 50.0),
            (1.0, 50.0),
        ] {
            assert_eq!(percentile(&five, share), value, "{share}");
        }
        assert_eq!(percentile(&[1.0, 1.0, 1.0, 2.0], 0.6), 1.0);
        assert_eq!(percentile(&[3.0], 0.99), 3.0);
    }

    #[test]
    fn whole_percents_of_a_hundred_values_are_exact() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        for (rank, value) in (1..=100).zip(&hundred) {
            assert_eq!(percentile(&hundred, f64::from(rank) / 100.0), *value);
        }
    }

    #[test]
    #[should_panic(expected = "no share")]
    fn percents_are_no_shares() {
        percentile(&[1.0], 95.0);
    }
}
