//! All frames in one file: what MP4 and APNG share.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::atomic;
use super::error::OutputError;
use super::sink::{FrameSink, OutputOptions, Resumed, check_image, tone_map};
use super::spool::Spool;
use crate::Image;

/// Why an encoder stopped.
pub(super) enum EncodeFailure {
    /// The disk's fault.
    Io(io::Error),
    /// The encoder's fault, in its own words.
    Encoder(String),
}

impl EncodeFailure {
    fn at(self, path: &Path, frame: usize) -> OutputError {
        match self {
            Self::Io(source) => OutputError::io(path, source),
            Self::Encoder(reason) => OutputError::Encode {
                path: path.to_owned(),
                frame,
                reason,
            },
        }
    }
}

impl From<io::Error> for EncodeFailure {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<::png::EncodingError> for EncodeFailure {
    fn from(error: ::png::EncodingError) -> Self {
        match error {
            ::png::EncodingError::IoError(error) => Self::Io(error),
            other => Self::Encoder(other.to_string()),
        }
    }
}

impl From<String> for EncodeFailure {
    fn from(reason: String) -> Self {
        Self::Encoder(reason)
    }
}

/// Turns frames into one file. `draft` is where that file may grow: it lies in
/// the spool's folder and is renamed when the encoder has finished.
pub(super) trait VideoEncoder: Send + Sized {
    /// Starts a video with the given options.
    fn start(draft: &Path, options: &OutputOptions) -> Result<Self, EncodeFailure>;

    /// Adds one frame of 8-bit sRGB pixels.
    fn push(&mut self, rgb: &[u8]) -> Result<(), EncodeFailure>;

    /// Completes the file `draft`.
    fn finish(self, draft: &Path) -> Result<(), EncodeFailure>;
}

/// Spools and encodes frames as they come.
pub(super) struct VideoSink<E> {
    target: PathBuf,
    options: OutputOptions,
    spool: Spool,
    resumed: Resumed,
    encoder: E,
    /// The first frame the encoder has not had yet.
    next: usize,
}

impl<E: VideoEncoder> VideoSink<E> {
    pub(super) fn open(target: &Path, options: OutputOptions) -> Result<Self, OutputError> {
        atomic::check_writable(target)?;
        let (spool, resumed) = Spool::open(target, &options)?;
        let encoder = E::start(&spool.video_path(), &options)
            .map_err(|failure| failure.at(target, options.frames.start))?;
        Ok(Self {
            target: target.to_owned(),
            next: options.frames.start,
            options,
            spool,
            resumed,
            encoder,
        })
    }

    fn push(&mut self, rgb: &[u8]) -> Result<(), OutputError> {
        let frame = self.next;
        self.next += 1;
        self.encoder
            .push(rgb)
            .map_err(|failure| failure.at(&self.target, frame))
    }

    /// Feeds the encoder with frames of the earlier run, up to before `end`.
    fn catch_up(&mut self, end: usize) -> Result<(), OutputError> {
        while self.next < end {
            let index = self.next;
            let rgb =
                self.spool
                    .load(index, &self.options)
                    .map_err(|reason| OutputError::Misuse {
                        path: self.spool.frame_path(index),
                        frame: index,
                        reason: reason.unwrap_or_else(|| "it was never written".to_owned()),
                    })?;
            self.push(&rgb)?;
        }
        Ok(())
    }
}

impl<E: VideoEncoder> FrameSink for VideoSink<E> {
    fn resumed(&self) -> &Resumed {
        &self.resumed
    }

    fn write(&mut self, index: usize, image: &Image) -> Result<Duration, OutputError> {
        check_image(&self.target, &self.options, index, image)?;
        if index < self.next {
            return Err(OutputError::Misuse {
                path: self.target.clone(),
                frame: index,
                reason: format!("frame {} is the next one", self.next),
            });
        }
        self.catch_up(index)?;
        let (rgb, tone_mapping) = tone_map(image);
        self.spool.store(index, &rgb, &self.options)?;
        self.push(&rgb)?;
        Ok(tone_mapping)
    }

    fn finish(mut self: Box<Self>) -> Result<(), OutputError> {
        self.catch_up(self.options.frames.end)?;
        let draft = self.spool.video_path();
        self.encoder
            .finish(&draft)
            .map_err(|failure| failure.at(&self.target, self.next - 1))?;
        atomic::publish(&draft, &self.target)?;
        self.spool.clear()
    }
}
