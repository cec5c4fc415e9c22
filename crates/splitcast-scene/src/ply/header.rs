//! The PLY header: format, elements and their properties.
//!
//! Read as Turk describes it ("The PLY polygon file format", 1994), with lines
//! that end in LF, CR LF or CR, `comment` and `obj_info` lines anywhere, and
//! both spellings of the scalar types (`uchar` and `uint8`).

use std::io::{BufRead, Read};
use std::path::Path;

use crate::SceneError;
use crate::error::quoted;

/// Longest header accepted, in bytes. Headers with long comments reach a few
/// kilobytes; a bound keeps a file without line ends from being read whole.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Bytes shown of a file that is no PLY file.
const SHOWN_BYTES: usize = 12;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A number type of the format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// The type's first name in the format's description.
    pub(super) fn name(self) -> &'static str {
        match self {
            Scalar::I8 => "char",
            Scalar::U8 => "uchar",
            Scalar::I16 => "short",
            Scalar::U16 => "ushort",
            Scalar::I32 => "int",
            Scalar::U32 => "uint",
            Scalar::F32 => "float",
            Scalar::F64 => "double",
        }
    }

    /// Bytes of one number in a binary body.
    pub(super) fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    pub(super) fn is_float(self) -> bool {
        matches!(self, Scalar::F32 | Scalar::F64)
    }
}

/// What one property holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

/// A named column of an element.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

/// A table of the body: `count` records of the same properties.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    /// Line of the header that names the element, counted from one.
    pub(super) line: u64,
    pub(super) properties: Vec<Property>,
}

/// A whole header.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    /// The byte that ends lines of an ASCII body: CR in old Macintosh files,
    /// else LF (with any CR before it to be trimmed).
    pub(super) line_end: u8,
    /// Number of lines, so that lines of the body can be counted on.
    pub(super) lines: u64,
    /// Number of bytes, up to and including the end of the last line.
    pub(super) bytes: u64,
}

impl Header {
    /// Reads up to and including `end_header`.
    ///
    /// # Errors
    /// [`SceneError::EmptyFile`], [`SceneError::NotAMesh`] or
    /// [`SceneError::Header`]; a failure of the reader becomes what `io` says.
    pub(super) fn read(
        path: &Path,
        reader: &mut impl BufRead,
        io: impl Fn(std::io::Error) -> SceneError,
    ) -> Result<Self, SceneError> {
        let mut lines = Lines::start(path, reader, &io)?;
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        loop {
            let text = lines.next(reader, &io)?;
            let bad = |reason: String| SceneError::Header {
                path: path.to_path_buf(),
                line: lines.count,
                reason,
            };
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words[..] {
                [] | ["comment" | "obj_info", ..] => {}
                ["end_header"] => break,
                ["format", name, version] => {
                    if format.is_some() {
                        return Err(bad("a second format line, expected one".into()));
                    }
                    format = Some(parse_format(name, version).map_err(bad)?);
                }
                ["element", name, count] => {
                    if elements.iter().any(|element| element.name == name) {
                        let name = quoted(name.as_bytes());
                        return Err(bad(format!("a second element {name}, expected one")));
                    }
                    elements.push(Element {
                        name: name.to_owned(),
                        count: count.parse().map_err(|_| {
                            let found = quoted(count.as_bytes());
                            bad(format!("found {found}, expected a number of elements"))
                        })?,
                        line: lines.count,
                        properties: Vec::new(),
                    });
                }
                ["property", ref rest @ ..] => {
                    let property = parse_property(rest).map_err(bad)?;
                    let Some(element) = elements.last_mut() else {
                        return Err(bad("a property before any element".into()));
                    };
                    if element.properties.iter().any(|p| p.name == property.name) {
                        let name = quoted(property.name.as_bytes());
                        return Err(bad(format!("a second property {name} in one element")));
                    }
                    element.properties.push(property);
                }
                _ => {
                    let found = quoted(text.as_bytes());
                    return Err(bad(format!(
                        "found {found}, expected format, element, property, comment or end_header"
                    )));
                }
            }
        }
        Ok(Header {
            format: format.ok_or_else(|| SceneError::Header {
                path: path.to_path_buf(),
                line: lines.count,
                reason: "no format line, expected one such as \"format ascii 1.0\"".into(),
            })?,
            elements,
            line_end: lines.end,
            lines: lines.count,
            bytes: lines.bytes,
        })
    }

