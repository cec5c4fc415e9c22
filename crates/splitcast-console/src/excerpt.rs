//! Frames that are gone through more than once.

use std::ops::Range;
use std::sync::Arc;

use splitcast_scene::{Frame, FrameSource, SceneError};

use crate::input::Input;

/// Most bytes of frames that are kept in memory; what does not fit is read
/// again every time. Enough for 252,500 triangles in 100 frames.
const KEPT_BYTES: usize = 512 << 20;

/// A range of an input's frames, kept in memory as far as there is room.
///
/// Its frames are counted from 0; a frame that a file refuses because it has no
/// geometry is an empty frame here.
pub struct Excerpt {
    input: Input,
    range: Range<usize>,
    kept: Vec<Option<Arc<Frame>>>,
    /// Bytes that may still be kept.
    room: usize,
}

impl Excerpt {
    /// The frames `range` of `input`, none of which is read yet.
    pub fn new(input: Input, range: Range<usize>) -> Self {
        Self {
            kept: vec![None; range.len()],
            input,
            range,
            room: KEPT_BYTES,
        }
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.range.len()
    }

    /// Whether the range holds no frame.
    pub fn is_empty(&self) -> bool {
        self.range.is_empty()
    }

    /// The number in the input of frame `index`.
    pub fn number(&self, index: usize) -> usize {
        self.range.start + index
    }

    /// Where frame `index` comes from: its file, or the scene's name.
    pub fn place(&self, index: usize) -> String {
        self.input.place(self.number(index))
    }

    /// Frame `index`, from memory if it was kept there.
    ///
    /// # Errors
    /// Whatever kept the frame from being read.
    ///
    /// # Panics
    /// If `index` is not below [`len`](Self::len).
    pub fn get(&mut self, index: usize) -> Result<Arc<Frame>, SceneError> {
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

    /// Those of `frames` whose triangles differ from those of the one before.
    ///
    /// # Errors
    /// Whatever kept one of the frames from being read.
    ///
    /// # Panics
    /// As [`get`](Self::get).
    pub fn topology_changes(&mut self, frames: &[usize]) -> Result<Vec<usize>, SceneError> {
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
        self.len()
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

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    /// Frames of one triangle, wound the other way from frame 3 on; the last
    /// has none. Notes what is read.
    struct Triangles(Arc<Mutex<Vec<usize>>>);

    const COUNT: usize = 6;

    impl FrameSource for Triangles {
        fn name(&self) -> &str {
            "triangles"
        }

        fn frame_count(&self) -> usize {
            COUNT
        }

        fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
            self.0.lock().unwrap().push(index);
            if index == COUNT - 1 {
                return Err(SceneError::NoGeometry {
                    path: "triangles".into(),
                    what: "triangles",
                });
            }
            let triangle = if index < 3 { [0, 1, 2] } else { [0, 2, 1] };
            Ok(Frame {
                positions: vec![[index as f32; 3]; 3],
                triangles: Arc::new(vec![triangle]),
                ..Frame::default()
            })
        }
    }

    /// Frames from 1 on, with room for so many of them, and what is read.
    fn excerpt(room: usize) -> (Excerpt, Arc<Mutex<Vec<usize>>>) {
        let read = Arc::new(Mutex::new(Vec::new()));
        let source = Box::new(Triangles(Arc::clone(&read)));
        let mut excerpt = Excerpt::new(Input::of(source), 1..COUNT);
        let one = excerpt.input.source.frame(0).unwrap();
        excerpt.room = room * bytes(&one);
        read.lock().unwrap().clear();
        (excerpt, read)
    }

    #[test]
    fn what_does_not_fit_is_read_again() {
        let (mut excerpt, read) = excerpt(2);
        for _ in 0..2 {
            for index in 0..3 {
                let frame = excerpt.get(index).unwrap();
                assert_eq!(frame.positions[0][0] as usize, excerpt.number(index));
            }
        }
        assert_eq!(*read.lock().unwrap(), [1, 2, 3, 3]);
        assert_eq!((excerpt.len(), excerpt.is_empty()), (COUNT - 1, false));
    }

    #[test]
    fn changes_are_of_content_and_an_empty_frame_is_one() {
        let (mut excerpt, _) = excerpt(COUNT);
        assert!(excerpt.get(4).unwrap().triangles.is_empty());
        assert_eq!(excerpt.topology_changes(&[0, 1, 2, 3, 4]).unwrap(), [2, 4]);
        assert!(excerpt.topology_changes(&[0, 1]).unwrap().is_empty());
    }
}
