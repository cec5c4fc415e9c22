//! Million rays a second on one thread: from a camera (coherent), and from the points the camera
//! sees in random directions; one by one, in packets and in slices. Then what rays cost that hit
//! nothing because they are not sound, over what the sound ones cost.
//!
//! `cargo run --release -p splitcast --example trace_rate [LEVELS]`, where the
//! mesh has `8 · 4^LEVELS` triangles (7, 131072 triangles, if not given).

use std::time::Instant;

use splitcast::{BuildOptions, Builder, Hit, KdTree, Mesh, Ray, RayPacket};

#[path = "../tests/suite/meshes.rs"]
#[expect(dead_code, reason = "the test suite uses the rest")]
mod meshes;

/// Pixels on either side of the picture.
const SIZE: usize = 512;

/// Passes over all rays; the fastest is printed: it is the least disturbed.
const PASSES: usize = 5;

/// Makes a ray that hits nothing.
type Spoil = fn(Ray) -> Ray;

/// What may be wrong with a ray.
const FAULTS: [(&str, Spoil); 5] = [
    ("NaN direction", |ray| Ray {
        direction: [f32::NAN, 0.0, 1.0],
        ..ray
    }),
    ("NaN origin", |ray| Ray {
        origin: [0.0, f32::NAN, 0.0],
        ..ray
    }),
    ("infinite origin", |ray| Ray {
        origin: [f32::INFINITY, 0.0, 0.0],
        ..ray
    }),
    ("infinite direction", |ray| Ray {
        direction: [0.0, 0.0, f32::NEG_INFINITY],
        ..ray
    }),
    ("no direction", |ray| Ray {
        direction: [0.0; 3],
        ..ray
    }),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let levels = std::env::args().nth(1).map_or(Ok(7), |text| text.parse())?;
    let soup = meshes::bumpy_sphere(levels, 0.0);
    let mesh = Mesh::new(&soup.positions, &soup.triangles)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    println!("{} triangles, {SIZE}x{SIZE} rays", soup.triangles.len());
    for &builder in Builder::ALL {
        let options = BuildOptions {
            builder,
            ..BuildOptions::default()
        };
        let tree = KdTree::build(mesh, &options)?;
        println!("{builder}: SAH cost {:.1}", tree.stats().sah_cost);
        pool.install(|| measure(&tree));
    }
    Ok(())
}

fn measure(tree: &KdTree<'_>) {
    let primary = camera_rays();
    let diffuse = bounced_rays(tree, &primary);
    for (name, rays) in [("primary", &primary), ("diffuse", &diffuse)] {
        let rates = rates(tree, rays)
            .map(|rate| format!("{rate:.1}"))
            .join(", ");
        println!(
            "  {name}: {rates} Mray/s (closest hit and occluded: one by one; packets of 4, 8, 16; slices)"
        );
    }
    for (name, fault) in FAULTS {
        for every in [1, 16] {
            let spoil = |rays: &[Ray]| -> Vec<Ray> {
                let rays = rays.iter().enumerate();
                rays.map(|(k, &ray)| if k % every == 0 { fault(ray) } else { ray })
                    .collect()
            };
            let cost = |rays: &[Ray]| {
                let (sound, spoilt) = (rates(tree, rays), rates(tree, &spoil(rays)));
                let costs: [f64; 10] = std::array::from_fn(|k| sound[k] / spoilt[k]);
                costs.into_iter().fold(0.0, f64::max)
            };
            println!(
                "  {name}, one ray of {every}: at most {:.2} of what primary rays cost, {:.2} of diffuse",
                cost(&primary),
                cost(&diffuse)
            );
        }
    }
}

/// Million rays a second of each kind of query.
fn rates(tree: &KdTree<'_>, rays: &[Ray]) -> [f64; 10] {
    fn packets<const N: usize>(rays: &[Ray]) -> impl Iterator<Item = RayPacket<N>> {
        let all = rays.chunks_exact(N);
        all.map(|rays| RayPacket::new(std::array::from_fn(|k| rays[k])))
    }
    fn hit<const N: usize>(tree: &KdTree<'_>, rays: &[Ray]) -> usize {
        packets::<N>(rays)
            .map(|packet| tree.closest_hit_packet(&packet).iter().flatten().count())
            .sum()
    }
    fn dark<const N: usize>(tree: &KdTree<'_>, rays: &[Ray]) -> usize {
        packets::<N>(rays)
            .map(|packet| {
                tree.occluded_packet(&packet)
                    .iter()
                    .filter(|dark| **dark)
                    .count()
            })
            .sum()
    }
    let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
    let mut occluded = vec![false; rays.len()];
    [
        rate(rays, || {
            rays.iter()
                .filter(|ray| tree.closest_hit(ray).is_some())
                .count()
        }),
        rate(rays, || hit::<4>(tree, rays)),
        rate(rays, || hit::<8>(tree, rays)),
        rate(rays, || hit::<16>(tree, rays)),
        rate(rays, || {
            tree.closest_hits(rays, &mut hits);
            hits.len()
        }),
        rate(rays, || {
            rays.iter().filter(|ray| tree.occluded(ray)).count()
        }),
        rate(rays, || dark::<4>(tree, rays)),
        rate(rays, || dark::<8>(tree, rays)),
        rate(rays, || dark::<16>(tree, rays)),
        rate(rays, || {
            tree.occluded_rays(rays, &mut occluded);
            occluded.len()
        }),
    ]
}

/// A perspective view of the unit sphere from (0, 0, 3).
fn camera_rays() -> Vec<Ray> {
    let screen = |pixel: usize| (pixel as f32 + 0.5) / SIZE as f32 - 0.5;
    (0..SIZE * SIZE)
        .map(|i| Ray::new([0.0, 0.0, 3.0], [screen(i % SIZE), screen(i / SIZE), -1.1]))
        .collect()
}

/// One ray in a random direction from every point that the camera sees.
fn bounced_rays(tree: &KdTree<'_>, rays: &[Ray]) -> Vec<Ray> {
    let mut rng = meshes::Rng(1);
    rays.iter()
        .filter_map(|ray| {
            let origin = ray.at(tree.closest_hit(ray)?.t);
            Some(Ray::new(origin, rng.direction()).with_range(1e-4, f32::INFINITY))
        })
        .collect()
}

fn rate(rays: &[Ray], mut trace: impl FnMut() -> usize) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..PASSES {
        let start = Instant::now();
        std::hint::black_box(trace());
        best = best.min(start.elapsed().as_secs_f64());
    }
    rays.len() as f64 / best / 1e6
}
