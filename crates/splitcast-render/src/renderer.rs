//! The renderer: a camera, a stage and options, ready to be given frames.

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;
use std::sync::OnceLock;

use glam::{Vec2, Vec3};
use splitcast::{Aabb, KdTree, Ray};
use splitcast_scene::{Frame, vertex_normals};

use crate::adaptive::{Estimate, first_samples, is_uneven};
use crate::ground::{self, Ground};
use crate::preview::{Pixel, Preview};
use crate::sampling::{PixelSamples, tent};
use crate::shade::{FILTER, Sample, Surroundings, Tracer};
use crate::sky::Sky;
use crate::stage::Stage;
use crate::surface::{CLAY, PLASTER, Surface, Surfaces};
use crate::tiles::render_tiles;
use crate::{
    Camera, Image, Quality, RenderError, RenderOptions, Shading, ToneCurve, View, debug_view,
    to_srgb8,
};

/// Sine of the lowest sun that still gives light on the ground.
const LOWEST_SUN: f32 = 0.02;

/// Samples that are taken together: the paths of as many fit into a core's cache.
const BATCH: usize = 1024;

/// What a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderStats {
    /// Rays traced: from the camera, to the sun, and into the surroundings.
    /// Those that pass by the whole tree count as well; where ground surely is in the sun's light, a
    /// preview sends none there.
    pub rays: u64,
}

/// Renders frames of one motion with one camera.
#[derive(Clone, Debug)]
pub struct Renderer {
    camera: Camera,
    options: RenderOptions,
    surroundings: Surroundings,
    backdrops: Backdrops,
}

/// Previews without the mesh, made when they are first asked for.
#[derive(Clone, Default)]
struct Backdrops {
    light: OnceLock<Vec<[f32; 3]>>,
    bytes: OnceLock<Vec<[u8; 3]>>,
}

