//! How much room text takes. The page's font is unknown, so these are estimates
//! for common sans-serif fonts, on the generous side.

/// Estimated width of `text` set at `size`.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let em = |c: char| match c {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | ';' | '\'' | '|' | '!' | '·' => 0.3,
        ' ' | 'f' | 'r' | 't' | '(' | ')' | '[' | ']' | '/' | '-' => 0.38,
        '\u{2009}' => 0.2,
        '⁰'..='⁹' | '⁻' | '¹' | '²' | '³' => 0.42,
        'm' | 'w' | 'M' | 'W' | '@' | '%' => 0.92,
        'A'..='Z' => 0.7,
        // Hangul, kana, ideographs and most symbols are as wide as they are high.
        '\u{1100}'.. => 1.0,
        '0'..='9' => 0.64,
        // Shown as U+FFFD.
        c if c.is_control() => 1.0,
        _ => 0.62,
    };
    text.chars().map(em).sum::<f64>() * size
}

/// Breaks `text` at spaces into lines of at most `room`, and at most `most` lines; what
/// does not fit is cut and ends in an ellipsis.
pub(super) fn wrap(text: &str, size: f64, room: f64, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let full = lines.len() >= most;
        match lines.last_mut() {
            // Past the last line, everything joins it and is cut below.
            Some(line)
                if full || width(line, size) + width(" ", size) + width(word, size) <= room =>
            {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
        .into_iter()
        .map(|line| cut(&line, size, room))
        .collect()
}

/// `text` as far as it fits `room`, with an ellipsis where something is missing.
pub(super) fn cut(text: &str, size: f64, room: f64) -> String {
    if width(text, size) <= room {
        return text.into();
    }
    let room = room - width("…", size);
    let mut taken = 0.0;
    let fits = |c: &char| {
        taken += width(c.encode_utf8(&mut [0; 4]), size);
        taken <= room
    };
    let mut kept: String = text.chars().take_while(fits).collect();
    kept.truncate(kept.trim_end().len());
    kept.push('…');
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_fit_and_nothing_is_lost_without_an_ellipsis() {
        let text = "one two three four five six seven";
        let lines = wrap(text, 10.0, 80.0, 9);
        assert_eq!(lines.join(" "), text);
        assert!(lines.len() > 1 && lines.iter().all(|line| width(line, 10.0) <= 80.0));

        let lines = wrap(text, 10.0, 80.0, 2);
        assert_eq!(lines.len(), 2);
        assert!(lines[1].ends_with('…') && width(&lines[1], 10.0) <= 80.0);

        assert_eq!(wrap("  ", 10.0, 80.0, 2), Vec::<String>::new());
        assert_eq!(wrap("Donaudampfschiff", 10.0, 40.0, 3).len(), 1);
    }
}
