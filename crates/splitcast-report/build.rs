//! Tells the crate which commit and which compiler it is built from.
//!
//! Cargo runs this again when HEAD moves or a source file changes, so the mark for
//! uncommitted changes is that of the last build, and an idle build stays idle.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the program is made of, relative to the top of the checkout.
const SOURCES: [&str; 3] = ["crates", "Cargo.toml", "Cargo.lock"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let manifest = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let commit = commit(&manifest).unwrap_or_else(|| "unknown".into());
    println!("cargo::rustc-env=SPLITCAST_COMMIT={commit}");

    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let compiler = output(Command::new(rustc).arg("--version"));
    let compiler = compiler.unwrap_or_else(|| "unknown".into());
    println!("cargo::rustc-env=SPLITCAST_COMPILER={compiler}");
}

/// The commit that the sources are from, `None` outside a checkout of this project: a
/// packaged crate may be built somewhere inside another one's.
fn commit(manifest: &Path) -> Option<String> {
    let git = |args: &[&str]| output(Command::new("git").args(args).current_dir(manifest));
    let top = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?);
    let ours = top.join("crates/splitcast-report").canonicalize().ok()?;
    if ours != manifest.canonicalize().ok()? {
        return None;
    }
    // A path that does not exist would make Cargo run this at every build.
    let watched = ["HEAD", "logs/HEAD"].map(|name| git(&["rev-parse", "--git-path", name]));
    let watched = watched
        .into_iter()
        .flatten()
        .map(|path| manifest.join(path));
    for path in watched.chain(SOURCES.map(|source| top.join(source))) {
        if path.exists() {
            println!("cargo::rerun-if-changed={}", path.display());
        }
    }
    let commit = git(&["rev-parse", "HEAD"])?;
    let status = output(
        Command::new("git")
            .args(["--no-optional-locks", "status", "--porcelain", "--"])
            .args(SOURCES)
            .current_dir(top),
    )?;
    let changes = if status.is_empty() { "" } else { " + changes" };
    Some(format!("{commit}{changes}"))
}

/// What a command prints, `None` where it cannot be run or fails.
fn output(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|out| out.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
