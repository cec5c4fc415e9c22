//! The `splitcast-bench` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    splitcast_bench::command::main()
}
