//! Rays through the tree: each query is a sink for hits, fed by one descent.

mod completion;
mod descend;
mod lanes;
mod packet;
mod ray_packet;
mod rays;
pub mod reference;
mod triangle;

use std::ops::ControlFlow;

pub use descend::TraversalCounts;
use fearless_simd::f32x8;
use fearless_simd::prelude::*;
pub use ray_packet::RayPacket;

use crate::simd::{Kernel, dispatch};
use crate::wide::{Block, LANES};
use crate::{Hit, KdTree, Mesh, Ray};
use descend::{BlockVisitor, Slabs, descend};
use lanes::{ErrorScale, Passing, RayLanes, TriangleLanes, length_bound};
use triangle::{Crossing, ShearedRay, unit_normal};

impl KdTree<'_> {
    /// The nearest hit along the ray within its range; of hits at the same
    /// distance, the one on the triangle with the lowest index.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest_hit_counted(ray).0
    }

    /// [`KdTree::closest_hit`], and what it took.
    pub fn closest_hit_counted(&self, ray: &Ray) -> (Option<Hit>, TraversalCounts) {
        let mut closest = Closest::new(ray);
        let counts = self.trace(ray, &mut closest);
        (closest.into_hit(self.mesh()), counts)
    }

    /// The nearest of the hits that `accept` lets through, such as those on
    /// opaque parts of a texture. It is asked about each hit that is nearer than the nearest
    /// accepted so far, in no order and perhaps more than once.
    pub fn closest_hit_where(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let mut accepted = Accepted {
            sink: Closest::new(ray),
            mesh: self.mesh(),
            accept,
        };
        self.trace(ray, &mut accepted);
        accepted.sink.into_hit(self.mesh())
    }

    /// Whether anything is hit along the ray within its range. Cheaper than
    /// [`KdTree::closest_hit`]: the first hit found will do.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut any = Any::new(ray);
        self.trace(ray, &mut any);
        any.found
    }

    /// Whether any hit along the ray within its range is let through by `accept`, which is
    /// asked in no order and perhaps more than once about a hit.
    pub fn occluded_where(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> bool {
        let mut accepted = Accepted {
            sink: Any::new(ray),
            mesh: self.mesh(),
            accept,
        };
        self.trace(ray, &mut accepted);
        accepted.sink.found
    }

    /// Replaces the contents of `hits` with all hits along the ray within its
    /// range, nearest first and those at the same distance by triangle. No
    /// triangle stands there twice. A ray through an edge or a vertex hits
    /// every triangle around it. Keep `hits` from ray to ray to save
    /// allocations.
    pub fn all_hits(&self, ray: &Ray, hits: &mut Vec<Hit>) {
        let mut all = All::new(ray, hits);
        self.trace(ray, &mut all);
        all.finish(self.mesh());
    }

    /// Feeds the hits of the ray to `sink`, block by block.
    #[inline(always)]
    fn trace(&self, ray: &Ray, sink: &mut impl HitSink) -> TraversalCounts {
        dispatch(Trace {
            tree: self,
            ray,
            sink,
        })
    }
}

/// One ray's way through a tree.
struct Trace<'q, 'm, H> {
    tree: &'q KdTree<'m>,
    ray: &'q Ray,
    sink: &'q mut H,
}

impl<H: HitSink> Kernel for Trace<'_, '_, H> {
    type Output = TraversalCounts;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> TraversalCounts {
        self.trace(simd)
    }
}

impl<H: HitSink> Trace<'_, '_, H> {
    #[inline(always)]
    fn trace<S: Simd>(self, simd: S) -> TraversalCounts {
        let Self { tree, ray, sink } = self;
        let bounds = tree.bounds();
        let slabs = Slabs::new(ray, bounds.reach(ray.origin));
        // The box first: many rays miss it, few are invalid.
        if slabs.clip(&bounds, ray.t_min, ray.t_max).is_none() {
            return TraversalCounts::default();
        }
        let Some(sheared) = ShearedRay::new(ray) else {
            return TraversalCounts::default();
        };
        let splat = |[x, y, z]: [f32; 3]| {
            [
                f32x8::splat(simd, x),
                f32x8::splat(simd, y),
                f32x8::splat(simd, z),
            ]
        };
        let reach = length_bound(bounds.farthest(ray.origin));
        let mut tester = BlockTester {
            simd,
            mesh: tree.mesh(),
            lanes: RayLanes {
                origin: splat(ray.origin),
                direction: splat(ray.direction),
            },
            errors: ErrorScale::new(length_bound(ray.direction), reach),
            sheared,
            t_min: ray.t_min,
            sink,
        };
        descend(simd, tree.wide(), &slabs, ray.t_min, &mut tester)
    }
}

/// What a query does with hits.
trait HitSink {
    /// Whether it is enough to know that there is a hit.
    const ANY: bool = false;

    /// Hits beyond this are of no interest (any more).
    fn t_max(&self) -> f32;

    /// Takes a hit within the range, perhaps not for the first time. `Break` ends the query.
    fn take(&mut self, crossing: Crossing, triangle: u32) -> ControlFlow<()>;
}

