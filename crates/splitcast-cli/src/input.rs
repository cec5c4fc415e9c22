//! What INPUT stands for: a built-in scene or mesh files.

use std::path::{Path, PathBuf};

use splitcast_scene::{FrameSource, MeshSequence, SceneError, builtin};

use crate::error::{CliError, warn};

/// An opened input.
pub(crate) struct Input {
    pub(crate) source: Box<dyn FrameSource>,
    /// The file of each frame; none for built-in scenes.
    files: Vec<PathBuf>,
}

impl Input {
    /// Opens a built-in scene if there is one of that name, mesh files
    /// otherwise, and tells of what looks odd about those.
    pub(crate) fn open(input: &Path) -> Result<Self, CliError> {
        if let Some(source) = input.to_str().and_then(builtin::open) {
            return Ok(Self {
                source,
                files: Vec::new(),
            });
        }
        let sequence = match MeshSequence::open(input) {
            // A bare name was more likely meant for a scene than for a file.
            Err(SceneError::Missing { .. })
                if input.components().count() == 1 && input.extension().is_none() =>
            {
                return Err(CliError::Missing {
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

    /// The file that frame `index` is read from, or the scene's name.
    pub(crate) fn place(&self, index: usize) -> String {
        match self.files.get(index) {
            Some(file) => file.display().to_string(),
            None => self.source.name().to_owned(),
        }
    }
}

/// The names of the built-in scenes as a list in words.
pub(crate) fn scene_names() -> String {
    builtin::names().collect::<Vec<_>>().join(", ")
}
