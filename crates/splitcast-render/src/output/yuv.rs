//! RGB to Y'CbCr 4:2:0 (ITU-R BT.709-6, limited range), the form video is
//! coded in.
//!
//! All in 16-bit fixed point, so that every machine gives the same bytes.

/// Luma weights of BT.709, times 2^16.
const LUMA: [i32; 3] = [13_933, 46_871, 4_732];
/// Bits after the point.
const SHIFT: i32 = 16;
/// Largest 8-bit code.
const FULL: i32 = 255;
/// Luma codes run from 16 to 235, chroma codes from 16 to 240.
const LUMA_RANGE: i32 = 219;
const CHROMA_RANGE: i32 = 224;
const LUMA_ZERO: i32 = 16;
const CHROMA_ZERO: i32 = 128;
/// What 2 (1 - weight) is for blue and red in BT.709, times 2^16: the span
/// that B' - Y' and R' - Y' are divided by.
const BLUE_SPAN: i32 = 121_608;
const RED_SPAN: i32 = 103_206;

/// The three planes of a frame, rows without gaps.
pub(super) struct Planes {
    /// `width * height` luma codes.
    pub(super) luma: Vec<u8>,
    /// A quarter as many codes of blue minus luma.
    pub(super) blue: Vec<u8>,
    /// A quarter as many codes of red minus luma.
    pub(super) red: Vec<u8>,
}

/// Converts 8-bit RGB of even width and height. Chroma samples sit on every
/// second column and between two rows (left siting, the default of H.264 and
/// AV1's "vertical"), found with the weights 1 2 1 across and 1 1 down.
pub(super) fn from_rgb(rgb: &[u8], width: usize, height: usize) -> Planes {
    let (half_width, half_height) = (width / 2, height / 2);
    let mut planes = Planes {
        luma: rgb.chunks_exact(3).map(luma).collect(),
        blue: Vec::with_capacity(half_width * half_height),
        red: Vec::with_capacity(half_width * half_height),
    };
    for row_pair in rgb.chunks_exact(6 * width) {
        let (upper, lower) = row_pair.split_at(3 * width);
        for x in (0..width).step_by(2) {
            let columns = [x.saturating_sub(1), x, x, x + 1];
            // Eight samples of each component; their mean keeps three more bits.
            let sum = [0, 1, 2].map(|c| {
                let column = |&x: &usize| i32::from(upper[3 * x + c]) + i32::from(lower[3 * x + c]);
                columns.iter().map(column).sum::<i32>()
            });
            let grey = weigh(sum);
            planes
                .blue
                .push(chroma((sum[2] << SHIFT) - grey, BLUE_SPAN));
            planes.red.push(chroma((sum[0] << SHIFT) - grey, RED_SPAN));
        }
    }
    planes
}

fn luma(rgb: &[u8]) -> u8 {
    let scaled = i64::from(weigh([rgb[0], rgb[1], rgb[2]].map(i32::from))) * i64::from(LUMA_RANGE);
    let code = divide_rounded(scaled, i64::from(FULL) << SHIFT);
    (LUMA_ZERO + code) as u8
}

/// Y' times 2^16.
fn weigh(rgb: [i32; 3]) -> i32 {
    rgb.iter()
        .zip(LUMA)
        .map(|(&value, weight)| value * weight)
        .sum()
}

/// The chroma code of a difference summed over eight samples, times 2^16.
fn chroma(difference: i32, span: i32) -> u8 {
    let scaled = i64::from(difference) * i64::from(CHROMA_RANGE);
    let code = divide_rounded(scaled, 8 * i64::from(FULL) * i64::from(span));
    (CHROMA_ZERO + code) as u8
}

fn divide_rounded(numerator: i64, denominator: i64) -> i32 {
    (2 * numerator + denominator).div_euclid(2 * denominator) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid(rgb: [u8; 3]) -> [u8; 3] {
        let planes = from_rgb(&rgb.repeat(8), 4, 2);
        assert_eq!(
            (planes.luma.len(), planes.blue.len(), planes.red.len()),
            (8, 2, 2)
        );
        assert!(planes.luma.iter().all(|&code| code == planes.luma[0]));
        assert_eq!(
            (planes.blue[0], planes.red[0]),
            (planes.blue[1], planes.red[1])
        );
        [planes.luma[0], planes.blue[0], planes.red[0]]
    }

    /// The colour bars of BT.709 at full amplitude, as every vectorscope shows them.
    #[test]
    fn colour_bars() {
        assert_eq!(solid([0, 0, 0]), [16, 128, 128]);
        assert_eq!(solid([255, 255, 255]), [235, 128, 128]);
        assert_eq!(solid([255, 0, 0]), [63, 102, 240]);
        assert_eq!(solid([0, 255, 0]), [173, 42, 26]);
        assert_eq!(solid([0, 0, 255]), [32, 240, 118]);
        assert_eq!(solid([255, 255, 0]), [219, 16, 138]);
    }

    #[test]
    fn weights_sum_to_one() {
        assert_eq!(LUMA.iter().sum::<i32>(), 1 << SHIFT);
        assert_eq!(BLUE_SPAN, 2 * ((1 << SHIFT) - LUMA[2]));
        assert_eq!(RED_SPAN, 2 * ((1 << SHIFT) - LUMA[0]));
    }

    #[test]
    fn greys_have_no_colour() {
        for value in 0..=255 {
            let [_, blue, red] = solid([value; 3]);
            assert_eq!((blue, red), (128, 128));
        }
    }
}
