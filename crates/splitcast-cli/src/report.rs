//! What `render --json` writes: figures of every frame.

use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use splitcast_console::{to_json, write_file};

use crate::error::CliError;

/// The whole run.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// Name of the scene or sequence.
    pub(crate) input: String,
    /// Where the frames went.
    pub(crate) out: String,
    /// Version of the program.
    pub(crate) version: &'static str,
    pub(crate) builder: &'static str,
    pub(crate) view: &'static str,
    pub(crate) quality: &'static str,
    pub(crate) threads: usize,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) samples_per_pixel: u32,
    pub(crate) frames_per_second: f64,
    /// Time from start to end, reading and encoding included.
    pub(crate) wall_ms: f64,
    /// Time from the first frame, which may still be read, to the complete output.
    pub(crate) frames_ms: f64,
    /// Frames that an earlier run had finished; they are not in `frames`.
    pub(crate) resumed_frames: Vec<usize>,
    /// The frames that were rendered, in order.
    pub(crate) frames: Vec<FrameReport>,
}

/// One frame.
#[derive(Debug, Serialize)]
pub(crate) struct FrameReport {
    /// Its number in the input, from 0.
    pub(crate) frame: usize,
    pub(crate) triangles: usize,
    /// Triangles left out because of a vertex that is not finite.
    pub(crate) skipped_triangles: usize,
    /// Time to build the tree.
    pub(crate) build_ms: f64,
    /// Time to trace and shade the picture.
    pub(crate) trace_ms: f64,
    /// Time to bring it to the display's bytes, while another is traced.
    pub(crate) tone_map_ms: f64,
    /// Time to encode and store it, while others are traced.
    pub(crate) write_ms: f64,
    /// Rays of all kinds.
    pub(crate) rays: u64,
    /// Nodes of the tree.
    pub(crate) nodes: usize,
    /// Triangle references in its leaves.
    pub(crate) references: usize,
    /// Its expected cost by the surface area heuristic.
    pub(crate) sah_cost: f64,
    /// Its memory.
    pub(crate) bytes: usize,
}

impl Report {
    /// Writes the report as JSON, whole or not at all.
    pub(crate) fn write(&self, path: &Path) -> Result<(), CliError> {
        let text = to_json(self);
        Ok(write_file(path, text.as_bytes())?)
    }
}

/// Milliseconds to the microsecond, all that a clock is good for.
pub(crate) fn milliseconds(time: Duration) -> f64 {
    (time.as_secs_f64() * 1e6).round() / 1e3
}
