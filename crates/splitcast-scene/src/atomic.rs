//! Files that are whole or absent.

use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Bytes gathered before they go to the system.
const BUFFER_BYTES: usize = 256 * 1024;

/// Writes a file beside its place and renames it once it is whole.
///
/// Whatever `write` or the system fails at, and whenever the program is
/// stopped, `path` holds either what it held before or all of the new content.
///
/// # Errors
/// What `write` returned, or the system's reason why the file could not be
/// created, written or renamed.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    // A rename is atomic only within a file system, hence the same folder.
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".splitcast-").suffix(".tmp");
    #[cfg(unix)]
    {
        // As any other new file: readable as the user's mask allows, where a
        // temporary file would be private.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut out = BufWriter::with_capacity(BUFFER_BYTES, builder.tempfile_in(folder)?);
    write(&mut out)?;
    let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    file.persist(path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("frame.ply");
        write_atomically(&path, |out| out.write_all(b"old")).expect("a first write");
        let error = write_atomically(&path, |out| {
            out.write_all(&vec![7; 2 * BUFFER_BYTES])?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert_eq!(
            error.expect_err("a full disk").kind(),
            io::ErrorKind::StorageFull
        );
        assert_eq!(std::fs::read(&path).expect("the old file"), b"old");
        write_atomically(&path, |out| out.write_all(b"new")).expect("a second write");
        assert_eq!(std::fs::read(&path).expect("the new file"), b"new");
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("a folder").count(),
            1
        );
        let nowhere = folder.path().join("missing/frame.ply");
        assert!(write_atomically(&nowhere, |_| Ok(())).is_err());
        assert!(write_atomically(folder.path(), |_| Ok(())).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn files_are_as_readable_as_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        std::fs::write(&a, "").expect("a plain file");
        write_atomically(&b, |_| Ok(())).expect("an atomic file");
        let mode = |path| {
            std::fs::metadata(path)
                .expect("a file")
                .permissions()
                .mode()
        };
        assert_eq!(mode(&a), mode(&b));
    }
}
