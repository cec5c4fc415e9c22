//! The `splitcast` command.

mod args;
mod cells;
mod column;
mod error;
mod fingerprint;
mod info;
mod render;
mod report;
mod reproduce;
mod scene;
mod scenes;
mod summary;
mod threads;
mod track;
mod trees;

use std::process::ExitCode;

use splitcast_console::{exit, parse_command_line};

use args::Cli;

fn main() -> ExitCode {
    match parse_command_line::<Cli>() {
        Ok(cli) => exit(cli.command.run()),
        Err(code) => code,
    }
}
