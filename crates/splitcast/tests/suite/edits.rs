//! Changes of a mesh from one frame to the next, gentle and brutal.

use std::ops::Range;

use super::cases::soup;
use super::meshes::{Rng, Soup};

/// A run of triangles: where it starts and how long it is, as shares of all of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub(crate) start: f32,
    pub(crate) share: f32,
}

impl Part {
    pub(crate) const ALL: Self = Self {
        start: 0.0,
        share: 1.0,
    };

    /// Indices in a list of `count`, at least one if there are any.
    fn of(self, count: usize) -> Range<usize> {
        let start = (self.start * count as f32) as usize;
        let length = (self.share * count as f32).ceil() as usize;
        start.min(count)..(start + length.max(1)).min(count)
    }
}

/// What changes. Triangles move with their vertices, and so do those that share these.
#[derive(Clone, Debug)]
pub(crate) enum Edit {
    Nothing,
    /// Every vertex by itself, by up to `size` on each axis.
    Shake(Part, f32),
    Shift(Part, [f32; 3]),
    /// Scaled about the origin and moved, to be a small heap somewhere.
    Gather(Part, f32, [f32; 3]),
    /// Onto a plane, a line or a point, by the number of axes.
    Collapse(Part, usize),
    /// Triangles behind the others, of the given size.
    Append(usize, f32),
    /// The last share of the triangles goes.
    Truncate(f32),
    /// Triangles go, and those behind them move up.
    Remove(Part),
    /// Triangles change places in the list.
    Reorder(Part),
    /// An unrelated mesh of so many triangles.
    Replace(usize),
}

impl Edit {
    pub(crate) fn apply(&self, mesh: &mut Soup, rng: &mut Rng) {
        let count = mesh.triangles.len();
        let of = |part: Part| part.of(count);
        match *self {
            Self::Nothing => (),
            Self::Shake(part, size) => {
                map_part(mesh, of(part), |p| p.map(|x| size.mul_add(rng.signed(), x)))
            }
            Self::Shift(part, by) => map_part(mesh, of(part), |p| plus(p, by)),
            Self::Gather(part, scale, at) => {
                map_part(mesh, of(part), |p| plus(p.map(|x| scale * x), at));
            }
            Self::Collapse(part, axes) => {
                let place = rng.in_cube();
                map_part(mesh, of(part), |mut p| {
                    p[..axes].copy_from_slice(&place[..axes]);
                    p
                });
            }
            Self::Append(more, size) => mesh.append(&soup(more, size, rng.bits())),
            Self::Truncate(share) => {
                mesh.triangles
                    .truncate(((1.0 - share) * count as f32) as usize);
            }
            Self::Remove(part) => drop(mesh.triangles.drain(of(part))),
            Self::Reorder(part) => {
                let part = &mut mesh.triangles[of(part)];
                part.reverse();
                part.rotate_left(part.len() / 3);
            }
            Self::Replace(count) => *mesh = soup(count, 0.1, rng.bits()),
        }
    }
}

fn plus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}

/// Moves every vertex of some triangles, once.
fn map_part(mesh: &mut Soup, part: Range<usize>, mut map: impl FnMut([f32; 3]) -> [f32; 3]) {
    let mut vertices: Vec<u32> = mesh.triangles[part].iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    for vertex in vertices {
        let position = &mut mesh.positions[vertex as usize];
        *position = map(*position);
    }
}

/// Runs of triangles that are not, bit by bit, where they were; of those that both meshes have.
pub(crate) fn moved_ranges(before: &Soup, after: &Soup) -> Vec<Range<usize>> {
    let corners = |mesh: &Soup, triangle: usize| {
        mesh.triangles[triangle].map(|v| mesh.positions[v as usize].map(f32::to_bits))
    };
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for triangle in 0..before.triangles.len().min(after.triangles.len()) {
        if corners(before, triangle) != corners(after, triangle) {
            match ranges.last_mut() {
                Some(last) if last.end == triangle => last.end += 1,
                _ => ranges.push(triangle..triangle + 1),
            }
        }
    }
    ranges
}

/// The same triangles, said badly: out of order, overlapping, with ranges that are empty, run
/// backwards or lie behind the end of `count` triangles.
pub(crate) fn muddled(ranges: &[Range<usize>], count: usize, rng: &mut Rng) -> Vec<Range<usize>> {
    let mut muddled = Vec::new();
    for range in ranges {
        let middle = range.start + rng.below(range.len());
        let overlap = (middle + 1 + rng.below(range.len())).min(range.end);
        muddled.extend([middle..range.end, range.start..overlap]);
        let (start, end) = (range.end, range.start);
        muddled.push(start..end);
    }
    let (start, end) = (usize::MAX, 0);
    muddled.extend([
        0..0,
        count..count + 100,
        usize::MAX - 1..usize::MAX,
        start..end,
        count / 2..count / 2,
    ]);
    for last in (1..muddled.len()).rev() {
        muddled.swap(last, rng.below(last + 1));
    }
    muddled
}
