//! Which frames are asked for.

use std::fmt;

use crate::values::ValueError;

/// Frames `start..end`; without an end, all from `start` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    /// The first frame, counted from 0.
    pub start: usize,
    /// The frame behind the last.
    pub end: Option<usize>,
}

/// As it is written on the command line: `2:5` or `2:`.
impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.start)?;
        self.end.map_or(Ok(()), |end| write!(f, "{end}"))
    }
}

/// Reads `A:B`, `A:`, `:B`, `:`, or the number of a single frame.
///
/// # Errors
/// [`ValueError::Frames`], or [`ValueError::NoFrame`] for a range that holds
/// none.
pub fn parse_frames(text: &str) -> Result<FrameRange, ValueError> {
    let number = |text: &str| text.parse::<usize>().map_err(|_| ValueError::Frames);
    let range = match text.split_once(':') {
        None => {
            let start = number(text)?;
            FrameRange {
                start,
                end: Some(start.saturating_add(1)),
            }
        }
        Some((start, end)) => FrameRange {
            start: if start.is_empty() { 0 } else { number(start)? },
            end: if end.is_empty() {
                None
            } else {
                Some(number(end)?)
            },
        },
    };
    match range.end {
        Some(end) if end <= range.start => Err(ValueError::NoFrame { start: range.start }),
        _ => Ok(range),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_half_open() {
        let range = |start, end| Ok(FrameRange { start, end });
        assert_eq!(parse_frames("2:5"), range(2, Some(5)));
        assert_eq!(parse_frames(":5"), range(0, Some(5)));
        assert_eq!(parse_frames("2:"), range(2, None));
        assert_eq!(parse_frames(":"), range(0, None));
        assert_eq!(parse_frames("7"), range(7, Some(8)));
        for bad in ["", "a", "-1:2", "1:2:3", "1.5"] {
            assert_eq!(parse_frames(bad), Err(ValueError::Frames), "{bad}");
        }
        for (bad, start) in [("5:2", 5), ("3:3", 3), (":0", 0)] {
            assert_eq!(parse_frames(bad), Err(ValueError::NoFrame { start }));
        }
    }

    #[test]
    fn ranges_are_shown_as_they_are_written() {
        for text in ["2:5", "2:"] {
            assert_eq!(parse_frames(text).unwrap().to_string(), text);
        }
    }
}
