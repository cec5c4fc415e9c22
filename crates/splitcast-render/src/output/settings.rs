//! What a frame was made with, kept inside the frame's file.

use std::fmt::{Display, Write};

/// Named settings that decide what a picture looks like: input, size, samples,
/// camera and so on. Two runs with equal settings make equal pictures, so a
/// resumed run may keep what the earlier one finished.
///
/// Leave out what does not change pixels, such as the number of threads, the
/// range of frames or the frame rate: those may differ between the runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    entries: Vec<(String, String)>,
}

impl Settings {
    /// No settings yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one setting; `name` should be the flag or field a person would change.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: impl Display) -> Self {
        self.entries.push((name.into(), value.to_string()));
        self
    }

    /// One `name=value` a line in plain ASCII, as it stands in the files.
    pub(crate) fn to_text(&self) -> String {
        let mut text = String::new();
        for (name, value) in &self.entries {
            writeln!(text, "{}={}", escaped(name), escaped(value))
                .expect("writing to a string cannot fail");
        }
        text
    }

    /// The first difference between these settings and the `text` of a file,
    /// in words; `None` if the file was made with the same.
    pub(crate) fn difference(&self, text: Option<&str>) -> Option<String> {
        let Some(text) = text else {
            return Some("they do not say what they were made with".to_owned());
        };
        let own = self.to_text();
        if own == text {
            return None;
        }
        let was = |name: &str| {
            text.lines()
                .find_map(|line| line.strip_prefix(name)?.strip_prefix('='))
        };
        for line in own.lines() {
            let (name, value) = line.split_once('=').unwrap_or((line, ""));
            match was(name) {
                Some(old) if old == value => {}
                Some(old) => return Some(format!("{name} was {old} and is now {value}")),
                None => return Some(format!("{name} was not set and is now {value}")),
            }
        }
        Some("settings were set that no longer are".to_owned())
    }
}

/// Printable ASCII as it is, everything else as `\u{…}`: what the text fields
/// of every format can hold.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            ' '..='~' if c != '\\' => out.push(c),
            _ => out.extend(c.escape_unicode()),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_settings_match_their_text() {
        let settings = Settings::new().with("input", "hörse=1\nx").with("spp", 4);
        assert!(settings.to_text().is_ascii());
        assert_eq!(settings.to_text().lines().count(), 2);
        assert_eq!(settings.difference(Some(&settings.to_text())), None);
    }

    #[test]
    fn a_difference_names_the_setting() {
        let old = Settings::new().with("size", "8x8").with("spp", 4).to_text();
        let new = Settings::new().with("size", "8x8").with("spp", 16);
        assert_eq!(
            new.difference(Some(&old)).as_deref(),
            Some("spp was 4 and is now 16")
        );
        assert!(new.difference(None).is_some());
        assert!(Settings::new().difference(Some(&old)).is_some());
        let more = new.clone().with("spp_extra", 1);
        assert!(more.difference(Some(&new.to_text())).is_some());
    }
}
