//! Million rays a second of single rays on one thread: from a camera
//! (coherent), and from the points the camera sees in random directions.
//!
//! `cargo run --release -p splitcast --example trace_rate [LEVELS]`, where the
//! mesh has `8 · 4^LEVELS` triangles (7, 131072 triangles, if not given).

use std::time::Instant;

use splitcast::{BuildOptions, Builder, KdTree, Mesh, Ray};

#[path = "../tests/suite/meshes.rs"]
#[expect(dead_code, reason = "the test suite uses the rest")]
mod meshes;

/// Pixels on either side of the picture.
const SIZE: usize = 512;

/// Passes over all rays; the fastest is printed: it is the least disturbed.
const PASSES: usize = 5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let levels = std::env::args().nth(1).map_or(Ok(7), |text| text.parse())?;
    let soup = meshes::bumpy_sphere(levels, 0.0);
    let mesh = Mesh::new(&soup.positions, &soup.triangles)?;
    println!("{} triangles, {SIZE}x{SIZE} rays", soup.triangles.len());
    for &builder in Builder::ALL {
        let options = BuildOptions {
            builder,
            ..BuildOptions::default()
        };
        let tree = KdTree::build(mesh, &options)?;
        let primary = camera_rays();
        let diffuse = bounced_rays(&tree, &primary);
        println!("{builder}: SAH cost {:.1}", tree.stats().sah_cost);
        for (name, rays) in [("primary", &primary), ("diffuse", &diffuse)] {
            let closest = rate(rays, |ray| tree.closest_hit(ray).is_some());
            let occluded = rate(rays, |ray| tree.occluded(ray));
            println!("  {name}: closest hit {closest:.2} Mray/s, occluded {occluded:.2} Mray/s");
        }
    }
    Ok(())
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

fn rate(rays: &[Ray], query: impl Fn(&Ray) -> bool) -> f64 {
    let mut seconds: Vec<f64> = (0..PASSES)
        .map(|_| {
            let start = Instant::now();
            let hits = rays.iter().filter(|ray| query(ray)).count();
            std::hint::black_box(hits);
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    rays.len() as f64 / seconds[0] / 1e6
}
