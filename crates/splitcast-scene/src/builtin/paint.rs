//! Colours that vary over a body.

use glam::Vec3;

use super::value_noise::value_noise;

/// `color` with a spot on it: `ink` up to `inner` from its middle, fading out
/// towards `outer`.
pub(super) fn spot(color: [u8; 3], ink: [u8; 3], distance: f32, inner: f32, outer: f32) -> [u8; 3] {
    let cover = ((outer - distance) / (outer - inner)).clamp(0.0, 1.0);
    std::array::from_fn(|i| {
        (f32::from(color[i]) * (1.0 - cover) + f32::from(ink[i]) * cover).round() as u8
    })
}

/// `color` made lighter and darker by up to `depth` of itself, in blotches of
/// which `frequency` fit in a metre.
pub(super) fn mottle(color: [u8; 3], position: Vec3, frequency: f32, depth: f32) -> [u8; 3] {
    let factor = 1.0 + depth * value_noise(position * frequency);
    color.map(|channel| (f32::from(channel) * factor).round().clamp(0.0, 255.0) as u8)
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
