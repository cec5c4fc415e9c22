//! Numbered file names as C's `printf` spells them: `frame_%04d.ply`.

/// A file name with one `%d` or `%0Nd` in it, which stands for a frame's number;
/// `%%` is a percent sign.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NumberPattern {
    before: String,
    /// Least number of digits, filled up with zeros.
    width: usize,
    after: String,
}

impl NumberPattern {
    /// Reads a file's name, without its folder.
    ///
    /// # Errors
    /// What is wrong with the pattern and what was expected, in words.
    pub fn parse(name: &str) -> Result<Self, String> {
        let (mut before, mut width, mut after) = (String::new(), None, String::new());
        let mut rest = name;
        while let Some(at) = rest.find('%') {
            let text = if width.is_some() {
                &mut after
            } else {
                &mut before
            };
            text.push_str(&rest[..at]);
            rest = &rest[at + 1..];
            if let Some(behind) = rest.strip_prefix('%') {
                text.push('%');
                rest = behind;
                continue;
            }
            let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
            let (spec, behind) = rest.split_at(digits);
            let number = match spec {
                "" => Some(1),
                // Without the zero, C pads with blanks, which no file has.
                spec if spec.starts_with('0') => spec.parse().ok().filter(|width| *width <= 20),
                _ => None,
            };
            let (Some(number), Some(behind)) = (number, behind.strip_prefix('d')) else {
                return Err(
                    "expected %d, or %04d with the number of digits, or %% for a percent sign"
                        .into(),
                );
            };
            if width.replace(number).is_some() {
                return Err("more than one number, expected one %d or %04d".into());
            }
            rest = behind;
        }
        let Some(width) = width else {
            return Err("no number in it, expected %d or %04d".into());
        };
        after.push_str(rest);
        Ok(NumberPattern {
            before,
            width: width.max(1),
            after,
        })
    }

    /// The file name for a number.
    pub fn name(&self, number: u64) -> String {
        let NumberPattern {
            before,
            width,
            after,
        } = self;
        format!("{before}{number:0width$}{after}")
    }

    /// The number of a file name, if it is just as the pattern would write it.
    pub fn number(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(&self.before)?.strip_suffix(&self.after)?;
        if !digits.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        let number = digits.parse().ok()?;
        (self.name(number) == name).then_some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn number_patterns_match_what_they_would_write() {
        let pattern = NumberPattern::parse("f_%04d.ply").expect("a pattern");
        for (name, number) in [
            ("f_0000.ply", Some(0)),
            ("f_0123.ply", Some(123)),
            ("f_12345.ply", Some(12345)),
            ("f_123.ply", None),
            ("f_01234.ply", None),
            ("f_+123.ply", None),
            ("f_.ply", None),
            ("f_0001.obj", None),
            ("g_0001.ply", None),
            ("f_99999999999999999999999.ply", None),
        ] {
            assert_eq!(pattern.number(name), number, "{name}");
            assert!(
                number.is_none_or(|number| pattern.name(number) == name),
                "{name}"
            );
        }
        let pattern = NumberPattern::parse("100%%_%d%%.ply").expect("a pattern");
        assert_eq!(pattern.number("100%_7%.ply"), Some(7));
        assert_eq!(pattern.number("100%_07%.ply"), None);
        for bad in [
            "%s.ply",
            "%4d.ply",
            "%04x.ply",
            "%d_%d.ply",
            "%",
            "%%.ply",
            "%099d.ply",
        ] {
            let reason = NumberPattern::parse(bad).expect_err(bad);
            assert!(reason.contains("expected"), "{bad}: {reason}");
        }
    }
}
