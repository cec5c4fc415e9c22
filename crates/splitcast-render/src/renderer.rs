//! The renderer: a camera, a stage and options, ready to be given frames.

use std::borrow::Cow;
use std::ops::Range;

use glam::{Vec2, Vec3};
use splitcast::{Aabb, KdTree, Ray};
use splitcast_scene::{Frame, vertex_normals};

use crate::adaptive::{Estimate, first_samples, is_uneven};
use crate::ground::{self, Ground};
use crate::sampling::{PixelSamples, tent};
use crate::shade::{FILTER, Surroundings, Tracer};
use crate::sky::Sky;
use crate::stage::Stage;
use crate::surface::{CLAY, PLASTER, Surface, Surfaces};
use crate::tiles::render_tiles;
use crate::{Camera, Image, RenderError, RenderOptions, Shading, ToneCurve, View, debug_view};

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
                None => Cow::Owned(vertex_normals(&frame.positions, &frame.triangles)),
            }),
        };
        let options = &self.options;
        let surfaces = Surfaces {
            tree,
            normals: normals.as_deref(),
            colors: match options.view {
                View::SplitPlanes => None,
                _ => frame.colors.as_ref().map(|colors| colors.as_slice()),
            },
            material: match options.view {
                View::SplitPlanes => PLASTER,
                _ => CLAY,
            },
        };
        let &RenderOptions { width, height, .. } = options;
        let tracer = || Tracer::new(surfaces, &self.surroundings);
        let samples = options.effective_samples_per_pixel();
        let first_samples = first_samples(samples);
        let (first, mut tracers) = render_tiles(width, height, tracer, |tracer, x, y| {
            self.sample_pixel(tracer, Estimate::default(), [x, y], 0..first_samples)
        });
        let (pixels, rest) = render_tiles(width, height, tracer, |tracer, x, y| {
            let estimate = first[y as usize * width as usize + x as usize];
            let (estimate, taken) = if is_uneven(&first, width, x, y) {
                let rest = first_samples..samples;
                (self.sample_pixel(tracer, estimate, [x, y], rest), samples)
            } else {
                (estimate, first_samples)
            };
            (estimate.sum() / taken as f32).max(Vec3::ZERO).into()
        });
        tracers.extend(rest);
        let mut image = Image {
            width,
            height,
            pixels,
            tone_curve: self.tone_curve(),
        };
        debug_view::draw_legend(&mut image, tree, options);
        let rays = tracers.iter().map(|tracer| tracer.rays).sum();
        Ok((image, RenderStats { rays }))
    }

    /// How the picture is brought to a display.
    fn tone_curve(&self) -> ToneCurve {
        match self.options.view {
            View::Beauty | View::SplitPlanes => ToneCurve::Filmic,
            View::Steps | View::LeafDepth | View::Normals => ToneCurve::Exact,
        }
    }

    /// Adds the given samples of a pixel to its estimate.
    fn sample_pixel(
        &self,
        tracer: &mut Tracer<'_>,
        mut estimate: Estimate,
        [x, y]: [u32; 2],
        samples: Range<u32>,
    ) -> Estimate {
        let options = &self.options;
        let size = Vec2::new(options.width as f32, options.height as f32);
        let points = PixelSamples::new(x, y, options.effective_samples_per_pixel(), options.seed);
        let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let tree = tracer.tree();
        for sample in samples {
            let place = (middle + tent(points.point(sample, FILTER))) / size;
            let ray = self.camera.ray(place.into(), size.x / size.y);
            let color = match options.view {
                View::Beauty => self.light(tracer, &ray, &points, sample),
                View::SplitPlanes => self
                    .split_line(tracer, &ray, place)
                    .unwrap_or_else(|| self.light(tracer, &ray, &points, sample)),
                View::Steps => {
                    let (_, counts) = tracer.mesh_along(&ray);
                    debug_view::steps_color(counts.nodes + counts.blocks, options)
                }
                View::LeafDepth => self.data_color(tracer, &ray, |surface| {
                    let depth = debug_view::leaf_depth(tree, surface.position);
                    let color = debug_view::depth_color(depth, tree);
                    debug_view::shaded(color, surface, ray.direction.into())
                }),
                View::Normals => self.data_color(tracer, &ray, |surface| {
                    debug_view::normal_color(surface.normal)
                }),
            };
            estimate.add(color, self.tone_curve());
        }
        estimate
    }

    /// Light from the scene, as bright as the exposure makes it.
    fn light(
        &self,
        tracer: &mut Tracer<'_>,
        ray: &Ray,
        points: &PixelSamples,
        sample: u32,
    ) -> Vec3 {
        tracer.radiance(ray, points, sample) * self.options.exposure.exp2()
    }

    /// What `color` makes of the mesh along the ray, or the background.
    fn data_color(
        &self,
        tracer: &mut Tracer<'_>,
        ray: &Ray,
        color: impl Fn(&Surface) -> Vec3,
    ) -> Vec3 {
        let (surface, _) = tracer.mesh_along(ray);
        surface.map_or(debug_view::BACKGROUND, |surface| color(&surface))
    }

    /// The line that a split plane draws where the ray through `place` of the
    /// picture meets the mesh.
    fn split_line(&self, tracer: &mut Tracer<'_>, ray: &Ray, place: Vec2) -> Option<Vec3> {
        let options = &self.options;
        let surface = tracer.mesh_along(ray).0?;
        let eye = Vec3::from(ray.origin);
        let size = Vec2::new(options.width as f32, options.height as f32);
        let distance = (surface.position - eye).dot(surface.facet);
        // Where neighbouring pixels would see the plane of the triangle.
        let steps = [Vec2::X, Vec2::Y].map(|pixel| {
            let beside = self
                .camera
                .ray((place + pixel / size).into(), size.x / size.y);
            let direction = Vec3::from(beside.direction);
            eye + direction * (distance / direction.dot(surface.facet)) - surface.position
        });
        debug_view::split_line(
            tracer.tree(),
            surface.position,
            steps,
            options.split_levels,
            options.height,
        )
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
