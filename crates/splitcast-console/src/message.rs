//! One line on standard error for everything that there is to say.

use std::io;

/// Prints `error: …` on one line, whatever a file's name holds.
pub fn report_error(message: &str) {
    print_line("error", message);
}

/// Prints `warning: …` on one line.
pub fn warn(message: &str) {
    print_line("warning", message);
}

fn print_line(kind: &str, message: &str) {
    let line: String = message
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    // Nobody is left to tell if standard error is closed.
    let _ = io::Write::write_fmt(&mut io::stderr(), format_args!("{kind}: {line}\n"));
}
