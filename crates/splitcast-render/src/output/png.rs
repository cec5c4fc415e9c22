//! PNG (W3C Recommendation, third edition): one lossless 8-bit picture a file.

use std::io::{BufReader, Read, Seek};

use ::png::{BitDepth, ColorType, Compression, Decoder, Encoder, SrgbRenderingIntent};

use super::error::OutputError;
use super::settings::Settings;
use crate::{Image, to_srgb8};

/// Keyword of the text chunk that holds the settings.
const KEYWORD: &str = "splitcast";

/// The bytes of a PNG file that shows `image`, for a picture that goes into
/// another file, such as a page. Conversion runs on the current rayon thread pool.
///
/// # Errors
/// [`OutputError::Picture`] if a side is 0, or if the pixels are not as many
/// as the sides say.
pub fn encode_png(image: &Image) -> Result<Vec<u8>, OutputError> {
    let (width, height) = (image.width, image.height);
    let rgb = to_srgb8(image);
    encode(width, height, &rgb, &Settings::new(), Compression::High).map_err(|error| {
        OutputError::Picture {
            width,
            height,
            reason: error.to_string(),
        }
    })
}

/// Encodes 8-bit sRGB pixels and the settings they were made with.
pub(super) fn encode(
    width: u32,
    height: u32,
    rgb: &[u8],
    settings: &Settings,
    compression: Compression,
) -> Result<Vec<u8>, ::png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(compression);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    encoder.add_text_chunk(KEYWORD.to_owned(), settings.to_text())?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(rgb)?;
    writer.finish()?;
    Ok(bytes)
}

/// Decodes a picture that [`encode`] made with these settings, or says in
/// words why it is none. The size is compared before any pixel is read, so a
/// foreign file cannot ask for memory.
pub(super) fn decode(
    file: impl Read + Seek,
    width: u32,
    height: u32,
    settings: &Settings,
) -> Result<Vec<u8>, String> {
    let broken = |error: ::png::DecodingError| format!("they are not whole PNG files ({error})");
    let mut reader = Decoder::new(BufReader::new(file))
        .read_info()
        .map_err(broken)?;
    let info = reader.info();
    if (info.width, info.height) != (width, height) {
        return Err(format!(
            "they have {}x{} pixels, not {width}x{height}",
            info.width, info.height
        ));
    }
    let text = info.uncompressed_latin1_text.iter();
    let text = text
        .filter(|chunk| chunk.keyword == KEYWORD)
        .map(|chunk| chunk.text.as_str())
        .next();
    if let Some(difference) = settings.difference(text) {
        return Err(difference);
    }
    if (info.color_type, info.bit_depth) != (ColorType::Rgb, BitDepth::Eight) {
        return Err("they are not 8-bit RGB".to_owned());
    }
    let mut rgb = vec![0; 3 * width as usize * height as usize];
    reader.next_frame(&mut rgb).map_err(broken)?;
    reader.finish().map_err(broken)?;
    Ok(rgb)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::ToneCurve;

    #[test]
    fn a_picture_in_memory_keeps_its_pixels_and_a_broken_one_is_refused() {
        let mut image = Image {
            width: 2,
            height: 1,
            pixels: vec![[0.0; 3], [1.0; 3]],
            tone_curve: ToneCurve::Exact,
        };
        let bytes = encode_png(&image).unwrap();
        let rgb = decode(Cursor::new(&bytes), 2, 1, &Settings::new()).unwrap();
        assert_eq!(rgb, [0, 0, 0, 255, 255, 255]);
        image.width = 3;
        let message = encode_png(&image).unwrap_err().to_string();
        assert!(message.contains("3x1"), "{message}");
    }

    #[test]
    fn round_trip_and_every_truncation() {
        let settings = Settings::new().with("spp", 4);
        let rgb: Vec<u8> = (0..3 * 7 * 5).map(|i| (i * 37) as u8).collect();
        let bytes = encode(7, 5, &rgb, &settings, Compression::Fast).unwrap();
        assert_eq!(decode(Cursor::new(&bytes), 7, 5, &settings).unwrap(), rgb);
        for length in 0..bytes.len() {
            assert!(
                decode(Cursor::new(&bytes[..length]), 7, 5, &settings).is_err(),
                "{length}"
            );
        }
        assert!(
            decode(Cursor::new(&bytes), 5, 7, &settings)
                .unwrap_err()
                .contains("7x5")
        );
        let other = Settings::new().with("spp", 5);
        assert!(
            decode(Cursor::new(&bytes), 7, 5, &other)
                .unwrap_err()
                .contains("spp")
        );
    }
}
