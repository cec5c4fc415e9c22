//! The sRGB transfer curve between display bytes and linear light (IEC
//! 61966-2-1).

use std::sync::LazyLock;

/// Linear light of every byte.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let encoded = byte as f64 / 255.0;
        let linear = if encoded <= 0.040_45 {
            encoded / 12.92
        } else {
            ((encoded + 0.055) / 1.055).powf(2.4)
        };
        linear as f32
    })
});

/// Linear light, 0 to 1, of an sRGB colour.
pub(crate) fn decode(bytes: [u8; 3]) -> [f32; 3] {
    bytes.map(|byte| LINEAR[usize::from(byte)])
}

/// The byte whose linear light lies closest; values beyond 0 and 1 are
/// clipped, and NaN is black.
pub(crate) fn encode(linear: f32) -> u8 {
    encode_at(linear, 0.5)
}

/// One of the two bytes around `linear`: the upper one from `threshold`, 0 to
/// 1, of the way between them in linear light.
pub(crate) fn encode_at(linear: f32, threshold: f32) -> u8 {
    let table = &*LINEAR;
    let above = table.partition_point(|&entry| entry <= linear);
    match above {
        0 => 0,
        256 => 255,
        _ => {
            let (low, high) = (table[above - 1], table[above]);
            let upper = linear - low >= threshold * (high - low);
            (if upper { above } else { above - 1 }) as u8
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_way_there_and_back() {
        for byte in 0..=255 {
            assert_eq!(encode(decode([byte; 3])[0]), byte);
        }
    }

    #[test]
    fn values_without_a_byte_are_clipped() {
        let cases = [
            (-1.0, 0),
            (f32::NEG_INFINITY, 0),
            (f32::NAN, 0),
            (1.5, 255),
            (f32::INFINITY, 255),
        ];
        for (linear, byte) in cases {
            assert_eq!(encode(linear), byte, "{linear}");
        }
    }

    #[test]
    fn middle_grey_is_where_the_standard_puts_it() {
        // 0.2140 is the linear light of a signal of one half.
        assert_eq!(encode(0.2140), 127);
        assert_eq!(encode(0.2159), 128);
    }

    #[test]
    fn thresholds_divide_the_way_between_two_bytes() {
        let (low, high) = (decode([100; 3])[0], decode([101; 3])[0]);
        for share in [0.1, 0.4, 0.9] {
            let between = low + share * (high - low);
            assert_eq!(encode_at(between, share - 0.05), 101);
            assert_eq!(encode_at(between, share + 0.05), 100);
            assert_eq!(encode_at(low, share), 100);
        }
    }
}
