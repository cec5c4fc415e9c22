//! Value noise: random values on the integer lattice, smoothly interpolated
//! (K. Perlin, "An Image Synthesizer", SIGGRAPH 1985), on an integer hash.

use glam::{IVec3, Vec3};

/// Smooth noise from -1 to 1 with features of unit size.
pub(super) fn value_noise(at: Vec3) -> f32 {
    let corner = at.floor();
    let t = at - corner;
    let t = t * t * (3.0 - 2.0 * t);
    let value = |x: i32, y: i32, z: i32| lattice_value(corner.as_ivec3() + IVec3::new(x, y, z));
    let mix = |from: f32, to: f32, t: f32| from + (to - from) * t;
    let row = |y, z| mix(value(0, y, z), value(1, y, z), t.x);
    let sheet = |z| mix(row(0, z), row(1, z), t.y);
    mix(sheet(0), sheet(1), t.z)
}

/// A value from -1 to 1 for a lattice point, by the finalizer of MurmurHash3.
fn lattice_value(at: IVec3) -> f32 {
    let mut hash = [at.x, at.y, at.z].iter().fold(0u32, |hash, &coordinate| {
        (hash ^ coordinate as u32)
            .wrapping_mul(0x9e37_79b1)
            .rotate_left(13)
    });
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
    hash ^= hash >> 16;
    (hash >> 8) as f32 / (1 << 23) as f32 - 1.0
}
