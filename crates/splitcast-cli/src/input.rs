//! What INPUT stands for: a built-in scene or mesh files.

use std::ops::Range;
use std::path::{Path, PathBuf};

use splitcast::{BuildError, KdTree, Mesh, NonFinite, SequenceBuilder};
use splitcast_scene::{Frame, FrameSource, MeshSequence, SceneError, SequenceInfo, builtin};

use crate::args::FrameRange;
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

    /// The frames asked for, or all; a range that ends behind the last frame is
    /// refused rather than cut, since the result would be shorter than expected.
    pub(crate) fn frame_range(&self, range: Option<FrameRange>) -> Result<Range<usize>, CliError> {
        let count = self.source.frame_count();
        let Some(range) = range else {
            return Ok(0..count);
        };
        let end = range.end.unwrap_or(count);
        if range.start < end && end <= count {
            return Ok(range.start..end);
        }
        Err(CliError::Usage(format!(
            "--frames {}:{} is out of range: {} has {count} frames, so the largest range is 0:{count}",
            range.start,
            range.end.map_or(String::new(), |end| end.to_string()),
            self.source.name(),
        )))
    }

    /// Finds the first of `frames` that cannot be built because of its
    /// vertices, before work is spent on the frames in front of it. `info` is
    /// that of the whole input.
    pub(crate) fn refuse_non_finite(
        &mut self,
        info: &SequenceInfo,
        frames: Range<usize>,
        builder: &SequenceBuilder,
    ) -> Result<(), CliError> {
        if builder.options().non_finite == NonFinite::Skip {
            return Ok(());
        }
        for index in frames {
            if info.frames[index].non_finite > 0 {
                let frame = self.source.frame(index)?;
                build_tree(&frame, &mut builder.clone(), index, &self.place(index))?;
            }
        }
        Ok(())
    }

    /// The file that frame `index` is read from, or the scene's name.
    pub(crate) fn place(&self, index: usize) -> String {
        match self.files.get(index) {
            Some(file) => file.display().to_string(),
            None => self.source.name().to_owned(),
        }
    }
}

/// Lets frames through and shows each to `watch`.
pub(crate) struct Watched<'s, W> {
    pub(crate) source: &'s mut dyn FrameSource,
    pub(crate) watch: W,
}

impl<W: FnMut(&Frame) + Send> FrameSource for Watched<'_, W> {
    fn name(&self) -> &str {
        self.source.name()
    }

    fn frame_count(&self) -> usize {
        self.source.frame_count()
    }

    fn frames_per_second(&self) -> f32 {
        self.source.frames_per_second()
    }

    fn is_periodic(&self) -> bool {
        self.source.is_periodic()
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        let frame = self.source.frame(index)?;
        (self.watch)(&frame);
        Ok(frame)
    }
}

/// The tree of the next frame; an error names the frame and its `place`.
pub(crate) fn build_tree<'f>(
    frame: &'f Frame,
    builder: &mut SequenceBuilder,
    index: usize,
    place: &str,
) -> Result<KdTree<'f>, CliError> {
    builder.build(mesh(frame, index, place)?).map_err(|error| {
        let remedy = if matches!(error, BuildError::NonFinite { .. }) {
            "; use --non-finite skip"
        } else {
            ""
        };
        CliError::Frame {
            index,
            place: place.to_owned(),
            reason: format!("{error}{remedy}"),
        }
    })
}

/// The mesh of a frame; an error names the frame and its `place`.
pub(crate) fn mesh<'f>(frame: &'f Frame, index: usize, place: &str) -> Result<Mesh<'f>, CliError> {
    Mesh::new(&frame.positions, &frame.triangles).map_err(|error| CliError::Frame {
        index,
        place: place.to_owned(),
        reason: error.to_string(),
    })
}

/// The names of the built-in scenes as a list in words.
pub(crate) fn scene_names() -> String {
    builtin::names().collect::<Vec<_>>().join(", ")
}
