//! Which squares of a picture may show a mesh, and which its shadow on the ground.
//!
//! Corners of triangles are projected into the picture from the eye, and once more from where the
//! sun casts them on the ground. A triangle may be seen in the box around its
//! corners there, and anywhere if the camera has part of the mesh behind it.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4};
use glam::Vec3;
use rayon::prelude::*;
use splitcast::{Aabb, KdTree, Kernel, dispatch};

use crate::Camera;
use crate::ground::Ground;
use crate::lanes::{LANES, Lanes, Vector};

/// Pixels along the side of a square.
pub(crate) const SIDE: u32 = 8;

/// What a square may show, as bits.
pub(crate) const MESH: u8 = 1;
pub(crate) const SHADOW: u8 = 2;

/// What rounding may move a point by, relative to its largest coordinate, or a pixel,
/// relative to the picture's longer side: many times what it does.
const SLACK: f32 = 1e-5;

/// Vertices, or triangles, that one task looks at.
const TASK: usize = 1 << 13;

/// Columns and rows, in squares, of a point and of its shadow.
type Places = [f32; 4];

/// How a picture of some width and height is taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection<'p> {
    pub(crate) camera: &'p Camera,
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Unit direction to the sun.
    pub(crate) sun: Vec3,
    pub(crate) ground: Option<&'p Ground>,
}

/// What squares may show, row by row.
#[derive(Clone, Debug)]
pub(crate) struct Coverage {
    columns: usize,
    squares: Vec<u8>,
}

impl Coverage {
    /// Every square may show anything.
    fn full(width: u32, height: u32) -> Self {
        let [columns, rows] = [width, height].map(|side| side.div_ceil(SIDE) as usize);
        Self {
            columns,
            squares: vec![MESH | SHADOW; columns * rows],
        }
    }

    /// What squares may show of the mesh of `tree`. On the current rayon thread pool.
    pub(crate) fn of(tree: &KdTree<'_>, projection: &Projection<'_>) -> Self {
        let mut coverage = Self::full(projection.width, projection.height);
        let bounds = tree.bounds();
        let margin = match bounds.is_empty() {
            true => Some([0.0; 4]),
            false => projection.margin(&bounds),
        };
        let Some(margin) = margin else {
            return coverage;
        };
        let mesh = tree.mesh();
        let positions = mesh.positions();
        let mut places = vec![Places::default(); positions.len()];
        (places.par_chunks_mut(TASK).zip(positions.par_chunks(TASK))).for_each(
            |(places, positions)| {
                dispatch(Project {
                    projection,
                    positions,
                    places,
                });
            },
        );
        let (columns, size) = (coverage.columns, coverage.squares.len());
        let cover = |triangles: &[[u32; 3]]| {
            let mut squares = vec![0; size];
            dispatch(Cover {
                places: &places,
                triangles,
                margin,
                columns,
                shadows: projection.ground.is_some(),
                squares: &mut squares,
            });
            squares
        };
        let together = |mut a: Vec<u8>, b: Vec<u8>| {
            for (a, b) in a.iter_mut().zip(b) {
                *a |= b;
            }
            a
        };
        let covered = mesh.triangles().par_chunks(TASK).map(cover);
        coverage.squares = covered.reduce_with(together).unwrap_or(vec![0; size]);
        coverage
    }

    /// What the square in a column and a row may show; nothing if it is beyond the picture.
    pub(crate) fn at(&self, column: u32, row: u32) -> u8 {
        let (column, row) = (column as usize, row as usize);
        let square = self.squares.get(row * self.columns + column);
        square
            .filter(|_| column < self.columns)
            .copied()
            .unwrap_or(0)
    }
}

