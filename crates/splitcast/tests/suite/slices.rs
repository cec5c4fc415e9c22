//! Slices and packets of rays: neighbors that take much the same way, that do not, and that are a mixture of
//! good and bad ones.

use splitcast::{Hit, KdTree, Mesh, Ray, RayPacket, reference};

use super::bits;
use super::rays::{RaySource, between, invalid, towards};

/// Rays that are traced as one at most.
const PACKET: usize = 64;

/// Rays that share their way through a tree.
const GROUP: usize = 16;

/// Around the numbers of rays that are traced together.
const SHORT: [usize; 8] = [0, 1, 15, 16, 17, 63, 64, 65];

/// Some rays of every kind of stream, more of each than a stream holds, and more than several threads' tasks.
const LONG: [usize; 3] = [1000, 3000, 20_000];

/// Numbers of threads that may share a long slice.
const THREADS: [usize; 2] = [1, 3];

/// Rays in an order, with what brute force says of each. Slices of any length begin at any group
/// and go round.
pub(crate) struct Slices {
    name: &'static str,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
}

/// So many packets of each kind, or no slices at all. `unkind` are rays of every kind.
pub(crate) fn all(mesh: Mesh<'_>, packets: usize, unkind: &[Ray]) -> Vec<Slices> {
    if packets == 0 {
        return Vec::new();
    }
    let mut source = RaySource::new(mesh);
    let mut all = Vec::new();
    let mut several = |name, of_packet: &mut dyn FnMut(usize) -> Vec<Ray>| {
        let rays = (0..packets).flat_map(of_packet);
        all.push(Slices::new(mesh, name, rays.collect()));
    };
    several("camera", &mut |packet| camera(&mut source, packet));
    several("light", &mut |packet| light(mesh, &mut source, packet));
    several("parallel", &mut |packet| parallel(&mut source, packet));
    several("mixed", &mut |packet| mixed(&mut source, packet));
    several("bundles", &mut |packet| {
        bundles(&mut source, &unkind[packet % unkind.len()..])
    });
    several("unkind", &mut |packet| {
        let cycle = unkind.iter().cycle().skip(packet * PACKET);
        cycle.take(PACKET).copied().collect()
    });
    all
}

/// Panics if anything in slices of few rays is not what brute force says. Not every length for every
/// kind, but another with each of many trees, chosen by any number.
pub(crate) fn check(all: &[Slices], tree: &KdTree<'_>, chosen: usize, what: &str) {
    for (kind, slices) in all.iter().enumerate() {
        let turn = chosen + kind;
        slices.check(tree, turn, SHORT[turn % SHORT.len()], what);
        match turn % 3 {
            0 => slices.check_packet::<4>(tree, turn, what),
            1 => slices.check_packet::<8>(tree, turn, what),
            _ => slices.check_packet::<16>(tree, turn, what),
        }
    }
}

/// The same in a slice of many rays, of one kind after the other, divided among threads.
pub(crate) fn check_long(all: &[Slices], tree: &KdTree<'_>, chosen: usize, what: &str) {
    if all.is_empty() {
        return;
    }
    let every_kind = Slices {
        name: "every kind",
        rays: all.iter().flat_map(|slices| slices.rays.clone()).collect(),
        hits: all.iter().flat_map(|slices| slices.hits.clone()).collect(),
    };
    let threads = THREADS[chosen / LONG.len() % THREADS.len()];
    let what = format!("{what}, {threads} threads");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.expect("a pool of a few threads").install(|| {
        every_kind.check(tree, chosen, LONG[chosen % LONG.len()], &what);
    });
}

impl Slices {
    fn new(mesh: Mesh<'_>, name: &'static str, rays: Vec<Ray>) -> Self {
        let closest = |ray| reference::closest_hit(mesh, ray);
        Self {
            name,
            hits: rays.iter().map(closest).collect(),
            rays,
        }
    }

