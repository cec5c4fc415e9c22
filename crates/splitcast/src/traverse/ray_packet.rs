//! Packets of a fixed number of rays.

use crate::{Hit, KdTree, Ray};

/// 4, 8 or 16 rays that are traced together, some of which may be inactive: those neither
/// hit nor cost anything. Best of rays that take much the same way.
///
/// ```
/// use splitcast::{BuildOptions, KdTree, Mesh, Ray, RayPacket};
/// let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let tree = KdTree::build(Mesh::new(&positions, &[[0, 1, 2]])?, &BuildOptions::default())?;
/// let from = |x: f32| Ray::new([x, 0.2, 1.0], [0.0, 0.0, -1.0]);
/// let packet = RayPacket::new([from(0.1), from(0.2), from(0.3), from(4.0)]);
/// let hits = tree.closest_hit_packet(&packet);
/// assert_eq!(hits.map(|hit| hit.map(|hit| hit.t)), [Some(1.0), Some(1.0), Some(1.0), None]);
/// let fewer = packet.masked([true, false, true, true]);
/// assert_eq!(tree.occluded_packet(&fewer), [true, false, true, false]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Other numbers of rays do not compile; [`KdTree::closest_hits`] takes any.
///
/// ```compile_fail
/// use splitcast::{Ray, RayPacket};
/// RayPacket::new([Ray::new([0.0; 3], [1.0; 3]); 5]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayPacket<const N: usize> {
    rays: [Ray; N],
    active: [bool; N],
}

impl<const N: usize> RayPacket<N> {
    /// A packet of rays that are all active.
    pub fn new(rays: [Ray; N]) -> Self {
        const { assert!(N == 4 || N == 8 || N == 16, "packets have 4, 8 or 16 rays") };
        Self {
            rays,
            active: [true; N],
        }
    }

    /// The same rays, of which only those are active that `active` says.
    #[must_use]
    pub fn masked(mut self, active: [bool; N]) -> Self {
        self.active = active;
        self
    }

    /// All rays, active or not.
    pub fn rays(&self) -> &[Ray; N] {
        &self.rays
    }

    /// Which of them are active.
    pub fn active(&self) -> &[bool; N] {
        &self.active
    }

    /// The active rays, in front, and their number.
    fn gathered(&self) -> ([Ray; N], usize) {
        let mut rays = self.rays;
        let mut count = 0;
        for (ray, _) in self.rays.iter().zip(self.active).filter(|(_, on)| *on) {
            rays[count] = *ray;
            count += 1;
        }
        (rays, count)
    }

    /// Gives answers to active rays back to their lanes.
    fn scattered<T: Copy>(&self, answers: [T; N], nothing: T) -> [T; N] {
        let mut answers = answers.into_iter();
        self.active.map(|active| match active {
            true => answers.next().unwrap_or(nothing),
            false => nothing,
        })
    }
}

impl KdTree<'_> {
    /// The nearest hit of each active ray of a packet, as [`KdTree::closest_hit`] finds it; `None` for the
    /// others.
    pub fn closest_hit_packet<const N: usize>(&self, packet: &RayPacket<N>) -> [Option<Hit>; N] {
        let (rays, count) = packet.gathered();
        let mut hits = [None; N];
        self.closest_hits(&rays[..count], &mut hits[..count]);
        packet.scattered(hits, None)
    }

    /// Whether each active ray of a packet hits anything, as [`KdTree::occluded`] tells; `false` for the
    /// others.
    pub fn occluded_packet<const N: usize>(&self, packet: &RayPacket<N>) -> [bool; N] {
        let (rays, count) = packet.gathered();
        let mut occluded = [false; N];
        self.occluded_rays(&rays[..count], &mut occluded[..count]);
        packet.scattered(occluded, false)
    }
}
