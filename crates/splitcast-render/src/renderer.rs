//! The renderer: a camera, a stage and options, ready to be given frames.

use std::borrow::Cow;

use glam::{Vec2, Vec3};
use splitcast::{Aabb, KdTree};
use splitcast_scene::Frame;

use crate::ground::{self, Ground};
use crate::sampling::{PixelSamples, tent};
use crate::shade::{FILTER, Surroundings, Tracer};
use crate::sky::Sky;
use crate::smooth_normals::smooth_normals;
use crate::stage::Stage;
use crate::surface::Surfaces;
use crate::tiles::render_tiles;
use crate::{Camera, Image, RenderError, RenderOptions, Shading, ToneCurve};

/// Sine of the lowest sun that still gives light on the ground.
const LOWEST_SUN: f32 = 0.02;

/// What a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderStats {
    /// Rays traced through the tree: from the camera, to the sun, and into
    /// the surroundings.
    pub rays: u64,
}

/// Renders frames of one motion with one camera.
#[derive(Clone, Debug)]
pub struct Renderer {
    camera: Camera,
    options: RenderOptions,
    surroundings: Surroundings,
}

impl Renderer {
    /// A renderer for a motion within `bounds`, the box around all of its
    /// frames: it decides where the ground lies and how far it reaches.
    ///
    /// # Errors
    /// [`RenderError`] names the first option that is out of bounds.
    pub fn new(camera: Camera, bounds: &Aabb, options: RenderOptions) -> Result<Self, RenderError> {
        options.validate()?;
        let stage = Stage::new(bounds, options.up);
        let up = stage.up().as_vec3();
        let sun = match options.sun {
            Some(sun) => Vec3::from(sun).as_dvec3().normalize(),
            None => stage.default_sun(),
        }
        .as_vec3();
        if sun.dot(up) < LOWEST_SUN {
            return Err(RenderError::OutOfRange {
                field: "sun's height over the horizon (its direction along up)",
                value: sun.dot(up),
                expected: "0.02 to 1",
            });
        }
        let surroundings = Surroundings {
            sky: Sky::new(up, sun, options.ground.then_some(ground::ALBEDO)),
            ground: options.ground.then(|| Ground::new(&stage)),
            bounces: options.quality.bounces(),
        };
        Ok(Self {
            camera,
            options,
            surroundings,
        })
    }

    /// The options the renderer was made with.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// Renders `frame`, over whose positions and triangles `tree` was built,
    /// on the current rayon thread pool. The picture is the same on any
    /// number of threads.
    ///
    /// # Errors
    /// [`RenderError`] if the tree belongs to another mesh, or if an attribute
    /// of the frame has not one value per vertex.
    pub fn render(
        &self,
        tree: &KdTree<'_>,
        frame: &Frame,
    ) -> Result<(Image, RenderStats), RenderError> {
        check_frame(tree, frame)?;
        let normals = match self.options.shading {
            Shading::Flat => None,
            Shading::Smooth => Some(match &frame.normals {
                Some(normals) => Cow::Borrowed(normals.as_slice()),
                None => Cow::Owned(smooth_normals(&frame.positions, &frame.triangles)),
            }),
        };
        let surfaces = Surfaces {
            tree,
            normals: normals.as_deref(),
            colors: frame.colors.as_ref().map(|colors| colors.as_slice()),
        };
        let &RenderOptions { width, height, .. } = &self.options;
        let (pixels, tracers) = render_tiles(
            width,
            height,
            || Tracer::new(surfaces, &self.surroundings),
            |tracer, x, y| self.pixel(tracer, x, y),
        );
        let image = Image {
            width,
            height,
            pixels,
            tone_curve: ToneCurve::Filmic,
        };
        let rays = tracers.iter().map(|tracer| tracer.rays).sum();
        Ok((image, RenderStats { rays }))
    }

    fn pixel(&self, tracer: &mut Tracer<'_>, x: u32, y: u32) -> [f32; 3] {
        let options = &self.options;
        let size = Vec2::new(options.width as f32, options.height as f32);
        let samples = options.effective_samples_per_pixel();
        let points = PixelSamples::new(x, y, samples, options.seed);
        let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let sum: Vec3 = (0..samples)
            .map(|sample| {
                let place = (middle + tent(points.point(sample, FILTER))) / size;
                let ray = self.camera.ray(place.into(), size.x / size.y);
                tracer.radiance(&ray, &points, sample)
            })
            .sum();
        let mean = sum / samples as f32 * options.exposure.exp2();
        mean.max(Vec3::ZERO).into()
    }
}

fn check_frame(tree: &KdTree<'_>, frame: &Frame) -> Result<(), RenderError> {
    let mesh = tree.mesh();
    let positions = frame.positions.len();
    if mesh.positions().len() != positions || mesh.triangles().len() != frame.triangles.len() {
        return Err(RenderError::FrameMismatch {
            tree_positions: mesh.positions().len(),
            tree_triangles: mesh.triangles().len(),
            frame_positions: positions,
            frame_triangles: frame.triangles.len(),
        });
    }
    let lengths = [
        ("normals", frame.normals.as_ref().map(Vec::len)),
        ("colors", frame.colors.as_ref().map(|colors| colors.len())),
    ];
    for (attribute, length) in lengths {
        if let Some(values) = length
            && values != positions
        {
            return Err(RenderError::AttributeLength {
                attribute,
                values,
                positions,
            });
        }
    }
    Ok(())
}
