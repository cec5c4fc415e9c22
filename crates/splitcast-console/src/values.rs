//! Values of flags, as they are written on the command line.

use std::num::NonZeroUsize;

use splitcast_render::MAX_SIDE;

/// Most threads that can be asked for.
const MAX_THREADS: usize = 1024;

/// What is wrong with a flag's value. The message says what was expected and
/// leaves out the value and the flag, which clap puts in front.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueError {
    /// No two numbers with an x between them.
    #[error("write width and height in pixels, such as 960x540")]
    Size,
    /// A side without pixels or too long.
    #[error("each side must be from 1 to {MAX_SIDE} pixels")]
    Side,
    /// No range of frames.
    #[error("write A:B with frame numbers from 0, such as 0:10, 10: or :10")]
    Frames,
    /// A range that ends where it starts, or before.
    #[error(
        "the range holds no frame: B is not included and must be above A, such as {start}:{}",
        start.saturating_add(1)
    )]
    NoFrame {
        /// Where the range starts.
        start: usize,
    },
    /// No number, or one that is out of range.
    #[error("expected a number from 1 to {most}")]
    Number {
        /// The most that can be asked for.
        most: usize,
    },
}

/// Reads width and height in pixels, such as `960x540`, of a picture that can be rendered.
///
/// # Errors
/// [`ValueError::Size`] or [`ValueError::Side`].
pub fn parse_size(text: &str) -> Result<(u32, u32), ValueError> {
    let sides = text.split_once(['x', 'X']);
    let sides = sides.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let (width, height) = sides.ok_or(ValueError::Size)?;
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) {
        Ok((width, height))
    } else {
        Err(ValueError::Side)
    }
}

/// Reads a number of threads, from 1 to 1024.
///
/// # Errors
/// [`ValueError::Number`].
pub fn parse_threads(text: &str) -> Result<NonZeroUsize, ValueError> {
    parse_up_to(MAX_THREADS, text)
}

/// Reads a number from 1 to `most`.
///
/// # Errors
/// [`ValueError::Number`].
pub fn parse_up_to(most: usize, text: &str) -> Result<NonZeroUsize, ValueError> {
    text.parse::<NonZeroUsize>()
        .ok()
        .filter(|number| number.get() <= most)
        .ok_or(ValueError::Number { most })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_sides_within_bounds() {
        assert_eq!(parse_size("64x36"), Ok((64, 36)));
        assert_eq!(parse_size("1X65535"), Ok((1, 65535)));
        for bad in ["0x0", "65536x1", "1x65536"] {
            let side = ValueError::Side;
            assert_eq!(parse_size(bad), Err(side), "{bad}");
        }
        for bad in ["64", "64x", "x36", "-1x2", "1x1x1", "99999999999x2"] {
            assert_eq!(parse_size(bad), Err(ValueError::Size), "{bad}");
        }
    }

    #[test]
    fn numbers_start_at_one_and_end_at_the_most() {
        assert_eq!(parse_up_to(5, "1").map(usize::from), Ok(1));
        assert_eq!(parse_up_to(5, "5").map(usize::from), Ok(5));
        for bad in ["0", "6", "-1", "1.5", "", "two"] {
            let number = ValueError::Number { most: 5 };
            assert_eq!(parse_up_to(5, bad), Err(number), "{bad}");
        }
    }
}