/// Tests one triangle. The only place where hits are compared with the range.
#[inline(always)]
fn test_triangle(
    mesh: Mesh<'_>,
    sheared: &ShearedRay<'_>,
    t_min: f32,
    triangle: u32,
    sink: &mut impl HitSink,
) -> ControlFlow<()> {
    if let Some(crossing) = sheared.intersect(&mesh.corners(triangle))
        && crossing.t >= t_min
        && crossing.t <= sink.t_max()
    {
        sink.take(crossing, triangle)?;
    }
    ControlFlow::Continue(())
}

/// Passes the hits in the blocks that a descent visits on to a sink.
struct BlockTester<'q, 'm, S: Simd, H> {
    simd: S,
    mesh: Mesh<'m>,
    lanes: RayLanes<f32x8<S>>,
    errors: ErrorScale,
    sheared: ShearedRay<'q>,
    t_min: f32,
    sink: &'q mut H,
}

impl<S: Simd, H: HitSink> BlockVisitor for BlockTester<'_, '_, S, H> {
    #[inline(always)]
    fn visit(&mut self, block: &Block) -> ControlFlow<()> {
        let simd = self.simd;
        let triangles = TriangleLanes::of_block(simd, block);
        let errors = self.errors.of(simd, &triangles);
        let passing = Passing::new(&self.lanes, &triangles, &errors);
        if passing.missed.all_true() {
            return ControlFlow::Continue(());
        }
        let distance = passing.distance(simd, &errors);
        let t_min = f32x8::splat(simd, self.t_min);
        let t_max = f32x8::splat(simd, self.sink.t_max());
        if H::ANY && distance.surely_within(t_min, t_max).any_true() {
            let somewhere = Crossing::default();
            return self.sink.take(somewhere, block.triangles[0]);
        }
        let possible = distance.possible(t_min, t_max) & !passing.missed;
        let mut candidates = possible.to_bitmask() as u32;
        while candidates != 0 {
            let triangle = block.triangles[candidates.trailing_zeros() as usize % LANES];
            candidates &= candidates - 1;
            test_triangle(self.mesh, &self.sheared, self.t_min, triangle, self.sink)?;
        }
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.sink.t_max()
    }
}

/// Keeps the nearest hit.
struct Closest {
    t_max: f32,
    hit: Option<(Crossing, u32)>,
}

impl Closest {
    fn new(ray: &Ray) -> Self {
        Self {
            t_max: ray.t_max,
            hit: None,
        }
    }

    fn into_hit(self, mesh: Mesh<'_>) -> Option<Hit> {
        self.hit
            .map(|(crossing, triangle)| complete(mesh, crossing, triangle))
    }
}

impl HitSink for Closest {
    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn take(&mut self, crossing: Crossing, triangle: u32) -> ControlFlow<()> {
        let nearer = |(best, lowest): (Crossing, u32)| crossing.t < best.t || triangle < lowest;
        if self.hit.is_none_or(nearer) {
            self.t_max = crossing.t;
            self.hit = Some((crossing, triangle));
        }
        ControlFlow::Continue(())
    }
}

/// Stops at the first hit.
struct Any {
    t_max: f32,
    found: bool,
}

impl Any {
    fn new(ray: &Ray) -> Self {
        Self {
            t_max: ray.t_max,
            found: false,
        }
    }
}

impl HitSink for Any {
    const ANY: bool = true;

    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn take(&mut self, _: Crossing, _: u32) -> ControlFlow<()> {
        self.found = true;
        ControlFlow::Break(())
    }
}

/// Lets a closure choose hits.
struct Accepted<'m, H, F> {
    sink: H,
    mesh: Mesh<'m>,
    accept: F,
}

impl<H: HitSink, F: FnMut(&Hit) -> bool> HitSink for Accepted<'_, H, F> {
    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.sink.t_max()
    }

    #[inline(always)]
    fn take(&mut self, crossing: Crossing, triangle: u32) -> ControlFlow<()> {
        if (self.accept)(&complete(self.mesh, crossing, triangle)) {
            return self.sink.take(crossing, triangle);
        }
        ControlFlow::Continue(())
    }
}

/// Collects every hit.
struct All<'h> {
    t_max: f32,
    hits: &'h mut Vec<Hit>,
}

impl<'h> All<'h> {
    fn new(ray: &Ray, hits: &'h mut Vec<Hit>) -> Self {
        hits.clear();
        Self {
            t_max: ray.t_max,
            hits,
        }
    }

    /// Sorts the hits, drops repetitions (a triangle in two leaves) and adds the normals.
    fn finish(self, mesh: Mesh<'_>) {
        self.hits
            .sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
        self.hits.dedup_by_key(|hit| hit.triangle);
        for hit in self.hits {
            hit.normal = unit_normal(mesh, hit.triangle);
        }
    }
}

impl HitSink for All<'_> {
    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn take(&mut self, Crossing { t, u, v }: Crossing, triangle: u32) -> ControlFlow<()> {
        self.hits.push(Hit {
            t,
            u,
            v,
            triangle,
            normal: [0.0; 3],
        });
        ControlFlow::Continue(())
    }
}

fn complete(mesh: Mesh<'_>, Crossing { t, u, v }: Crossing, triangle: u32) -> Hit {
    Hit {
        t,
        u,
        v,
        triangle,
        normal: unit_normal(mesh, triangle),
    }
}
