//! An input that has been looked through and is ready to be measured.

use std::path::Path;
use std::sync::Arc;

use splitcast::{NonFinite, SequenceBuilder};
use splitcast_console::{Excerpt, FrameRange, Input, Progress, Watched, count, warn};
use splitcast_scene::{Frame, SequenceInfo};

use crate::error::CliError;
use crate::trees::{build_tree, mesh};

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
        builder: &SequenceBuilder,
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
            if has_no_triangle(&mut excerpt, index, &info, builder)? {
                let note = format!(
                    "Frame {} ({}) has no triangle to build a tree over. It is left out; the \
                     filters go on behind it with what they knew before.",
                    excerpt.number(index),
                    excerpt.place(index)
                );
                warn(&note);
                notes.push(note);
            } else {
                measured.push(index);
            }
        }
        let Some(&first) = measured.first() else {
            return Err(CliError::NothingToMeasure { name });
        };
        if measured.len() == 1 {
            notes.push(format!(
                "Only frame {} is measured, so there is no running build, and every figure of one \
                 is missing.",
                excerpt.number(first)
            ));
        }
        let changes = excerpt.topology_changes(&measured)?;
        if let Some(&first) = changes.first() {
            notes.push(format!(
                "The triangles change {}, first at frame {}. Tracking goes on across such a \
                 change, since it follows planes and not vertices.",
                count(changes.len(), "time"),
                excerpt.number(first)
            ));
        }
        Ok(Self {
            name,
            info,
            measured,
            notes,
            excerpt,
        })
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

/// Whether a frame has nothing to build a tree over. Refuses a frame with
/// vertices that are not finite, unless their triangles are to be skipped.
fn has_no_triangle(
    excerpt: &mut Excerpt,
    index: usize,
    info: &SequenceInfo,
    builder: &SequenceBuilder,
) -> Result<bool, CliError> {
    let found = info.frames[index];
    if found.non_finite == 0 || found.triangles == 0 {
        return Ok(found.triangles == 0);
    }
    let (number, place) = (excerpt.number(index), excerpt.place(index));
    let frame = excerpt.get(index)?;
    match builder.options().non_finite {
        NonFinite::Reject => {
            build_tree(&frame, &mut builder.clone(), number, &place)?;
            Ok(false)
        }
        NonFinite::Skip => {
            let mesh = mesh(&frame, number, &place)?;
            Ok(!(0..found.triangles as u32).any(|triangle| mesh.is_traceable(triangle)))
        }
    }
}
