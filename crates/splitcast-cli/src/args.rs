//! The command line: flags, their defaults, and how they are read.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{ArgAction, Parser, Subcommand};
use splitcast::{Builder, NonFinite, Orientation};
use splitcast_console::{
    FrameRange, ValueError, parse_frames, parse_size, parse_threads, parse_up_to,
};
use splitcast_render::{DEFAULT_FOV_DEGREES, Quality, View};

use crate::error::CliError;
use crate::reproduce::NodePath;
use crate::{info, render, reproduce, scenes, track};

/// Most times that a measurement can be repeated.
const MAX_ROUNDS: usize = 1000;

/// Ray traces animated triangle meshes on the CPU, with a kd-tree for every frame.
#[derive(Debug, Parser)]
#[command(name = "splitcast", version, max_term_width = 100)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render an animation to a video or to pictures
    Render(Box<RenderArgs>),
    /// Measure the paper's tracked builds: its table and figures, and a page of both
    Reproduce(ReproduceArgs),
    /// Follow an animation with a tracked tree: times and quality of every update
    Track(TrackArgs),
    /// List the built-in scenes, or export one as mesh files
    #[command(args_conflicts_with_subcommands = true)]
    Scenes(ScenesArgs),
    /// Tell what an input holds: frames, counts, bounds, motion, topology
    Info(InfoArgs),
}

impl Command {
    /// Does what was asked for.
    pub(crate) fn run(self) -> Result<(), CliError> {
        match self {
            Self::Render(args) => render::run(&args),
            Self::Reproduce(args) => reproduce::run(&args),
            Self::Track(args) => track::run(&args),
            Self::Scenes(ScenesArgs {
                command: Some(ScenesCommand::Export { name, folder }),
                ..
            }) => scenes::export(&name, &folder),
            Self::Scenes(args) => scenes::list(args.json),
            Self::Info(args) => info::run(&args.input, args.json),
        }
    }
}

#[derive(Debug, clap::Args)]
pub(crate) struct RenderArgs {
    /// A built-in scene, a mesh file, a folder, a glob or a numbered pattern
    ///
    /// Built-in scenes come first (see `splitcast scenes`); write ./horse for a
    /// file of such a name. Files are .ply, .ply.gz or .obj; quote globs such
    /// as 'dir/*.ply' and patterns such as dir/frame_%04d.ply.
    #[arg(value_name = "INPUT")]
    pub(crate) input: PathBuf,

    /// Where the result goes: film.mp4, film.apng, frame_%04d.png, frame_%04d.exr
    ///
    /// A video appears only when whole; until then its finished frames are
    /// kept in FILE.partial, for --resume. %04d stands for the frame's number;
    /// a name without it holds a single picture.
    #[arg(long, short, value_name = "FILE")]
    pub(crate) out: PathBuf,

