//! One file a frame: PNG and EXR sequences.

use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::time::Duration;

use ::png::Compression;
use splitcast_scene::write_atomically;

use super::error::OutputError;
use super::sink::{FrameSink, OutputOptions, Resumed, check_image, tone_map};
use super::spec::{OutputFormat, OutputSpec};
use super::{atomic, exr, png};
use crate::Image;

/// Writes every frame as soon as it comes; there is nothing left to finish.
pub(super) struct SequenceSink {
    spec: OutputSpec,
    options: OutputOptions,
    resumed: Resumed,
}

impl SequenceSink {
    /// Checks every place a frame will go to, and, when resuming, every frame
    /// that is there.
    pub(super) fn open(spec: OutputSpec, options: OutputOptions) -> Result<Self, OutputError> {
        atomic::check_writable(&spec.frame_path(options.frames.start))?;
        let mut resumed = Resumed::default();
        for index in options.frames.clone() {
            let path = spec.frame_path(index);
            match fs::metadata(&path) {
                Ok(data) if data.is_dir() || data.permissions().readonly() => {
                    atomic::check_writable(&path)?;
                }
                Ok(_) if options.resume => match check_frame(&spec, &path, &options) {
                    Ok(()) => resumed.whole.push(index),
                    Err(reason) => {
                        resumed.stale += 1;
                        resumed.difference.get_or_insert(reason);
                    }
                },
                _ => {}
            }
        }
        Ok(Self {
            spec,
            options,
            resumed,
        })
    }
}

impl FrameSink for SequenceSink {
    fn resumed(&self) -> &Resumed {
        &self.resumed
    }

    fn write(&mut self, index: usize, image: &Image) -> Result<Duration, OutputError> {
        let path = self.spec.frame_path(index);
        check_image(&path, &self.options, index, image)?;
        let failed = |reason: String| OutputError::Encode {
            path: path.clone(),
            frame: index,
            reason,
        };
        let settings = &self.options.settings;
        let (bytes, tone_mapping) = if self.spec.format() == OutputFormat::Exr {
            let bytes = exr::encode(image, settings).map_err(|error| failed(error.to_string()))?;
            (bytes, Duration::ZERO)
        } else {
            let (rgb, tone_mapping) = tone_map(image);
            let bytes = png::encode(
                image.width,
                image.height,
                &rgb,
                settings,
                Compression::Balanced,
            )
            .map_err(|error| failed(error.to_string()))?;
            (bytes, tone_mapping)
        };
        write_atomically(&path, |out| out.write_all(&bytes))
            .map_err(|error| OutputError::io(&path, error))?;
        Ok(tone_mapping)
    }

    fn finish(self: Box<Self>) -> Result<(), OutputError> {
        Ok(())
    }
}

fn check_frame(spec: &OutputSpec, path: &Path, options: &OutputOptions) -> Result<(), String> {
    let (width, height, settings) = (options.width, options.height, &options.settings);
    if spec.format() == OutputFormat::Exr {
        return exr::check(path, width, height, settings);
    }
    let open = |error: io::Error| format!("they cannot be read ({error})");
    let file = File::open(path).map_err(open)?;
    png::decode(file, width, height, settings).map(|_| ())
}
