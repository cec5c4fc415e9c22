//! From a frame to its tree, or to a message that names the frame.

use std::ops::Range;

use splitcast::{BuildError, KdTree, Mesh, NonFinite, SequenceBuilder};
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
    builder: &SequenceBuilder,
) -> Result<(), CliError> {
    if builder.options().non_finite == NonFinite::Skip {
        return Ok(());
    }
    for index in frames {
        if info.frames[index].non_finite > 0 {
            let frame = input.source.frame(index)?;
            build_tree(&frame, &mut builder.clone(), index, &input.place(index))?;
        }
    }
    Ok(())
}

/// The tree of the next frame; an error names the frame and its `place`.
pub(crate) fn build_tree<'f>(
    frame: &'f Frame,
    builder: &mut SequenceBuilder,
    index: usize,
    place: &str,
) -> Result<KdTree<'f>, CliError> {
    builder.build(mesh(frame, index, place)?).map_err(|error| {
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
    })
}

/// The mesh of a frame; an error names the frame and its `place`.
pub(crate) fn mesh<'f>(frame: &'f Frame, index: usize, place: &str) -> Result<Mesh<'f>, CliError> {
    Mesh::new(&frame.positions, &frame.triangles).map_err(|error| CliError::Frame {
        index,
        place: place.to_owned(),
        reason: error.to_string(),
    })
}
