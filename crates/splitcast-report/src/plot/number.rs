//! Numbers for readers.

/// A number with up to four digits that matter: `12.5`, `40 000`, `3·10⁻⁷`.
pub(super) fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    // The exponent after rounding to four digits: 9.9999 has that of 10.
    let rounded = format!("{value:.3e}");
    let (mantissa, exponent) = rounded.split_once('e').unwrap_or((&rounded, "0"));
    let exponent = exponent.parse().unwrap_or(0);
    if (-4..6).contains(&exponent) {
        return plain(value, (3 - exponent).max(0) as usize, true);
    }
    // The mantissa as written: dividing fails for numbers that are next to 0.
    times_power(&plain(mantissa.parse().unwrap_or(value), 3, true), exponent)
}

/// A multiple of `step`, with the digits it takes to tell it from its neighbours.
/// `greatest` is the largest magnitude among them, so that all use the same form.
pub(super) fn with_step(value: f64, step: f64, greatest: f64) -> String {
    // Steps are 1, 2 or 5 times a power of ten, give or take the last bit.
    let digit = (step.log10() + 1e-9).floor() as i32;
    if value.abs() < step / 2.0 {
        return "0".into();
    }
    if greatest < 999_999.5 && digit >= -5 {
        return plain(value, (-digit).max(0) as usize, false);
    }
    let exponent = (greatest.log10() + 1e-9).floor() as i32;
    // Beyond 15 digits there is nothing to show.
    let digits = (exponent - digit).clamp(0, 15) as usize;
    times_power(
        &plain(value / 10f64.powi(exponent), digits, false),
        exponent,
    )
}

fn times_power(mantissa: &str, exponent: i32) -> String {
    let power = format!("10{}", superscript(exponent));
    match mantissa {
        "1" => power,
        "\u{2212}1" => format!("\u{2212}{power}"),
        _ => format!("{mantissa}·{power}"),
    }
}

/// Decimal notation with a true minus sign and groups of three digits from 10 000 on.
fn plain(value: f64, decimals: usize, trim: bool) -> String {
    let digits = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = digits.split_once('.').unwrap_or((&digits, ""));
    let fraction = if trim {
        fraction.trim_end_matches('0')
    } else {
        fraction
    };
    let mut text = String::new();
    if value < 0.0 && digits.bytes().any(|digit| (b'1'..=b'9').contains(&digit)) {
        text.push('\u{2212}');
    }
    for (at, digit) in whole.char_indices() {
        if at > 0 && whole.len() >= 5 && (whole.len() - at).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    if !fraction.is_empty() {
        text.push('.');
        text.push_str(fraction);
    }
    text
}

fn superscript(exponent: i32) -> String {
    let digit = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        c => char::from_u32('⁰' as u32 + c as u32 - '0' as u32).unwrap_or(c),
    };
    exponent.to_string().chars().map(digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_numbers_keep_four_digits() {
        let cases = [
            (0.0, "0"),
            (12.5, "12.5"),
            (0.1 + 0.2, "0.3"),
            (9.99996, "10"),
            (-3.25, "\u{2212}3.25"),
            (1234.0, "1234"),
            (40_000.0, "40\u{2009}000"),
            (123_456.0, "123\u{2009}456"),
            (1e6, "10⁶"),
            (2.5e7, "2.5·10⁷"),
            (3e-7, "3·10⁻⁷"),
            (-1e-12, "\u{2212}10⁻¹²"),
            (5e-324, "4.941·10⁻³²⁴"),
        ];
        for (value, expected) in cases {
            assert_eq!(short(value), expected, "{value:e}");
        }
    }

    #[test]
    fn numbers_of_one_axis_have_the_same_digits() {
        assert_eq!(with_step(0.5, 0.25e0, 1.0), "0.5");
        assert_eq!(with_step(0.30000000000000004, 0.1, 1.0), "0.3");
        assert_eq!(with_step(1.0, 0.1, 1.0), "1.0");
        assert_eq!(with_step(-20.0, 10.0, 30.0), "\u{2212}20");
        assert_eq!(with_step(1e-17, 0.1, 1.0), "0");
        assert_eq!(with_step(1_500_000.0, 500_000.0, 2e6), "1.5·10⁶");
        assert_eq!(with_step(2e-7, 1e-7, 5e-7), "2·10⁻⁷");
    }
}
