//! An input that has been looked through and is ready to be measured.

use std::path::Path;
use std::sync::Arc;

use splitcast::{BuildOptions, NonFinite};
use splitcast_console::{Excerpt, FrameRange, Input, Progress, Watched, warn};
use splitcast_scene::{Frame, SequenceInfo};

use crate::error::CliError;
use crate::trees::{mesh, try_build};

/// An input, and which of its frames are measured.
pub(crate) struct Scene {
    pub(crate) name: String,
    pub(crate) info: SequenceInfo,
    /// Which frames of the excerpt are measured; never empty.
    pub(crate) measured: Vec<usize>,
    /// What a reader of the results has to know.
    pub(crate) notes: Vec<String>,
    excerpt: Excerpt,
}

impl Scene {
    /// Opens an input and goes through the frames asked for, so that a bad one
    /// is found before any is measured.
    pub(crate) fn open(
        input: &Path,
        range: Option<FrameRange>,
        options: &BuildOptions,
    ) -> Result<Self, CliError> {
        let input = Input::open(input)?;
        let range = input.frame_range(range)?;
        let mut excerpt = Excerpt::new(input, range);
        let mut progress = Progress::new("reading", excerpt.len());
        let info = SequenceInfo::measure(&mut Watched {
            source: &mut excerpt,
            watch: |_: &Frame| progress.step(""),
        })?;
        drop(progress);
        let name = info.name.clone();
        let (mut measured, mut notes) = (Vec::new(), Vec::new());
        for index in 0..info.frames.len() {
            if has_no_triangle(&mut excerpt, index, &info, options)? {
                let note = format!(
                    "Frame {} ({}) has no triangle to build a tree over. It is left out; \
                     what is tracked goes on behind it as it was.",
                    excerpt.number(index),
                    excerpt.place(index)
                );
                warn(&note);
                notes.push(note);
            } else {
                measured.push(index);
            }
        }
        if measured.is_empty() {
            return Err(CliError::NothingToMeasure { name });
        }
        Ok(Self {
            name,
            info,
            measured,
            notes,
            excerpt,
        })
    }

    /// Those of the measured frames whose triangles differ from those of the one before.
    pub(crate) fn topology_changes(&mut self) -> Result<Vec<usize>, CliError> {
        Ok(self.excerpt.topology_changes(&self.measured)?)
    }

    /// Frame `index` of the excerpt.
    pub(crate) fn frame(&mut self, index: usize) -> Result<Arc<Frame>, CliError> {
        Ok(self.excerpt.get(index)?)
    }

    /// The number in the input of frame `index` of the excerpt.
    pub(crate) fn number(&self, index: usize) -> usize {
        self.excerpt.number(index)
    }

    /// Where frame `index` of the excerpt comes from.
    pub(crate) fn place(&self, index: usize) -> String {
        self.excerpt.place(index)
    }
}

/// A frame with its name for messages.
pub(crate) struct FrameAt<'f> {
    pub(crate) frame: &'f Frame,
    pub(crate) number: usize,
    pub(crate) place: String,
}

impl<'f> FrameAt<'f> {
    pub(crate) fn new(scene: &Scene, index: usize, frame: &'f Frame) -> Self {
        Self {
            frame,
            number: scene.number(index),
            place: scene.place(index),
        }
    }
}

/// Whether a frame has nothing to build a tree over. Refuses a frame with
/// vertices that are not finite, unless their triangles are to be skipped.
fn has_no_triangle(
    excerpt: &mut Excerpt,
    index: usize,
    info: &SequenceInfo,
    options: &BuildOptions,
) -> Result<bool, CliError> {
    let found = info.frames[index];
    if found.non_finite == 0 || found.triangles == 0 {
        return Ok(found.triangles == 0);
    }
    let (number, place) = (excerpt.number(index), excerpt.place(index));
    let frame = excerpt.get(index)?;
    match options.non_finite {
        NonFinite::Reject => {
            try_build(&frame, options, number, &place)?;
            Ok(false)
        }
        NonFinite::Skip => {
            let mesh = mesh(&frame, number, &place)?;
            Ok(!(0..found.triangles as u32).any(|triangle| mesh.is_traceable(triangle)))
        }
    }
}
