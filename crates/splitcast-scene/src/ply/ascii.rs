//! ASCII bodies: one record a line, values parted by blanks.

use std::io::BufRead;

use super::header::{Header, Scalar};
use super::records::{Fault, Records, Source, Value};
use crate::Place;
use crate::error::quoted;

/// An ASCII body.
pub(super) struct Ascii<'a, 's> {
    source: &'a mut Source<'s>,
    line_end: u8,
    /// The current line, with its end if it has one.
    line: Vec<u8>,
    /// Number of the current line in the file, from one.
    number: u64,
    /// Where the next value is looked for.
    cursor: usize,
}

impl<'a, 's> Ascii<'a, 's> {
    /// Starts behind the header.
    pub(super) fn new(source: &'a mut Source<'s>, header: &Header) -> Self {
        Ascii {
            source,
            line_end: header.line_end,
            line: Vec::new(),
            number: header.lines,
            cursor: 0,
        }
    }

    fn word(&mut self) -> Option<&[u8]> {
        let blank = |byte: &u8| byte.is_ascii_whitespace();
        let rest = &self.line[self.cursor..];
        let start = self.cursor + rest.iter().position(|byte| !blank(byte))?;
        let rest = &self.line[start..];
        self.cursor = start + rest.iter().position(blank).unwrap_or(rest.len());
        Some(&self.line[start..self.cursor])
    }

    /// A value is missing: the whole file ends here, or only the line.
    fn missing(&self, expected: &str) -> Fault {
        if self.line.last() == Some(&self.line_end) {
            Fault::Value {
                found: "the end of the line".into(),
                expected: expected.into(),
            }
        } else {
            Fault::End
        }
    }
}

impl Records for Ascii<'_, '_> {
    fn begin(&mut self) -> Result<(), Fault> {
        self.cursor = 0;
        loop {
            self.line.clear();
            self.number += 1;
            if self.source.read_until(self.line_end, &mut self.line)? == 0 {
                return Err(Fault::End);
            }
            if !self.line.trim_ascii().is_empty() {
                return Ok(());
            }
        }
    }

    fn scalar(&mut self, scalar: Scalar) -> Result<Value, Fault> {
        let Some(word) = self.word() else {
            return Err(self.missing(&format!("a value of type {}", scalar.name())));
        };
        parse(word, scalar).ok_or_else(|| Fault::Value {
            found: quoted(word),
            expected: format!("a value of type {}", scalar.name()),
        })
    }

    fn skip(&mut self, count: u64, scalar: Scalar) -> Result<(), Fault> {
        for _ in 0..count {
            if self.word().is_none() {
                return Err(self.missing(&format!("a value of type {}", scalar.name())));
            }
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), Fault> {
        match self.word() {
            None => Ok(()),
            Some(word) => Err(Fault::Value {
                found: quoted(word),
                expected: "the end of the line".into(),
            }),
        }
    }

    fn place(&self, _element: &str, _index: u64) -> Place {
        Place::Line(self.number)
    }

    fn surplus(&mut self) -> Result<Option<Place>, Fault> {
        match self.begin() {
            Ok(()) => Ok(Some(Place::Line(self.number))),
            Err(Fault::End) => Ok(None),
            Err(fault) => Err(fault),
        }
    }
}

fn parse(word: &[u8], scalar: Scalar) -> Option<Value> {
    let word = str::from_utf8(word).ok()?;
    Some(match scalar {
        Scalar::I8 => Value::Int(word.parse::<i8>().ok()?.into()),
        Scalar::U8 => Value::Int(word.parse::<u8>().ok()?.into()),
        Scalar::I16 => Value::Int(word.parse::<i16>().ok()?.into()),
        Scalar::U16 => Value::Int(word.parse::<u16>().ok()?.into()),
        Scalar::I32 => Value::Int(word.parse::<i32>().ok()?.into()),
        Scalar::U32 => Value::Int(word.parse::<u32>().ok()?.into()),
        Scalar::F32 => Value::Float(word.parse().ok()?),
        Scalar::F64 => Value::Double(word.parse().ok()?),
    })
}
