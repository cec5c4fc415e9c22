//! What Splitcast's command-line programs share: opening inputs, progress,
//! tables and messages, so that they look and fail alike.
//!
//! Everything that a program says about its work goes to standard error, one
//! line a message; standard output is left to results.
//!
//! ```
//! use std::path::Path;
//!
//! use splitcast_console::{Input, InputError, count, parse_frames};
//!
//! let mut input = Input::open(Path::new("cloth-ball"))?;
//! let frames = input.frame_range(parse_frames("2:5").ok())?;
//! assert_eq!(count(frames.len(), "frame"), "3 frames");
//! let frame = input.source.frame(frames.start)?;
//! assert!(!frame.triangles.is_empty());
//! # Ok::<(), InputError>(())
//! ```

#![deny(missing_docs)]

mod command_line;
mod excerpt;
mod exit;
mod frame_range;
mod input;
mod json;
mod message;
mod progress;
mod result_files;
mod statistics;
pub mod table;
mod values;
mod watched;
mod words;

pub use command_line::{FAILURE, USAGE, parse_command_line};
pub use excerpt::Excerpt;
pub use exit::{ProgramError, exit};
pub use frame_range::{FrameRange, parse_frames};
pub use input::{Input, InputError, scene_names};
pub use json::to_json;
pub use message::{report_error, warn};
pub use progress::{Progress, clock};
pub use result_files::{FileError, ResultFolder, write_file};
pub use statistics::{median, percentile};
pub use values::{ValueError, parse_size, parse_threads, parse_up_to};
pub use watched::Watched;
pub use words::{count, distinct_names, figure};
