//! What is found out about the pixels of a tile of a preview, step by step: all camera rays before all
//! rays to the sun, so that the tree gets slices of rays that are alike.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use glam::Vec3;
use splitcast::{Hit, KdTree, Kernel, Ray, dispatch};

use super::{Pixel, Preview};
use crate::coverage::SIDE;
use crate::ground;
use crate::lanes::{LANES, Lanes, Vector};
use crate::shade::{Lit, Surroundings};
use crate::surface::{HitLanes, Surfaces};
use crate::tiles::{PIXELS, PLACES, Tile};

/// Pixels of a square, which is looked at or not as a whole: as many rays as the tree traces together.
pub(super) const SQUARE: usize = (SIDE * SIDE) as usize;
pub(super) const SQUARES: usize = PIXELS / SQUARE;

/// Vectors of pixels in a square and in a tile: blocks of four by two pixels.
pub(super) const OCTETS: usize = PIXELS / LANES;
const COLUMNS: usize = 4;

/// Coordinates of vectors.
type Coordinates = [[f32; LANES]; 3];

/// What is known of the pixels of a tile, and what is asked about them.
#[derive(Debug)]
pub(super) struct Workspace {
    octets: [Octet; OCTETS],
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// Rays to the sun, where they come from, and which are occluded.
    to_sun: Vec<Ray>,
    from: Vec<usize>,
    occluded: Vec<bool>,
    on_mesh: Vec<MeshOctet>,
}

/// Pixels of a tile.
#[derive(Clone, Copy, Debug, Default)]
struct Octet {
    /// Of the ray, of unit length.
    direction: Coordinates,
    /// From the eye to the ground; infinite where there is none.
    distance: [f32; LANES],
    /// Where the ray meets the ground, and how much of that is haze.
    point: Coordinates,
    haze: [f32; LANES],
    /// 1 or, for ground in shadow, 0.
    in_sun: [f32; LANES],
}

/// Pixels that show the mesh.
#[derive(Clone, Copy, Debug, Default)]
struct MeshOctet {
    /// How many lanes are used.
    count: usize,
    pixels: [usize; LANES],
    hits: HitLanes,
    normal: Coordinates,
    albedo: Coordinates,
    to_eye: Coordinates,
    /// Cosine between the normal and the direction to the sun, 0 in shadow.
    cosine: [f32; LANES],
}

impl Default for Workspace {
    fn default() -> Self {
        Self {
            octets: [Octet::default(); OCTETS],
            rays: Vec::with_capacity(PIXELS),
            hits: Vec::with_capacity(PIXELS),
            to_sun: Vec::with_capacity(PIXELS),
            from: Vec::with_capacity(PIXELS),
            occluded: Vec::with_capacity(PIXELS),
            on_mesh: Vec::with_capacity(OCTETS),
        }
    }
}

/// The place of a pixel in its tile.
fn place(pixel: usize) -> [u32; 2] {
    let [x, y] = PLACES[pixel / LANES * LANES];
    let lane = (pixel % LANES) as u32;
    [x + lane % COLUMNS as u32, y + lane / COLUMNS as u32]
}

/// Columns and rows of an octet's pixels in the picture.
#[inline(always)]
fn places<P>(tile: &Tile<'_, P>, octet: usize) -> [[u32; LANES]; 2] {
    let [left, top] = PLACES[octet * LANES];
    let (mut x, mut y) = ([0; LANES], [0; LANES]);
    for lane in 0..LANES {
        x[lane] = tile.left + left + (lane % COLUMNS) as u32;
        y[lane] = tile.top + top + (lane / COLUMNS) as u32;
    }
    [x, y]
}

#[inline(always)]
fn floats(numbers: [u32; LANES]) -> [f32; LANES] {
    let mut floats = [0.0; LANES];
    for lane in 0..LANES {
        floats[lane] = numbers[lane] as f32;
    }
    floats
}

impl Workspace {
    /// Makes the rays of some of a tile's squares, and meets them with the ground.
    pub(super) fn begin<P>(
        &mut self,
        preview: &Preview<'_>,
        tile: &Tile<'_, P>,
        squares: [bool; SQUARES],
    ) {
        self.on_mesh.clear();
        dispatch(CameraRays {
            preview,
            octets: &mut self.octets,
            tile,
            squares,
        });
    }

