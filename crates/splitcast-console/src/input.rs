//! What INPUT stands for: a built-in scene or mesh files.

use std::ops::Range;
use std::path::{Path, PathBuf};

use splitcast_scene::{FrameSource, MeshSequence, SceneError, builtin};

use crate::frame_range::FrameRange;
use crate::message::warn;

/// Why an input could not be opened or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A bare name that is neither a scene nor a file.
    #[error("{}: no such built-in scene, file or folder; the scenes are: {scenes}", input.display())]
    Missing {
        /// The name.
        input: PathBuf,
        /// The names that would have been scenes, as a list in words.
        scenes: String,
    },
    /// Frames were asked for that the input does not have.
    #[error(
        "--frames {range} is out of range: {name} has {count} frames, so the largest range is 0:{count}"
    )]
    Frames {
        /// What was asked for.
        range: FrameRange,
        /// The input's name.
        name: String,
        /// Number of its frames.
        count: usize,
    },
    /// The scene or its files.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl InputError {
    /// Whether the request itself is at fault, so that no retry can help.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Missing { .. } => false,
            Self::Frames { .. } => true,
            Self::Scene(error) => matches!(
                error,
                SceneError::FrameOutOfRange { .. }
                    | SceneError::UnknownExtension { .. }
                    | SceneError::BadPattern { .. }
            ),
        }
    }
}

/// An opened input.
pub struct Input {
    /// Yields all of its frames.
    pub source: Box<dyn FrameSource>,
    /// The file of each frame; none for built-in scenes.
    files: Vec<PathBuf>,
}

impl Input {
    /// Opens a built-in scene if there is one of that name, mesh files
    /// otherwise, and warns of what looks odd about those.
    ///
    /// # Errors
    /// [`InputError::Missing`], or what a scene's files were refused for.
    pub fn open(input: &Path) -> Result<Self, InputError> {
        if let Some(source) = input.to_str().and_then(builtin::open) {
            return Ok(Self::of(source));
        }
        let sequence = match MeshSequence::open(input) {
            // A bare name was more likely meant for a scene than for a file.
            Err(SceneError::Missing { .. })
                if input.components().count() == 1 && input.extension().is_none() =>
            {
                return Err(InputError::Missing {
                    input: input.to_owned(),
                    scenes: scene_names(),
                });
            }
            sequence => sequence?,
        };
        for warning in sequence.warnings() {
            warn(&format!("{}: {warning}", input.display()));
        }
        Ok(Self {
            files: sequence.files().to_vec(),
            source: Box::new(sequence),
        })
    }

    /// Frames that come from no files.
    pub(crate) fn of(source: Box<dyn FrameSource>) -> Self {
        Self {
            source,
            files: Vec::new(),
        }
    }

    /// The frames asked for, or all; a range that ends behind the last frame is
    /// refused rather than cut, since the result would be shorter than expected.
    ///
    /// # Errors
    /// [`InputError::Frames`].
    pub fn frame_range(&self, range: Option<FrameRange>) -> Result<Range<usize>, InputError> {
        let count = self.source.frame_count();
        let Some(range) = range else {
            return Ok(0..count);
        };
        let end = range.end.unwrap_or(count);
        if range.start < end && end <= count {
            return Ok(range.start..end);
        }
        Err(InputError::Frames {
            range,
            name: self.source.name().to_owned(),
            count,
        })
    }

    /// The file that frame `index` is read from, or the scene's name.
    pub fn place(&self, index: usize) -> String {
        match self.files.get(index) {
            Some(file) => file.display().to_string(),
            None => self.source.name().to_owned(),
        }
    }
}

/// The names of the built-in scenes as a list in words.
pub fn scene_names() -> String {
    builtin::names().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse_frames;

    #[test]
    fn ranges_are_within_the_input() {
        let input = Input::open(Path::new("horse")).unwrap();
        let count = input.source.frame_count();
        let range = |text: &str| input.frame_range(parse_frames(text).ok());
        assert_eq!(input.frame_range(None).unwrap(), 0..count);
        assert_eq!(range("2:").unwrap(), 2..count);
        assert_eq!(range("2:3").unwrap(), 2..3);
        let ends_behind = format!("0:{}", count + 1);
        for bad in [&format!("{count}:"), &ends_behind] {
            let error = range(bad).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!(
                    "--frames {bad} is out of range: horse has {count} frames, so the largest \
                     range is 0:{count}"
                )
            );
            assert!(error.is_usage());
        }
    }

    #[test]
    fn bare_names_are_taken_for_scenes() {
        let error = Input::open(Path::new("horsse")).err().unwrap();
        assert!(error.to_string().contains(&scene_names()), "{error}");
        assert!(!error.is_usage());
        let error = Input::open(Path::new("horsse.xyz")).err().unwrap();
        assert!(matches!(error, InputError::Scene(_)), "{error}");
    }
}
