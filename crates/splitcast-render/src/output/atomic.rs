//! Whether and how a finished file gets to its place.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::error::{OutputError, explain};

/// Moves the finished file `from` to `to`, after its data reached the disk.
pub(crate) fn publish(from: &Path, to: &Path) -> Result<(), OutputError> {
    let publish = || -> io::Result<()> {
        // Some file systems report a full disk only when the data goes out.
        File::options().write(true).open(from)?.sync_data()?;
        fs::rename(from, to)
    };
    publish().map_err(|source| OutputError::io(to, source))
}

/// Finds out whether a file can be put at `path`, and leaves no trace.
///
/// # Errors
/// [`OutputError::Unwritable`] with the reason and the remedy.
pub fn check_writable(path: &Path) -> Result<(), OutputError> {
    let unwritable = |path: &Path, reason: String| OutputError::Unwritable {
        path: path.to_owned(),
        reason,
    };
    let folder = folder_of(path);
    match fs::metadata(folder) {
        Ok(data) if data.is_dir() => {}
        Ok(_) => {
            let reason = "it is a file, not a folder: write elsewhere".to_owned();
            return Err(unwritable(folder, reason));
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let reason = "the folder does not exist: create it first".to_owned();
            return Err(unwritable(folder, reason));
        }
        Err(error) => return Err(unwritable(folder, explain(&error))),
    }
    if let Ok(data) = fs::metadata(path) {
        if data.is_dir() {
            let reason = "it is a folder: give the name of a file in it".to_owned();
            return Err(unwritable(path, reason));
        }
        if !data.is_file() {
            let reason = "it is a device or a pipe, which a file would replace: write elsewhere";
            return Err(unwritable(path, reason.to_owned()));
        }
        if data.permissions().readonly() {
            let reason = "the file is read-only: remove it or write elsewhere".to_owned();
            return Err(unwritable(path, reason));
        }
    }
    // A full disk still makes empty files; a block of zeros needs real space.
    tempfile::tempfile_in(folder)
        .and_then(|mut probe| {
            probe.write_all(&[0; 4096])?;
            probe.sync_data()
        })
        .map_err(|error| unwritable(path, explain(&error)))
}

/// The folder a file lies in, `.` for a bare name.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => Path::new("/"),
    }
}

/// `path` with `suffix` after its whole name: `film.mp4` to `film.mp4.partial`.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn unwritable_places_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, b"x").unwrap();
        let cases = [
            (folder.path().join("none/a.mp4"), "does not exist"),
            (file.join("a.mp4"), "not a folder"),
            (folder.path().to_owned(), "is a folder"),
        ];
        for (path, expected) in cases {
            let message = check_writable(&path).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
            assert!(!message.contains('\n'));
        }
        #[cfg(unix)]
        {
            let message = check_writable(Path::new("/dev/null"))
                .unwrap_err()
                .to_string();
            assert!(message.contains("a device"), "{message}");
        }
        let mut rights = fs::metadata(&file).unwrap().permissions();
        rights.set_readonly(true);
        fs::set_permissions(&file, rights).unwrap();
        let message = check_writable(&file).unwrap_err().to_string();
        assert!(message.contains("read-only"), "{message}");
        check_writable(&folder.path().join("new")).unwrap();
        assert_eq!(names(folder.path()), ["file"]);
    }
}
