//! The rays that every system traces: five sets, the same for all.

use std::fmt;
use std::str::FromStr;

use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use splitcast::{Aabb, KdTree, Ray};
use splitcast_render::Camera;

/// Rays of a block: 4 by 4 neighbouring pixels of a picture.
pub const LANES: usize = 16;

/// Pixels along a side of a block.
const BLOCK_SIDE: u32 = 4;

/// Pixels along a side of a tile; tiles are the pieces that threads share out.
const TILE_SIDE: u32 = 64;

/// How far from a surface rays start, as a share of the scene's diagonal: far
/// enough that no library's rounding makes them hit where they come from.
const OFFSET: f32 = 1e-4;

/// Length of the rays of ambient occlusion, as a share of the scene's diagonal.
const OCCLUSION_LENGTH: f32 = 0.1;

/// The light's place and half its side, in diagonals from the scene's middle.
const LIGHT_PLACE: [f32; 3] = [0.5, 1.2, 0.7];
const LIGHT_HALF_SIDE: f32 = 0.15;

/// A kind of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum RaySetKind {
    /// From the camera, one a pixel: closest hit.
    Primary,
    /// From each point that is seen to a random point of a square light: occlusion.
    Shadow,
    /// From the same points into the half space above, short: occlusion.
    Ao,
    /// From the same points into the half space above, unlimited: closest hit.
    Diffuse,
    /// Between random points of the frame's box, half as many: closest hit.
    Random,
}

impl RaySetKind {
    /// All kinds, in the order in which they are traced.
    pub const ALL: [Self; 5] = [
        Self::Primary,
        Self::Shadow,
        Self::Ao,
        Self::Diffuse,
        Self::Random,
    ];

    /// Name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Shadow => "shadow",
            Self::Ao => "ao",
            Self::Diffuse => "diffuse",
            Self::Random => "random",
        }
    }

    /// Whether only the question is asked if anything is hit.
    pub fn is_occlusion(self) -> bool {
        matches!(self, Self::Shadow | Self::Ao)
    }
}

impl fmt::Display for RaySetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for RaySetKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|kind| kind.name() == text);
        known.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("no set of rays is called {text:?}; they are {names}")
        })
    }
}

/// Rays lane by lane, for systems that trace packets of them.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct RayBlock {
    /// Origins, by axis.
    pub origin: [[f32; LANES]; 3],
    /// Directions of unit length, by axis.
    pub direction: [[f32; LANES]; 3],
    /// Least distance.
    pub t_min: [f32; LANES],
    /// Greatest distance; below the least one in lanes without a ray.
    pub t_max: [f32; LANES],
}

impl RayBlock {
    fn new(rays: &[Ray]) -> Self {
        let mut block = Self {
            origin: [[0.0; LANES]; 3],
            direction: [[1.0; LANES]; 3],
            t_min: [0.0; LANES],
            t_max: [-1.0; LANES],
        };
        for (lane, ray) in rays.iter().enumerate() {
            for axis in 0..3 {
                block.origin[axis][lane] = ray.origin[axis];
                block.direction[axis][lane] = ray.direction[axis];
            }
            block.t_min[lane] = ray.t_min;
            block.t_max[lane] = ray.t_max;
        }
        block
    }
}

/// Rays of one kind for one frame. Directions have unit length.
#[derive(Clone, Debug)]
pub struct RaySet {
    /// Their kind.
    pub kind: RaySetKind,
    /// One after the other: primary rays tile by tile and block by block,
    /// those of a surface in the order of the primary rays that found it.
    pub rays: Vec<Ray>,
    /// The same rays in blocks.
    pub blocks: Vec<RayBlock>,
}

impl RaySet {
    /// The rays as a set of a kind.
    pub fn new(kind: RaySetKind, rays: Vec<Ray>) -> Self {
        let blocks = rays.chunks(LANES).map(RayBlock::new).collect();
        Self { kind, rays, blocks }
    }
}

/// What a picture shows: the same for all frames of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    /// Where it is seen from.
    pub camera: Camera,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Box around the whole motion.
    pub bounds: Aabb,
}

