//! Plain text tables.

use std::fmt::Write;

/// Side on which the cells of a column are flush.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// To the left, as text is read.
    Left,
    /// To the right, so that digits line up.
    Right,
}

/// Lays out rows under the columns' names; every column is as wide as its
/// widest cell. Ends with a line end.
///
/// # Panics
/// If a row has fewer cells than there are columns.
pub fn layout(columns: &[(&str, Align)], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        let name = columns[column].0.chars().count();
        cells.chain([name]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns.len()).map(width).collect();
    let mut text = String::new();
    let header = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
    for row in [&header].into_iter().chain(rows) {
        let mut line = String::new();
        for ((cell, &width), (_, align)) in row.iter().zip(&widths).zip(columns) {
            match align {
                Align::Left => write!(line, "{cell:width$}  "),
                Align::Right => write!(line, "{cell:>width$}  "),
            }
            .expect("writing to a string cannot fail");
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// A number with a space between each three digits, as in 252 518.
pub fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = vec![
            vec!["a".to_owned(), "1".to_owned()],
            vec!["bcd".to_owned(), "2345".to_owned()],
        ];
        assert_eq!(
            layout(&[("x", Align::Left), ("n", Align::Right)], &rows),
            "x       n\na       1\nbcd  2345\n"
        );
    }

    #[test]
    fn digits_go_by_threes() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1000), "1 000");
        assert_eq!(grouped(1_252_518), "1 252 518");
    }
}
