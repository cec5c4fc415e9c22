//! A sequence into a folder of PLY files.

use std::path::{Path, PathBuf};

use crate::{FrameSource, SceneError, write_ply};

/// Writes every frame of `source` as `NAME_0000.ply` and so on into `folder`,
/// which is created if it does not exist. `written` is told of each file as
/// soon as it is whole, with the index of its frame.
///
/// Numbers have four digits, or more if the sequence needs them, so that the
/// folder is read back in order; files already there are replaced one by one.
///
/// # Errors
/// [`SceneError::Write`] if the folder or a file cannot be written, or what
/// kept a frame from being made. Files written before stay.
pub fn export(
    source: &mut dyn FrameSource,
    folder: impl AsRef<Path>,
    mut written: impl FnMut(usize, &Path),
) -> Result<Vec<PathBuf>, SceneError> {
    let folder = folder.as_ref();
    std::fs::create_dir_all(folder).map_err(|source| SceneError::Write {
        path: folder.to_path_buf(),
        source,
    })?;
    let frames = source.frame_count();
    let digits = frames.saturating_sub(1).to_string().len().max(4);
    let mut paths = Vec::with_capacity(frames);
    for index in 0..frames {
        let frame = source.frame(index)?;
        let path = folder.join(format!("{}_{index:0digits$}.ply", source.name()));
        write_ply(&path, &frame)?;
        written(index, &path);
        paths.push(path);
    }
    Ok(paths)
}