/// Makes the rays of `kinds` for the mesh of a tree. `frame` numbers the random choices.
///
/// Which triangles are hit does not depend on the tree, so neither do the rays.
pub fn ray_sets(
    kinds: &[RaySetKind],
    picture: &Picture,
    tree: &KdTree<'_>,
    frame: usize,
) -> Vec<RaySet> {
    let primary = primary(picture);
    let surface = Surface::seen_by(tree, &primary, picture);
    let set = |&kind: &RaySetKind| {
        let mut random = ChaCha8Rng::seed_from_u64(frame as u64);
        random.set_stream(kind as u64);
        let rays = match kind {
            RaySetKind::Primary => primary.clone(),
            RaySetKind::Shadow => surface.shadow(picture, &mut random),
            RaySetKind::Ao => surface.hemisphere(surface.scale * OCCLUSION_LENGTH, &mut random),
            RaySetKind::Diffuse => surface.hemisphere(f32::INFINITY, &mut random),
            RaySetKind::Random => segments(&tree.bounds(), primary.len() / 2, &mut random),
        };
        RaySet::new(kind, rays)
    };
    kinds.iter().map(set).collect()
}

/// One ray through the middle of each pixel.
fn primary(picture: &Picture) -> Vec<Ray> {
    let Picture { width, height, .. } = *picture;
    let aspect = width as f32 / height as f32;
    let mut rays = Vec::with_capacity((width * height) as usize);
    // Squares that the border cuts off come last, so that all other blocks are whole squares.
    let mut rest = Vec::new();
    // Squares of one size, cut off at the border, from left to right and from top to bottom.
    let squares = |from: [u32; 2], to: [u32; 2], side: u32| {
        (from[1]..to[1]).step_by(side as usize).flat_map(move |y| {
            let xs = (from[0]..to[0]).step_by(side as usize);
            xs.map(move |x| ([x, y], [(x + side).min(to[0]), (y + side).min(to[1])]))
        })
    };
    for (from, to) in squares([0, 0], [width, height], TILE_SIDE) {
        for (from, to) in squares(from, to, BLOCK_SIDE) {
            let whole = (to[0] - from[0]) * (to[1] - from[1]) == BLOCK_SIDE * BLOCK_SIDE;
            let rays = if whole { &mut rays } else { &mut rest };
            for ([x, y], _) in squares(from, to, 1) {
                let point = [
                    (x as f32 + 0.5) / width as f32,
                    (y as f32 + 0.5) / height as f32,
                ];
                rays.push(picture.camera.ray(point, aspect));
            }
        }
    }
    rays.append(&mut rest);
    rays
}

/// Points that are seen, from which light goes on.
struct Surface {
    /// Points off the surface on the side that is seen, and unit normals to that side.
    points: Vec<([f32; 3], [f32; 3])>,
    /// Diagonal of the scene.
    scale: f32,
}

impl Surface {
    fn seen_by(tree: &KdTree<'_>, rays: &[Ray], picture: &Picture) -> Self {
        let scale = dot(picture.bounds.extent(), picture.bounds.extent()).sqrt();
        let points = rays.iter().filter_map(|ray| {
            let hit = tree.closest_hit(ray)?;
            let away = dot(hit.normal, ray.direction) > 0.0;
            let normal = if away {
                hit.normal.map(|x| -x)
            } else {
                hit.normal
            };
            Some((along(ray.at(hit.t), normal, OFFSET * scale), normal))
        });
        Self {
            points: points.collect(),
            scale,
        }
    }

    /// One ray a point to a point of the light.
    fn shadow(&self, picture: &Picture, random: &mut ChaCha8Rng) -> Vec<Ray> {
        let Aabb { min, max } = picture.bounds;
        let middle = |k: usize| 0.5 * (min[k] + max[k]);
        let place: [f32; 3] = std::array::from_fn(|k| middle(k) + LIGHT_PLACE[k] * self.scale);
        let towards = normalized(LIGHT_PLACE.map(|x| -x));
        let (right, up) = tangents(towards);
        let rays = self.points.iter().map(|&(origin, _)| {
            let mut side = || self.scale * LIGHT_HALF_SIDE * random.random_range(-1.0..1.0_f32);
            let target = along(along(place, right, side()), up, side());
            segment(origin, target)
        });
        rays.collect()
    }

    /// One ray a point into the half space above it, distributed as the cosine.
    fn hemisphere(&self, length: f32, random: &mut ChaCha8Rng) -> Vec<Ray> {
        let rays = self.points.iter().map(|&(origin, normal)| {
            let (right, up) = tangents(normal);
            let (share, turn) = (random.random::<f32>(), random.random::<f32>());
            let (radius, angle) = (share.sqrt(), std::f32::consts::TAU * turn);
            let height = (1.0 - share).sqrt();
            let direction = along(normal.map(|x| height * x), right, radius * angle.cos());
            let direction = normalized(along(direction, up, radius * angle.sin()));
            Ray::new(origin, direction).with_range(0.0, length)
        });
        rays.collect()
    }
}

