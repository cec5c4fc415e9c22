//! Pictures of procedural meshes, compared with stored ones and with each other.
//!
//! A change that is meant to change pictures renews them with
//! `SPLITCAST_BLESS=1 cargo test --release -p splitcast-render --test pictures`;
//! look at every one before it is committed.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use splitcast::{Aabb, BuildOptions, KdTree, Mesh, NonFinite};
use splitcast_render::{
    Camera, Image, Perspective, Quality, RenderError, RenderOptions, RenderStats, Renderer,
    Shading, View, to_srgb8,
};
use splitcast_scene::Frame;

/// Size of the stored pictures: small, and no multiple of the tiles.
const WIDTH: u32 = 120;
const HEIGHT: u32 = 75;

/// Pictures may differ by this many levels of 255 on average: other platforms
/// round differently, which flips single samples.
const MEAN_TOLERANCE: f64 = 0.5;

/// A channel may differ by more than this many levels in no more than this
/// share of places.
const LEVELS: u8 = 24;
const SHARE_BEYOND: f64 = 0.005;

/// A torus with bumps that stands on its side, leaning on a second one.
fn tori() -> Frame {
    use std::f32::consts::TAU;
    let (around, across) = (80u32, 32u32);
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for body in 0..2u32 {
        let first = positions.len() as u32;
        for (i, j) in (0..around).flat_map(|i| (0..across).map(move |j| (i, j))) {
            let (turn, roll) = (
                TAU * i as f32 / around as f32,
                TAU * j as f32 / across as f32,
            );
            let thickness = 0.34 + 0.05 * (7.0 * turn).cos() * (2.0 * roll).sin();
            let ring = 1.0 + thickness * roll.cos();
            let (x, y, z) = (ring * turn.cos(), ring * turn.sin(), thickness * roll.sin());
            positions.push(if body == 0 {
                [x, 0.94 * y + 0.34 * z, 0.94 * z - 0.34 * y]
            } else {
                [x + 0.9, z - 1.05, y + 0.6]
            });
            let at = |i: u32, j: u32| first + (i % around) * across + j % across;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    Frame {
        positions,
        triangles: Arc::new(triangles),
        normals: None,
        colors: None,
    }
}

/// The same, with a colour that runs around each torus.
fn colored_tori() -> Frame {
    let frame = tori();
    let colors = (0..frame.positions.len())
        .map(|vertex| {
            let turn = (vertex / 32 % 80) as f32 / 80.0;
            let band = |shift: f32| {
                let distance = ((turn + shift).fract() - 0.5).abs();
                (60.0 + 380.0 * distance).min(250.0) as u8
            };
            [band(0.0), band(0.33), band(0.67)]
        })
        .collect();
    Frame {
        colors: Some(Arc::new(colors)),
        ..frame
    }
}

fn options() -> RenderOptions {
    RenderOptions {
        width: WIDTH,
        height: HEIGHT,
        ..RenderOptions::default()
    }
}

/// The picture by the default camera.
fn picture(frame: &Frame, options: &RenderOptions) -> Image {
    render(frame, options).0
}

/// The picture by the default camera, and what it took.
fn render(frame: &Frame, options: &RenderOptions) -> (Image, RenderStats) {
    let build = BuildOptions {
        non_finite: NonFinite::Skip,
        ..BuildOptions::default()
    };
    let mesh = Mesh::new(&frame.positions, &frame.triangles).unwrap();
    let tree = KdTree::build(mesh, &build).unwrap();
    let bounds = tree.bounds();
    let aspect = options.width as f32 / options.height as f32;
    let view = Perspective::framing(&frame.positions, options.up, aspect, 24.0).unwrap();
    let camera = Camera::new(&view).unwrap();
    let renderer = Renderer::new(camera, &bounds, options.clone()).unwrap();
    let (image, stats) = renderer.render(&tree, frame).unwrap();
    let pixels = u64::from(options.width) * u64::from(options.height);
    assert!(stats.rays >= pixels, "{stats:?}");
    (image, stats)
}

fn reference_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/references")
        .join(format!("{name}.png"))
}

fn write_png(path: &Path, image: &Image) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, image.width, image.height);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&to_srgb8(image)).unwrap();
}

