//! Finished frames of an unfinished video.
//!
//! A video is one file that exists only when whole, so what an interrupted run
//! has rendered is kept beside it: `film.mp4.partial/` holds each finished
//! frame as a lossless PNG until the video is complete. A resumed run feeds
//! these to the encoder instead of rendering them, which gives the same bytes
//! as a run without interruption.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use ::png::Compression;
use splitcast_scene::write_atomically;

use super::error::OutputError;
use super::sink::{OutputOptions, Resumed};
use super::{atomic, png};

/// The folder of one video's finished frames.
pub(super) struct Spool {
    folder: PathBuf,
}

impl Spool {
    /// Makes the folder for the video at `target`, looks through what is in it
    /// when resuming, and empties it otherwise.
    pub(super) fn open(
        target: &Path,
        options: &OutputOptions,
    ) -> Result<(Self, Resumed), OutputError> {
        let folder = atomic::with_suffix(target, ".partial");
        match fs::create_dir(&folder) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                return Err(OutputError::io(&folder, error));
            }
            _ => atomic::check_writable(&folder.join("probe"))?,
        }
        let spool = Self { folder };
        let mut resumed = Resumed::default();
        if !options.resume {
            spool.clear()?;
            return Ok((spool, resumed));
        }
        for index in options.frames.clone() {
            match spool.load(index, options) {
                Ok(_) => resumed.whole.push(index),
                Err(None) => {}
                Err(Some(reason)) => {
                    resumed.stale += 1;
                    resumed.difference.get_or_insert(reason);
                }
            }
        }
        Ok((spool, resumed))
    }

    /// Where the video may grow before it is renamed into place.
    pub(super) fn video_path(&self) -> PathBuf {
        self.folder.join("video")
    }

    /// Keeps one finished frame, 8-bit sRGB.
    pub(super) fn store(
        &self,
        index: usize,
        rgb: &[u8],
        options: &OutputOptions,
    ) -> Result<(), OutputError> {
        let path = self.frame_path(index);
        let (width, height) = (options.width, options.height);
        let bytes = png::encode(width, height, rgb, &options.settings, Compression::Fast)
            .map_err(|error| OutputError::io(&path, io::Error::other(error)))?;
        write_atomically(&path, |out| out.write_all(&bytes))
            .map_err(|error| OutputError::io(&path, error))
    }

    /// The pixels of a frame that is whole and made with the same settings;
    /// otherwise the reason, or nothing when there is no such frame.
    pub(super) fn load(
        &self,
        index: usize,
        options: &OutputOptions,
    ) -> Result<Vec<u8>, Option<String>> {
        let file = match File::open(self.frame_path(index)) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(None),
            Err(error) => return Err(Some(format!("they cannot be read ({error})"))),
        };
        png::decode(file, options.width, options.height, &options.settings).map_err(Some)
    }

    /// The file of one frame.
    pub(super) fn frame_path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("frame_{index:06}.png"))
    }

    /// Removes the files that are ours; someone else's stay.
    pub(super) fn clear(&self) -> Result<(), OutputError> {
        let failed = |error| OutputError::io(&self.folder, error);
        for entry in fs::read_dir(&self.folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let ours = name == "video"
                || (name.starts_with("frame_") && name.ends_with(".png"))
                || (name.starts_with(".splitcast-") && name.ends_with(".tmp"));
            if ours {
                fs::remove_file(entry.path())
                    .map_err(|error| OutputError::io(&entry.path(), error))?;
            }
        }
        Ok(())
    }
}

impl Drop for Spool {
    fn drop(&mut self) {
        // What cannot be removed is found and told of when the folder is next opened. The
        // folder goes only if it holds no frames: removing it fails otherwise.
        let _ = fs::remove_file(self.video_path());
        let _ = fs::remove_dir(&self.folder);
    }
}
