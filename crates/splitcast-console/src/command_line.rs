//! Reading a whole command line.

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Error, Parser};

use crate::message::report_error;

/// Exit code when the work could not be done.
pub const FAILURE: u8 = 1;

/// Exit code when what was asked for makes no sense, so that asking again is
/// no use.
pub const USAGE: u8 = 2;

/// Reads the command line. Help and version are printed here, and so is what
/// is wrong with the command line, on one line.
///
/// # Errors
/// The code to exit with, if there is nothing left to do: success after help or
/// version, [`USAGE`] otherwise.
pub fn parse_command_line<P: Parser>() -> Result<P, ExitCode> {
    P::try_parse().map_err(|error| match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            // Printing only fails if nobody is there to read.
            let _ = error.print();
            ExitCode::SUCCESS
        }
        _ => {
            report_error(&message::<P>(&error));
            ExitCode::from(USAGE)
        }
    })
}

/// What is wrong with a command line, in one line.
fn message<P: Parser>(error: &Error) -> String {
    match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand => {
            format!("no command given: try {} --help", P::command().get_name())
        }
        _ => first_paragraph(&error.to_string()),
    }
}

/// What clap found wrong, without the usage that it adds below.
fn first_paragraph(message: &str) -> String {
    let lines = message.lines().map(str::trim);
    let told: Vec<&str> = lines
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more information"))
        .filter(|line| !line.is_empty())
        .collect();
    let told = told.join(" ");
    let told = told.strip_prefix("error: ").unwrap_or(&told);
    format!("{} (see --help)", told.trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;

    #[derive(Debug, Parser)]
    #[command(name = "weave")]
    struct Cli {
        #[command(subcommand)]
        command: Command,
    }

    #[derive(Debug, clap::Subcommand)]
    enum Command {
        Start {
            #[arg(long, value_parser = crate::parse_threads)]
            threads: NonZeroUsize,
        },
    }

    fn told(args: &[&str]) -> String {
        let args = ["weave"].iter().chain(args);
        message::<Cli>(&Cli::try_parse_from(args).expect_err("wrong on purpose"))
    }

    #[test]
    fn mistakes_are_told_on_one_line() {
        assert_eq!(told(&[]), "no command given: try weave --help");
        assert_eq!(
            told(&["start", "--threads", "0"]),
            "invalid value '0' for '--threads <THREADS>': expected a number from 1 to 1024 \
             (see --help)"
        );
        assert_eq!(
            told(&["start"]),
            "the following required arguments were not provided: --threads <THREADS> (see --help)"
        );
    }

    #[test]
    fn a_right_command_line_is_read() {
        let cli = Cli::try_parse_from(["weave", "start", "--threads", "3"]).unwrap();
        let Command::Start { threads } = cli.command;
        assert_eq!(threads.get(), 3);
    }
}