fn read_png(path: &Path) -> Vec<u8> {
    let file = std::fs::File::open(path).unwrap_or_else(|error| {
        panic!(
            "{}: {error}; make it with SPLITCAST_BLESS=1",
            path.display()
        )
    });
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.width, info.height), (WIDTH, HEIGHT));
    bytes
}

/// Mean difference in levels, and share of channels that differ by far.
fn difference(a: &[u8], b: &[u8]) -> (f64, f64) {
    assert_eq!(a.len(), b.len());
    let levels = || a.iter().zip(b).map(|(a, b)| a.abs_diff(*b));
    let sum: u64 = levels().map(u64::from).sum();
    let far = levels().filter(|&level| level > LEVELS).count();
    (sum as f64 / a.len() as f64, far as f64 / a.len() as f64)
}

fn compare_with_reference(name: &str, image: &Image) {
    let path = reference_path(name);
    if std::env::var_os("SPLITCAST_BLESS").is_some() {
        write_png(&path, image);
        return;
    }
    let (mean, far) = difference(&to_srgb8(image), &read_png(&path));
    if mean > MEAN_TOLERANCE || far > SHARE_BEYOND {
        let actual = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        write_png(&actual, image);
        panic!(
            "{name} differs from {} by {mean:.2} levels on average (up to {MEAN_TOLERANCE}) and by \
             more than {LEVELS} in {:.2} % of channels (up to {:.2} %): see {}",
            path.display(),
            100.0 * far,
            100.0 * SHARE_BEYOND,
            actual.display()
        );
    }
}

#[test]
fn smooth_clay_in_sun_and_sky_light() {
    compare_with_reference("smooth", &picture(&tori(), &options()));
}

#[test]
fn faceted_clay() {
    let options = RenderOptions {
        shading: Shading::Flat,
        ..options()
    };
    compare_with_reference("flat", &picture(&tori(), &options));
}

#[test]
fn vertex_colors_at_best_quality() {
    let options = RenderOptions {
        quality: Quality::Best,
        samples_per_pixel: Some(16),
        ..options()
    };
    compare_with_reference("colors", &picture(&colored_tori(), &options));
}

#[test]
fn a_draft_without_ground_under_another_sun() {
    let options = RenderOptions {
        quality: Quality::Draft,
        samples_per_pixel: Some(16),
        ground: false,
        sun: Some([1.0, 0.6, 0.2]),
        exposure: 0.5,
        ..options()
    };
    compare_with_reference("draft", &picture(&tori(), &options));
}

#[test]
fn a_preview_takes_two_rays_a_pixel_and_has_no_noise() {
    let options = RenderOptions {
        quality: Quality::Preview,
        ..options()
    };
    let (image, stats) = render(&tori(), &options);
    compare_with_reference("preview", &image);
    assert!(stats.rays <= u64::from(2 * WIDTH * HEIGHT), "{stats:?}");
    let other_noise = RenderOptions { seed: 7, ..options };
    assert!(picture(&tori(), &other_noise).pixels == image.pixels);
}

#[test]
fn normals_as_colors() {
    let options = RenderOptions {
        view: View::Normals,
        ..options()
    };
    compare_with_reference("normals", &picture(&tori(), &options));
}

/// Views of the tree have no stored pictures: better builders change them.
#[test]
fn views_of_the_tree_show_the_mesh_and_the_tree() {
    let of = |view| {
        let options = RenderOptions { view, ..options() };
        picture(&tori(), &options)
    };
    let colors = |image: &Image| {
        let mut bytes: Vec<_> = to_srgb8(image).chunks(3).map(<[u8]>::to_vec).collect();
        bytes.sort_unstable();
        bytes.dedup();
        bytes.len()
    };
    for view in [View::Steps, View::LeafDepth] {
        let image = of(view);
        assert_ne!(
            image.pixels[0],
            image.pixels[(3 * HEIGHT / 4 * WIDTH + WIDTH / 3) as usize]
        );
        assert!(colors(&image) > 20, "{view}");
    }
    let strongly_colored = |image: &Image| {
        let spread = |p: &[u8]| p.iter().max().unwrap() - p.iter().min().unwrap();
        to_srgb8(image)
            .chunks(3)
            .filter(|p| spread(p) > 100)
            .count()
    };
    assert!(strongly_colored(&of(View::SplitPlanes)) > 20);
}