impl fmt::Debug for Backdrops {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Backdrops").finish_non_exhaustive()
    }
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
            detail: options.quality.detail(),
        };
        Ok(Self {
            camera,
            options,
            surroundings,
            backdrops: Backdrops::default(),
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
        let draw = |surfaces: Surfaces<'_>| match self.preview() {
            Some(preview) => preview_on(&self.backdrops.light, &preview, &surfaces),
            None => self.pixels(surfaces),
        };
        let (pixels, rays) = self.with_surfaces(tree, frame, draw)?;
        let mut image = Image {
            width: self.options.width,
            height: self.options.height,
            pixels,
            tone_curve: self.tone_curve(),
        };
        debug_view::draw_legend(&mut image, tree, &self.options);
        Ok((image, RenderStats { rays }))
    }

    /// [`Renderer::render`] and [`to_srgb8`], in less time than both if the options ask for a plain preview.
    ///
    /// # Errors
    /// As for [`Renderer::render`].
    pub fn render_srgb8(
        &self,
        tree: &KdTree<'_>,
        frame: &Frame,
    ) -> Result<(Vec<u8>, RenderStats), RenderError> {
        let Some(preview) = self.preview() else {
            let (image, stats) = self.render(tree, frame)?;
            return Ok((to_srgb8(&image), stats));
        };
        let (bytes, rays) = self.with_surfaces(tree, frame, |surfaces| {
            preview_on(&self.backdrops.bytes, &preview, &surfaces)
        })?;
        Ok((bytes.into_flattened(), RenderStats { rays }))
    }

    /// What makes the picture if it is a preview with a sample in the middle of each pixel.
    fn preview(&self) -> Option<Preview<'_>> {
        let options = &self.options;
        let is_plain = options.quality == Quality::Preview
            && options.view == View::Beauty
            && options.effective_samples_per_pixel() == 1;
        is_plain.then(|| Preview {
            camera: &self.camera,
            surroundings: &self.surroundings,
            width: options.width,
            height: options.height,
            brightness: options.exposure.exp2(),
        })
    }

    /// What `use_them` makes of the frame's surfaces.
    fn with_surfaces<T>(
        &self,
        tree: &KdTree<'_>,
        frame: &Frame,
        use_them: impl FnOnce(Surfaces<'_>) -> T,
    ) -> Result<T, RenderError> {
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
        Ok(use_them(surfaces))
    }

    /// The picture's pixels, row by row, and the number of rays that took.
    fn pixels(&self, surfaces: Surfaces<'_>) -> (Vec<[f32; 3]>, u64) {
        let &RenderOptions { width, height, .. } = &self.options;
        let tone_curve = self.tone_curve();
        let samples = self.options.effective_samples_per_pixel();
        let first_samples = first_samples(samples);
        let mean = |sum: Vec3, taken: u32| (sum / taken as f32).max(Vec3::ZERO).into();
        if first_samples == samples {
            return render_tiles(width, height, |places, pixels| {
                let mut sums = vec![Vec3::ZERO; places.len()];
                let rays = self.take_samples(surfaces, places, 0..samples, |pixel, color| {
                    sums[pixel] += color;
                });
                for (pixel, sum) in pixels.iter_mut().zip(sums) {
                    *pixel = mean(sum, samples);
                }
                rays
            });
        }
        let (first, first_rays) =
            render_tiles(width, height, |places, estimates: &mut [Estimate]| {
                self.take_samples(surfaces, places, 0..first_samples, |pixel, color| {
                    estimates[pixel].add(color, tone_curve);
                })
            });
        let (pixels, rest_rays) = render_tiles(width, height, |places, pixels| {
            let estimate = |[x, y]: [u32; 2]| first[y as usize * width as usize + x as usize];
            let (mut uneven, mut of_pixel, mut sums) = (Vec::new(), Vec::new(), Vec::new());
            for (pixel, &[x, y]) in places.iter().enumerate() {
                let sum = estimate([x, y]).sum();
                if is_uneven(&first, width, x, y) {
                    uneven.push([x, y]);
                    of_pixel.push(pixel);
                    sums.push(sum);
                } else {
                    pixels[pixel] = mean(sum, first_samples);
                }
            }
            let rest = first_samples..samples;
            let rays = self.take_samples(surfaces, &uneven, rest, |pixel, color| {
                sums[pixel] += color;
            });
            for (pixel, sum) in of_pixel.into_iter().zip(sums) {
                pixels[pixel] = mean(sum, samples);
            }
            rays
        });
        (pixels, first_rays + rest_rays)
    }

    /// How the picture is brought to a display.
    fn tone_curve(&self) -> ToneCurve {
        match self.options.view {
            View::Beauty | View::SplitPlanes => ToneCurve::Filmic,
            View::Steps | View::LeafDepth | View::Normals => ToneCurve::Exact,
        }
    }

    /// Takes the given samples of the pixels at `places`, and gives each to
    /// `add` with the number of its pixel, those of a pixel in their order.
    /// Returns the number of rays.
    fn take_samples(
        &self,
        surfaces: Surfaces<'_>,
        places: &[[u32; 2]],
        numbers: Range<u32>,
        mut add: impl FnMut(usize, Vec3),
    ) -> u64 {
        let options = &self.options;
        let size = Vec2::new(options.width as f32, options.height as f32);
        let all = options.effective_samples_per_pixel();
        let middles = options.quality == Quality::Preview && all == 1;
        let mut tracer = Tracer::new(surfaces, &self.surroundings);
        let mut take = |batch: &mut Batch<'_>| {
            let colors = self.colors(&mut tracer, batch);
            for (&pixel, color) in batch.pixels.iter().zip(colors) {
                add(pixel, color);
            }
            batch.clear();
        };
        let mut batch = Batch::with_capacity(BATCH.min(places.len() * numbers.len()));
        let points: Vec<PixelSamples> = (places.iter())
            .map(|&[x, y]| PixelSamples::new(x, y, all, options.seed))
            .collect();
        // Samples of a pixel follow each other: their rays are the most alike.
        for (pixel, (&[x, y], points)) in places.iter().zip(&points).enumerate() {
            let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            for number in numbers.clone() {
                let sample = Sample { points, number };
                let offset = if middles {
                    Vec2::ZERO
                } else {
                    tent(sample.point(FILTER))
                };
                let place = (middle + offset) / size;
                batch.pixels.push(pixel);
                batch.samples.push(sample);
                batch.places.push(place);
                batch
                    .rays
                    .push(self.camera.ray(place.into(), size.x / size.y));
                if batch.pixels.len() == BATCH {
                    take(&mut batch);
                }
            }
        }
        take(&mut batch);
        tracer.rays
    }

    /// The colors of samples.
    fn colors(&self, tracer: &mut Tracer<'_>, batch: &Batch<'_>) -> Vec<Vec3> {
        let options = &self.options;
        let Batch { samples, rays, .. } = batch;
        let tree = tracer.tree();
        match options.view {
            View::Beauty => self.light(tracer, rays, samples),
            View::SplitPlanes => {
                let surfaces = tracer.mesh_along(rays);
                let lines = surfaces.iter().zip(rays).zip(&batch.places);
                let lines: Vec<_> = lines
                    .map(|((surface, ray), &place)| {
                        self.split_line(tree, surface.as_ref()?, ray, place)
                    })
                    .collect();
                let beside = |index: &usize| lines[*index].is_none();
                let (rays, samples): (Vec<_>, Vec<_>) = (0..rays.len())
                    .filter(beside)
                    .map(|index| (rays[index], samples[index]))
                    .unzip();
                let mut light = self.light(tracer, &rays, &samples).into_iter();
                (lines.iter())
                    .filter_map(|line| line.or_else(|| light.next()))
                    .collect()
            }
            View::Steps => {
                let steps = tracer.steps_along(rays).into_iter();
                steps
                    .map(|steps| debug_view::steps_color(steps, options))
                    .collect()
            }
            View::LeafDepth => data_colors(tracer, rays, |surface, direction| {
                let depth = debug_view::leaf_depth(tree, surface.position);
                let color = debug_view::depth_color(depth, tree);
                debug_view::shaded(color, surface, direction)
            }),
            View::Normals => data_colors(tracer, rays, |surface, _| {
                debug_view::normal_color(surface.normal)
            }),
        }
    }

    /// Light from the scene, as bright as the exposure makes it.
    fn light(&self, tracer: &mut Tracer<'_>, rays: &[Ray], samples: &[Sample<'_>]) -> Vec<Vec3> {
        let brightness = self.options.exposure.exp2();
        let mut light = tracer.radiance(rays, samples);
        for light in &mut light {
            *light *= brightness;
        }
        light
    }

    /// The line that a split plane draws on the mesh where the ray through
    /// `place` of the picture meets it.
    fn split_line(
        &self,
        tree: &KdTree<'_>,
        surface: &Surface,
        ray: &Ray,
        place: Vec2,
    ) -> Option<Vec3> {
        let options = &self.options;
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
            tree,
            surface.position,
            steps,
            options.split_levels,
            options.height,
        )
    }
}