    /// Meets the rays of some squares with the mesh.
    pub(super) fn find_mesh<P>(
        &mut self,
        preview: &Preview<'_>,
        tree: &KdTree<'_>,
        tile: &Tile<'_, P>,
        squares: [bool; SQUARES],
        changed: &mut [bool; OCTETS],
    ) {
        let eye = preview.camera.eye();
        self.rays.clear();
        for square in (0..SQUARES).filter(|&square| squares[square]) {
            for octet in &self.octets[square * SQUARE / LANES..][..SQUARE / LANES] {
                let [x, y, z] = &octet.direction;
                for lane in 0..LANES {
                    self.rays.push(Ray::new(eye, [x[lane], y[lane], z[lane]]));
                }
            }
        }
        self.hits.resize(self.rays.len(), None);
        tree.closest_hits(&self.rays, &mut self.hits);
        let mut squares_hits = self.hits.chunks_exact(SQUARE);
        for square in (0..SQUARES).filter(|&square| squares[square]) {
            let hits = squares_hits.next().expect("one for each of these squares");
            for (index, hit) in hits.iter().enumerate() {
                let pixel = square * SQUARE + index;
                let (octet, lane) = (&mut self.octets[pixel / LANES], pixel % LANES);
                let Some(hit) = hit else {
                    continue;
                };
                if hit.t > octet.distance[lane] || !tile.contains(place(pixel)) {
                    continue;
                }
                octet.haze[lane] = 1.0;
                changed[pixel / LANES] = true;
                if self.on_mesh.last().is_none_or(|last| last.count == LANES) {
                    self.on_mesh.push(MeshOctet::default());
                }
                let last = self.on_mesh.last_mut().expect("just made");
                last.pixels[last.count] = pixel;
                last.hits.triangles[last.count] = hit.triangle;
                last.hits.u[last.count] = hit.u;
                last.hits.v[last.count] = hit.v;
                last.count += 1;
            }
        }
        if let Some(last) = self.on_mesh.last_mut() {
            // Any triangle will do where there is none.
            for lane in last.count..LANES {
                last.hits.triangles[lane] = last.hits.triangles[0];
            }
        }
    }

    /// Finds out which ground is in shadow in some squares. Returns the number of rays.
    pub(super) fn shade_ground<P>(
        &mut self,
        preview: &Preview<'_>,
        tree: &KdTree<'_>,
        tile: &Tile<'_, P>,
        squares: [bool; SQUARES],
        changed: &mut [bool; OCTETS],
    ) -> u64 {
        let sun = preview.surroundings.sky.sun().into();
        self.to_sun.clear();
        self.from.clear();
        for square in (0..SQUARES).filter(|&square| squares[square]) {
            for pixel in square * SQUARE..(square + 1) * SQUARE {
                let (octet, lane) = (&self.octets[pixel / LANES], pixel % LANES);
                let seen = octet.distance[lane] < f32::INFINITY && octet.haze[lane] < 1.0;
                if seen && tile.contains(place(pixel)) {
                    let [x, y, z] = &octet.point;
                    self.to_sun.push(Ray::new([x[lane], y[lane], z[lane]], sun));
                    self.from.push(pixel);
                }
            }
        }
        self.drop_open(tree);
        for &pixel in &self.from {
            self.octets[pixel / LANES].in_sun[pixel % LANES] = 0.0;
            changed[pixel / LANES] = true;
        }
        self.to_sun.len() as u64
    }

    /// Keeps of `from` only where the rays to the sun are occluded.
    fn drop_open(&mut self, tree: &KdTree<'_>) {
        self.occluded.resize(self.to_sun.len(), false);
        tree.occluded_rays(&self.to_sun, &mut self.occluded);
        let mut occluded = self.occluded.iter();
        self.from
            .retain(|_| *occluded.next().expect("one for each ray"));
    }

    /// Finds what the mesh is like where it is seen, and the sun's light there. Returns the number of rays.
    pub(super) fn light_mesh(&mut self, preview: &Preview<'_>, surfaces: &Surfaces<'_>) -> u64 {
        self.to_sun.clear();
        self.from.clear();
        dispatch(MeshSurfaces {
            preview,
            surfaces,
            work: self,
        });
        self.drop_open(surfaces.tree);
        for &place in &self.from {
            self.on_mesh[place / LANES].cosine[place % LANES] = 0.0;
        }
        self.to_sun.len() as u64
    }

    /// Puts some octets into the picture.
    pub(super) fn show<P: Pixel>(
        &self,
        preview: &Preview<'_>,
        tile: Tile<'_, P>,
        octets: [bool; OCTETS],
    ) {
        dispatch(Shade {
            preview,
            work: self,
            tile,
            octets,
        });
    }
}

/// Makes camera rays and meets them with the ground.
struct CameraRays<'w, 'p, P> {
    preview: &'w Preview<'w>,
    octets: &'w mut [Octet; OCTETS],
    tile: &'w Tile<'p, P>,
    squares: [bool; SQUARES],
}

impl<P> Kernel for CameraRays<'_, '_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Preview {
            camera,
            surroundings,
            ..
        } = self.preview;
        let eye = Vec3::from(camera.eye());
        for index in 0..OCTETS {
            if !self.squares[index * LANES / SQUARE] {
                continue;
            }
            let [x, y] = places(self.tile, index);
            let x = f32x8::simd_from(simd, floats(x));
            let y = f32x8::simd_from(simd, floats(y));
            let direction = self.preview.towards(x, y).normalize();
            let octet = &mut self.octets[index];
            octet.direction = direction.rows();
            octet.in_sun = [1.0; LANES];
            match &surroundings.ground {
                Some(ground) => {
                    let distance = ground.distance(ground.above(eye), direction);
                    let point = Vector::splat(x, eye) + direction * distance;
                    octet.distance = distance.into();
                    octet.point = point.rows();
                    octet.haze = ground.haze_lanes(point).into();
                }
                None => octet.distance = [f32::INFINITY; LANES],
            }
        }
    }
}