/// Rays between points that are uniform in the box.
fn segments(bounds: &Aabb, count: usize, random: &mut ChaCha8Rng) -> Vec<Ray> {
    let extent = bounds.extent();
    let mut point = || std::array::from_fn(|k| bounds.min[k] + random.random::<f32>() * extent[k]);
    (0..count).map(|_| segment(point(), point())).collect()
}

/// The ray from one point to another.
fn segment(from: [f32; 3], to: [f32; 3]) -> Ray {
    let way: [f32; 3] = std::array::from_fn(|k| to[k] - from[k]);
    let length = dot(way, way).sqrt();
    let direction = if length > 0.0 {
        way.map(|x| x / length)
    } else {
        [1.0, 0.0, 0.0]
    };
    Ray::new(from, direction).with_range(0.0, length)
}

/// Two unit vectors at right angles to a unit vector and to each other (Duff et al. 2017).
fn tangents([x, y, z]: [f32; 3]) -> ([f32; 3], [f32; 3]) {
    let sign = 1.0_f32.copysign(z);
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    (
        [1.0 + sign * x * x * a, sign * b, -sign * x],
        [b, sign + y * y * a, -y],
    )
}

fn along(point: [f32; 3], direction: [f32; 3], distance: f32) -> [f32; 3] {
    std::array::from_fn(|k| point[k] + distance * direction[k])
}

fn normalized(v: [f32; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt();
    v.map(|x| x / length)
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use splitcast::{BuildOptions, Mesh};
    use splitcast_render::{DEFAULT_FOV_DEGREES, Perspective};

    use super::*;

    fn picture(width: u32, height: u32) -> Picture {
        let corners = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]];
        let aspect = width as f32 / height as f32;
        let view = Perspective::framing(&corners, [0.0, 1.0, 0.0], aspect, DEFAULT_FOV_DEGREES);
        Picture {
            camera: Camera::new(&view.expect("a view")).expect("a camera"),
            width,
            height,
            bounds: Aabb::of_points(&corners),
        }
    }

    #[test]
    fn blocks_are_squares_of_pixels_whatever_the_size() {
        let picture = picture(70, 9);
        let rays = primary(&picture);
        assert_eq!(rays.len(), 70 * 9);
        let pixel = |ray: &Ray| {
            let [x, y] = picture
                .camera
                .project(ray.at(1.0), 70.0 / 9.0)
                .expect("in front");
            [(x * 70.0) as u32, (y * 9.0) as u32]
        };
        let mut seen: Vec<[u32; 2]> = rays.iter().map(pixel).collect();
        // 17 by 2 whole squares.
        for block in seen.chunks(LANES).take(34) {
            let [x, y] = block[0];
            assert!(x.is_multiple_of(BLOCK_SIDE) && y.is_multiple_of(BLOCK_SIDE));
            assert!(block.iter().all(|p| p[0] / 4 == x / 4 && p[1] / 4 == y / 4));
        }
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 70 * 9);
    }

    #[test]
    fn rays_start_off_the_surface_that_is_seen_and_have_unit_length() {
        let positions = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
        ];
        let triangles = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
        let mesh = Mesh::new(&positions, &triangles).expect("indices are in range");
        let tree = KdTree::build(mesh, &BuildOptions::default()).expect("all are finite");
        let picture = picture(64, 48);
        let sets = ray_sets(&RaySetKind::ALL, &picture, &tree, 7);
        let hits = sets[0]
            .rays
            .iter()
            .filter(|ray| tree.closest_hit(ray).is_some())
            .count();
        assert!(hits > 100);
        let counts: Vec<usize> = sets.iter().map(|set| set.rays.len()).collect();
        assert_eq!(counts, [64 * 48, hits, hits, hits, 64 * 48 / 2]);
        for (set, ray) in sets
            .iter()
            .flat_map(|set| set.rays.iter().map(move |ray| (set, ray)))
        {
            let length = dot(ray.direction, ray.direction).sqrt();
            assert!((length - 1.0).abs() < 1e-5, "{} has {length}", set.kind);
        }
        // What is seen of a solid with corners that stand out lights itself nowhere.
        let inside = |ray: &&Ray| tree.occluded(&Ray::new(ray.origin, ray.direction));
        assert_eq!(sets[2].rays.iter().filter(inside).count(), 0);
        // The same frame gives the same rays, another one others.
        let again = ray_sets(&RaySetKind::ALL, &picture, &tree, 7);
        let other = ray_sets(&RaySetKind::ALL, &picture, &tree, 8);
        assert!(again.iter().zip(&sets).all(|(a, b)| a.rays == b.rays));
        assert!(other[3].rays != sets[3].rays);
    }
}