/// Samples that are taken together.
struct Batch<'p> {
    /// The number of each sample's pixel among those that are sampled.
    pixels: Vec<usize>,
    samples: Vec<Sample<'p>>,
    /// Where in the picture they lie.
    places: Vec<Vec2>,
    /// The camera's rays through these places.
    rays: Vec<Ray>,
}

impl Batch<'_> {
    fn with_capacity(samples: usize) -> Self {
        Self {
            pixels: Vec::with_capacity(samples),
            samples: Vec::with_capacity(samples),
            places: Vec::with_capacity(samples),
            rays: Vec::with_capacity(samples),
        }
    }

    fn clear(&mut self) {
        self.pixels.clear();
        self.samples.clear();
        self.places.clear();
        self.rays.clear();
    }
}

/// What `color` makes of the mesh along each ray and of the ray's direction, or the background.
fn data_colors(
    tracer: &mut Tracer<'_>,
    rays: &[Ray],
    color: impl Fn(&Surface, Vec3) -> Vec3,
) -> Vec<Vec3> {
    let surfaces = tracer.mesh_along(rays).into_iter().zip(rays);
    let color = |(surface, ray): (Option<Surface>, &Ray)| {
        surface.map_or(debug_view::BACKGROUND, |surface| {
            color(&surface, ray.direction.into())
        })
    };
    surfaces.map(color).collect()
}