    /// Width and height in pixels; MP4 needs even numbers
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = parse_size)]
    pub(crate) size: (u32, u32),

    /// Samples per pixel [default: 1, 4, 16 or 64, by --quality]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) spp: Option<u32>,

    /// Frames from A up to but not including B, counted from 0 [default: all]
    ///
    /// As slices in programming: 0:10 are the first ten frames, 10: all others,
    /// :10 the same as 0:10, and 7 alone is frame 7. Files and tables keep these
    /// numbers.
    #[arg(long, value_name = "A:B", value_parser = parse_frames, allow_negative_numbers = true)]
    pub(crate) frames: Option<FrameRange>,

    /// Frames per second of the video [default: the input's, or 25]
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    pub(crate) fps: Option<f64>,

    /// Where the camera stands [default: where the whole motion is in view]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(crate) eye: Option<[f32; 3]>,

    /// What the camera looks at [default: the middle of the motion]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(crate) look_at: Option<[f32; 3]>,

    /// Which way is up, in the picture and for ground and sky
    #[arg(long, value_name = "X,Y,Z", default_value = "0,1,0", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(crate) up: [f32; 3],

    /// Vertical field of view in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = DEFAULT_FOV_DEGREES, allow_hyphen_values = true)]
    pub(crate) fov: f32,

    /// How trees are built
    ///
    /// tracked carries over from frame to frame what still holds; binned rebuilds fast, sweep
    /// exactly; search is the paper's normal build, kalman and wiener track its planes. The picture
    /// is the same with all of them.
    #[arg(long, value_name = "NAME", default_value = Builder::Tracked.name(), value_parser = builder_parser())]
    pub(crate) builder: Builder,

    /// Worker threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = parse_threads, allow_negative_numbers = true)]
    pub(crate) threads: Option<NonZeroUsize>,

    /// How much light is traced
    ///
    /// preview is for playing a motion at its own speed: one sample a pixel, hard shadows, no
    /// noise; draft is for looking at it, good for videos, best for stills.
    #[arg(long, value_name = "NAME", default_value = Quality::default().name(), value_parser = quality_parser())]
    pub(crate) quality: Quality,

    /// What is shown: the scene, or what the tree does
    #[arg(long, value_name = "NAME", default_value = View::default().name(), value_parser = view_parser())]
    pub(crate) view: View,

    /// Brightness in photographic stops: 1 doubles it, -1 halves it
    #[arg(
        long,
        value_name = "STOPS",
        default_value_t = 0.0,
        allow_hyphen_values = true
    )]
    pub(crate) exposure: f32,

    /// Round off the facets (the default)
    #[arg(long, overrides_with = "flat")]
    pub(crate) smooth: bool,

    /// Show every triangle as a facet
    #[arg(long)]
    pub(crate) flat: bool,

    /// Whether a ground catches the shadow: on or off
    #[arg(long, value_name = "ON|OFF", default_value = "on", action = ArgAction::Set, value_parser = on_off_parser())]
    pub(crate) ground: bool,

    /// What to do about vertices at NaN or infinity: reject the input, or skip their triangles
    #[arg(long, value_name = "WHAT", default_value = "reject", value_parser = non_finite_parser())]
    pub(crate) non_finite: NonFinite,

    /// Keep the frames that an interrupted run finished with the same settings
    #[arg(long)]
    pub(crate) resume: bool,

    /// Write times and tree figures of every frame to this file
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct ReproduceArgs {
    /// Built-in scenes, mesh files, folders, globs or numbered patterns [default: the built-in scenes]
    #[arg(value_name = "INPUT")]
    pub(crate) input: Vec<PathBuf>,

    /// Folder for tables, figures and report.html; made if it does not exist
    #[arg(long, short, value_name = "DIR", default_value = "reproduction")]
    pub(crate) out: PathBuf,

    /// Write the table to this file too
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,

    /// Frames from A up to but not including B, counted from 0 [default: all]
    #[arg(long, value_name = "A:B", value_parser = parse_frames, allow_negative_numbers = true)]
    pub(crate) frames: Option<FrameRange>,

    /// How often every build is repeated; times are medians
    #[arg(long, value_name = "N", default_value = "3", value_parser = parse_rounds, allow_negative_numbers = true)]
    pub(crate) rounds: NonZeroUsize,

    /// Worker threads; the paper used one
    #[arg(long, value_name = "N", default_value = "1", value_parser = parse_threads, allow_negative_numbers = true)]
    pub(crate) threads: NonZeroUsize,

    /// Where the random numbers of the noise start [default: 0]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub(crate) seed: Option<u64>,

    /// Process noise p(w): its standard deviation, relative to positions
    #[arg(long, value_name = "W", allow_negative_numbers = true)]
    pub(crate) noise_process: Option<f32>,

    /// Measurement noise p(v), likewise; it makes the virtual observations
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub(crate) noise_measurement: Option<f32>,

    /// How the axis of a split is found in normal builds
    #[arg(long, value_name = "NAME", value_parser = orientation_parser())]
    pub(crate) orientation_normal: Option<Orientation>,

    /// How the axis of a split is found in tracked builds
    #[arg(long, value_name = "NAME", value_parser = orientation_parser())]
    pub(crate) orientation_running: Option<Orientation>,

    /// Node to show beside the root, by the way to it, such as LRL; may be repeated
    /// [default: one at depth 4 and one at depth 8]
    #[arg(long, value_name = "PATH")]
    pub(crate) node: Vec<NodePath>,

    /// What to do about vertices at NaN or infinity: reject the input, or skip their triangles
    #[arg(long, value_name = "WHAT", default_value = "reject", value_parser = non_finite_parser())]
    pub(crate) non_finite: NonFinite,
}

