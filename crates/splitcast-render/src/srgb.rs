//! The sRGB transfer curve between display bytes and linear light (IEC
//! 61966-2-1).

use std::sync::LazyLock;

/// Equal parts of the range 0 to 1, a power of two so that dividing is exact,
/// and so many that no two bytes are in one.
const PARTS: usize = 1 << 12;

/// What the curve is computed from.
pub(crate) struct Tables {
    /// Linear light of every byte; what follows the last is out of reach.
    linear: [f32; 258],
    /// The last byte whose linear light is at most each part's low end. The
    /// last part holds 1 alone.
    first: [u8; PARTS + 1],
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let linear = std::array::from_fn(|byte| {
        let encoded = byte as f64 / 255.0;
        let linear = if byte > 255 {
            f64::INFINITY
        } else if encoded <= 0.040_45 {
            encoded / 12.92
        } else {
            ((encoded + 0.055) / 1.055).powf(2.4)
        };
        linear as f32
    });
    let first = |part: usize| {
        let low = part as f32 / PARTS as f32;
        (linear.partition_point(|&entry| entry <= low) - 1) as u8
    };
    Tables {
        linear,
        first: std::array::from_fn(first),
    }
});

/// The tables, for many colours in a row.
pub(crate) fn tables() -> &'static Tables {
    &TABLES
}

/// Linear light, 0 to 1, of an sRGB colour.
pub(crate) fn decode(bytes: [u8; 3]) -> [f32; 3] {
    let tables = &*TABLES;
    bytes.map(|byte| tables.linear[usize::from(byte)])
}

/// The bytes whose linear light lies closest; values beyond 0 and 1 are
/// clipped, and NaN is black.
pub(crate) fn encode(linear: [f32; 3]) -> [u8; 3] {
    encode_at(linear, 0.5)
}

/// Of each channel one of the two bytes around it: the upper one from
/// `threshold`, 0 to 1, of the way between them in linear light.
pub(crate) fn encode_at(linear: [f32; 3], threshold: f32) -> [u8; 3] {
    let tables = tables();
    // NaN stays NaN; it is in part 0, and no byte is found below or above it.
    linear.map(|linear| tables.encode(linear.clamp(0.0, 1.0), threshold))
}

impl Tables {
    /// [`encode_at`] for one channel, which must not be beyond 0 or 1.
    #[inline(always)]
    pub(crate) fn encode(&self, linear: f32, threshold: f32) -> u8 {
        // By way of i32, which every machine converts to in one step.
        let part = (linear * PARTS as f32) as i32;
        let first = usize::from(self.first[part as usize]);
        let below = first + usize::from(self.linear[first + 1] <= linear);
        let (low, high) = (self.linear[below], self.linear[below + 1]);
        (below + usize::from(linear - low >= threshold * (high - low))) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_way_there_and_back() {
        for byte in 0..=255 {
            assert_eq!(encode(decode([byte; 3])), [byte; 3]);
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
            assert_eq!(encode([linear; 3]), [byte; 3], "{linear}");
        }
    }

    #[test]
    fn middle_grey_is_where_the_standard_puts_it() {
        // 0.2140 is the linear light of a signal of one half.
        assert_eq!(encode([0.2140; 3]), [127; 3]);
        assert_eq!(encode([0.2159; 3]), [128; 3]);
    }

    /// The standard's curve the other way, from linear light to a signal of 0 to 255.
    fn signal(linear: f32) -> f64 {
        let linear = f64::from(linear);
        let encoded = if linear <= 0.003_130_8 {
            12.92 * linear
        } else {
            1.055 * linear.powf(1.0 / 2.4) - 0.055
        };
        255.0 * encoded
    }

    #[test]
    fn every_byte_is_where_the_standard_puts_it() {
        for byte in 0..=255 {
            let signal = signal(decode([byte; 3])[0]);
            assert!((signal - f64::from(byte)).abs() < 1e-3, "{byte}: {signal}");
        }
    }

    /// What [`encode_at`] promises, by looking through all bytes.
    fn searched(linear: f32, threshold: f32) -> u8 {
        let of = |byte: u8| decode([byte; 3])[0];
        let below = (0..=255).rfind(|&byte| of(byte) <= linear).unwrap();
        match below.checked_add(1) {
            Some(above) if linear - of(below) >= threshold * (of(above) - of(below)) => above,
            _ => below,
        }
    }

    #[test]
    fn every_boundary_is_where_a_search_finds_it() {
        let parts = (0..=PARTS).map(|part| part as f32 / PARTS as f32);
        let bytes = (0..=255).map(|byte| decode([byte; 3])[0]);
        let middles = (0..255).map(|byte| {
            let [low, high] = [byte, byte + 1].map(|byte| decode([byte; 3])[0]);
            0.5 * (low + high)
        });
        for boundary in parts.chain(bytes).chain(middles) {
            for linear in [boundary.next_down(), boundary, boundary.next_up()] {
                let linear = linear.clamp(0.0, 1.0);
                for threshold in [0.0, 0.3, 0.5, 1.0] {
                    assert_eq!(
                        encode_at([linear; 3], threshold),
                        [searched(linear, threshold); 3],
                        "{linear} at {threshold}"
                    );
                }
            }
        }
    }

    #[test]
    fn no_part_holds_two_bytes() {
        let first = &TABLES.first;
        assert!(first.windows(2).all(|pair| pair[1] - pair[0] <= 1));
    }

    #[test]
    fn thresholds_divide_the_way_between_two_bytes() {
        let (low, high) = (decode([100; 3])[0], decode([101; 3])[0]);
        for share in [0.1, 0.4, 0.9] {
            let between = low + share * (high - low);
            assert_eq!(encode_at([between; 3], share - 0.05), [101; 3]);
            assert_eq!(encode_at([between; 3], share + 0.05), [100; 3]);
            assert_eq!(encode_at([low; 3], share), [100; 3]);
        }
    }
}
