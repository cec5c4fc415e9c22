//! From an input to a list of mesh files in order.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::{MeshFormat, SequenceWarning};
use crate::{NumberPattern, SceneError};

/// The files of a sequence.
pub(super) struct Found {
    /// At least one, in order.
    pub(super) files: Vec<PathBuf>,
    /// The folder they lie in, if they lie in one.
    pub(super) folder: Option<PathBuf>,
    pub(super) warnings: Vec<SequenceWarning>,
}

/// Finds the files that an input names; see [`super::MeshSequence::open`].
pub(super) fn find(input: &Path) -> Result<Found, SceneError> {
    match std::fs::metadata(input) {
        Ok(metadata) if metadata.is_dir() => in_folder(input),
        Ok(_) if MeshFormat::of(input).is_some() => Ok(Found {
            files: vec![input.to_path_buf()],
            folder: None,
            warnings: Vec::new(),
        }),
        Ok(_) => Err(SceneError::UnknownExtension {
            path: input.to_path_buf(),
        }),
        Err(error) => by_pattern(input, error),
    }
}

fn in_folder(folder: &Path) -> Result<Found, SceneError> {
    let files: Vec<PathBuf> = list(folder)?
        .into_iter()
        .filter(|name| !name.as_encoded_bytes().starts_with(b"."))
        .map(|name| folder.join(name))
        .filter(|path| MeshFormat::of(path).is_some() && path.is_file())
        .collect();
    if files.is_empty() {
        return Err(SceneError::EmptyFolder {
            path: folder.to_path_buf(),
        });
    }
    Ok(Found {
        files: natural_order(files),
        folder: Some(folder.to_path_buf()),
        warnings: Vec::new(),
    })
}

/// Nothing stands under the input's own name, for the reason given.
fn by_pattern(input: &Path, error: std::io::Error) -> Result<Found, SceneError> {
    let text = input.to_string_lossy();
    let name = input.file_name().unwrap_or_default().to_string_lossy();
    if name.contains('%') {
        by_number(input, &name)
    } else if text.contains(['*', '?', '[']) {
        by_glob(input, &text)
    } else if error.kind() == std::io::ErrorKind::NotFound {
        Err(SceneError::Missing {
            path: input.to_path_buf(),
        })
    } else {
        Err(SceneError::Io {
            path: input.to_path_buf(),
            source: error,
        })
    }
}

fn by_number(input: &Path, name: &str) -> Result<Found, SceneError> {
    let pattern = NumberPattern::parse(name).map_err(|reason| SceneError::BadPattern {
        pattern: input.to_path_buf(),
        reason,
    })?;
    if MeshFormat::of(input).is_none() {
        return Err(SceneError::UnknownExtension {
            path: input.to_path_buf(),
        });
    }
    let folder = match input.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(SceneError::Missing {
            path: folder.to_path_buf(),
        });
    }
    let mut files = BTreeMap::new();
    for name in list(folder)? {
        let path = input.with_file_name(&name);
        if let Some(number) = name.to_str().and_then(|name| pattern.number(name))
            && path.is_file()
        {
            files.insert(number, path);
        }
    }
    if files.is_empty() {
        return Err(SceneError::NoMatch {
            pattern: input.to_path_buf(),
        });
    }
    Ok(Found {
        files: files.into_values().collect(),
        folder: Some(folder.to_path_buf()),
        warnings: Vec::new(),
    })
}

fn by_glob(input: &Path, text: &str) -> Result<Found, SceneError> {
    let as_the_shell = glob::MatchOptions {
        require_literal_leading_dot: true,
        ..glob::MatchOptions::new()
    };
    let matches = glob::glob_with(text, as_the_shell).map_err(|error| SceneError::BadPattern {
        pattern: input.to_path_buf(),
        reason: error.to_string(),
    })?;
    let (mut files, mut others) = (Vec::new(), Vec::new());
    for entry in matches {
        let path = entry.map_err(|error| SceneError::Io {
            path: error.path().to_path_buf(),
            source: error.into(),
        })?;
        match MeshFormat::of(&path) {
            Some(_) if path.is_file() => files.push(path),
            _ => others.push(path),
        }
    }
    if files.is_empty() {
        return Err(SceneError::NoMatch {
            pattern: input.to_path_buf(),
        });
    }
    let parent = |path: &PathBuf| path.parent().map(Path::to_path_buf);
    let folder =
        parent(&files[0]).filter(|_| files.iter().all(|file| file.parent() == files[0].parent()));
    let others = natural_order(others);
    let skipped = others.first().map(|first| SequenceWarning::NotMeshes {
        first: first.clone(),
        count: others.len(),
    });
    Ok(Found {
        files: natural_order(files),
        folder,
        warnings: skipped.into_iter().collect(),
    })
}

/// Names of the entries of a folder.
fn list(folder: &Path) -> Result<Vec<OsString>, SceneError> {
    let io = |source| SceneError::Io {
        path: folder.to_path_buf(),
        source,
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        names.push(entry.map_err(io)?.file_name());
    }
    Ok(names)
}

/// Sorts as people count: `frame2` before `frame10`. Names that are equal so
/// far (`frame1`, `frame01`) follow their bytes, so that the order is total.
fn natural_order(mut files: Vec<PathBuf>) -> Vec<PathBuf> {
    files.sort_by(|a, b| {
        let (left, right) = (a.to_string_lossy(), b.to_string_lossy());
        natord::compare(&left, &right).then_with(|| a.cmp(b))
    });
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_natural_and_total() {
        let names = ["b1", "a10", "a2", "a01", "a1", "A3"].map(PathBuf::from);
        let sorted = natural_order(names.to_vec());
        let mut reversed = sorted.clone();
        reversed.reverse();
        assert_eq!(natural_order(reversed), sorted);
        let at = |name: &str| sorted.iter().position(|path| path == Path::new(name));
        assert!(at("a1") < at("a2") && at("a2") < at("a10") && at("a10") < at("b1"));
    }
}
