//! Reading ahead on a thread of its own.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{Builder, JoinHandle};

use crate::{Frame, FrameSource, SceneError};

/// Frames that wait to be taken. With the one being read and the one in use,
/// at most four are in memory.
const FRAMES_AHEAD: usize = 2;

/// Reads frames of a source ahead of whoever takes them.
///
/// An iterator over the frames asked for, in that order, each with its index.
/// A frame that cannot be read is an error in its place; the frames behind it
/// still come. Dropping the iterator stops the thread, after the frame that it
/// is at.
///
/// # Panics
/// When the source panicked: taking the next frame then panics likewise.
#[derive(Debug)]
pub struct Prefetch {
    frames: Option<Receiver<Result<(usize, Frame), SceneError>>>,
    thread: Option<JoinHandle<()>>,
    /// Why there is no thread; handed out once.
    failure: Option<SceneError>,
}

impl Prefetch {
    /// Starts to read the frames that `indices` names, in its order.
    ///
    /// If no thread can be started, the first item is that error.
    pub fn new<I>(mut source: Box<dyn FrameSource>, indices: I) -> Self
    where
        I: IntoIterator<Item = usize>,
        I::IntoIter: Send + 'static,
    {
        let indices = indices.into_iter();
        let (sender, frames) = sync_channel(FRAMES_AHEAD);
        let read_all = move || {
            for index in indices {
                let item = source.frame(index).map(|frame| (index, frame));
                // The receiver is gone: nobody wants more frames.
                if sender.send(item).is_err() {
                    break;
                }
            }
        };
        let (thread, failure) = match Builder::new().name("prefetch".into()).spawn(read_all) {
            Ok(thread) => (Some(thread), None),
            Err(source) => (None, Some(SceneError::Thread { source })),
        };
        Prefetch {
            frames: Some(frames),
            thread,
            failure,
        }
    }
}

impl Iterator for Prefetch {
    type Item = Result<(usize, Frame), SceneError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(failure) = self.failure.take() {
            return Some(Err(failure));
        }
        if let Ok(item) = self.frames.as_ref()?.recv() {
            return Some(item);
        }
        // The thread has ended, either behind the last frame or by a panic.
        self.frames = None;
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join) {
            resume_unwind(panic);
        }
        None
    }
}

impl Drop for Prefetch {
    fn drop(&mut self) {
        // Closing the channel first wakes a thread that waits to send.
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            // A panic that nobody came to see is not worth a second one.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// Counts the frames it has made, and fails or panics at some.
    struct Counting(Arc<AtomicUsize>);

    impl FrameSource for Counting {
        fn name(&self) -> &str {
            "counting"
        }

        fn frame_count(&self) -> usize {
            1000
        }

        fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
            self.0.fetch_add(1, Ordering::SeqCst);
            assert_ne!(index, 666, "a broken source");
            if index == 13 {
                let (name, count) = ("counting".into(), 13);
                return Err(SceneError::FrameOutOfRange { name, index, count });
            }
            Ok(Frame {
                positions: vec![[index as f32; 3]],
                ..Frame::default()
            })
        }
    }

    #[test]
    fn frames_come_in_order_and_errors_in_their_place() {
        let made = Arc::new(AtomicUsize::new(0));
        let order = [5, 4, 13, 12, 12];
        let mut got = Vec::new();
        for item in Prefetch::new(Box::new(Counting(made.clone())), order) {
            got.push(match item {
                Ok((index, frame)) => {
                    assert_eq!(frame.positions, [[index as f32; 3]]);
                    index
                }
                Err(SceneError::FrameOutOfRange { index, .. }) => index,
                Err(other) => panic!("{other}"),
            });
        }
        assert_eq!(got, order);
        assert_eq!(made.load(Ordering::SeqCst), order.len());
    }

    #[test]
    fn no_more_than_a_few_frames_are_made_ahead_and_dropping_stops() {
        let made = Arc::new(AtomicUsize::new(0));
        let mut frames = Prefetch::new(Box::new(Counting(made.clone())), 20..600);
        for taken in 1..10 {
            assert!(matches!(frames.next(), Some(Ok(_))));
            // Those taken, those waiting, and the one at hand.
            assert!(made.load(Ordering::SeqCst) <= taken + FRAMES_AHEAD + 1);
        }
        drop(frames);
        assert!(made.load(Ordering::SeqCst) <= 9 + FRAMES_AHEAD + 1);
        assert_eq!(
            Arc::strong_count(&made),
            1,
            "the thread has let go of the source"
        );
    }

    #[test]
    fn the_end_is_final() {
        let source = Counting(Arc::default());
        let mut frames = Prefetch::new(Box::new(source), 0..1);
        assert!(frames.next().is_some());
        assert!(frames.next().is_none());
        assert!(frames.next().is_none());
    }

    #[test]
    #[should_panic(expected = "a broken source")]
    fn a_panic_of_the_source_is_passed_on() {
        let source = Counting(Arc::default());
        Prefetch::new(Box::new(source), 665..668).for_each(drop);
    }
}
