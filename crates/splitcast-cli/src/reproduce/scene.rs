//! An input that has been looked through and is ready to be measured.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use splitcast::{NonFinite, SequenceBuilder};
use splitcast_scene::{Frame, FrameSource, SceneError, SequenceInfo};

use crate::args::FrameRange;
use crate::error::{CliError, warn};
use crate::input::{Input, Watched, build_tree, mesh};
use crate::progress::Progress;
use crate::summary::count;

/// Most bytes of frames that one scene keeps in memory; what does not fit is
/// read again in every round. Enough for 252,500 triangles in 100 frames.
const KEPT_BYTES: usize = 512 << 20;

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
        let mut progress = Progress::new("reading", excerpt.range.len());
        let info = SequenceInfo::measure(&mut Watched {
            source: &mut excerpt,
            watch: |_: &Frame| progress.step(""),
        })?;
        drop(progress);
        let name = info.name.clone();
        let (mut measured, mut notes) = (Vec::new(), Vec::new());
        for index in 0..info.frames.len() {
            if excerpt.is_empty(index, &info, builder)? {
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

/// A range of an input's frames, kept in memory as far as there is room.
struct Excerpt {
    input: Input,
    range: Range<usize>,
    kept: Vec<Option<Arc<Frame>>>,
    /// Bytes that may still be kept.
    room: usize,
}

impl Excerpt {
    fn new(input: Input, range: Range<usize>) -> Self {
        Self {
            kept: vec![None; range.len()],
            input,
            range,
            room: KEPT_BYTES,
        }
    }

    fn number(&self, index: usize) -> usize {
        self.range.start + index
    }

    fn place(&self, index: usize) -> String {
        self.input.place(self.number(index))
    }

    fn get(&mut self, index: usize) -> Result<Arc<Frame>, SceneError> {
        if let Some(frame) = &self.kept[index] {
            return Ok(Arc::clone(frame));
        }
        let frame = match self.input.source.frame(self.number(index)) {
            // Refused as a file, but no reason to give up on a sequence.
            Err(SceneError::NoGeometry { .. }) => Frame::default(),
            frame => frame?,
        };
        let frame = Arc::new(frame);
        if let Some(room) = self.room.checked_sub(bytes(&frame)) {
            self.room = room;
            self.kept[index] = Some(Arc::clone(&frame));
        }
        Ok(frame)
    }

    /// Whether a frame has nothing to build a tree over. Refuses a frame with
    /// vertices that are not finite, unless their triangles are to be skipped.
    fn is_empty(
        &mut self,
        index: usize,
        info: &SequenceInfo,
        builder: &SequenceBuilder,
    ) -> Result<bool, CliError> {
        let found = info.frames[index];
        if found.non_finite == 0 || found.triangles == 0 {
            return Ok(found.triangles == 0);
        }
        let (number, place) = (self.number(index), self.place(index));
        let frame = self.get(index)?;
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

    /// Those of `frames` whose triangles differ from those of the one before.
    fn topology_changes(&mut self, frames: &[usize]) -> Result<Vec<usize>, SceneError> {
        let mut changes = Vec::new();
        for pair in frames.windows(2) {
            let (before, after) = (self.get(pair[0])?, self.get(pair[1])?);
            let shared = Arc::ptr_eq(&before.triangles, &after.triangles);
            if !shared && before.triangles != after.triangles {
                changes.push(pair[1]);
            }
        }
        Ok(changes)
    }
}

impl FrameSource for Excerpt {
    fn name(&self) -> &str {
        self.input.source.name()
    }

    fn frame_count(&self) -> usize {
        self.range.len()
    }

    fn frames_per_second(&self) -> f32 {
        self.input.source.frames_per_second()
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        let frame = self.get(index)?;
        Ok(Arc::try_unwrap(frame).unwrap_or_else(|frame| Frame::clone(&frame)))
    }
}

/// Bytes of a frame's own data. Triangles and colours count in full, though
/// frames of one topology share them.
fn bytes(frame: &Frame) -> usize {
    let normals = frame.normals.as_ref().map_or(0, Vec::len);
    let colors = frame.colors.as_ref().map_or(0, |colors| colors.len());
    size_of_val(&frame.positions[..])
        + size_of_val(&frame.triangles[..])
        + normals * size_of::<[f32; 3]>()
        + colors * size_of::<[u8; 3]>()
}