    /// The element of this name.
    pub(super) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }
}

fn parse_format(name: &str, version: &str) -> Result<Format, String> {
    if version != "1.0" {
        let found = quoted(version.as_bytes());
        return Err(format!("version {found}, expected 1.0"));
    }
    match name {
        "ascii" => Ok(Format::Ascii),
        "binary_little_endian" => Ok(Format::LittleEndian),
        "binary_big_endian" => Ok(Format::BigEndian),
        _ => Err(format!(
            "format {}, expected ascii, binary_little_endian or binary_big_endian",
            quoted(name.as_bytes())
        )),
    }
}

fn parse_property(words: &[&str]) -> Result<Property, String> {
    let scalar = |word: &str| {
        Scalar::parse(word).ok_or_else(|| {
            let found = quoted(word.as_bytes());
            format!("type {found}, expected char, uchar, short, ushort, int, uint, float or double")
        })
    };
    let (name, kind) = match *words {
        ["list", count, item, name] => {
            let (count, item) = (scalar(count)?, scalar(item)?);
            if count.is_float() {
                return Err("a list counted by a float, expected an integer type".into());
            }
            (name, Kind::List { count, item })
        }
        [kind, name] if kind != "list" => (name, Kind::Scalar(scalar(kind)?)),
        _ => {
            return Err(
                "expected \"property TYPE NAME\" or \"property list TYPE TYPE NAME\"".into(),
            );
        }
    };
    Ok(Property {
        name: name.to_owned(),
        kind,
    })
}

/// The lines of a header, with the count and the bytes read so far.
struct Lines<'a> {
    path: &'a Path,
    end: u8,
    count: u64,
    bytes: u64,
}

impl<'a> Lines<'a> {
    /// Reads the first line, which tells how lines end.
    fn start(
        path: &'a Path,
        reader: &mut impl BufRead,
        io: &impl Fn(std::io::Error) -> SceneError,
    ) -> Result<Self, SceneError> {
        let mut first = Vec::new();
        let mut end = b'\n';
        // Byte by byte over at most five: `ply`, and one or two line ends.
        while first.len() < 5 {
            let Some(&byte) = reader.fill_buf().map_err(io)?.first() else {
                break;
            };
            // A CR that no LF follows ends the line by itself.
            if first.last() == Some(&b'\r') && byte != b'\n' {
                end = b'\r';
                break;
            }
            reader.consume(1);
            first.push(byte);
            if byte == b'\n' || !b"ply\r\n".contains(&byte) {
                break;
            }
        }
        if first.is_empty() {
            return Err(SceneError::EmptyFile {
                path: path.to_path_buf(),
            });
        }
        if !matches!(&first[..], b"ply\n" | b"ply\r" | b"ply\r\n") {
            // A little more of it tells people what the file really is.
            let more = SHOWN_BYTES.saturating_sub(first.len()) as u64;
            reader
                .by_ref()
                .take(more)
                .read_to_end(&mut first)
                .map_err(io)?;
            let found = quoted(&first);
            return Err(SceneError::NotAMesh {
                path: path.to_path_buf(),
                format: "a PLY",
                reason: format!("it starts with {found}, expected a line \"ply\""),
            });
        }
        Ok(Lines {
            path,
            end,
            count: 1,
            bytes: first.len() as u64,
        })
    }

