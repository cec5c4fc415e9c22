//! Files that results go to: whole or absent, and refused before work is spent.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use splitcast_render::{OutputError, check_writable};
use splitcast_scene::write_atomically;

/// What kept a file from being written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct FileError {
    path: PathBuf,
    source: io::Error,
}

impl FileError {
    /// The error of one file.
    pub fn new(path: &Path, source: io::Error) -> Self {
        Self {
            path: path.to_owned(),
            source,
        }
    }
}

/// Writes a file, whole or not at all.
///
/// # Errors
/// [`FileError`] with the system's reason. What the file held before is kept.
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), FileError> {
    write_atomically(path, |out| out.write_all(content))
        .map_err(|source| FileError::new(path, source))
}

/// A folder for the results of a measurement, and perhaps a file beside it.
#[derive(Clone, Debug)]
pub struct ResultFolder {
    folder: PathBuf,
}

impl ResultFolder {
    /// Finds out whether files can be put into a folder, which may not exist
    /// yet, and to `extra`, and leaves no trace. `names` are those of the files that
    /// will be put into the folder.
    ///
    /// # Errors
    /// [`OutputError::Unwritable`] with the reason and the remedy.
    pub fn check(folder: &Path, names: &[&str], extra: Option<&Path>) -> Result<Self, OutputError> {
        let there = folder.ancestors().find(|path| path.exists());
        check_writable(&there.unwrap_or(Path::new(".")).join("results"))?;
        // A file in a folder that is yet to be made can be written when the folder can.
        let full = |path: &Path| std::path::absolute(path).unwrap_or(path.to_owned());
        if let Some(extra) = extra {
            if full(extra).parent() != Some(&full(folder)) {
                check_writable(extra)?;
            } else if names.iter().any(|name| extra.ends_with(name)) {
                return Err(OutputError::Unwritable {
                    path: extra.to_owned(),
                    reason: "results of another kind go there: choose another name".to_owned(),
                });
            }
        }
        Ok(Self {
            folder: folder.to_owned(),
        })
    }

    /// Makes the folder if it does not exist.
    ///
    /// # Errors
    /// [`FileError`] with the system's reason.
    pub fn create(&self) -> Result<(), FileError> {
        fs::create_dir_all(&self.folder).map_err(|source| FileError::new(&self.folder, source))
    }

    /// The place of a file in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file in the folder, whole or not at all.
    ///
    /// # Errors
    /// As [`write_file`].
    pub fn write(&self, name: &str, content: &[u8]) -> Result<(), FileError> {
        write_file(&self.path(name), content)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_checked_without_a_trace_and_made_when_needed() {
        let outer = tempfile::tempdir().expect("a folder");
        let (path, extra) = (outer.path().join("a/b"), outer.path().join("a/b/extra"));
        let folder =
            ResultFolder::check(&path, &["file"], Some(&extra)).expect("a place that is free");
        assert!(!outer.path().join("a").exists());
        folder.create().expect("a new folder");
        folder.write("file", b"content").expect("a new file");
        assert_eq!(fs::read(path.join("file")).expect("the file"), b"content");

        let below_file = path.join("file/c");
        let error = ResultFolder::check(&below_file, &[], None).expect_err("a file in the way");
        assert!(error.to_string().contains("file"), "{error}");
        let elsewhere = outer.path().join("missing/extra");
        assert!(ResultFolder::check(&path, &[], Some(&elsewhere)).is_err());
        let taken = outer.path().join("./a/b/file");
        assert!(ResultFolder::check(&path, &["file"], Some(&taken)).is_err());
    }
}
