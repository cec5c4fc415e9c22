//! The one way frames go out, whatever the format.

use std::ops::Range;
use std::time::{Duration, Instant};

use super::error::OutputError;
use super::mp4::Mp4Encoder;
use super::sequence::SequenceSink;
use super::settings::Settings;
use super::spec::{OutputFormat, OutputSpec};
use super::video::VideoSink;
use super::{apng::ApngEncoder, mp4};
use crate::{Image, to_srgb8};

/// Largest width or height of any output, in pixels: the limit that rav1e,
/// MP4's sample entry, and our own arithmetic share.
const MAX_SIDE: u32 = u16::MAX as u32;

/// What an output is opened for.
#[derive(Clone, Debug)]
pub struct OutputOptions {
    /// Pixels in a row of every frame, 1 to 65535; even and at least 16 for MP4.
    pub width: u32,
    /// Rows of every frame, with the same limits.
    pub height: u32,
    /// Frames shown in a second, 1 to 1000; sequences of pictures ignore it.
    pub frames_per_second: f64,
    /// The frames that are written, by their numbers in the source.
    pub frames: Range<usize>,
    /// Threads of the video encoder, at least 1; the bytes do not depend on it.
    pub threads: usize,
    /// Keep what an interrupted run with the same `settings` finished. When
    /// false, such leftovers are removed.
    pub resume: bool,
    /// What the frames are made with.
    pub settings: Settings,
}

/// Takes finished frames in rising order.
pub trait FrameSink: Send {
    /// What was found of an earlier run.
    fn resumed(&self) -> &Resumed;

    /// Whether frame `index` was finished by an earlier run, so that it need
    /// not be rendered, and must not be written, again.
    fn is_done(&self, index: usize) -> bool {
        self.resumed().whole.binary_search(&index).is_ok()
    }

    /// Writes frame `index`. Frames come in rising order, those that are done
    /// left out. Returns how much of the time went into bringing the picture to
    /// the display's bytes: none for formats that keep its light.
    ///
    /// # Errors
    /// [`OutputError::Io`] and [`OutputError::Encode`] when writing fails,
    /// [`OutputError::Misuse`] for a wrong size or order. What was written
    /// before stays whole.
    fn write(&mut self, index: usize, image: &Image) -> Result<Duration, OutputError>;

    /// Completes the output. A video appears under its name only now.
    ///
    /// # Errors
    /// As for [`FrameSink::write`].
    fn finish(self: Box<Self>) -> Result<(), OutputError>;
}

/// What an earlier run left behind for a resumed one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resumed {
    /// Frames that are whole and made with the same settings, in rising order.
    pub whole: Vec<usize>,
    /// How many frames are there but broken or made with other settings; they
    /// are written again.
    pub stale: usize,
    /// The first reason found, in words, why a frame is stale.
    pub difference: Option<String>,
}

impl OutputSpec {
    /// Checks that the options suit the format and that the target can be
    /// written, then makes everything ready for the first frame.
    ///
    /// # Errors
    /// Errors for which [`OutputError::is_usage`] holds when the options do not
    /// suit; [`OutputError::Unwritable`] when the target cannot be written.
    pub fn open(&self, options: OutputOptions) -> Result<Box<dyn FrameSink>, OutputError> {
        self.check(&options)?;
        Ok(match self.format() {
            OutputFormat::Png | OutputFormat::Exr => {
                Box::new(SequenceSink::open(self.clone(), options)?)
            }
            OutputFormat::Mp4 => Box::new(VideoSink::<Mp4Encoder>::open(self.path(), options)?),
            OutputFormat::Apng => Box::new(VideoSink::<ApngEncoder>::open(self.path(), options)?),
        })
    }

    /// Checks that `options` suit the format, without touching the disk.
    ///
    /// # Errors
    /// Only errors for which [`OutputError::is_usage`] holds.
    pub fn check(&self, options: &OutputOptions) -> Result<(), OutputError> {
        let path = || self.path().to_owned();
        let (width, height) = (options.width, options.height);
        let size = |reason: String| {
            Err(OutputError::Size {
                path: path(),
                width,
                height,
                reason,
            })
        };
        if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
            return size(format!(
                "is not from 1x1 to {MAX_SIDE}x{MAX_SIDE}: choose a size such as 960x540"
            ));
        }
        if self.format() == OutputFormat::Mp4
            && let Some(reason) = mp4::size_problem(width, height)
        {
            return size(reason);
        }
        let rate = options.frames_per_second;
        if !self.is_sequence_format() && !(1.0..=1000.0).contains(&rate) {
            return Err(OutputError::FrameRate { path: path(), rate });
        }
        if options.frames.is_empty() {
            return Err(OutputError::NoFrames { path: path() });
        }
        if self.is_sequence_format() && !self.has_pattern() && options.frames.len() > 1 {
            let stem = self
                .path()
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy();
            let extension = self
                .path()
                .extension()
                .unwrap_or_default()
                .to_string_lossy();
            return Err(OutputError::SingleFile {
                path: path(),
                count: options.frames.len(),
                example: self
                    .path()
                    .with_file_name(format!("{stem}_%04d.{extension}")),
            });
        }
        Ok(())
    }
}

/// [`to_srgb8`], and the time it took.
pub(super) fn tone_map(image: &Image) -> (Vec<u8>, Duration) {
    let started = Instant::now();
    let rgb = to_srgb8(image);
    (rgb, started.elapsed())
}

/// Refuses a picture whose size is not the one the output was opened with.
pub(super) fn check_image(
    path: &std::path::Path,
    options: &OutputOptions,
    index: usize,
    image: &Image,
) -> Result<(), OutputError> {
    let expected = (options.width, options.height);
    let pixels = options.width as usize * options.height as usize;
    let reason = if (image.width, image.height) != expected || image.pixels.len() != pixels {
        format!(
            "pictures of {}x{} pixels were announced",
            expected.0, expected.1
        )
    } else if !options.frames.contains(&index) {
        format!("frames {:?} were announced", options.frames)
    } else {
        return Ok(());
    };
    Err(OutputError::Misuse {
        path: path.to_owned(),
        frame: index,
        reason,
    })
}
