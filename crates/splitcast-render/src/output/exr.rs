//! OpenEXR: linear light as 16-bit floats, one scan-line picture a file.

use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::Path;
use std::result;

use ::exr::prelude::*;

use super::settings::Settings;
use crate::Image as Picture;

/// Name of the attribute that holds the settings.
const ATTRIBUTE: &str = "splitcast";

/// Encodes linear pixels and the settings they were made with. Values beyond
/// the range of a half, 65504, become infinite.
pub(super) fn encode(picture: &Picture, settings: &Settings) -> Result<Vec<u8>> {
    let width = picture.width as usize;
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        let [r, g, b] = picture.pixels[at.y() * width + at.x()];
        (f16::from_f32(r), f16::from_f32(g), f16::from_f32(b))
    });
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let mut attributes = LayerAttributes {
        software_name: Some(Text::from("splitcast")),
        ..LayerAttributes::default()
    };
    attributes.other.insert(
        Text::from(ATTRIBUTE),
        AttributeValue::Text(Text::from(settings.to_text().as_str())),
    );
    let size = (width, picture.height as usize);
    let image = Image::from_layer(Layer::new(size, attributes, encoding, channels));
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}

/// Checks that the file is whole and was made by [`encode`] with these
/// settings, or says in words why not.
pub(super) fn check(
    path: &Path,
    width: u32,
    height: u32,
    settings: &Settings,
) -> result::Result<(), String> {
    let broken = |error: Error| format!("they are not whole EXR files ({error})");
    // The header alone first: only a picture of the right size is worth memory.
    let meta = MetaData::read_from_file(path, false).map_err(broken)?;
    let header = match meta.headers.as_slice() {
        [header] => header,
        _ => return Err("they have several layers".to_owned()),
    };
    let size = header.layer_size;
    if (size.x(), size.y()) != (width as usize, height as usize) {
        return Err(format!(
            "they have {}x{} pixels, not {width}x{height}",
            size.x(),
            size.y()
        ));
    }
    let text = match header.own_attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(text)) => Some(text.to_string()),
        _ => None,
    };
    if let Some(difference) = settings.difference(text.as_deref()) {
        return Err(difference);
    }
    let file = File::open(path).map_err(|error| broken(error.into()))?;
    read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(BufReader::new(file))
        .map(|_| ())
        .map_err(broken)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_and_every_truncation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let settings = Settings::new().with("input", "h\u{f6}rse").with("spp", 4);
        let picture = Picture {
            width: 5,
            height: 37,
            pixels: (0..5 * 37).map(|i| [i as f32 / 8.0, 0.5, 1e9]).collect(),
            tone_curve: crate::ToneCurve::Exact,
        };
        let bytes = encode(&picture, &settings).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        check(&path, 5, 37, &settings).unwrap();
        let image = read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![[0.0; 4]; size.area()],
            |pixels, at, (r, g, b, a): (f32, f32, f32, f32)| {
                pixels[at.y() * 5 + at.x()] = [r, g, b, a];
            },
        )
        .unwrap();
        let pixels = image.layer_data.channel_data.pixels;
        for (read, written) in pixels.iter().zip(&picture.pixels) {
            assert_eq!(read[..2], written[..2]);
            assert_eq!(read[2], f32::INFINITY);
        }
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(check(&path, 5, 37, &settings).is_err(), "{length}");
        }
        std::fs::write(&path, &bytes).unwrap();
        assert!(check(&path, 37, 5, &settings).unwrap_err().contains("5x37"));
        let other = Settings::new().with("spp", 5);
        assert!(check(&path, 5, 37, &other).unwrap_err().contains("spp"));
    }
}
