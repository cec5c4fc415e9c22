//! AV1 (AOMedia Video 1 specification) by rav1e.

use rav1e::prelude::*;

use super::sink::OutputOptions;
use super::yuv;

/// rav1e's preset, 0 slowest to 10 fastest. Measured on 48 frames of 960x540 on
/// two cores, without reordering: preset 9 takes 9 to 15 s, 89 kB, 46.3 dB; 10
/// saves a third of the time but rings around moving outlines; 8 takes twice
/// as long for 10 % of the bytes.
const SPEED: u8 = 9;
/// Base quantizer, 0 best to 255 smallest; 80 saves a fifth of the bytes and
/// loses 0.4 dB.
const QUANTIZER: usize = 60;
/// Seconds between key frames, the points a player can jump to.
const KEY_FRAME_SECONDS: f64 = 2.0;
/// Pixels a tile should have at least. Tiles are what threads work on, and
/// their number must not depend on the threads, or else so would the bytes.
const TILE_PIXELS: usize = 128 * 1024;
/// Most tiles of a frame.
const MAX_TILES: usize = 8;

/// Level index, and the largest picture, width, height and pixels a second it
/// allows (AV1 specification, annex A.3).
const LEVELS: [(u8, u64, u64, u64, f64); 14] = [
    (0, 147_456, 2048, 1152, 4_423_680.0),
    (1, 278_784, 2816, 1584, 8_363_520.0),
    (4, 665_856, 4352, 2448, 19_975_680.0),
    (5, 1_065_024, 5504, 3096, 31_950_720.0),
    (8, 2_359_296, 6144, 3456, 70_778_880.0),
    (9, 2_359_296, 6144, 3456, 141_557_760.0),
    (12, 8_912_896, 8192, 4352, 267_386_880.0),
    (13, 8_912_896, 8192, 4352, 534_773_760.0),
    (14, 8_912_896, 8192, 4352, 1_069_547_520.0),
    (15, 8_912_896, 8192, 4352, 1_069_547_520.0),
    (16, 35_651_584, 16_384, 8704, 1_069_547_520.0),
    (17, 35_651_584, 16_384, 8704, 2_139_095_040.0),
    (18, 35_651_584, 16_384, 8704, 4_278_190_080.0),
    (19, 35_651_584, 16_384, 8704, 4_278_190_080.0),
];
/// Level index for streams beyond every level.
const NO_LEVEL: u8 = 31;

/// One temporal unit: what decodes to exactly one shown frame.
pub(super) struct TemporalUnit {
    /// Its bytes, as rav1e made them.
    pub(super) data: Vec<u8>,
    /// Whether decoding can start here.
    pub(super) is_key: bool,
}

/// A running encoder and what came out of it so far.
pub(super) struct Av1Encoder {
    context: Context<u8>,
    width: usize,
    height: usize,
    units: Vec<TemporalUnit>,
}

impl Av1Encoder {
    pub(super) fn new(options: &OutputOptions) -> Result<Self, String> {
        let (width, height) = (options.width as usize, options.height as usize);
        let rate = options.frames_per_second;
        let mut encoder = EncoderConfig::with_speed_preset(SPEED);
        encoder.width = width;
        encoder.height = height;
        encoder.time_base = Rational::new(1000, (1000.0 * rate).round() as u64);
        encoder.chroma_sampling = ChromaSampling::Cs420;
        encoder.chroma_sample_position = ChromaSamplePosition::Vertical;
        encoder.pixel_range = PixelRange::Limited;
        encoder.color_description = Some(ColorDescription {
            color_primaries: ColorPrimaries::BT709,
            transfer_characteristics: TransferCharacteristics::BT709,
            matrix_coefficients: MatrixCoefficients::BT709,
        });
        encoder.level_idx = Some(level(options.width, options.height, rate));
        encoder.quantizer = QUANTIZER;
        let key_interval = (KEY_FRAME_SECONDS * rate).ceil().max(1.0) as u64;
        encoder.set_key_frame_interval(key_interval, key_interval);
        // Without reordering, frames come out as they go in and take two thirds of the time;
        // that a short film is a third larger matters less.
        encoder.low_latency = true;
        // An animation has no cuts to look for.
        encoder.speed_settings.scene_detection_mode = SceneDetectionSpeed::None;
        encoder.tiles = (width * height / TILE_PIXELS).clamp(1, MAX_TILES);
        let config = Config::new()
            .with_encoder_config(encoder)
            .with_threads(options.threads.max(1));
        let context = config.new_context().map_err(|error| error.to_string())?;
        Ok(Self {
            context,
            width,
            height,
            units: Vec::new(),
        })
    }

    /// Adds a frame of 8-bit sRGB pixels.
    pub(super) fn push(&mut self, rgb: &[u8]) -> Result<(), String> {
        let planes = yuv::from_rgb(rgb, self.width, self.height);
        let mut frame = self.context.new_frame();
        let half = self.width / 2;
        let rows = [
            (planes.luma, self.width),
            (planes.blue, half),
            (planes.red, half),
        ];
        for (plane, (codes, stride)) in frame.planes.iter_mut().zip(rows) {
            plane.copy_from_raw_u8(&codes, stride, 1);
        }
        self.context
            .send_frame(frame)
            .map_err(|error| error.to_string())?;
        self.drain()
    }

    /// All temporal units in the order they are shown.
    pub(super) fn finish(mut self) -> Result<Vec<TemporalUnit>, String> {
        self.context.flush();
        self.drain()?;
        Ok(self.units)
    }

    fn drain(&mut self) -> Result<(), String> {
        loop {
            match self.context.receive_packet() {
                Ok(packet) => self.units.push(TemporalUnit {
                    is_key: packet.frame_type == FrameType::KEY,
                    data: packet.data,
                }),
                Err(EncoderStatus::Encoded) => {}
                Err(EncoderStatus::NeedMoreData | EncoderStatus::LimitReached) => return Ok(()),
                Err(error) => return Err(error.to_string()),
            }
        }
    }
}

/// The lowest level that allows such a stream, which players use to tell
/// whether they can keep up.
fn level(width: u32, height: u32, rate: f64) -> u8 {
    let (width, height) = (u64::from(width), u64::from(height));
    let pixels = width * height;
    let fits = |&&(_, max_pixels, max_width, max_height, max_rate): &&(u8, u64, u64, u64, f64)| {
        pixels <= max_pixels
            && width <= max_width
            && height <= max_height
            && pixels as f64 * rate <= max_rate
    };
    LEVELS.iter().find(fits).map_or(NO_LEVEL, |level| level.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_follow_size_and_rate() {
        assert_eq!(level(64, 36, 25.0), 0);
        assert_eq!(level(960, 540, 25.0), 4);
        assert_eq!(level(1920, 1080, 25.0), 8);
        assert_eq!(level(1920, 1080, 60.0), 9);
        assert_eq!(level(3840, 2160, 30.0), 12);
        assert_eq!(level(65_534, 65_534, 25.0), NO_LEVEL);
    }
}
