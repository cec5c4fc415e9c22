//! One line on standard error and an exit code for everything that goes wrong.

use std::io;

use splitcast_console::{FileError, InputError, ProgramError};
use splitcast_render::{OutputError, RenderError};
use splitcast_scene::SceneError;

/// Why a command ended early.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// Flags that do not fit each other or the input.
    #[error("{0}")]
    Usage(String),
    /// A frame of the input cannot be rendered.
    #[error("frame {index} ({place}): {reason}")]
    Frame {
        index: usize,
        /// The frame's file, or the scene's name.
        place: String,
        reason: String,
    },
    /// No frame of the input has a triangle to build a tree over.
    #[error("{name}: no frame has a triangle to build a tree over, so there is nothing to measure")]
    NothingToMeasure { name: String },
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file of the command's own, such as the one of `--json`.
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the {0} threads could not be started: choose fewer with --threads")]
    Threads(usize),
    /// Standard output or standard error.
    #[error("standard output: {0}")]
    Stdout(#[from] io::Error),
}

/// Through [`InputError`], which alone decides whether a scene's error is one of usage.
impl From<SceneError> for CliError {
    fn from(error: SceneError) -> Self {
        InputError::from(error).into()
    }
}

impl ProgramError for CliError {
    fn is_usage(&self) -> bool {
        match self {
            Self::Usage(_) => true,
            Self::Input(error) => error.is_usage(),
            // Options, camera and views come from the flags alone.
            Self::Render(error) => !matches!(
                error,
                RenderError::FrameMismatch { .. } | RenderError::AttributeLength { .. }
            ),
            Self::Output(error) => error.is_usage(),
            _ => false,
        }
    }

    fn of_stdout(&self) -> Option<&io::Error> {
        match self {
            Self::Stdout(error) => Some(error),
            _ => None,
        }
    }
}