    /// Traces the first rays of a group as a packet, some of them inactive.
    fn check_packet<const N: usize>(&self, tree: &KdTree<'_>, group: usize, what: &str) {
        let places: [usize; N] = std::array::from_fn(|k| (group * GROUP + k) % self.rays.len());
        let packet = RayPacket::new(places.map(|place| self.rays[place]));
        // All, every other, all but every third, none.
        let masks: [fn(usize) -> bool; 4] = [|_| true, |k| k % 2 == 0, |k| k % 3 > 0, |_| false];
        let packet = packet.masked(std::array::from_fn(masks[group % masks.len()]));
        let hits = tree.closest_hit_packet(&packet);
        let occluded = tree.occluded_packet(&packet);
        for (k, place) in places.into_iter().enumerate() {
            let expected = self.hits[place].filter(|_| packet.active()[k]);
            let ray = || format!("{k} of {packet:?} ({}) on {what}", self.name);
            assert_eq!(
                hits[k].map(bits),
                expected.map(bits),
                "closest hit of {}",
                ray()
            );
            assert_eq!(occluded[k], expected.is_some(), "occlusion of {}", ray());
        }
    }

    /// Traces so many rays from a group on.
    fn check(&self, tree: &KdTree<'_>, group: usize, length: usize, what: &str) {
        let cycle = |k: usize| (group * GROUP + k) % self.rays.len();
        let rays: Vec<Ray> = (0..length).map(|k| self.rays[cycle(k)]).collect();
        // Nothing of what was there may stay.
        let stale = Hit {
            t: -1.0,
            u: 0.0,
            v: 0.0,
            triangle: 0,
            normal: [0.0; 3],
        };
        let mut hits = vec![Some(stale); length];
        tree.closest_hits(&rays, &mut hits);
        let mut occluded: Vec<bool> = (0..length).map(|k| k % 2 == 0).collect();
        tree.occluded_rays(&rays, &mut occluded);
        for (k, ray) in rays.iter().enumerate() {
            let expected = self.hits[cycle(k)];
            let place = || {
                let name = self.name;
                format!("{ray:?}, {k} of {length} ({name} from group {group}) on {what}")
            };
            assert_eq!(
                hits[k].map(bits),
                expected.map(bits),
                "closest hit of {}",
                place()
            );
            assert_eq!(occluded[k], expected.is_some(), "occlusion of {}", place());
        }
    }
}

/// The pixel of each ray of a packet, from -4 to 3: four squares of four by four.
fn pixels() -> impl Iterator<Item = [f32; 2]> {
    (0..PACKET).map(|k| {
        let (square, pixel) = (k / GROUP, k % GROUP);
        let (x, y) = (4 * (square % 2) + pixel % 4, 4 * (square / 2) + pixel / 4);
        [x as f32 - 4.0, y as f32 - 4.0]
    })
}

/// Two directions of about unit length across another.
fn across(direction: [f32; 3]) -> [[f32; 3]; 2] {
    let size = direction.iter().fold(0.0f32, |size, x| size.max(x.abs()));
    let [x, y, z] = direction.map(|x| x / size);
    let aside = if x.abs() < 0.5 {
        [0.0, z, -y]
    } else {
        [y, -x, 0.0]
    };
    let [a, b, c] = aside;
    [aside, [y * c - z * b, z * a - x * c, x * b - y * a]]
}

/// Through an 8 by 8 pinhole camera, narrower from packet to packet; one of its
/// pixels is exactly at a vertex.
fn camera(source: &mut RaySource<'_>, packet: usize) -> Vec<Ray> {
    let spread = if source.rng.unit() < 0.3 { 1.0 } else { 3.0 };
    let (eye, target) = (source.point(spread), source.target());
    let forward = towards(eye, target);
    let length = forward.iter().map(|x| x * x).sum::<f32>().sqrt();
    let pixel = length * 0.06 * 0.1f32.powi((2 * packet % 7) as i32);
    let [right, up] = across(forward);
    let ray = |[x, y]: [f32; 2]| {
        let aside = |axis: usize| x * right[axis] + y * up[axis];
        Ray::new(
            eye,
            std::array::from_fn(|axis| forward[axis] + pixel * aside(axis)),
        )
    };
    pixels().map(ray).collect()
}

