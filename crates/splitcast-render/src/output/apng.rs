//! APNG (PNG, third edition, chapter 11.3.2.4 on): a lossless animation.
//!
//! Each frame holds only the smallest rectangle outside which nothing changed
//! since the frame before; the still parts of a scene cost nothing.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use ::png::{BitDepth, BlendOp, ColorType, DisposeOp, Encoder, SrgbRenderingIntent, Writer};

use super::sink::OutputOptions;
use super::video::{EncodeFailure, VideoEncoder};

/// Writes frames into the draft file as they come.
pub(super) struct ApngEncoder {
    writer: Writer<BufWriter<File>>,
    width: usize,
    previous: Option<Vec<u8>>,
}

impl VideoEncoder for ApngEncoder {
    fn start(draft: &Path, options: &OutputOptions) -> Result<Self, EncodeFailure> {
        let start = || -> Result<_, ::png::EncodingError> {
            let file = BufWriter::new(File::create(draft)?);
            let mut encoder = Encoder::new(file, options.width, options.height);
            encoder.set_color(ColorType::Rgb);
            encoder.set_depth(BitDepth::Eight);
            encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
            let frames = u32::try_from(options.frames.len()).unwrap_or(u32::MAX);
            encoder.set_animated(frames, 0)?;
            let (numerator, denominator) = frame_delay(options.frames_per_second);
            encoder.set_frame_delay(numerator, denominator)?;
            encoder.set_blend_op(BlendOp::Source)?;
            encoder.set_dispose_op(DisposeOp::None)?;
            encoder.write_header()
        };
        Ok(Self {
            writer: start()?,
            width: options.width as usize,
            previous: None,
        })
    }

    fn push(&mut self, rgb: &[u8]) -> Result<(), EncodeFailure> {
        let mut write = || -> Result<(), ::png::EncodingError> {
            let Some(previous) = &self.previous else {
                return self.writer.write_image_data(rgb);
            };
            let region = changed_region(previous, rgb, self.width);
            // Shrink before moving: the rectangle must lie inside at all times.
            self.writer.set_frame_position(0, 0)?;
            self.writer
                .set_frame_dimension(region.width as u32, region.height as u32)?;
            self.writer
                .set_frame_position(region.x as u32, region.y as u32)?;
            self.writer.write_image_data(&region.cut(rgb, self.width))
        };
        write()?;
        self.previous = Some(rgb.to_owned());
        Ok(())
    }

    fn finish(self, _draft: &Path) -> Result<(), EncodeFailure> {
        Ok(self.writer.finish()?)
    }
}

/// A rectangle of pixels, never empty.
#[derive(Debug, PartialEq, Eq)]
struct Region {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl Region {
    /// The pixels of the rectangle, row by row.
    fn cut(&self, rgb: &[u8], width: usize) -> Vec<u8> {
        let rows = rgb.chunks_exact(3 * width).skip(self.y).take(self.height);
        rows.flat_map(|row| &row[3 * self.x..3 * (self.x + self.width)])
            .copied()
            .collect()
    }
}

/// The smallest rectangle that holds every changed pixel; the first pixel if
/// none changed, since a frame cannot be empty.
fn changed_region(old: &[u8], new: &[u8], width: usize) -> Region {
    let (mut left, mut right, mut top, mut bottom) = (width, 0, usize::MAX, 0);
    let rows = old.chunks_exact(3 * width).zip(new.chunks_exact(3 * width));
    for (y, (old, new)) in rows.enumerate() {
        let differs = |(old, new): (&u8, &u8)| old != new;
        let Some(first) = old.iter().zip(new).position(differs) else {
            continue;
        };
        let last = old.iter().zip(new).rposition(differs).unwrap_or(first);
        left = left.min(first / 3);
        right = right.max(last / 3);
        top = top.min(y);
        bottom = y;
    }
    if top == usize::MAX {
        return Region {
            x: 0,
            y: 0,
            width: 1,
            height: 1,
        };
    }
    Region {
        x: left,
        y: top,
        width: right - left + 1,
        height: bottom - top + 1,
    }
}

/// Seconds a frame is shown, as the fraction of two 16-bit numbers APNG asks
/// for: exact for whole rates, within a thousandth otherwise.
fn frame_delay(rate: f64) -> (u16, u16) {
    let scale = [1.0, 100.0, 10.0]
        .into_iter()
        .find(|scale| (rate * scale).fract() == 0.0 && rate * scale <= f64::from(u16::MAX))
        .unwrap_or(if rate <= 65.0 { 1000.0 } else { 10.0 });
    (scale as u16, (rate * scale).round() as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_region_is_tight() {
        let old = vec![0; 3 * 6 * 4];
        let mut new = old.clone();
        assert_eq!(
            changed_region(&old, &new, 6),
            Region {
                x: 0,
                y: 0,
                width: 1,
                height: 1
            }
        );
        new[3 * (6 + 2) + 2] = 9;
        new[3 * (6 * 3 + 4)] = 9;
        let region = changed_region(&old, &new, 6);
        assert_eq!(
            region,
            Region {
                x: 2,
                y: 1,
                width: 3,
                height: 3
            }
        );
        let cut = region.cut(&new, 6);
        assert_eq!(cut.len(), 27);
        assert_eq!((cut[2], cut[24]), (9, 9));
    }

    #[test]
    fn delays_are_close_fractions() {
        assert_eq!(frame_delay(25.0), (1, 25));
        assert_eq!(frame_delay(12.5), (100, 1250));
        for rate in [1.0, 23.976, 29.97, 59.94, 60.0, 99.9, 1000.0] {
            let (numerator, denominator) = frame_delay(rate);
            let back = f64::from(denominator) / f64::from(numerator);
            assert!((back - rate).abs() <= 1e-3 * rate, "{rate}: {back}");
        }
    }
}
