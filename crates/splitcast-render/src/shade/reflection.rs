//! Light that a surface sends back: diffuse under a thin dielectric coat.

use glam::Vec3;

use crate::lanes::{Lanes, Vector};
use crate::sky::Sky;

/// Share of light reflected straight back by a dielectric such as clay, index 1.5.
const REFLECTANCE: f32 = 0.04;

/// Roughness of the sheen, squared as is usual for the width of the lobe.
const ROUGHNESS: f32 = 0.65;
const ALPHA: f32 = ROUGHNESS * ROUGHNESS;

/// Points of a surface, and the light there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lit<L> {
    /// Unit normal.
    pub(crate) normal: Vector<L>,
    /// Share of light that is reflected.
    pub(crate) albedo: Vector<L>,
    /// Unit direction to the eye.
    pub(crate) to_eye: Vector<L>,
    /// What arrives from the sun and from all around, on a white surface.
    pub(crate) sun: Vector<L>,
    pub(crate) around: Vector<L>,
    /// Share of the surroundings that is open.
    pub(crate) open: L,
}

impl<L: Lanes> Lit<L> {
    /// The light that goes to the eye.
    #[inline(always)]
    pub(crate) fn reflected(&self, sky: &Sky) -> Vector<L> {
        let Self { normal, to_eye, .. } = *self;
        let facing = normal.dot(to_eye);
        // Schlick's approximation, bounded for rough surfaces (Lagarde 2011): grazing light is
        // reflected by slopes that are not grazed.
        let grazing = facing.within(0.0, 1.0).rest();
        let range = (1.0 - ROUGHNESS).max(REFLECTANCE) - REFLECTANCE;
        let fresnel = grazing.fifth_power() * range + REFLECTANCE;
        let diffuse = self.albedo.times(self.sun + self.around) * fresnel.rest();
        let mirrored = normal * (facing * 2.0) - to_eye;
        let sheen = sky.irradiance_lanes(mirrored) * (fresnel * self.open);
        diffuse + sheen + self.sun * highlight(normal, to_eye, sky.sun())
    }
}

/// The GGX lobe for light from `to_light`, relative to a white diffuse
/// surface (Walter et al. 2007; visibility after Hammon 2017).
#[inline(always)]
fn highlight<L: Lanes>(normal: Vector<L>, to_eye: Vector<L>, to_light: Vec3) -> L {
    let to_light = Vector::splat(normal.x, to_light);
    let zero = normal.x.splat(0.0);
    // No direction between the two, no highlight.
    let half = (to_eye + to_light).normalize_or(-normal);
    let (n_h, n_l) = (normal.dot(half).max(zero), normal.dot(to_light).max(zero));
    let n_v = normal.dot(to_eye).max(zero.splat(1e-3));
    let spread = n_h * n_h * (ALPHA * ALPHA - 1.0) + 1.0;
    let lobe = zero.splat(ALPHA * ALPHA) / (spread * spread);
    let dimmed = n_l * ((1.0 - ALPHA) * 2.0) * n_v + (n_l + n_v) * ALPHA;
    let visibility = zero.splat(0.5) / dimmed.max(zero.splat(1e-6));
    let away = to_light.dot(half).max(zero).rest();
    let fresnel = away.fifth_power() * (1.0 - REFLECTANCE) + REFLECTANCE;
    lobe * visibility * fresnel
}