    /// The next line without its end.
    fn next(
        &mut self,
        reader: &mut impl BufRead,
        io: &impl Fn(std::io::Error) -> SceneError,
    ) -> Result<String, SceneError> {
        let mut line = Vec::new();
        let left = MAX_HEADER_BYTES.saturating_sub(self.bytes);
        let taken = std::io::Read::take(reader, left)
            .read_until(self.end, &mut line)
            .map_err(io)?;
        self.bytes += taken as u64;
        self.count += 1;
        if line.pop_if(|last| *last == self.end).is_none() {
            let reason = if taken as u64 == left {
                format!("no end_header in the first {MAX_HEADER_BYTES} bytes")
            } else if line.trim_ascii() == b"end_header" {
                "the file ends with the header, expected elements behind it".into()
            } else {
                "the file ends before the line end_header".into()
            };
            return Err(SceneError::Header {
                path: self.path.to_path_buf(),
                line: self.count,
                reason,
            });
        }
        Ok(String::from_utf8_lossy(line.trim_ascii_end()).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<Header, SceneError> {
        let path = Path::new("a.ply");
        Header::read(path, &mut &text[..], |source| SceneError::Io {
            path: path.to_path_buf(),
            source,
        })
    }

    const TEXT: &str = "ply\ncomment made by hand\nformat binary_big_endian 1.0\n\
        obj_info num_cols 3\nelement vertex 3\nproperty float32 x\n\
        property list uint8 int32 vertex_indices\nend_header\n";

    #[test]
    fn every_kind_of_line_end_gives_the_same_header() {
        for (end, byte) in [
            ("\n", b'\n'),
            ("\r\n", b'\n'),
            ("\r", b'\r'),
            (" \t\r\n", b'\n'),
        ] {
            let text = TEXT.replace('\n', end).replacen("ply \t", "ply", 1);
            let header = read(format!("{text}body").as_bytes()).expect("a good header");
            assert_eq!(header.format, Format::BigEndian);
            assert_eq!(header.line_end, byte);
            assert_eq!(header.bytes, text.len() as u64);
            assert_eq!(header.lines, 8);
            let vertex = header.element("vertex").expect("an element");
            assert_eq!((vertex.count, vertex.properties.len()), (3, 2));
            assert_eq!(vertex.properties[0].kind, Kind::Scalar(Scalar::F32));
            let list = Kind::List {
                count: Scalar::U8,
                item: Scalar::I32,
            };
            assert_eq!(vertex.properties[1].kind, list);
        }
    }

    #[test]
    fn bad_lines_are_named() {
        for (from, to, line, reason) in [
            ("format b", "farmat b", 3, "found \"farmat"),
            ("big_endian", "middle_endian", 3, "expected ascii"),
            ("1.0", "2.0", 3, "version \"2.0\""),
            ("vertex 3", "vertex -3", 5, "found \"-3\""),
            (
                "vertex 3",
                "vertex 99999999999999999999",
                5,
                "number of elements",
            ),
            ("float32 x", "quad x", 6, "type \"quad\""),
            ("float32 x", "x", 6, "property TYPE NAME"),
            ("list uint8", "list float", 7, "integer type"),
            (
                "obj_info num_cols 3",
                "property int x",
                4,
                "before any element",
            ),
            ("float32 x", "float vertex_indices", 7, "second property"),
            (
                "property float32 x",
                "element vertex 4",
                6,
                "second element",
            ),
            (
                "obj_info num_cols 3",
                "format ascii 1.0",
                4,
                "second format",
            ),
            (
                "format binary_big_endian 1.0",
                "comment",
                8,
                "no format line",
            ),
            ("end_header\n", "", 8, "ends before"),
            ("end_header\n", "end_header", 8, "ends with the header"),
        ] {
            let error = read(TEXT.replacen(from, to, 1).as_bytes()).expect_err(to);
            let message = error.to_string();
            assert!(
                matches!(error, SceneError::Header { line: l, .. } if l == line),
                "{message}"
            );
            assert!(
                message.contains(reason) && !message.contains('\n'),
                "{message}"
            );
        }
    }

    #[test]
    fn what_is_no_ply_is_told_from_what_is_empty() {
        assert!(matches!(read(b""), Err(SceneError::EmptyFile { .. })));
        for text in [&b"p"[..], b"plyx\n", b"GIF89a", b"\n", b"ply", b"\0\0\0\0"] {
            assert!(
                matches!(read(text), Err(SceneError::NotAMesh { .. })),
                "{text:?}"
            );
        }
        let endless = [
            b"ply\nformat ascii 1.0\ncomment ".to_vec(),
            vec![b'x'; 2 << 20],
        ]
        .concat();
        let message = read(&endless).expect_err("no end").to_string();
        assert!(
            message.contains("line 3") && message.contains("1048576"),
            "{message}"
        );
    }
}
