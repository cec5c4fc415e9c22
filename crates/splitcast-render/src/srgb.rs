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

/// Equal parts of the range 0 to 1, a power of two so that dividing is exact,
/// and small enough that no two bytes are in one.
const PARTS: usize = 1 << 12;

/// The number of bytes whose linear light is at most that of a part's low end.
static AT_LOW_END: LazyLock<[u16; PARTS]> = LazyLock::new(|| {
    std::array::from_fn(|part| {
        let low = part as f32 / PARTS as f32;
        LINEAR.partition_point(|&entry| entry <= low) as u16
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
    if linear >= 1.0 {
        return 255;
    }
    // Negative values and NaN are in the first part.
    let linear = linear.max(0.0);
    let table = &*LINEAR;
    let at_least = usize::from(AT_LOW_END[(linear * PARTS as f32) as usize]) - 1;
    let below = at_least + usize::from(table[at_least + 1] <= linear);
    let (low, high) = (table[below], table[below + 1]);
    (below + usize::from(linear - low >= threshold * (high - low))) as u8
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
    fn a_value_lies_between_the_bytes_around_it() {
        for step in 0..1 << 20 {
            let linear = step as f32 / (1 << 20) as f32;
            let above = LINEAR.partition_point(|&entry| entry <= linear);
            // No value is at least 2 ways from one byte to the next, and each at least 0.
            assert_eq!(usize::from(encode_at(linear, 2.0)), above - 1, "{linear}");
            assert_eq!(usize::from(encode_at(linear, 0.0)), above, "{linear}");
        }
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
