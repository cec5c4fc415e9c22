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
pub(crate) const SIDE: u32 = 16;
pub(crate) const PIXELS: usize = (SIDE * SIDE) as usize;

/// Columns and rows of a tile's pixels in Z-order.
pub(crate) static PLACES: LazyLock<[[u32; 2]; PIXELS]> = LazyLock::new(|| {
    let mut places = [[0; 2]; PIXELS];
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        places[interleave(x, y) as usize] = [x, y];
    }
    places
});

/// A tile of a picture; those at the right and at the lower border may be smaller than others.
#[derive(Debug)]
pub(crate) struct Tile<'p, P> {
    /// Place of its first pixel in the picture.
    pub(crate) left: u32,
    pub(crate) top: u32,
    /// Its pixels.
    rows: Vec<&'p mut [P]>,
}

impl<P: Copy> Tile<'_, P> {
    /// Writes pixels into a row of the tile, from a column on; what is beyond the tile is left out.
    #[inline(always)]
    pub(crate) fn put(&mut self, column: usize, row: usize, pixels: &[P]) {
        let Some(row) = self.rows.get_mut(row) else {
            return;
        };
        if let Some(places) = row.get_mut(column..column + pixels.len()) {
            places.copy_from_slice(pixels);
        } else if let Some(places) = row.get_mut(column..) {
            let count = places.len();
            places.copy_from_slice(&pixels[..count]);
        }
    }
}

impl<P> Tile<'_, P> {
    /// Whether the pixel at a column and a row is one of the tile's.
    pub(crate) fn contains(&self, [x, y]: [u32; 2]) -> bool {
        (x as usize) < self.rows[0].len() && (y as usize) < self.rows.len()
    }
}

/// Gives the tiles of a picture of the given width to `work`, on the current rayon thread pool: those of
/// whose first column and row `is_wanted` holds. They come with what `workspace` makes, one for many
/// tiles. Returns the sum of what `work` returns.
pub(crate) fn for_each_tile<P: Send, W>(
    picture: &mut [P],
    width: u32,
    is_wanted: impl Fn(u32, u32) -> bool,
    workspace: impl Fn() -> W + Sync + Send,
    work: impl Fn(&mut W, Tile<'_, P>) -> u64 + Sync + Send,
) -> u64 {
    let side = SIDE as usize;
    let mut tiles: Vec<Tile<'_, P>> = Vec::new();
    let mut lefts = Vec::new();
    for (band, pixels) in (0..).zip(picture.chunks_mut(side * width as usize)) {
        let top = band * SIDE;
        lefts.clear();
        lefts.extend(
            (0..width)
                .step_by(side)
                .filter(|&left| is_wanted(left, top)),
        );
        let first = tiles.len();
        tiles.extend(lefts.iter().map(|&left| Tile {
            left,
            top,
            rows: Vec::with_capacity(side),
        }));
        for mut row in pixels.chunks_mut(width as usize) {
            let mut column = 0;
            for tile in &mut tiles[first..] {
                let (_, rest) = row.split_at_mut((tile.left - column) as usize);
                let (part, rest) = rest.split_at_mut(side.min(rest.len()));
                tile.rows.push(part);
                (row, column) = (rest, tile.left + SIDE);
            }
        }
    }
    let tiles = tiles.into_par_iter();
    tiles.map_init(&workspace, &work).sum()
}

/// Computes every pixel on the current rayon thread pool. `tile` gets the
/// columns and rows of a tile's pixels, those of every aligned square of 2ᵏ by
/// 2ᵏ one after the other, and where to put their values; what it returns is
/// added up. Returns pixels row by row, and that sum.
pub(crate) fn render_tiles<P: Send + Copy + Default>(
    width: u32,
    height: u32,
    tile: impl Fn(&[[u32; 2]], &mut [P]) -> u64 + Sync + Send,
) -> (Vec<P>, u64) {
    let mut picture = vec![P::default(); width as usize * height as usize];
    let fill = |_: &mut (), mut part: Tile<'_, P>| {
        let (left, top) = (part.left, part.top);
        let places: Vec<[u32; 2]> = (PLACES.iter())
            .filter(|place| part.contains(**place))
            .map(|&[x, y]| [left + x, top + y])
            .collect();
        let values = &mut [P::default(); PIXELS][..places.len()];
        let sum = tile(&places, values);
        for (&[x, y], &mut value) in places.iter().zip(values) {
            part.rows[(y - top) as usize][(x - left) as usize] = value;
        }
        sum
    };
    let sum = for_each_tile(&mut picture, width, |_, _| true, || (), fill);
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
