//! From a frame to its tree, or to a message that names the frame.

use std::ops::Range;

use splitcast::{BuildError, BuildOptions, KdTree, Mesh, NonFinite, SequenceBuilder};
use splitcast_console::Input;
use splitcast_scene::{Frame, SequenceInfo};

use crate::error::CliError;

/// Finds the first of `frames` that cannot be built because of its vertices,
/// before work is spent on the frames in front of it. `info` is that of the
/// whole input.
pub(crate) fn refuse_non_finite(
    input: &mut Input,
    info: &SequenceInfo,
    frames: Range<usize>,
    options: &BuildOptions,
) -> Result<(), CliError> {
    if options.non_finite == NonFinite::Skip {
        return Ok(());
    }
    for index in frames {
        if info.frames[index].non_finite > 0 {
            let frame = input.source.frame(index)?;
            try_build(&frame, options, index, &input.place(index))?;
        }
    }
    Ok(())
}

/// Finds out whether a frame can be built, by building it.
pub(crate) fn try_build(
    frame: &Frame,
    options: &BuildOptions,
    index: usize,
    place: &str,
) -> Result<(), CliError> {
    let tree = KdTree::build(mesh(frame, index, place)?, options);
    tree.map(drop)
        .map_err(|error| refused(&error, index, place))
}

/// The tree of the next frame; an error names the frame and its `place`.
pub(crate) fn build_tree<'f>(
    frame: &'f Frame,
    builder: &mut SequenceBuilder,
    index: usize,
    place: &str,
) -> Result<KdTree<'f>, CliError> {
    let tree = builder.build(mesh(frame, index, place)?);
    tree.map_err(|error| refused(&error, index, place))
}

/// Why a frame was not built, with what can be done about it.
pub(crate) fn refused(error: &BuildError, index: usize, place: &str) -> CliError {
    let remedy = if matches!(error, BuildError::NonFinite { .. }) {
        "; use --non-finite skip"
    } else {
        ""
    };
    CliError::Frame {
        index,
        place: place.to_owned(),
        reason: format!("{error}{remedy}"),
    }
}

/// The mesh of a frame; an error names the frame and its `place`.
pub(crate) fn mesh<'f>(frame: &'f Frame, index: usize, place: &str) -> Result<Mesh<'f>, CliError> {
    Mesh::new(&frame.positions, &frame.triangles).map_err(|error| CliError::Frame {
        index,
        place: place.to_owned(),
        reason: error.to_string(),
    })
}