#[test]
fn the_picture_does_not_depend_on_threads() {
    let frame = colored_tori();
    for view in [View::Beauty, View::SplitPlanes] {
        let options = RenderOptions { view, ..options() };
        let with_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(|| picture(&frame, &options))
        };
        let one = with_threads(1);
        for threads in [2, 5] {
            let bits = |image: &Image| -> Vec<[u32; 3]> {
                image
                    .pixels
                    .iter()
                    .map(|pixel| pixel.map(f32::to_bits))
                    .collect()
            };
            assert_eq!(
                bits(&one),
                bits(&with_threads(threads)),
                "{view}, {threads} threads"
            );
        }
    }
}

#[test]
fn size_and_place_of_the_mesh_do_not_change_the_picture() {
    let frame = tori();
    let base = to_srgb8(&picture(&frame, &options()));
    for (scale, shift) in [(1e-5, 0.0), (1e5, 0.0), (1.0, 100.0)] {
        let moved = Frame {
            positions: frame
                .positions
                .iter()
                .map(|p| p.map(|x| x * scale + shift))
                .collect(),
            ..frame.clone()
        };
        let (mean, far) = difference(&base, &to_srgb8(&picture(&moved, &options())));
        assert!(
            mean < 1.0 && far < 0.01,
            "x {scale} + {shift}: {mean}, {far}"
        );
    }
}

#[test]
fn quality_changes_the_noise_but_not_the_brightness() {
    let mean_of = |quality| {
        let options = RenderOptions {
            quality,
            ..options()
        };
        let bytes = to_srgb8(&picture(&tori(), &options));
        bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / bytes.len() as f64
    };
    let best = mean_of(Quality::Best);
    for quality in [Quality::Draft, Quality::Good] {
        assert!((mean_of(quality) - best).abs() < 2.0, "{quality}");
    }
}

#[test]
fn odd_frames_still_give_whole_pictures() {
    let triangle = Frame {
        positions: vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [f32::NAN, 0.0, 1.0],
        ],
        triangles: Arc::new(vec![[0, 1, 2], [0, 1, 3], [0, 0, 0]]),
        normals: None,
        colors: None,
    };
    let nothing = Frame::default();
    let wild_normals = Frame {
        normals: Some(vec![[f32::NAN; 3], [0.0; 3], [1e30, 0.0, 0.0], [0.0; 3]]),
        ..triangle.clone()
    };
    for frame in [triangle, nothing, wild_normals] {
        let qualities = [Quality::default(), Quality::Preview];
        let all = View::ALL
            .iter()
            .flat_map(|view| qualities.map(|quality| (*view, quality)));
        for (view, quality) in all {
            let options = RenderOptions {
                view,
                quality,
                width: 24,
                height: 17,
                ..options()
            };
            let image = picture(&frame, &options);
            assert_eq!(image.pixels.len(), 24 * 17);
            assert!(
                image
                    .pixels
                    .iter()
                    .flatten()
                    .all(|x| x.is_finite() && *x >= 0.0),
                "{view}, {quality}"
            );
        }
    }
}

#[test]
fn frames_that_do_not_fit_are_refused() {
    let frame = tori();
    let mesh = Mesh::new(&frame.positions, &frame.triangles).unwrap();
    let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
    let view = Perspective::framing(&frame.positions, [0.0, 1.0, 0.0], 1.0, 24.0).unwrap();
    let renderer = Renderer::new(Camera::new(&view).unwrap(), &tree.bounds(), options()).unwrap();
    assert!(matches!(
        renderer.render(&tree, &Frame::default()),
        Err(RenderError::FrameMismatch { .. })
    ));
    let short = Frame {
        colors: Some(Arc::new(vec![[0; 3]; 5])),
        ..frame.clone()
    };
    let error = renderer.render(&tree, &short).unwrap_err().to_string();
    assert_eq!(
        error,
        "the frame has 5 colors for 5120 vertices, expected one a vertex"
    );
}

#[test]
fn a_sun_below_the_horizon_is_refused() {
    let view = Perspective::framing(&[], [0.0, 1.0, 0.0], 1.0, 24.0).unwrap();
    let options = RenderOptions {
        sun: Some([1.0, -0.5, 0.0]),
        ..options()
    };
    let error = Renderer::new(Camera::new(&view).unwrap(), &Aabb::EMPTY, options).unwrap_err();
    assert!(matches!(error, RenderError::OutOfRange { .. }), "{error}");
}