/// Finds what the mesh is like where it is seen, and asks about the sun.
struct MeshSurfaces<'w, 's> {
    preview: &'w Preview<'w>,
    surfaces: &'w Surfaces<'s>,
    work: &'w mut Workspace,
}

impl Kernel for MeshSurfaces<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let sun = self.preview.surroundings.sky.sun();
        let work = self.work;
        for (index, mesh) in work.on_mesh.iter_mut().enumerate() {
            let mut direction = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let pixel = mesh.pixels[lane];
                let octet = &work.octets[pixel / LANES % OCTETS];
                for axis in 0..3 {
                    direction[axis][lane] = octet.direction[axis][pixel % LANES];
                }
            }
            let direction = Vector::load(simd, &direction);
            let (spot, albedo) = self.surfaces.at_lanes(simd, &mesh.hits, direction);
            let cosine: [f32; LANES] = spot.normal.dot_with(sun).into();
            mesh.normal = spot.normal.rows();
            mesh.albedo = albedo.rows();
            mesh.to_eye = (-direction).rows();
            let [x, y, z] = spot.start.rows();
            for lane in 0..mesh.count {
                if cosine[lane] > 0.0 {
                    mesh.cosine[lane] = cosine[lane];
                    let start = [x[lane], y[lane], z[lane]];
                    work.to_sun.push(Ray::new(start, sun.into()));
                    work.from.push(index * LANES + lane);
                }
            }
        }
    }
}

/// Computes the light of some octets and puts it into the picture.
struct Shade<'w, 'p, P> {
    preview: &'w Preview<'w>,
    work: &'w Workspace,
    tile: Tile<'p, P>,
    octets: [bool; OCTETS],
}

impl<P: Pixel> Kernel for Shade<'_, '_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let Preview {
            surroundings: Surroundings { sky, ground, .. },
            brightness,
            ..
        } = self.preview;
        let zero = f32x8::simd_from(simd, 0.0);
        let one = zero.splat(1.0);
        // Ground has one of two colors.
        let up = sky.up();
        let in_shadow = ground::ALBEDO * sky.irradiance(up);
        let in_sun = ground::ALBEDO * (sky.sun_light() * up.dot(sky.sun()) + sky.irradiance(up));
        let (in_shadow, in_sun) = (Vector::splat(zero, in_shadow), Vector::splat(zero, in_sun));
        let mut light = [[[0.0; LANES]; 3]; OCTETS];
        for index in 0..OCTETS {
            if !self.octets[index] {
                continue;
            }
            let octet = &self.work.octets[index];
            let direction = Vector::load(simd, &octet.direction);
            let mut color = sky.backdrop_lanes(direction);
            if ground.is_some() {
                let distance = f32x8::simd_from(simd, octet.distance);
                let haze = f32x8::simd_from(simd, octet.haze);
                let lit = f32x8::simd_from(simd, octet.in_sun);
                let bare = in_sun.or(zero.is_below(lit), in_shadow);
                let is_ground = distance.is_below(zero.splat(f32::INFINITY));
                color = bare.lerp(color, haze).or(is_ground, color);
            }
            light[index] = color.rows();
        }
        for mesh in &self.work.on_mesh {
            let normal = Vector::load(simd, &mesh.normal);
            let cosine = f32x8::simd_from(simd, mesh.cosine);
            let lit = Lit {
                normal,
                albedo: Vector::load(simd, &mesh.albedo),
                to_eye: Vector::load(simd, &mesh.to_eye),
                sun: Vector::splat(zero, sky.sun_light()) * cosine,
                around: sky.irradiance_lanes(normal),
                open: one,
            };
            let color = lit.reflected(sky).rows();
            for lane in 0..mesh.count {
                let pixel = mesh.pixels[lane] % PIXELS;
                for channel in 0..3 {
                    light[pixel / LANES][channel][pixel % LANES] = color[channel][lane];
                }
            }
        }
        for index in 0..OCTETS {
            if !self.octets[index] {
                continue;
            }
            let light = Vector::load(simd, &light[index]) * zero.splat(*brightness);
            let [x, y] = places(&self.tile, index);
            let pixels = P::of_light(light, &x, &y);
            let (left, top) = (x[0] - self.tile.left, y[0] - self.tile.top);
            for (row, pixels) in pixels.chunks_exact(COLUMNS).enumerate() {
                self.tile.put(left as usize, top as usize + row, pixels);
            }
        }
    }
}
