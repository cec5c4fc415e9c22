//! Text from outside, made safe as content and attribute values of XML and HTML.

use std::fmt::{self, Display, Formatter, Write};

use askama::filters::Escaper;

/// Displays a string escaped.
pub(crate) struct Escaped<'a>(pub(crate) &'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        Xml.write_escaped_str(f, self.0)
    }
}

/// The escaper of the templates, named in `askama.toml`.
///
/// Characters that XML 1.0 cannot hold, such as NUL, come out as U+FFFD.
#[derive(Clone, Copy)]
pub(crate) struct Xml;

impl Escaper for Xml {
    fn write_escaped_str<W: Write>(&self, mut dest: W, string: &str) -> fmt::Result {
        for c in string.chars() {
            match c {
                '&' => dest.write_str("&amp;")?,
                '<' => dest.write_str("&lt;")?,
                '>' => dest.write_str("&gt;")?,
                '"' => dest.write_str("&quot;")?,
                '\'' => dest.write_str("&#39;")?,
                '\t' | '\n' => dest.write_char(c)?,
                c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => {
                    dest.write_char('\u{fffd}')?;
                }
                c => dest.write_char(c)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_and_control_characters_come_out_as_text() {
        let escaped = Escaped("<a b='c' d=\"e\">&\0\u{1b}\u{ffff}\n").to_string();
        assert_eq!(
            escaped,
            "&lt;a b=&#39;c&#39; d=&quot;e&quot;&gt;&amp;\u{fffd}\u{fffd}\u{fffd}\n"
        );
    }
}