impl Projection<'_> {
    fn aspect(&self) -> f32 {
        self.width as f32 / self.height as f32
    }

    /// The depths of points and of their shadows, and their places in squares.
    #[inline(always)]
    fn places<L: Lanes>(&self, point: Vector<L>) -> ([L; 2], [L; 4]) {
        let shadow = match self.ground {
            Some(ground) => ground.shadow(point, self.sun),
            None => point,
        };
        let aspect = self.aspect();
        let [depth, x, y] = self.camera.seen(point, aspect);
        let [shadow_depth, shadow_x, shadow_y] = self.camera.seen(shadow, aspect);
        let squares = 1.0 / SIDE as f32;
        let (width, height) = (self.width as f32 * squares, self.height as f32 * squares);
        // From the middles of the first pixels.
        let half = 0.5 * squares;
        let places = [
            x * width - half,
            y * height - half,
            shadow_x * width - half,
            shadow_y * height - half,
        ];
        ([depth, shadow_depth], places)
    }

    /// By how much places within `bounds` may be off, in squares; `None` if some of them, or of their shadows, are
    /// not in front of the camera.
    fn margin(&self, bounds: &Aabb) -> Option<Places> {
        let (low, high) = (Vec3::from(bounds.min), Vec3::from(bounds.max));
        let mut nearest = [f32::INFINITY; 2];
        for corner in 0..8 {
            let side = |axis: usize| if corner >> axis & 1 == 0 { low } else { high }[axis];
            let point = Vec3::from_array(std::array::from_fn(side));
            let (depths, _) = self.places(Vector::from(point));
            for (nearest, depth) in nearest.iter_mut().zip(depths) {
                *nearest = if depth < *nearest { depth } else { *nearest };
            }
        }
        let eye = Vec3::from(self.camera.eye());
        let size = low.abs().max(high.abs()).max(eye.abs()).max_element();
        // Errors of heights are errors of shadows, the larger the lower the sun is.
        let slope = self.ground.map_or(1.0, |ground| ground.slope(self.sun));
        let pixels = SLACK * self.width.max(self.height) as f32;
        let margin = |nearest: f32, error: f32| {
            let shift = self.camera.shift(error / nearest, self.aspect());
            (nearest > error).then_some((pixels + shift * self.height as f32) / SIDE as f32)
        };
        let point = margin(nearest[0], SLACK * size)?;
        let shadow = margin(nearest[1], SLACK * size / slope)?;
        let margin = [point, point, shadow, shadow];
        margin
            .iter()
            .all(|margin| margin.is_finite())
            .then_some(margin)
    }
}

/// Finds the places of vertices.
struct Project<'c> {
    projection: &'c Projection<'c>,
    positions: &'c [[f32; 3]],
    places: &'c mut [Places],
}

impl Kernel for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let octets = self.positions.chunks(LANES);
        for (positions, places) in octets.zip(self.places.chunks_mut(LANES)) {
            let mut rows = [[0.0; LANES]; 3];
            for (lane, position) in positions.iter().enumerate() {
                for axis in 0..3 {
                    rows[axis][lane] = position[axis];
                }
            }
            let (_, [a, b, c, d]) = self.projection.places(Vector::load(simd, &rows));
            for (lane, places) in places.iter_mut().enumerate() {
                *places = [a[lane], b[lane], c[lane], d[lane]];
            }
        }
    }
}

/// Marks the squares that triangles may cover.
struct Cover<'c> {
    places: &'c [Places],
    triangles: &'c [[u32; 3]],
    margin: Places,
    columns: usize,
    shadows: bool,
    squares: &'c mut [u8],
}

impl Kernel for Cover<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let size = [self.columns, self.squares.len() / self.columns];
        let [last_column, last_row] = size.map(|count| count - 1);
        let [right, bottom] = size.map(|count| count as f32);
        let zero = f32x4::simd_from(simd, 0.0);
        let end = f32x4::simd_from(simd, [right, bottom, right, bottom]);
        let margin = f32x4::simd_from(simd, self.margin);
        let bits = if self.shadows {
            &[MESH, SHADOW][..]
        } else {
            &[MESH]
        };
        for triangle in self.triangles {
            let [a, b, c] = triangle.map(|vertex| self.places[vertex as usize]);
            let [a, b, c] = [
                f32x4::simd_from(simd, a),
                f32x4::simd_from(simd, b),
                f32x4::simd_from(simd, c),
            ];
            let low = (a.min(b).min(c) - margin).max(zero);
            let high = (a.max(b).max(c) + margin).min(end);
            for (kind, &bit) in bits.iter().enumerate() {
                let [left, top] = [low[2 * kind], low[2 * kind + 1]];
                let [right, bottom] = [high[2 * kind], high[2 * kind + 1]];
                // Beyond the picture; NaN comes from triangles that are not in the tree.
                if !(left <= right && top <= bottom) {
                    continue;
                }
                let right = last_column.min(right as usize);
                for row in top as usize..=last_row.min(bottom as usize) {
                    let row = &mut self.squares[row * self.columns..];
                    for square in &mut row[left as usize..=right] {
                        *square |= bit;
                    }
                }
            }
        }
    }
}