/// A preview over its backdrop, and the number of rays that took.
fn preview_on<P: Pixel>(
    backdrop: &OnceLock<Vec<P>>,
    preview: &Preview<'_>,
    surfaces: &Surfaces<'_>,
) -> (Vec<P>, u64) {
    // Who finds no backdrop makes one. Waiting for another thread's could block the pool, whose
    // threads may take up one task while they wait for another.
    if backdrop.get().is_none() {
        let _ = backdrop.set(preview.backdrop());
    }
    preview.picture(backdrop.get().expect("just made"), surfaces)
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;
    use splitcast::{BuildOptions, Mesh, SimdLevel, force_simd};

    use super::*;
    use crate::Perspective;

    /// A picture's pixels as they come out of [`Preview`] and without it, bit by bit, on every instruction set.
    fn check_preview(frame: &Frame, view: &Perspective, options: RenderOptions) {
        let options = RenderOptions {
            quality: Quality::Preview,
            ..options
        };
        let mesh = Mesh::new(&frame.positions, &frame.triangles).unwrap();
        let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
        let camera = Camera::new(view).unwrap();
        let mut renderer = Renderer::new(camera, &tree.bounds(), options).unwrap();
        let (expected, _) =
            (renderer.with_surfaces(&tree, frame, |surfaces| renderer.pixels(surfaces))).unwrap();
        for &level in SimdLevel::ALL.iter().filter(|level| level.is_available()) {
            force_simd(Some(level)).unwrap();
            renderer.backdrops = Backdrops::default();
            let (image, _) = renderer.render(&tree, frame).unwrap();
            let (bytes, _) = renderer.render_srgb8(&tree, frame).unwrap();
            for (index, (pixel, expected)) in image.pixels.iter().zip(&expected).enumerate() {
                let (x, y) = (index as u32 % image.width, index as u32 / image.width);
                let same = pixel.map(f32::to_bits) == expected.map(f32::to_bits);
                assert!(same, "{level}, ({x}, {y}): {pixel:?}, not {expected:?}");
            }
            assert!(bytes == to_srgb8(&image), "{level}");
        }
        force_simd(None).unwrap();
    }

    fn point(reach: f32) -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3(prop_oneof![4 => -reach..reach, 1 => Just(0.5), 1 => Just(-0.5)])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn previews_show_what_single_rays_find(
            corners in prop::collection::vec(point(1.0), 3..40),
            colors in prop::bool::ANY,
            shading in prop::sample::select(Shading::ALL),
            // Near enough to have triangles behind the camera, and far enough to see the horizon.
            eye in prop_oneof![point(1.5), point(20.0)],
            look_at in point(0.3),
            vertical_fov_degrees in prop_oneof![Just(24.0f32), 5.0f32..150.0],
            sun in prop_oneof![Just(None), ([-1.0f32..1.0, 0.05f32..1.0, -1.0f32..1.0]).prop_map(Some)],
            (ground, exposure) in (prop::bool::weighted(0.8), -1.0f32..1.0),
            (width, height) in (1u32..70, 1u32..40),
            (scale, shift) in prop_oneof![
                Just((1.0f32, 0.0f32)), Just((1e-4, 0.0)), Just((1e4, 0.0)), Just((1.0, 1e3))
            ],
        ) {
            let moved = |p: [f32; 3]| p.map(|x| x * scale + shift);
            let count = corners.len() as u32;
            let frame = Frame {
                positions: corners.into_iter().map(moved).collect(),
                triangles: Arc::new((2..count).map(|i| [i - 2, i - 1, i]).collect()),
                normals: None,
                colors: colors.then(|| {
                    Arc::new((0..count).map(|i| [50 + 5 * i as u8, 200, 3 * i as u8]).collect())
                }),
            };
            let view = Perspective {
                eye: moved(eye),
                look_at: moved(look_at),
                up: [0.0, 1.0, 0.0],
                vertical_fov_degrees,
            };
            // A view along up has no picture.
            prop_assume!(Camera::new(&view).is_ok());
            let options = RenderOptions {
                width,
                height,
                shading,
                sun,
                ground,
                exposure,
                ..RenderOptions::default()
            };
            check_preview(&frame, &view, options);
        }
    }

    #[test]
    fn a_preview_of_nothing_is_its_backdrop() {
        let view = Perspective::framing(&[], [0.0, 1.0, 0.0], 1.5, 24.0).unwrap();
        let options = RenderOptions {
            width: 30,
            height: 20,
            ..RenderOptions::default()
        };
        check_preview(&Frame::default(), &view, options);
    }
}
