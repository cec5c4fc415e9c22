//! The form of all JSON outputs.

use serde::Serialize;

/// Pretty JSON with a line end.
///
/// # Panics
/// If a map within `value` has keys that are not text, or its own
/// implementation fails.
pub fn to_json(value: &impl Serialize) -> String {
    let mut text = serde_json::to_string_pretty(value)
        .expect("structures with named fields can always be written as JSON");
    text.push('\n');
    text
}
