//! Looking at frames on their way.

use splitcast_scene::{Frame, FrameSource, SceneError};

/// Lets frames through and shows each to `watch`.
pub struct Watched<'s, W> {
    /// Where the frames come from.
    pub source: &'s mut dyn FrameSource,
    /// Is shown every frame that could be had.
    pub watch: W,
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