/// From what a camera sees to one light, or the other way.
fn light(mesh: Mesh<'_>, source: &mut RaySource<'_>, packet: usize) -> Vec<Ray> {
    let light = source.point(2.0);
    let shadow = |ray: Ray| {
        let hit = reference::closest_hit(mesh, &ray);
        let point = ray.at(hit.map_or(1.0, |hit| hit.t));
        if packet.is_multiple_of(2) {
            Ray::new(point, towards(point, light)).with_range(1e-3, 1.0)
        } else {
            Ray::new(light, towards(light, point)).with_range(0.0, 0.999)
        }
    };
    camera(source, packet).into_iter().map(shadow).collect()
}

/// Along an axis, through coordinates that vertices have, or along anything.
fn parallel(source: &mut RaySource<'_>, packet: usize) -> Vec<Ray> {
    let direction = if packet.is_multiple_of(2) {
        source.axis_direction()
    } else {
        source.rng.direction()
    };
    let [right, up] = across(direction);
    let target = source.target();
    let size = source.size();
    let step = size * 0.02 * 0.1f32.powi((2 * packet % 5) as i32);
    let ray = |[x, y]: [f32; 2]| {
        let origin = |axis: usize| {
            let aside = x * right[axis] + y * up[axis];
            target[axis] + step * aside - 0.75 * size * direction[axis]
        };
        Ray::new(std::array::from_fn(origin), direction).with_range(-1.0, f32::INFINITY)
    };
    pixels().map(ray).collect()
}

/// A camera's rays, among them invalid ones and ones with other ranges; one group has only such.
fn mixed(source: &mut RaySource<'_>, packet: usize) -> Vec<Ray> {
    let bad = invalid();
    let mut rays = camera(source, packet);
    for (k, ray) in rays.iter_mut().enumerate() {
        let only_bad = k / GROUP == packet % 4;
        match source.rng.below(if only_bad { 2 } else { 8 }) {
            0 => *ray = bad[source.rng.below(bad.len())],
            1 => *ray = ray.with_range(1.0, -1.0),
            2 => *ray = ray.with_range(-1.0 - source.rng.unit(), source.rng.unit()),
            3 => *ray = source.limited(*ray),
            _ => (),
        }
    }
    rays
}

/// Some rays, each in a group of its own of rays that are off by a few roundings, and with other
/// ranges.
fn bundles(source: &mut RaySource<'_>, rays: &[Ray]) -> Vec<Ray> {
    // Groups that follow each other are unlike.
    let apart = rays.len().div_ceil(PACKET / GROUP).max(1);
    let groups = (0..PACKET / GROUP).map(|k| rays[(k * apart) % rays.len()]);
    let mut all = Vec::new();
    for ray in groups {
        for k in 0..GROUP {
            let mut near = |x: f32| x * (1.0 + (source.rng.below(5) as f32 - 2.0) * f32::EPSILON);
            let moved = Ray {
                origin: ray.origin.map(&mut near),
                direction: ray.direction.map(&mut near),
                ..ray
            };
            all.push(match k % 4 {
                0 => ray,
                1 => source.limited(moved),
                _ => moved,
            });
        }
    }
    all
}

impl RaySource<'_> {
    /// A vertex, or a point where there is none.
    fn target(&mut self) -> [f32; 3] {
        if self.is_empty() {
            return self.point(1.0);
        }
        let (a, b) = (self.vertex(), self.vertex());
        // Sometimes in the middle of things.
        if self.rng.unit() < 0.2 {
            between(a, b, 0.5)
        } else {
            a
        }
    }
}
