//! The command line.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Parser;
use splitcast_console::{ValueError, parse_size, parse_threads, parse_up_to};

use crate::rays::RaySetKind;

/// Most pixels of a picture: 2048 by 2048. Every pixel has up to five rays of 64 bytes.
const MAX_PIXELS: u64 = 1 << 22;

/// Most times that a sequence can be gone through, and largest step between traced frames.
const MAX_COUNT: usize = 10_000;

/// Measures Splitcast side by side with Embree and other libraries: updates of moving meshes, and
/// rays traced behind them.
#[derive(Debug, Parser)]
#[command(name = "splitcast-bench", version, max_term_width = 100)]
pub(crate) struct Args {
    /// Built-in scenes, mesh files, folders, globs or numbered patterns [default: the built-in scenes]
    #[arg(value_name = "INPUT")]
    pub(crate) input: Vec<PathBuf>,

    /// Systems or whole libraries, separated by commas, such as splitcast,embree-refit [default:
    /// all that are found]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) systems: Vec<String>,

    /// Sets of rays, separated by commas: primary, shadow, ao, diffuse, random [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) rays: Vec<RaySetKind>,

    /// Numbers of threads, separated by commas; everything is measured with each
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1", value_parser = parse_threads)]
    pub(crate) threads: Vec<NonZeroUsize>,

    /// Width and height of the picture that primary rays are for, in pixels
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = parse_picture)]
    pub(crate) size: (u32, u32),

    /// Trace rays in every K-th frame only; updates are made in all [default: as many as trace ten]
    #[arg(long, value_name = "K", value_parser = parse_count)]
    pub(crate) every: Option<NonZeroUsize>,

    /// How often each sequence is gone through [default: as often as gives ten updates]
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub(crate) rounds: Option<NonZeroUsize>,

    /// Write the results to this file too
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,

    /// Folder for results.json, frames.json and report.html; made if it does not exist
    #[arg(long, short, value_name = "DIR", default_value = "benchmarks")]
    pub(crate) out: PathBuf,

    /// List the systems that are found, and what is missing
    #[arg(long)]
    pub(crate) list: bool,
}

/// A picture that is not too large for its rays to be kept.
fn parse_picture(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = parse_size(text).map_err(|error| error.to_string())?;
    match u64::from(width) * u64::from(height) {
        0..=MAX_PIXELS => Ok((width, height)),
        _ => Err(format!(
            "all rays are kept in memory: at most {MAX_PIXELS} pixels"
        )),
    }
}

fn parse_count(text: &str) -> Result<NonZeroUsize, ValueError> {
    parse_up_to(MAX_COUNT, text)
}
