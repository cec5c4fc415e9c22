//! Mesh files as a sequence of frames.

mod find;
mod warning;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::{Frame, FrameSource, SceneError, read_obj, read_ply};

pub use warning::SequenceWarning;

/// A format that frames are read from, told by the file's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MeshFormat {
    Ply,
    PlyGz,
    Obj,
}

impl MeshFormat {
    /// The format of a file of this name, in any letter case.
    pub(crate) fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        [MeshFormat::PlyGz, MeshFormat::Ply, MeshFormat::Obj]
            .into_iter()
            .find(|format| name.ends_with(format.extension()))
    }

    /// The extension, with its dot.
    pub(crate) fn extension(self) -> &'static str {
        match self {
            MeshFormat::Ply => ".ply",
            MeshFormat::PlyGz => ".ply.gz",
            MeshFormat::Obj => ".obj",
        }
    }
}

/// Reads a mesh file: `.ply`, `.ply.gz` or `.obj`.
///
/// # Errors
/// [`SceneError::UnknownExtension`], or what [`read_ply`] and [`read_obj`]
/// find wrong.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<Frame, SceneError> {
    let path = path.as_ref();
    match MeshFormat::of(path) {
        Some(MeshFormat::Ply | MeshFormat::PlyGz) => read_ply(path),
        Some(MeshFormat::Obj) => read_obj(path),
        None => Err(SceneError::UnknownExtension {
            path: path.to_path_buf(),
        }),
    }
}

/// Mesh files, one a frame, read when asked for.
///
/// A frame whose triangles (or colours) equal those of the frame read before
/// shares them with it.
#[derive(Debug)]
pub struct MeshSequence {
    name: String,
    files: Vec<PathBuf>,
    warnings: Vec<SequenceWarning>,
    triangles: Arc<Vec<[u32; 3]>>,
    colors: Arc<Vec<[u8; 3]>>,
}

impl MeshSequence {
    /// Finds the files that `input` names:
    ///
    /// * one `.ply`, `.ply.gz` or `.obj` file;
    /// * a folder: all such files directly in it, hidden ones left out, in
    ///   natural order (`frame2` before `frame10`);
    /// * a glob such as `dir/*.ply`, in natural order;
    /// * a pattern such as `dir/frame_%04d.ply`, in order of the numbers, which
    ///   may start anywhere. `%d` takes numbers without leading zeros, `%04d`
    ///   those padded to four digits, `%%` is a percent sign.
    ///
    /// What exists under the very name is taken before any pattern is tried.
    /// No mesh is read yet, but PLY headers are, so that
    /// [`warnings`](Self::warnings) can tell of differing sizes; a file that
    /// cannot be read is an error of its frame.
    ///
    /// # Errors
    /// [`SceneError::Missing`], [`SceneError::UnknownExtension`],
    /// [`SceneError::EmptyFolder`], [`SceneError::NoMatch`],
    /// [`SceneError::BadPattern`], or [`SceneError::Io`] for a folder that
    /// cannot be listed.
    pub fn open(input: impl AsRef<Path>) -> Result<Self, SceneError> {
        let input = input.as_ref();
        let found = find::find(input)?;
        let mut warnings = found.warnings;
        warnings.extend(warning::of_names(&found.files));
        warnings.extend(warning::of_sizes(&found.files));
        Ok(MeshSequence {
            name: name_of(&found.files, found.folder.as_deref()),
            files: found.files,
            warnings,
            triangles: Arc::default(),
            colors: Arc::default(),
        })
    }

    /// The files in order of their frames.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// What looks odd about the files: gaps, mixed types, differing sizes.
    /// Nothing is done about it.
    pub fn warnings(&self) -> &[SequenceWarning] {
        &self.warnings
    }
}

impl FrameSource for MeshSequence {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.files.len()
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        let path = self
            .files
            .get(index)
            .ok_or_else(|| SceneError::FrameOutOfRange {
                name: self.name.clone(),
                index,
                count: self.files.len(),
            })?;
        let mut frame = read_mesh(path)?;
        share(&mut frame.triangles, &mut self.triangles);
        if let Some(colors) = &mut frame.colors {
            share(colors, &mut self.colors);
        }
        Ok(frame)
    }
}

/// Makes `new` the same as `known` if they are equal, else remembers it.
fn share<T: PartialEq>(new: &mut Arc<Vec<T>>, known: &mut Arc<Vec<T>>) {
    if *new == *known {
        *new = Arc::clone(known);
    } else {
        *known = Arc::clone(new);
    }
}

/// A single file's stem; else what the files' names start with in common,
/// without the number; else the folder's name.
fn name_of(files: &[PathBuf], folder: Option<&Path>) -> String {
    let stems: Vec<String> = files.iter().map(|file| stem(file)).collect();
    let Some((first, rest)) = stems.split_first() else {
        return String::new();
    };
    if rest.is_empty() {
        return first.clone();
    }
    let common = rest.iter().fold(first.len(), |len, other| {
        let same = first.bytes().zip(other.bytes());
        len.min(same.take_while(|(a, b)| a == b).count())
    });
    let common = (0..=common).rev().find_map(|len| first.get(..len));
    let is_joint = |c: char| c.is_ascii_digit() || "_-. ".contains(c);
    let common = common.unwrap_or_default().trim_end_matches(is_joint);
    let folder = folder
        .and_then(|folder| std::path::absolute(folder).ok())
        .and_then(|folder| folder.file_name().map(OsStr::to_os_string));
    match (common, folder) {
        ("", Some(folder)) => folder.to_string_lossy().into_owned(),
        ("", None) => first.clone(),
        (common, _) => common.to_owned(),
    }
}

/// The file's name without its mesh extension.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let extension = MeshFormat::of(path).map_or(0, |format| format.extension().len());
    let len = name.len() - extension;
    name.get(..len).unwrap_or(&name).to_owned()
}

#[cfg(test)]
mod tests;
