//! Previews: a ray to the middle of every pixel, another from what it meets to the middle of the
//! sun, all else as if it were open.
//!
//! A picture starts as a copy of what is seen without the mesh, which is the same for all
//! frames. Only squares of pixels that may show the mesh or its shadow are looked at, eight pixels
//! at a time in the lanes of vectors.

mod workspace;

use fearless_simd::{Simd, f32x8};

use crate::coverage::{Coverage, MESH, Projection, SHADOW, SIDE};
use crate::lanes::{LANES, Lanes, Vector};
use crate::shade::Surroundings;
use crate::surface::Surfaces;
use crate::tiles::{PLACES, Tile, for_each_tile};
use crate::{Camera, ToneCurve};
use workspace::{OCTETS, SQUARE, SQUARES, Workspace};

/// What a picture is made of.
pub(crate) trait Pixel: Copy + Default + Send + Sync {
    /// Pixels of the given light at columns `x` and rows `y` of the picture.
    fn of_light<S: Simd>(
        light: Vector<f32x8<S>>,
        x: &[u32; LANES],
        y: &[u32; LANES],
    ) -> [Self; LANES];
}

/// Linear light.
impl Pixel for [f32; 3] {
    #[inline(always)]
    fn of_light<S: Simd>(
        light: Vector<f32x8<S>>,
        _: &[u32; LANES],
        _: &[u32; LANES],
    ) -> [Self; LANES] {
        let rows = light.rows();
        let mut pixels = [[0.0; 3]; LANES];
        for lane in 0..LANES {
            for channel in 0..3 {
                pixels[lane][channel] = rows[channel][lane];
            }
        }
        pixels
    }
}

/// Bytes of a display.
impl Pixel for [u8; 3] {
    #[inline(always)]
    fn of_light<S: Simd>(
        light: Vector<f32x8<S>>,
        x: &[u32; LANES],
        y: &[u32; LANES],
    ) -> [Self; LANES] {
        ToneCurve::Filmic.shown(light, x, y)
    }
}

/// Pictures of one size, by one camera, in the same surroundings.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Preview<'r> {
    pub(crate) camera: &'r Camera,
    pub(crate) surroundings: &'r Surroundings,
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// What light is multiplied by.
    pub(crate) brightness: f32,
}

impl Preview<'_> {
    /// The picture without the mesh, row by row.
    pub(crate) fn backdrop<P: Pixel>(&self) -> Vec<P> {
        let mut picture = vec![P::default(); self.width as usize * self.height as usize];
        let fill = |work: &mut Workspace, tile: Tile<'_, P>| {
            work.begin(self, &tile, [true; SQUARES]);
            work.show(self, tile, [true; OCTETS]);
            0
        };
        for_each_tile(
            &mut picture,
            self.width,
            |_, _| true,
            Workspace::default,
            fill,
        );
        picture
    }

    /// The picture, row by row, and the number of rays that it took; `backdrop` is the picture without the mesh.
    pub(crate) fn picture<P: Pixel>(
        &self,
        backdrop: &[P],
        surfaces: &Surfaces<'_>,
    ) -> (Vec<P>, u64) {
        let coverage = Coverage::of(surfaces.tree, &self.projection());
        let mut picture = backdrop.to_vec();
        let rays = for_each_tile(
            &mut picture,
            self.width,
            |left, top| covered(&coverage, left, top) != [0; SQUARES],
            Workspace::default,
            |work, tile| self.fill(surfaces, &coverage, work, tile),
        );
        (picture, rays + backdrop.len() as u64)
    }

    /// Puts the mesh and its shadow into a tile that shows the backdrop. Returns the number of rays to
    /// the sun.
    fn fill<P: Pixel>(
        &self,
        surfaces: &Surfaces<'_>,
        coverage: &Coverage,
        work: &mut Workspace,
        tile: Tile<'_, P>,
    ) -> u64 {
        let tree = surfaces.tree;
        let covered = covered(coverage, tile.left, tile.top);
        let [meets, shaded] = [MESH, SHADOW].map(|bit| covered.map(|bits| bits & bit != 0));
        work.begin(self, &tile, covered.map(|bits| bits != 0));
        let mut changed = [false; OCTETS];
        work.find_mesh(self, tree, &tile, meets, &mut changed);
        let rays = work.shade_ground(self, tree, &tile, shaded, &mut changed)
            + work.light_mesh(self, surfaces);
        work.show(self, tile, changed);
        rays
    }

    fn projection(&self) -> Projection<'_> {
        Projection {
            camera: self.camera,
            width: self.width,
            height: self.height,
            sun: self.surroundings.sky.sun(),
            ground: self.surroundings.ground.as_ref(),
        }
    }

    /// From the eye through the middles of pixels.
    #[inline(always)]
    fn towards<L: Lanes>(&self, x: L, y: L) -> Vector<L> {
        let (width, height) = (self.width as f32, self.height as f32);
        let (x, y) = ((x + 0.5) / width, (y + 0.5) / height);
        self.camera.towards(x, y, width / height)
    }
}

/// What the squares of the tile whose first pixel is in a column and a row may show.
fn covered(coverage: &Coverage, left: u32, top: u32) -> [u8; SQUARES] {
    std::array::from_fn(|square| {
        let [x, y] = PLACES[square * SQUARE];
        coverage.at((left + x) / SIDE, (top + y) / SIDE)
    })
}
