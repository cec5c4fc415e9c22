//! The front of best systems.

/// A system in a scatter plot: what it takes to update, and how fast rays are then traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Standing<'a> {
    pub(crate) system: &'a str,
    /// Less is better.
    pub(crate) update_ms: f64,
    /// More is better.
    pub(crate) rate: f64,
}

/// The systems that no other one beats in both figures, or equals in one and beats in the
/// other, from the fastest update to the slowest.
pub(crate) fn front<'a>(all: &[Standing<'a>]) -> Vec<Standing<'a>> {
    let beats = |a: &Standing<'_>, b: &Standing<'_>| {
        a.update_ms <= b.update_ms
            && a.rate >= b.rate
            && (a.update_ms, a.rate) != (b.update_ms, b.rate)
    };
    let unbeaten = all
        .iter()
        .filter(|one| !all.iter().any(|other| beats(other, one)));
    let mut front: Vec<_> = unbeaten.copied().collect();
    front.sort_by(|a, b| a.update_ms.total_cmp(&b.update_ms));
    front
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names<'a>(all: &[(&'a str, f64, f64)]) -> Vec<&'a str> {
        let standing = |&(system, update_ms, rate)| Standing {
            system,
            update_ms,
            rate,
        };
        let all: Vec<_> = all.iter().map(standing).collect();
        front(&all).into_iter().map(|one| one.system).collect()
    }

    #[test]
    fn what_is_beaten_in_both_is_not_on_the_front() {
        let all = [
            ("best tree", 9.0, 30.0),
            ("slow and poor", 8.0, 9.0),
            ("fastest", 1.0, 10.0),
            ("between", 3.0, 20.0),
            ("as fast, better", 3.0, 21.0),
            ("slower, as good", 10.0, 30.0),
        ];
        assert_eq!(names(&all), ["fastest", "as fast, better", "best tree"]);
    }

    #[test]
    fn equals_share_their_place() {
        assert_eq!(names(&[("a", 1.0, 1.0), ("b", 1.0, 1.0)]), ["a", "b"]);
        assert_eq!(names(&[]), [""; 0]);
    }
}
