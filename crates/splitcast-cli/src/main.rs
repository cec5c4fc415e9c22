//! The `splitcast` command.

mod args;
mod error;
mod fingerprint;
mod info;
mod input;
mod progress;
mod render;
mod report;
mod reproduce;
mod scenes;
mod summary;
mod table;

use std::process::ExitCode;

fn main() -> ExitCode {
    match args::parse() {
        Ok(command) => error::exit(command.run()),
        Err(code) => code,
    }
}