#[derive(Debug, clap::Args)]
pub(crate) struct TrackArgs {
    /// A built-in scene, a mesh file, a folder, a glob or a numbered pattern
    #[arg(value_name = "INPUT")]
    pub(crate) input: PathBuf,

    /// Rebuild every frame as well, and compare: time and cost of update and rebuild
    #[arg(long)]
    pub(crate) reference: bool,

    /// Frames from A up to but not including B, counted from 0 [default: all]
    #[arg(long, value_name = "A:B", value_parser = parse_frames, allow_negative_numbers = true)]
    pub(crate) frames: Option<FrameRange>,

    /// Worker threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = parse_threads, allow_negative_numbers = true)]
    pub(crate) threads: Option<NonZeroUsize>,

    /// What to do about vertices at NaN or infinity: reject the input, or skip their triangles
    #[arg(long, value_name = "WHAT", default_value = "reject", value_parser = non_finite_parser())]
    pub(crate) non_finite: NonFinite,

    /// Write the figures of every frame to this file
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct ScenesArgs {
    #[command(subcommand)]
    command: Option<ScenesCommand>,

    /// Print an object whose `scenes` is a list
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum ScenesCommand {
    /// Write a built-in scene as one binary PLY file a frame
    Export {
        /// Name of the scene
        name: String,
        /// Folder for the files; made if it does not exist
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

#[derive(Debug, clap::Args)]
pub(crate) struct InfoArgs {
    /// A built-in scene, a mesh file, a folder, a glob or a numbered pattern
    #[arg(value_name = "INPUT")]
    input: PathBuf,

    /// Print one object instead of text
    #[arg(long)]
    json: bool,
}

fn parse_vector(text: &str) -> Result<[f32; 3], String> {
    let parts: Option<Vec<f32>> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect();
    parts
        .and_then(|parts| <[f32; 3]>::try_from(parts).ok())
        .ok_or_else(|| "write three numbers, such as 1.5,0,-2".to_owned())
}

fn parse_rounds(text: &str) -> Result<NonZeroUsize, ValueError> {
    parse_up_to(MAX_ROUNDS, text)
}

fn orientation_parser() -> impl TypedValueParser<Value = Orientation> {
    PossibleValuesParser::new(
        Orientation::ALL
            .iter()
            .map(|orientation| orientation.name()),
    )
    .try_map(|name| name.parse())
}

fn builder_parser() -> impl TypedValueParser<Value = Builder> {
    PossibleValuesParser::new(Builder::ALL.iter().map(|builder| builder.name()))
        .try_map(|name| name.parse())
}

fn quality_parser() -> impl TypedValueParser<Value = Quality> {
    PossibleValuesParser::new(Quality::ALL.iter().map(|quality| quality.name()))
        .try_map(|name| name.parse())
}

fn view_parser() -> impl TypedValueParser<Value = View> {
    PossibleValuesParser::new(View::ALL.iter().map(|view| view.name())).try_map(|name| name.parse())
}

fn on_off_parser() -> impl TypedValueParser<Value = bool> {
    PossibleValuesParser::new(["on", "off"]).map(|name| name == "on")
}

fn non_finite_parser() -> impl TypedValueParser<Value = NonFinite> {
    let [reject, skip] = [NonFinite::Reject, NonFinite::Skip].map(non_finite_name);
    PossibleValuesParser::new([reject, skip]).map(move |name| {
        if name == skip {
            NonFinite::Skip
        } else {
            NonFinite::Reject
        }
    })
}

/// How the choice is written on the command line and in results.
pub(crate) fn non_finite_name(choice: NonFinite) -> &'static str {
    match choice {
        NonFinite::Reject => "reject",
        NonFinite::Skip => "skip",
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn vectors_have_three_numbers() {
        assert_eq!(parse_vector("1, -2,3e1"), Ok([1.0, -2.0, 30.0]));
        for bad in ["1,2", "1,2,3,4", "a,b,c", ""] {
            assert!(parse_vector(bad).is_err(), "{bad}");
        }
    }
}
