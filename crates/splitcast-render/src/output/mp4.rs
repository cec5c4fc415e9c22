//! MP4 (ISO/IEC 14496-12 and 14496-14, AV1 Codec ISO Media File Format
//! Binding) around an AV1 stream, with the index in front so that a browser
//! can start at once.

use std::fs;
use std::path::Path;

use muxide::api::{MuxerConfig, VideoCodec};

use super::av1::{Av1Encoder, TemporalUnit};
use super::sink::OutputOptions;
use super::video::{EncodeFailure, VideoEncoder};

/// Smallest side the encoder takes, in pixels.
const MIN_SIDE: u32 = 16;
/// Header byte of a temporal delimiter, an OBU without content that comes
/// first in a temporal unit and that the binding asks to leave out.
const TEMPORAL_DELIMITER: &[u8] = &[0x12, 0x00];
/// The file type box as muxide writes it, and with the brand that the binding
/// requires in place of the older of its two.
const FILE_TYPE: &[u8] = b"ftypisom\0\0\x02\0isommp41";
const FILE_TYPE_AV1: &[u8] = b"ftypisom\0\0\x02\0isomav01";

/// Encodes frames as they come and writes the file at the end: its index
/// stands in front and needs the size of every frame.
pub(super) struct Mp4Encoder {
    encoder: Av1Encoder,
    width: u32,
    height: u32,
    rate: f64,
}

/// Why a picture size cannot be coded, with the nearest that can.
pub(super) fn size_problem(width: u32, height: u32) -> Option<String> {
    let fitting = |side: u32| (side & !1).max(MIN_SIDE);
    let (better_width, better_height) = (fitting(width), fitting(height));
    ((width, height) != (better_width, better_height)).then(|| {
        format!(
            "does not suit MP4, whose sides are even and at least {MIN_SIDE}: \
             choose {better_width}x{better_height}, or write .png frames"
        )
    })
}

impl VideoEncoder for Mp4Encoder {
    fn start(_draft: &Path, options: &OutputOptions) -> Result<Self, EncodeFailure> {
        Ok(Self {
            encoder: Av1Encoder::new(options)?,
            width: options.width,
            height: options.height,
            rate: options.frames_per_second,
        })
    }

    fn push(&mut self, rgb: &[u8]) -> Result<(), EncodeFailure> {
        Ok(self.encoder.push(rgb)?)
    }

    fn finish(self, draft: &Path) -> Result<(), EncodeFailure> {
        let units = self.encoder.finish()?;
        let bytes = mux(&units, self.width, self.height, self.rate)?;
        Ok(fs::write(draft, bytes)?)
    }
}

fn mux(units: &[TemporalUnit], width: u32, height: u32, rate: f64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let mut muxer = MuxerConfig::new(width, height, rate)
        .with_fast_start(true)
        .into_builder(&mut bytes, VideoCodec::Av1)
        .build()
        .map_err(|error| error.to_string())?;
    for (index, unit) in units.iter().enumerate() {
        let data = unit
            .data
            .strip_prefix(TEMPORAL_DELIMITER)
            .unwrap_or(&unit.data);
        muxer
            .write_video(index as f64 / rate, data, unit.is_key)
            .map_err(|error| error.to_string())?;
    }
    muxer.finish().map_err(|error| error.to_string())?;
    if let Some(file_type) = bytes.get_mut(4..4 + FILE_TYPE.len())
        && file_type == FILE_TYPE
    {
        file_type.copy_from_slice(FILE_TYPE_AV1);
    }
    Ok(bytes)
}
