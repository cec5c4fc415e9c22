//! Finished frames on disk: PNG and EXR sequences, APNG, and AV1 in MP4.
//!
//! Whatever the format, three promises hold. A file under its final name is
//! whole: it is written beside its place and renamed, so an interrupted run
//! leaves what was there before. Whether the target can be written is found
//! out by [`OutputSpec::open`], before any frame is rendered. And every frame
//! carries the [`Settings`] it was made with, so a resumed run takes over only
//! frames that it would have rendered the same.

mod apng;
mod atomic;
mod av1;
mod error;
mod exr;
mod mp4;
mod png;
mod sequence;
mod settings;
mod sink;
mod spec;
mod spool;
mod thread;
mod video;
mod yuv;

pub use atomic::check_writable;
pub use error::OutputError;
pub use png::encode_png;
pub use settings::Settings;
pub use sink::{FrameSink, OutputOptions, Resumed};
pub use spec::{OutputFormat, OutputSpec};
pub use thread::{OutputThread, WriteTimes};
