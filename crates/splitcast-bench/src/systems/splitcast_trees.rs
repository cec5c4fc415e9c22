//! Our own trees: one system for each way to build them.

use splitcast::{BuildOptions, Builder, KdTree, SequenceBuilder};

use super::Catalog;
use crate::rays::RaySetKind;
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// The most rays of a slice: a chunk, whose hits fit in the second-level cache.
const SLICE: usize = 4096;

/// The mode in which rays are traced one by one.
const SINGLY: usize = 1;

/// Adds every builder and tracker.
pub(super) fn add_to(catalog: &mut Catalog) {
    for &builder in Builder::ALL {
        let options = BuildOptions {
            builder,
            ..BuildOptions::default()
        };
        catalog.entries.push(CatalogEntry {
            name: name(builder),
            family: "splitcast",
            about: format!(
                "Splitcast {}, kd-tree, builder {builder}",
                env!("CARGO_PKG_VERSION")
            ),
            yardstick: (builder != Builder::Binned).then(|| name(Builder::Binned)),
            make: Box::new(move |_| {
                let builder = SequenceBuilder::new(&options).map_err(error)?;
                Ok(Box::new(Trees(builder)))
            }),
        });
    }
}

fn name(builder: Builder) -> String {
    format!("splitcast-{}", builder.name())
}

struct Trees(SequenceBuilder);

impl System for Trees {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        Ok(Box::new(self.0.build(frame.mesh).map_err(error)?))
    }
}

impl Tracer for KdTree<'_> {
    fn modes(&self, _: RaySetKind) -> &'static [&'static str] {
        &["slices of rays", "single rays"]
    }

    fn closest_hits(&self, mode: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        if mode == SINGLY {
            return hits.fill(rays.rays, |ray| {
                self.closest_hit(ray).map(|hit| (hit.t, hit.triangle))
            });
        }
        let mut slice = [None; SLICE];
        for (index, rays) in rays.rays.chunks(SLICE).enumerate() {
            let slice = &mut slice[..rays.len()];
            KdTree::closest_hits(self, rays, slice);
            let places = index * SLICE..index * SLICE + rays.len();
            let (t, triangle) = (&mut hits.t[places.clone()], &mut hits.triangle[places]);
            for ((hit, t), triangle) in slice.iter().zip(t).zip(triangle) {
                (*t, *triangle) = match hit {
                    Some(hit) => (hit.t, hit.triangle),
                    None => (f32::INFINITY, u32::MAX),
                };
            }
        }
    }

    fn occluded(&self, mode: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        if mode == SINGLY {
            for (ray, occluded) in rays.rays.iter().zip(occluded) {
                *occluded = KdTree::occluded(self, ray);
            }
            return;
        }
        // There is room behind for whole blocks of rays.
        let occluded = &mut occluded[..rays.rays.len()];
        let slices = rays.rays.chunks(SLICE);
        for (rays, occluded) in slices.zip(occluded.chunks_mut(SLICE)) {
            self.occluded_rays(rays, occluded);
        }
    }

    fn sah_cost(&self) -> Option<f64> {
        // A box without area, which no ray meets, has no cost.
        Some(self.stats().sah_cost).filter(|&cost| cost > 0.0)
    }
}

fn error(error: impl std::fmt::Display) -> SystemError {
    SystemError(error.to_string())
}
