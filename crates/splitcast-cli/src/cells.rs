//! Measured values as they stand in tables; some are absent.

use splitcast_console::figure;

/// What stands in a cell that has no value.
pub(crate) const NONE: &str = "-";

/// Milliseconds or counts, to three digits.
pub(crate) fn number(value: Option<f64>) -> String {
    value.map_or(NONE.to_owned(), figure)
}

/// A share in whole percent, with a decimal where it would not be seen else.
pub(crate) fn percent(value: Option<f64>) -> String {
    value.map_or(NONE.to_owned(), |share| {
        let digits = usize::from(share.abs() < 0.1);
        format!("{:.digits$}%", 100.0 * share)
    })
}

/// A ratio to three decimals.
pub(crate) fn ratio(value: Option<f64>) -> String {
    value.map_or(NONE.to_owned(), |ratio| format!("{ratio:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_values_are_dashes() {
        assert_eq!(number(None), "-");
        assert_eq!(percent(Some(0.784)), "78%");
        assert_eq!(percent(Some(0.0123)), "1.2%");
        assert_eq!(ratio(Some(1.0)), "1.000");
    }
}
