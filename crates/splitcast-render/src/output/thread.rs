//! Writing on a thread of its own, so that encoding one frame and rendering
//! the next overlap.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::error::OutputError;
use super::sink::FrameSink;
use crate::Image;

/// Frames that may wait to be written: enough to even out slow frames, few
/// enough to bound the memory.
const QUEUE: usize = 2;

enum Message {
    Frame(usize, Image),
    Finish,
}

/// What the output thread took for a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteTimes {
    /// To bring the picture to the display's bytes.
    pub tone_map: Duration,
    /// To encode and to store it.
    pub write: Duration,
}

/// Hands frames to a [`FrameSink`] that runs on another thread.
///
/// Dropping it without [`OutputThread::finish`] abandons the output: frames
/// that were handed over are still written, but a video is not completed.
#[derive(Debug)]
pub struct OutputThread {
    messages: Option<SyncSender<Message>>,
    worker: Option<JoinHandle<Result<Vec<WriteTimes>, OutputError>>>,
}

impl OutputThread {
    /// Starts the thread.
    #[must_use]
    pub fn new(sink: Box<dyn FrameSink>) -> Self {
        let (messages, queue) = sync_channel(QUEUE);
        Self {
            messages: Some(messages),
            worker: Some(std::thread::spawn(move || work(sink, &queue))),
        }
    }

    /// Hands over frame `index`, under the rules of [`FrameSink::write`];
    /// waits while too many frames are in the queue.
    ///
    /// # Errors
    /// The error of this or an earlier frame, once; after it nothing more is
    /// written.
    pub fn write(&mut self, index: usize, image: Image) -> Result<(), OutputError> {
        self.send(Message::Frame(index, image))
    }

    /// Waits until everything is written, and completes the output. Returns
    /// what each frame took, in their order, while the caller did other things.
    ///
    /// # Errors
    /// As for [`FrameSink::write`] and [`FrameSink::finish`].
    pub fn finish(mut self) -> Result<Vec<WriteTimes>, OutputError> {
        self.send(Message::Finish)?;
        self.join()
    }

    fn send(&mut self, message: Message) -> Result<(), OutputError> {
        match &self.messages {
            Some(messages) if messages.send(message).is_ok() => Ok(()),
            // The worker only stops early for an error, which joining yields.
            _ => self.join().map(drop),
        }
    }

    fn join(&mut self) -> Result<Vec<WriteTimes>, OutputError> {
        self.messages = None;
        match self.worker.take().map(JoinHandle::join) {
            None => Ok(Vec::new()),
            Some(Ok(result)) => result,
            Some(Err(panic)) => resume_unwind(panic),
        }
    }
}

impl Drop for OutputThread {
    fn drop(&mut self) {
        self.messages = None;
        if let Some(worker) = self.worker.take() {
            // Whoever drops the thread has an error of their own to report.
            let _ = worker.join();
        }
    }
}

fn work(
    mut sink: Box<dyn FrameSink>,
    queue: &Receiver<Message>,
) -> Result<Vec<WriteTimes>, OutputError> {
    let mut times = Vec::new();
    for message in queue {
        match message {
            Message::Frame(index, image) => {
                let started = Instant::now();
                let tone_map = sink.write(index, &image)?;
                let write = started.elapsed().saturating_sub(tone_map);
                times.push(WriteTimes { tone_map, write });
            }
            Message::Finish => {
                sink.finish()?;
                break;
            }
        }
    }
    Ok(times)
}
