//! Square tiles, rendered in parallel, with their pixels along a Z-order curve.
//!
//! Neighbouring pixels send similar rays, which are traced together and find
//! what they need in the cache. Pixels do not depend on tiles, and each tile
//! has its own part of the picture, so the picture is the same on any number
//! of threads.

use std::sync::LazyLock;

use rayon::prelude::*;

use crate::sampling::interleave;

/// Pixels along the side of a tile, a power of two: 256 pixels of some tens of
/// nanoseconds to microseconds each are work enough for a task, and a picture
/// still has hundreds of tasks.
const SIDE: u32 = 16;
const PIXELS: usize = (SIDE * SIDE) as usize;

/// Columns and rows of a tile's pixels in Z-order.
static PLACES: LazyLock<[[u32; 2]; PIXELS]> = LazyLock::new(|| {
    let mut places = [[0; 2]; PIXELS];
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        places[interleave(x, y) as usize] = [x, y];
    }
    places
});

/// Computes every pixel on the current rayon thread pool. `tile` gets the
/// columns and rows of a tile's pixels, those of every aligned square of 2ᵏ by
/// 2ᵏ one after the other, and where to put their values; what it returns is
/// added up. Returns pixels row by row, and that sum.
pub(crate) fn render_tiles<P: Send + Copy + Default>(
    width: u32,
    height: u32,
    tile: impl Fn(&[[u32; 2]], &mut [P]) -> u64 + Sync,
) -> (Vec<P>, u64) {
    let mut picture = vec![P::default(); width as usize * height as usize];
    let side = SIDE as usize;
    let bands = picture.par_chunks_mut(side * width as usize);
    let sum = bands.enumerate().map(|(band, pixels)| {
        let top = band as u32 * SIDE;
        let mut tiles: Vec<Vec<&mut [P]>> = Vec::new();
        tiles.resize_with(width.div_ceil(SIDE) as usize, || Vec::with_capacity(side));
        for row in pixels.chunks_mut(width as usize) {
            for (tile, part) in tiles.iter_mut().zip(row.chunks_mut(side)) {
                tile.push(part);
            }
        }
        let tiles = tiles.into_par_iter().enumerate();
        let sums = tiles.map(|(index, mut rows)| {
            let left = index as u32 * SIDE;
            let (width, height) = (rows[0].len() as u32, rows.len() as u32);
            let places: Vec<[u32; 2]> = (PLACES.iter())
                .filter(|&&[x, y]| x < width && y < height)
                .map(|&[x, y]| [left + x, top + y])
                .collect();
            let values = &mut [P::default(); PIXELS][..places.len()];
            let sum = tile(&places, values);
            for (&[x, y], &mut value) in places.iter().zip(values) {
                rows[(y - top) as usize][(x - left) as usize] = value;
            }
            sum
        });
        sums.sum::<u64>()
    });
    let sum = sum.sum();
    (picture, sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_computed_once_and_put_in_its_place() {
        for (width, height) in [(1, 1), (16, 16), (33, 17), (5, 100)] {
            let (picture, count) = render_tiles(width, height, |places, values| {
                values.copy_from_slice(places);
                places.len() as u64
            });
            let expected: Vec<[u32; 2]> = (0..height)
                .flat_map(|y| (0..width).map(move |x| [x, y]))
                .collect();
            assert_eq!(picture, expected);
            assert_eq!(count, u64::from(width * height));
        }
    }

    #[test]
    fn aligned_squares_follow_each_other() {
        let (_, squares) = render_tiles::<()>(64, 32, |places, _| {
            let square = |square: &[[u32; 2]]| {
                square
                    .iter()
                    .all(|p| p.map(|x| x / 4) == square[0].map(|x| x / 4))
            };
            places.chunks(16).filter(|places| square(places)).count() as u64
        });
        assert_eq!(squares, 16 * 8);
    }
}
