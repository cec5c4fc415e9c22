//! Square tiles along a Z-order curve, rendered in parallel.
//!
//! Neighbouring pixels send similar rays, and rays of a tile find what they
//! need in the cache. Pixels do not depend on tiles, and tiles are put
//! together in order, so the picture is the same on any number of threads.

use rayon::prelude::*;

use crate::sampling::interleave;

/// Pixels along the side of a tile: 256 pixels of a few microseconds each are
/// work enough for a task, and a picture still has hundreds of tasks.
const SIDE: u32 = 16;

/// Computes every pixel on the current rayon thread pool. `tile` is called
/// once a tile for the state it keeps while it computes pixels; `pixel` gets
/// that state and the pixel's column and row. Returns pixels row by row, and
/// the states in an order that does not depend on threads.
pub(crate) fn render_tiles<T: Send, P: Send + Clone + Default>(
    width: u32,
    height: u32,
    tile: impl Fn() -> T + Sync,
    pixel: impl Fn(&mut T, u32, u32) -> P + Sync,
) -> (Vec<P>, Vec<T>) {
    let mut corners: Vec<[u32; 2]> = (0..height.div_ceil(SIDE))
        .flat_map(|y| (0..width.div_ceil(SIDE)).map(move |x| [x, y]))
        .collect();
    corners.sort_unstable_by_key(|&[x, y]| interleave(x, y));
    let rendered: Vec<(Vec<P>, T)> = corners
        .par_iter()
        .map(|&[x, y]| {
            let mut state = tile();
            let pixels = pixels_of_tile([x * SIDE, y * SIDE], width, height)
                .map(|[x, y]| pixel(&mut state, x, y))
                .collect();
            (pixels, state)
        })
        .collect();
    let mut picture = vec![P::default(); width as usize * height as usize];
    let mut states = Vec::with_capacity(rendered.len());
    for (&[x, y], (pixels, state)) in corners.iter().zip(rendered) {
        let places = pixels_of_tile([x * SIDE, y * SIDE], width, height);
        for ([x, y], value) in places.zip(pixels) {
            picture[y as usize * width as usize + x as usize] = value;
        }
        states.push(state);
    }
    (picture, states)
}

/// Columns and rows of a tile's pixels within the picture.
fn pixels_of_tile(
    [left, top]: [u32; 2],
    width: u32,
    height: u32,
) -> impl Iterator<Item = [u32; 2]> {
    let (right, bottom) = ((left + SIDE).min(width), (top + SIDE).min(height));
    (top..bottom).flat_map(move |y| (left..right).map(move |x| [x, y]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_computed_once_and_put_in_its_place() {
        for (width, height) in [(1, 1), (16, 16), (33, 17), (5, 100)] {
            let (picture, counts) = render_tiles(
                width,
                height,
                || 0u64,
                |count, x, y| {
                    *count += 1;
                    (x, y)
                },
            );
            let expected: Vec<(u32, u32)> = (0..height)
                .flat_map(|y| (0..width).map(move |x| (x, y)))
                .collect();
            assert_eq!(picture, expected);
            assert_eq!(counts.iter().sum::<u64>(), u64::from(width * height));
        }
    }
}
