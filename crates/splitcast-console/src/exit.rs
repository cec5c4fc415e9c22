//! How a program ends.

use std::error::Error;
use std::io;
use std::process::ExitCode;

use crate::{FAILURE, USAGE, report_error};

/// Why a program ended early.
pub trait ProgramError: Error {
    /// Whether what was asked for makes no sense, so that asking again is no use.
    fn is_usage(&self) -> bool;

    /// The error of standard output, if that is what went wrong.
    fn of_stdout(&self) -> Option<&io::Error>;
}

/// Reports what went wrong, if anything, and gives the code to exit with. Whoever
/// closed the pipe that is written to, such as `head`, has seen enough: nothing went wrong.
pub fn exit(result: Result<(), impl ProgramError>) -> ExitCode {
    let Err(error) = result else {
        return ExitCode::SUCCESS;
    };
    let stdout = error.of_stdout();
    if stdout.is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe) {
        return ExitCode::SUCCESS;
    }
    report_error(&error.to_string());
    ExitCode::from(if error.is_usage() { USAGE } else { FAILURE })
}
