//! Which format and which files a name such as `frame_%04d.png` stands for.

use std::ffi::OsStr;
use std::fmt;
use std::path::{Path, PathBuf};

use splitcast_scene::NumberPattern;

use super::error::OutputError;

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputFormat {
    /// One video: AV1 in an MP4 container, 8 bits, 4:2:0.
    Mp4,
    /// One animated PNG: lossless, 8 bits, repeats for ever.
    Apng,
    /// One PNG a frame: lossless, 8 bits, sRGB.
    Png,
    /// One OpenEXR a frame: linear light in 16-bit floats.
    Exr,
}

impl fmt::Display for OutputFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mp4 => "MP4",
            Self::Apng => "APNG",
            Self::Png => "PNG",
            Self::Exr => "EXR",
        })
    }
}

/// A parsed output name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputSpec {
    path: PathBuf,
    format: OutputFormat,
    /// The file's name, if it has a frame number in it.
    pattern: Option<NumberPattern>,
}

impl OutputSpec {
    /// Reads the format off the name's extension. Names of PNG and EXR
    /// sequences hold one pattern for the frame number, `%d` or `%04d` (four
    /// digits, zeros in front), and `%%` for a per cent sign; without a
    /// pattern the name stands for a single picture.
    ///
    /// # Errors
    /// [`OutputError::UnknownExtension`] and [`OutputError::Pattern`].
    pub fn parse(path: impl AsRef<Path>) -> Result<Self, OutputError> {
        let path = path.as_ref();
        let extension = path.extension().and_then(OsStr::to_str);
        let format = match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("mp4") => OutputFormat::Mp4,
            Some("apng") => OutputFormat::Apng,
            Some("png") => OutputFormat::Png,
            Some("exr") => OutputFormat::Exr,
            _ => {
                return Err(OutputError::UnknownExtension {
                    path: path.to_owned(),
                });
            }
        };
        let mut spec = Self {
            path: path.to_owned(),
            format,
            pattern: None,
        };
        if spec.is_sequence_format() {
            spec.pattern = parse_pattern(path)?;
        }
        Ok(spec)
    }

    /// The name as it was given.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The format the name stands for.
    #[must_use]
    pub fn format(&self) -> OutputFormat {
        self.format
    }

    /// The file that holds frame `index`; for a video, the video itself.
    #[must_use]
    pub fn frame_path(&self, index: usize) -> PathBuf {
        match &self.pattern {
            None => self.path.clone(),
            Some(pattern) => self.path.with_file_name(pattern.name(index as u64)),
        }
    }

    /// Whether the format has one file a frame.
    pub(crate) fn is_sequence_format(&self) -> bool {
        matches!(self.format, OutputFormat::Png | OutputFormat::Exr)
    }

    /// Whether frames get names of their own.
    pub(crate) fn has_pattern(&self) -> bool {
        self.pattern.is_some()
    }
}

fn parse_pattern(path: &Path) -> Result<Option<NumberPattern>, OutputError> {
    let fail = |reason: String| OutputError::Pattern {
        path: path.to_owned(),
        reason,
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    if folder.to_string_lossy().contains('%') {
        let reason = "frame numbers belong in the file's name, not in the folder's";
        return Err(fail(reason.to_owned()));
    }
    match path.file_name().and_then(OsStr::to_str) {
        Some(name) if name.contains('%') => NumberPattern::parse(name).map(Some).map_err(fail),
        // A name that is not Unicode is taken as it is: a single picture.
        _ => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_go_by_extension() {
        let format = |name| OutputSpec::parse(name).unwrap().format();
        assert_eq!(format("a.mp4"), OutputFormat::Mp4);
        assert_eq!(format("a.b.APNG"), OutputFormat::Apng);
        assert_eq!(format("x/frame_%04d.png"), OutputFormat::Png);
        assert_eq!(format("%d.exr"), OutputFormat::Exr);
        for bad in ["a", "a.avi", "mp4", ".png", "a.mp4/"] {
            let parsed = OutputSpec::parse(bad);
            if bad == "a.mp4/" {
                // A path forgets a slash at its end.
                assert!(parsed.is_ok());
                continue;
            }
            let error = parsed.unwrap_err();
            assert!(error.is_usage());
            assert!(error.to_string().contains(".mp4"), "{error}");
        }
    }

    #[test]
    fn patterns_number_frames() {
        let name = |pattern: &str, index| {
            let spec = OutputSpec::parse(pattern).unwrap();
            assert!(spec.has_pattern());
            spec.frame_path(index).to_str().unwrap().to_owned()
        };
        assert_eq!(name("out/f_%04d.png", 7), "out/f_0007.png");
        assert_eq!(name("f_%04d.png", 12345), "f_12345.png");
        assert_eq!(name("%d.exr", 0), "0.exr");
        assert_eq!(name("50%%_%03d_b.png", 2), "50%_002_b.png");
        assert!(!OutputSpec::parse("one.png").unwrap().has_pattern());
        let video = OutputSpec::parse("a%04d.mp4").unwrap();
        assert_eq!(video.frame_path(3), Path::new("a%04d.mp4"));
    }

    #[test]
    fn bad_patterns_are_usage_errors() {
        for bad in [
            "%04d_%d.png",
            "%s.png",
            "a%.png",
            "%99d.png",
            "%99999999999999999999999d.png",
            "100%%.png",
            "%4d.png",
            "dir%d/a.png",
        ] {
            let error = OutputSpec::parse(bad).unwrap_err();
            assert!(matches!(error, OutputError::Pattern { .. }), "{bad}");
            assert!(error.is_usage());
        }
    }
}
