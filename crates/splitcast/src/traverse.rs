//! Rays through the tree: each query is a sink for hits, fed by one descent.

mod completion;
mod descend;
mod intervals;
mod lanes;
mod nearest;
mod packet;
mod ray_packet;
mod rays;
pub mod reference;
mod strands;
mod stream;
mod triangle;

use std::marker::PhantomData;
use std::ops::ControlFlow;

pub use descend::TraversalCounts;
use fearless_simd::f32x8;
use fearless_simd::prelude::*;
pub use ray_packet::RayPacket;

use crate::simd::{Kernel, dispatch};
use crate::wide::{Block, Blocks, LANES};
use crate::{Hit, KdTree, Mesh, Ray};
use descend::{BlockVisitor, Slabs, descend};
use lanes::{ErrorScale, Passing, RayLanes, TriangleLanes, length_bound};
use nearest::{AnyHits, ClosestHits, Nearest, Query};
use triangle::{Crossing, ShearedRay, unit_normal};

impl KdTree<'_> {
    /// The nearest hit along the ray within its range; of hits at the same
    /// distance, the one on the triangle with the lowest index.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest_hit_counted(ray).0
    }

    /// [`KdTree::closest_hit`], and what it took.
    pub fn closest_hit_counted(&self, ray: &Ray) -> (Option<Hit>, TraversalCounts) {
        let (nearest, counts) = dispatch(Alone::<ClosestHits>::new(self, ray));
        (nearest.into_hit(&self.wide().blocks, ray), counts)
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
        dispatch(Alone::<AnyHits>::new(self, ray)).0.is_hit()
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
        let Self { tree, ray, sink } = self;
        let Some(way) = Way::new(tree, ray) else {
            return TraversalCounts::default();
        };
        let mut tester = BlockTester {
            simd,
            mesh: tree.mesh(),
            lanes: RayLanes::of_ray(simd, ray),
            errors: way.errors,
            sheared: way.sheared,
            t_min: ray.t_min,
            sink,
        };
        descend(
            simd,
            tree.wide(),
            &way.slabs,
            tree.wide().root(),
            &mut tester,
        )
    }
}

/// What a descent needs of a ray.
struct Way<'q> {
    slabs: Slabs,
    errors: ErrorScale,
    sheared: ShearedRay<'q>,
}

impl<'q> Way<'q> {
    /// `None` if the ray passes by the box around all, or cannot hit anything.
    #[inline(always)]
    fn new(tree: &KdTree<'_>, ray: &'q Ray) -> Option<Self> {
        let bounds = tree.bounds();
        let slabs = Slabs::new(ray, &bounds);
        // The box first: many rays miss it, few are invalid.
        if !slabs.may_meet(&bounds, ray.t_max) {
            return None;
        }
        let sheared = ShearedRay::new(ray)?;
        let reach = length_bound(bounds.farthest(ray.origin));
        Some(Self {
            slabs,
            errors: ErrorScale::new(length_bound(ray.direction), reach),
            sheared,
        })
    }
}

/// One ray's way to its nearest hit, or to any.
struct Alone<'q, 'm, Q> {
    tree: &'q KdTree<'m>,
    ray: &'q Ray,
    query: PhantomData<Q>,
}

impl<'q, 'm, Q: Query> Alone<'q, 'm, Q> {
    #[inline(always)]
    fn new(tree: &'q KdTree<'m>, ray: &'q Ray) -> Self {
        Self {
            tree,
            ray,
            query: PhantomData,
        }
    }
}

impl<Q: Query> Kernel for Alone<'_, '_, Q> {
    type Output = (Nearest, TraversalCounts);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        let Self { tree, ray, .. } = self;
        let nearest = Nearest::before(ray.t_max);
        let Some(way) = Way::new(tree, ray) else {
            return (nearest, TraversalCounts::default());
        };
        let mut tester =
            NearestTester::<S, Q>::new(simd, &tree.wide().blocks, ray, way.errors, nearest);
        let counts = descend(
            simd,
            tree.wide(),
            &way.slabs,
            tree.wide().root(),
            &mut tester,
        );
        (tester.nearest, counts)
    }
}

/// Keeps the nearest hit in the blocks that a descent visits.
struct NearestTester<'q, S: Simd, Q> {
    simd: S,
    blocks: &'q Blocks,
    ray: &'q Ray,
    lanes: RayLanes<f32x8<S>>,
    errors: ErrorScale,
    nearest: Nearest,
    query: PhantomData<Q>,
}

impl<'q, S: Simd, Q: Query> NearestTester<'q, S, Q> {
    #[inline(always)]
    fn new(
        simd: S,
        blocks: &'q Blocks,
        ray: &'q Ray,
        errors: ErrorScale,
        nearest: Nearest,
    ) -> Self {
        Self {
            simd,
            blocks,
            ray,
            lanes: RayLanes::of_ray(simd, ray),
            errors,
            nearest,
            query: PhantomData,
        }
    }
}

impl<S: Simd, Q: Query> BlockVisitor for NearestTester<'_, S, Q> {
    const ANY: bool = Q::ANY;

    #[inline(always)]
    fn visit(&mut self, index: usize, block: &Block) -> ControlFlow<()> {
        let simd = self.simd;
        let triangles = TriangleLanes::of_block(simd, block);
        let errors = self.errors.of(simd, &triangles);
        let (blocks, ray) = (self.blocks, self.ray);
        let passing = Passing::new(&self.lanes, &triangles, &errors);
        (self.nearest).test_block::<S, Q>(simd, blocks, ray, index, &passing, &errors);
        if Q::ANY && self.nearest.is_hit() {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }

    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.nearest.high
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
    const ANY: bool = H::ANY;

    #[inline(always)]
    fn visit(&mut self, _: usize, block: &Block) -> ControlFlow<()> {
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
            .map(|(crossing, triangle)| of_mesh(mesh, crossing, triangle))
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
    const ANY: bool = H::ANY;

    #[inline(always)]
    fn t_max(&self) -> f32 {
        self.sink.t_max()
    }

    #[inline(always)]
    fn take(&mut self, crossing: Crossing, triangle: u32) -> ControlFlow<()> {
        if (self.accept)(&of_mesh(self.mesh, crossing, triangle)) {
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
            hit.normal = unit_normal(&mesh.corners(hit.triangle));
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

/// A hit of a triangle of the mesh.
fn of_mesh(mesh: Mesh<'_>, crossing: Crossing, triangle: u32) -> Hit {
    complete(crossing, triangle, unit_normal(&mesh.corners(triangle)))
}

fn complete(Crossing { t, u, v }: Crossing, triangle: u32, normal: [f32; 3]) -> Hit {
    Hit {
        t,
        u,
        v,
        triangle,
        normal,
    }
}
