//! What looks odd about the files of a sequence. It is told, never mended:
//! which of two meanings was meant is for the user to say.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{MeshFormat, stem};
use crate::error::shown;
use crate::ply::{Counts, read_counts};

/// Something odd about a sequence. The message is one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SequenceWarning {
    /// Numbers are missing between two files that follow each other.
    #[error(
        "{missing} frames are missing between {} and {}; the motion jumps there",
        name(before),
        name(after)
    )]
    Gap {
        /// The last file before the gap.
        before: PathBuf,
        /// The first file behind it.
        after: PathBuf,
        /// How many numbers are missing.
        missing: u64,
    },
    /// Two files have the same number.
    #[error(
        "{} and {} have the same number; both are frames, in this order",
        name(first),
        name(second)
    )]
    SameNumber {
        /// The file that comes first.
        first: PathBuf,
        /// The file that comes second.
        second: PathBuf,
    },
    /// The names differ in more than one number, or in letters.
    #[error(
        "the files do not share one numbering, e.g. {} and {}; frames are in order of their names",
        name(first),
        name(second)
    )]
    MixedNames {
        /// The first file.
        first: PathBuf,
        /// The first file whose name is made differently.
        second: PathBuf,
    },
    /// The files are of more than one type.
    #[error("the files are of several types: {types}; all are frames")]
    MixedTypes {
        /// Each extension with its number of files.
        types: String,
    },
    /// A glob matched files that are no meshes; they were left out.
    #[error(
        "{count} matches are no mesh files and were left out, the first is {}",
        name(first)
    )]
    NotMeshes {
        /// The first of them.
        first: PathBuf,
        /// How many.
        count: usize,
    },
    /// Not all PLY headers promise the same numbers of vertices and faces.
    #[error(
        "the frames differ in size: {vertices_min} to {vertices_max} vertices, {faces_min} to {faces_max} faces, first at {}; the topology changes",
        name(first)
    )]
    MixedSizes {
        /// The first file that differs from the one before.
        first: PathBuf,
        /// Fewest vertices.
        vertices_min: u64,
        /// Most vertices.
        vertices_max: u64,
        /// Fewest faces.
        faces_min: u64,
        /// Most faces.
        faces_max: u64,
    },
}

/// Looks at the files' names, which are in order.
pub(super) fn of_names(files: &[PathBuf]) -> Vec<SequenceWarning> {
    let mut warnings = Vec::new();
    let mut types = BTreeMap::new();
    for format in files.iter().filter_map(|file| MeshFormat::of(file)) {
        *types.entry(format).or_insert(0_usize) += 1;
    }
    if types.len() > 1 {
        let list: Vec<String> = types
            .iter()
            .map(|(format, count)| format!("{count} {}", format.extension()))
            .collect();
        warnings.push(SequenceWarning::MixedTypes {
            types: list.join(", "),
        });
    }
    match numbers(files) {
        Ok(numbers) => warnings.extend(of_numbers(files, &numbers)),
        Err(odd) => warnings.push(SequenceWarning::MixedNames {
            first: files[0].clone(),
            second: files[odd].clone(),
        }),
    }
    warnings
}

/// Looks at the sizes that PLY headers promise.
pub(super) fn of_sizes(files: &[PathBuf]) -> Option<SequenceWarning> {
    if files.len() < 2 {
        return None;
    }
    // A header that cannot be read is an error of its frame.
    let counts: Vec<(&PathBuf, Counts)> = files
        .iter()
        .filter(|file| MeshFormat::of(file) != Some(MeshFormat::Obj))
        .filter_map(|file| Some((file, read_counts(file).ok()?)))
        .collect();
    let first = counts.windows(2).find(|pair| pair[0].1 != pair[1].1)?[1].0;
    let vertices = || counts.iter().map(|(_, counts)| counts.vertices);
    let faces = || counts.iter().map(|(_, counts)| counts.faces);
    Some(SequenceWarning::MixedSizes {
        first: first.clone(),
        vertices_min: vertices().min()?,
        vertices_max: vertices().max()?,
        faces_min: faces().min()?,
        faces_max: faces().max()?,
    })
}

fn name(path: &Path) -> String {
    shown(Path::new(path.file_name().unwrap_or_default()))
}

/// A file name as text and digits in turn, starting with text.
fn chunks(file: &Path) -> Vec<String> {
    let (mut chunks, mut last) = (Vec::new(), String::new());
    for c in stem(file).chars() {
        // An even number of chunks is followed by text, an odd one by digits.
        if c.is_ascii_digit() != (chunks.len() % 2 == 1) {
            chunks.push(std::mem::take(&mut last));
        }
        last.push(c);
    }
    chunks.push(last);
    chunks
}

/// The number in which the files' names differ, for each file. If they do not
/// differ in one number alone, the first file that is odd.
fn numbers(files: &[PathBuf]) -> Result<Vec<u64>, usize> {
    let names: Vec<Vec<String>> = files.iter().map(|file| chunks(file)).collect();
    let same_texts = |name: &Vec<String>| {
        name.len() == names[0].len() && name.iter().step_by(2).eq(names[0].iter().step_by(2))
    };
    if let Some(odd) = names.iter().position(|name| !same_texts(name)) {
        return Err(odd);
    }
    let mut varying = None;
    for (i, name) in names.iter().enumerate() {
        for place in (1..name.len()).step_by(2) {
            if name[place] != names[0][place] && *varying.get_or_insert(place) != place {
                return Err(i);
            }
        }
    }
    let Some(place) = varying else {
        return Ok(Vec::new());
    };
    names
        .iter()
        .enumerate()
        .map(|(i, name)| name[place].parse().map_err(|_| i))
        .collect()
}

fn of_numbers(files: &[PathBuf], numbers: &[u64]) -> Vec<SequenceWarning> {
    let steps = || numbers.windows(2).map(|pair| pair[1].abs_diff(pair[0]));
    // Every tenth step of a simulation is no gap.
    let usual = steps().filter(|&step| step > 0).min().unwrap_or(1);
    let pairs = files.windows(2).zip(steps());
    pairs
        .filter_map(|(pair, step)| {
            let (before, after) = (pair[0].clone(), pair[1].clone());
            match step / usual {
                0 => Some(SequenceWarning::SameNumber {
                    first: before,
                    second: after,
                }),
                1 => None,
                steps => Some(SequenceWarning::Gap {
                    before,
                    after,
                    missing: steps - 1,
                }),
            }
        })
        .collect()
}
