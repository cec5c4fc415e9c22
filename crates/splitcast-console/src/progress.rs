//! How far the work is: a bar on a terminal, plain lines in a log.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Least time between two lines of steps about which there is nothing to tell
/// but their number.
const QUIET: Duration = Duration::from_secs(5);

/// Tells about steps of one piece of work, on standard error.
pub struct Progress {
    what: &'static str,
    total: usize,
    done: usize,
    started: Instant,
    told: Instant,
    /// The bar, if standard error is a terminal.
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Starts work of `total` steps; `what` names it in a word.
    pub fn new(what: &'static str, total: usize) -> Self {
        let bar = io::stderr().is_terminal().then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            let style =
                ProgressStyle::with_template("{prefix} {wide_bar:.cyan/dim} {pos}/{len} {msg}");
            bar.set_style(style.expect("the template is valid").progress_chars("━━╌"));
            bar.set_prefix(what);
            bar.tick();
            bar
        });
        Self {
            what,
            total,
            done: 0,
            started: Instant::now(),
            told: Instant::now(),
            bar,
        }
    }

    /// One step is done; `message` tells more about it.
    pub fn step(&mut self, message: &str) {
        self.done += 1;
        let left = self.started.elapsed() / self.done as u32
            * (self.total - self.done.min(self.total)) as u32;
        let left = clock(left);
        let quiet = message.is_empty();
        // The time first: a narrow terminal cuts the end off.
        let message = if quiet {
            format!("{left} left")
        } else {
            format!("{left} left, {message}")
        };
        match &self.bar {
            Some(bar) => {
                bar.set_message(message);
                bar.inc(1);
            }
            None if quiet && self.told.elapsed() < QUIET => {}
            None => {
                self.told = Instant::now();
                let (what, done, total) = (self.what, self.done, self.total);
                // Nobody is left to tell if standard error is closed.
                let _ = writeln!(io::stderr().lock(), "{what} {done}/{total}: {message}");
            }
        }
    }

    /// Takes the bar off the screen; lines stay.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        // An error message must not be mixed with a bar.
        self.finish();
    }
}

/// A length of time as people read it: 0:07, 12:40, 1:02:03.
pub fn clock(time: Duration) -> String {
    let seconds = (time.as_secs_f64() + 0.5) as u64;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    if hours > 0 {
        format!("{hours}:{minutes:02}:{seconds:02}")
    } else {
        format!("{minutes}:{seconds:02}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_read_like_a_clock() {
        assert_eq!(clock(Duration::from_millis(6700)), "0:07");
        assert_eq!(clock(Duration::from_secs(760)), "12:40");
        assert_eq!(clock(Duration::from_secs(3723)), "1:02:03");
    }
}
