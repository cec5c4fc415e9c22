//! Colours that vary over a body.

use glam::{IVec3, Vec3};

/// `color` with a spot on it: `ink` up to `inner` from its middle, fading out
/// towards `outer`.
pub(super) fn spot(color: [u8; 3], ink: [u8; 3], distance: f32, inner: f32, outer: f32) -> [u8; 3] {
    let cover = ((outer - distance) / (outer - inner)).clamp(0.0, 1.0);
    std::array::from_fn(|i| {
        (f32::from(color[i]) * (1.0 - cover) + f32::from(ink[i]) * cover).round() as u8
    })
}

/// `color` made lighter and darker by up to `depth` of itself, in blotches of
/// which `frequency` fit in a metre (Perlin's value noise, on an integer hash).
pub(super) fn mottle(color: [u8; 3], position: Vec3, frequency: f32, depth: f32) -> [u8; 3] {
    let at = position * frequency;
    let corner = at.floor();
    let t = at - corner;
    let t = t * t * (3.0 - 2.0 * t);
    let value = |x: i32, y: i32, z: i32| lattice_value(corner.as_ivec3() + IVec3::new(x, y, z));
    let mix = |from: f32, to: f32, t: f32| from + (to - from) * t;
    let row = |y, z| mix(value(0, y, z), value(1, y, z), t.x);
    let sheet = |z| mix(row(0, z), row(1, z), t.y);
    let factor = 1.0 + depth * mix(sheet(0), sheet(1), t.z);
    color.map(|channel| (f32::from(channel) * factor).round().clamp(0.0, 255.0) as u8)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mottling_is_bounded_and_continuous() {
        let shade = |x: f32| f32::from(mottle([100; 3], Vec3::new(x, 0.3, -0.7), 5.0, 0.2)[0]);
        let line: Vec<f32> = (0..2000).map(|index| shade(index as f32 * 0.001)).collect();
        assert!(line.iter().all(|value| (80.0..=120.0).contains(value)));
        assert!(line.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 2.0));
        assert!(line.iter().any(|value| *value > 105.0) && line.iter().any(|value| *value < 95.0));
    }
}
