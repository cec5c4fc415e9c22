//! Numbers as they stand in sentences and tables.

/// Three digits, and not more than two after the point.
pub fn figure(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    format!("{value:.digits$}")
}

/// A number with its noun: 1 frame, 2 frames.
pub fn count(number: usize, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// Numbers the names that an earlier one has already, so that all differ:
/// walk, walk-2, walk-3.
pub fn distinct_names(names: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut distinct: Vec<String> = Vec::new();
    for name in names {
        let numbered = (2..).map(|number| format!("{name}-{number}"));
        let mut candidates = std::iter::once(name.clone()).chain(numbered);
        let free = candidates.find(|candidate| !distinct.contains(candidate));
        distinct.push(free.expect("there are more numbers than names"));
    }
    distinct
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits() {
        assert_eq!(figure(0.1234), "0.12");
        assert_eq!(figure(12.345), "12.3");
        assert_eq!(figure(812.34), "812");
    }

    #[test]
    fn names_that_repeat_are_numbered() {
        let names = ["a", "b", "a", "a-2", "a"].map(str::to_owned);
        assert_eq!(distinct_names(names), ["a", "b", "a-2", "a-2-2", "a-3"]);
    }

    #[test]
    fn one_is_singular() {
        assert_eq!(count(0, "frame"), "0 frames");
        assert_eq!(count(1, "frame"), "1 frame");
        assert_eq!(count(2, "frame"), "2 frames");
    }
}
