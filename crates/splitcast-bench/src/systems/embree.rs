//! Intel Embree 4: the reference for ray tracing on CPUs. Loaded at run time, so
//! that everything else works without it.

mod library;

use std::sync::Arc;

use library::{
    Aligned, BuildQuality, Coherence, Committed, Device, Embree, Packet, RayHits, Rays, Scene,
    SceneFlags, VARIABLE,
};

use super::{Catalog, Missing};
use crate::rays::{LANES, RaySetKind};
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// A way to keep a scene up to date.
#[derive(Clone, Copy)]
struct Way {
    name: &'static str,
    about: &'static str,
    scene: BuildQuality,
    geometry: BuildQuality,
    flags: SceneFlags,
}

/// The name of the yardstick.
const MEDIUM: &str = "embree-medium";

const WAYS: [Way; 4] = [
    Way {
        name: "embree-refit",
        about: "tree of the first frame, refitted",
        // Refitting is only honoured in scenes of low quality.
        scene: BuildQuality::Low,
        geometry: BuildQuality::Refit,
        flags: SceneFlags::Dynamic,
    },
    Way {
        name: "embree-low",
        about: "rebuilt along a Morton curve",
        scene: BuildQuality::Low,
        geometry: BuildQuality::Low,
        flags: SceneFlags::Dynamic,
    },
    Way {
        name: MEDIUM,
        about: "rebuilt by binned surface areas",
        scene: BuildQuality::Medium,
        geometry: BuildQuality::Medium,
        flags: SceneFlags::Static,
    },
    Way {
        name: "embree-high",
        about: "rebuilt with spatial splits",
        scene: BuildQuality::High,
        geometry: BuildQuality::High,
        flags: SceneFlags::Static,
    },
];

/// Adds the systems if the library can be loaded.
pub(super) fn add_to(catalog: &mut Catalog) {
    let (embree, version) = match Embree::load() {
        Ok(loaded) => loaded,
        Err(reason) => {
            let reason = format!(
                "{reason}; install it (libembree4-4 on Debian and Ubuntu, or `pip download \
                 --no-deps embreex` and unzip) and set {VARIABLE} to the file of libembree4"
            );
            catalog.missing.push(Missing {
                family: "embree",
                reason,
            });
            return;
        }
    };
    for way in WAYS {
        let embree = Arc::clone(&embree);
        catalog.entries.push(CatalogEntry {
            name: way.name.to_owned(),
            family: "embree",
            about: format!("Embree {version}, BVH, {}", way.about),
            yardstick: (way.name != MEDIUM).then(|| MEDIUM.to_owned()),
            make: Box::new(move |threads| {
                let device = Device::new(&embree, threads).map_err(SystemError)?;
                let scene = Scene::new(device, way.scene, way.geometry, way.flags);
                Ok(Box::new(EmbreeSystem(scene.map_err(SystemError)?)))
            }),
        });
    }
}

struct EmbreeSystem(Scene);

impl System for EmbreeSystem {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        let is_new = self.0.is_empty() || !frame.same_topology;
        let triangles = is_new.then(|| frame.mesh.triangles());
        let committed = self.0.commit(frame.padded_positions, triangles);
        Ok(Box::new(committed.map_err(SystemError)?))
    }

    fn foreign_bytes(&self) -> usize {
        self.0.device().bytes()
    }
}

const MODES: [&str; 4] = [
    "single rays",
    "packets of 8, coherent",
    "packets of 16",
    "packets of 16, coherent",
];

impl Tracer for Committed<'_> {
    fn modes(&self, _: RaySetKind) -> &'static [&'static str] {
        &MODES
    }

    fn closest_hits(&self, mode: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        match mode {
            0 => {
                for (lane, ray) in rays.rays.iter().enumerate() {
                    let mut found = RayHits::new(Rays::of_ray(ray));
                    Rays::<1>::intersect(self, &mut found, Coherence::Incoherent);
                    (hits.t[lane], hits.triangle[lane]) = found.hit(0);
                }
            }
            1 => closest_in_packets::<8>(self, Coherence::Coherent, rays, &mut hits),
            2 => closest_in_packets::<16>(self, Coherence::Incoherent, rays, &mut hits),
            _ => closest_in_packets::<16>(self, Coherence::Coherent, rays, &mut hits),
        }
    }

    fn occluded(&self, mode: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        match mode {
            0 => {
                for (ray, occluded) in rays.rays.iter().zip(occluded) {
                    let mut ray = Aligned(Rays::of_ray(ray));
                    Rays::<1>::occluded(self, &mut ray, Coherence::Incoherent);
                    *occluded = ray.0.t_far[0] == f32::NEG_INFINITY;
                }
            }
            1 => occluded_in_packets::<8>(self, Coherence::Coherent, rays, occluded),
            2 => occluded_in_packets::<16>(self, Coherence::Incoherent, rays, occluded),
            _ => occluded_in_packets::<16>(self, Coherence::Coherent, rays, occluded),
        }
    }
}

fn closest_in_packets<const N: usize>(
    scene: &Committed<'_>,
    coherence: Coherence,
    rays: RayChunk<'_>,
    hits: &mut HitChunk<'_>,
) where
    Rays<N>: Packet<Hits = RayHits<N>>,
{
    for (index, block) in rays.blocks.iter().enumerate() {
        let (t, triangle) = hits.block(index);
        for first in (0..LANES).step_by(N) {
            let mut found = RayHits::new(Rays::of_block(block, first));
            Rays::<N>::intersect(scene, &mut found, coherence);
            for lane in 0..N {
                (t[first + lane], triangle[first + lane]) = found.hit(lane);
            }
        }
    }
}

fn occluded_in_packets<const N: usize>(
    scene: &Committed<'_>,
    coherence: Coherence,
    rays: RayChunk<'_>,
    occluded: &mut [bool],
) where
    Rays<N>: Packet,
{
    for (block, occluded) in rays.blocks.iter().zip(occluded.chunks_mut(LANES)) {
        for first in (0..LANES).step_by(N) {
            let mut packet = Aligned(Rays::<N>::of_block(block, first));
            Rays::<N>::occluded(scene, &mut packet, coherence);
            for lane in 0..N {
                occluded[first + lane] = packet.0.t_far[lane] == f32::NEG_INFINITY;
            }
        }
    }
}
