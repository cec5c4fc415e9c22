//! Our own trees: one system for each way to build them.

use splitcast::{BuildOptions, Builder, KdTree, SequenceBuilder};

use super::Catalog;
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

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
    fn closest_hits(&self, _: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        hits.fill(rays.rays, |ray| {
            self.closest_hit(ray).map(|hit| (hit.t, hit.triangle))
        });
    }

    fn occluded(&self, _: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        for (ray, occluded) in rays.rays.iter().zip(occluded) {
            *occluded = KdTree::occluded(self, ray);
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
