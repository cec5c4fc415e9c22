//! A heat map from dark blue over red to pale yellow.
//!
//! Its lightness in Oklab (Ottosson 2020, "A perceptual color space for image
//! processing") rises evenly and its hue turns evenly, so that equal steps of
//! the value look like equal steps, in print and to colour-blind eyes too.

use glam::Vec3;

/// Oklab colours that the map's curve is drawn towards: the control points of
/// a Bézier curve from the coldest to the hottest colour, evenly spaced in lightness.
const CONTROLS: [Vec3; 5] = [
    Vec3::new(0.16, 0.010, -0.085),
    Vec3::new(0.3575, 0.210, -0.230),
    Vec3::new(0.555, 0.290, 0.060),
    Vec3::new(0.7525, 0.090, 0.215),
    Vec3::new(0.95, -0.035, 0.110),
];

/// The linear sRGB colour for `heat` from 0 to 1; beyond, that of the nearer end.
pub(crate) fn heat_color(heat: f32) -> Vec3 {
    let heat = if heat > 0.0 { heat.min(1.0) } else { 0.0 };
    let mut curve = CONTROLS;
    // De Casteljau's construction.
    for left in (1..curve.len()).rev() {
        for point in 0..left {
            curve[point] = curve[point].lerp(curve[point + 1], heat);
        }
    }
    oklab_to_linear_srgb(curve[0]).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Oklab to linear sRGB, with the constants of the paper above.
fn oklab_to_linear_srgb(lab: Vec3) -> Vec3 {
    let root = Vec3::new(
        lab.x + 0.396_337_78 * lab.y + 0.215_803_76 * lab.z,
        lab.x - 0.105_561_346 * lab.y - 0.063_854_17 * lab.z,
        lab.x - 0.089_484_18 * lab.y - 1.291_485_5 * lab.z,
    );
    let cones = root * root * root;
    Vec3::new(
        4.076_741_7 * cones.x - 3.307_711_6 * cones.y + 0.230_969_94 * cones.z,
        -1.268_438 * cones.x + 2.609_757_4 * cones.y - 0.341_319_4 * cones.z,
        -0.004_196_086_3 * cones.x - 0.703_418_6 * cones.y + 1.707_614_7 * cones.z,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hotter_is_always_brighter() {
        let luminance = |heat| heat_color(heat).dot(Vec3::new(0.2126, 0.7152, 0.0722));
        for step in 0..200 {
            let (a, b) = (step as f32 / 200.0, (step + 1) as f32 / 200.0);
            assert!(luminance(a) < luminance(b), "{a}");
        }
    }

    #[test]
    fn white_of_oklab_is_white() {
        let white = oklab_to_linear_srgb(Vec3::X);
        assert!((white - Vec3::ONE).abs().max_element() < 1e-4, "{white}");
    }

    #[test]
    fn values_out_of_range_take_the_nearer_end() {
        assert_eq!(heat_color(-2.0), heat_color(0.0));
        assert_eq!(heat_color(f32::NAN), heat_color(0.0));
        assert_eq!(heat_color(f32::INFINITY), heat_color(1.0));
    }
}
