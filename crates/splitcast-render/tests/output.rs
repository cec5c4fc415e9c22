//! Outputs through the public interface: whole, resumable, the same bytes.

use std::fs;
use std::path::Path;

use splitcast_render::{
    FrameSink, Image, OutputError, OutputOptions, OutputSpec, OutputThread, Settings, ToneCurve,
};

const WIDTH: u32 = 32;
const HEIGHT: u32 = 18;
const FRAMES: usize = 5;

fn picture(index: usize) -> Image {
    let pixel = |i: u32| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let inside = (x as i32 - 4 * index as i32).abs() < 4 && (5..12).contains(&y);
        if inside {
            [0.9, 0.3, 0.05]
        } else {
            [0.02 * y as f32, 0.1, 0.3]
        }
    };
    Image {
        width: WIDTH,
        height: HEIGHT,
        pixels: (0..WIDTH * HEIGHT).map(pixel).collect(),
        tone_curve: ToneCurve::Exact,
    }
}

fn options() -> OutputOptions {
    OutputOptions {
        width: WIDTH,
        height: HEIGHT,
        frames_per_second: 25.0,
        frames: 0..FRAMES,
        threads: 1,
        resume: false,
        settings: Settings::new().with("input", "bar").with("spp", 1),
    }
}

fn open(path: &Path, options: OutputOptions) -> Box<dyn FrameSink> {
    OutputSpec::parse(path).unwrap().open(options).unwrap()
}

fn run(path: &Path, options: OutputOptions) -> usize {
    let frames = options.frames.clone();
    let mut sink = open(path, options);
    let mut written = 0;
    for index in frames {
        if !sink.is_done(index) {
            sink.write(index, &picture(index)).unwrap();
            written += 1;
        }
    }
    sink.finish().unwrap();
    written
}

/// Every file of a folder with its bytes, by name.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            let bytes = if path.is_dir() {
                Vec::new()
            } else {
                fs::read(&path).unwrap()
            };
            (name, bytes)
        })
        .collect();
    files.sort();
    files
}

const TARGETS: [&str; 4] = ["film.mp4", "film.apng", "frame_%02d.png", "frame_%02d.exr"];

#[test]
fn threads_do_not_change_the_bytes() {
    for target in TARGETS {
        let folders = [1, 2, 3].map(|threads| {
            let folder = tempfile::tempdir().unwrap();
            run(
                &folder.path().join(target),
                OutputOptions {
                    threads,
                    ..options()
                },
            );
            folder
        });
        let files = contents(folders[0].path());
        let expected = if target.contains('%') { FRAMES } else { 1 };
        assert_eq!(
            files.len(),
            expected,
            "{target}: nothing but the result stays"
        );
        for folder in &folders[1..] {
            assert_eq!(files, contents(folder.path()), "{target}");
        }
    }
}

#[test]
fn a_resumed_run_gives_the_same_bytes() {
    for target in TARGETS {
        let (whole, parts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        run(&whole.path().join(target), options());
        let path = parts.path().join(target);
        let mut sink = open(&path, options());
        sink.write(0, &picture(0)).unwrap();
        sink.write(1, &picture(1)).unwrap();
        drop(sink);
        assert!(
            !parts.path().join("film.mp4").exists() && !parts.path().join("film.apng").exists()
        );
        let resume = OutputOptions {
            resume: true,
            ..options()
        };
        assert_eq!(run(&path, resume), FRAMES - 2, "{target}");
        assert_eq!(contents(whole.path()), contents(parts.path()), "{target}");
    }
}

#[test]
fn resuming_takes_nothing_broken_or_foreign() {
    for target in TARGETS {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(target);
        let mut sink = open(&path, options());
        for index in 0..3 {
            sink.write(index, &picture(index)).unwrap();
        }
        drop(sink);
        let frames = if target.contains('%') {
            folder.path().to_owned()
        } else {
            folder.path().join(format!("{target}.partial"))
        };
        assert!(
            !frames.join("video").exists(),
            "a draft is of no use to a later run"
        );
        let first = fs::read_dir(&frames)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let first = first
            .filter(|path| path.file_name().unwrap() != "video")
            .min()
            .unwrap();
        let bytes = fs::read(&first).unwrap();
        fs::write(&first, &bytes[..bytes.len() / 2]).unwrap();

        let resume = OutputOptions {
            resume: true,
            ..options()
        };
        let found = open(&path, resume.clone()).resumed().clone();
        assert_eq!((found.whole, found.stale), (vec![1, 2], 1), "{target}");
        assert!(found.difference.unwrap().contains("whole"));

        let settings = Settings::new().with("input", "bar").with("spp", 2);
        let found = open(
            &path,
            OutputOptions {
                settings,
                ..resume.clone()
            },
        )
        .resumed()
        .clone();
        assert_eq!((found.whole.len(), found.stale), (0, 3), "{target}");

        let wider = OutputOptions {
            width: WIDTH + 2,
            ..resume.clone()
        };
        let found = open(&path, wider).resumed().clone();
        assert_eq!((found.whole.len(), found.stale), (0, 3), "{target}");
        assert_eq!(
            run(&path, resume),
            FRAMES - 2,
            "{target}: one was broken, two never written"
        );
    }
}

#[test]
fn an_abandoned_video_leaves_the_old_one() {
    for target in ["film.mp4", "film.apng"] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(target);
        fs::write(&path, b"earlier").unwrap();
        let mut thread = OutputThread::new(open(&path, options()));
        thread.write(0, picture(0)).unwrap();
        drop(thread);
        assert_eq!(fs::read(&path).unwrap(), b"earlier");
        assert!(
            folder
                .path()
                .join(format!("{target}.partial/frame_000000.png"))
                .exists()
        );
        run(&path, options());
        assert_ne!(fs::read(&path).unwrap(), b"earlier");
        assert_eq!(contents(folder.path()).len(), 1);
    }
}

#[test]
fn errors_reach_the_caller_of_a_thread() {
    let folder = tempfile::tempdir().unwrap();
    let mut thread = OutputThread::new(open(&folder.path().join("film.apng"), options()));
    thread.write(3, picture(3)).unwrap();
    let first = (0..9).find_map(|_| thread.write(0, picture(0)).err());
    let error = first.or_else(|| thread.finish().err()).unwrap();
    assert!(matches!(error, OutputError::Misuse { .. }), "{error}");
}

#[test]
fn a_thread_tells_what_each_frame_took() {
    let folder = tempfile::tempdir().unwrap();
    // Pictures that keep their light need no tone mapping.
    for (name, tone_mapped) in [
        ("film.apng", true),
        ("f_%02d.png", true),
        ("f_%02d.exr", false),
    ] {
        let mut thread = OutputThread::new(open(&folder.path().join(name), options()));
        for index in 0..FRAMES {
            thread.write(index, picture(index)).unwrap();
        }
        let times = thread.finish().unwrap();
        assert_eq!(times.len(), FRAMES, "{name}");
        for time in times {
            assert!(!time.write.is_zero(), "{name}: {time:?}");
            assert_eq!(!time.tone_map.is_zero(), tone_mapped, "{name}: {time:?}");
        }
    }
}

#[test]
fn an_apng_decodes_to_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.apng");
    run(&path, options());
    let file = std::io::BufReader::new(fs::File::open(&path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    assert_eq!(
        reader.info().animation_control.unwrap().num_frames,
        FRAMES as u32
    );
    let mut canvas = vec![0; (3 * WIDTH * HEIGHT) as usize];
    for index in 0..FRAMES {
        let mut patch = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut patch).unwrap();
        let control = reader.info().frame_control.unwrap();
        assert_eq!((control.delay_num, control.delay_den), (1, 25));
        for row in 0..control.height as usize {
            let row_bytes = 3 * control.width as usize;
            let at = 3
                * ((control.y_offset as usize + row) * WIDTH as usize + control.x_offset as usize);
            canvas[at..at + row_bytes]
                .copy_from_slice(&patch[row * row_bytes..(row + 1) * row_bytes]);
        }
        assert_eq!(
            canvas,
            splitcast_render::to_srgb8(&picture(index)),
            "frame {index}"
        );
    }
}

#[test]
fn an_mp4_has_its_boxes_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mp4");
    run(&path, options());
    let bytes = fs::read(&path).unwrap();
    let (mut at, mut boxes) = (0, Vec::new());
    while at < bytes.len() {
        let size = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        boxes.push(
            std::str::from_utf8(&bytes[at + 4..at + 8])
                .unwrap()
                .to_owned(),
        );
        at += size;
    }
    assert_eq!(boxes, ["ftyp", "moov", "mdat"]);
    let find = |name: &[u8]| bytes.windows(4).position(|window| window == name).unwrap() + 4;
    assert_eq!(&bytes[4..24], b"ftypisom\0\0\x02\0isomav01");
    // Marker and version, Main profile at level 2.0, 4:2:0 sited as "vertical".
    let config = &bytes[find(b"av1C")..];
    assert_eq!(config[..4], [0x81, 0x00, 0x0d, 0x00]);
    // A sequence header with its size field follows.
    assert_eq!(config[4], 0x0a);
    let samples = find(b"stsz");
    let count = u32::from_be_bytes(bytes[samples + 8..samples + 12].try_into().unwrap());
    assert_eq!(count as usize, FRAMES);
}

#[test]
fn unsuitable_options_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let huge = 70_000;
    let cases = [
        (
            "a.mp4",
            OutputOptions {
                width: 33,
                ..options()
            },
            "32x18",
        ),
        (
            "a.mp4",
            OutputOptions {
                width: 8,
                ..options()
            },
            "16x18",
        ),
        (
            "a.mp4",
            OutputOptions {
                width: 0,
                ..options()
            },
            "960x540",
        ),
        (
            "a.png",
            OutputOptions {
                height: 0,
                ..options()
            },
            "960x540",
        ),
        (
            "a.png",
            OutputOptions {
                height: huge,
                ..options()
            },
            "65535",
        ),
        ("a.png", options(), "a_%04d.png"),
        (
            "%d.png",
            OutputOptions {
                frames: 3..3,
                ..options()
            },
            "no frames",
        ),
        (
            "a.mp4",
            OutputOptions {
                frames_per_second: f64::NAN,
                ..options()
            },
            "1 to 1000",
        ),
        (
            "a.apng",
            OutputOptions {
                frames_per_second: 0.0,
                ..options()
            },
            "1 to 1000",
        ),
    ];
    for (name, options, expected) in cases {
        let spec = OutputSpec::parse(folder.path().join(name)).unwrap();
        let error = spec.open(options).err().unwrap();
        assert!(error.is_usage(), "{error}");
        let message = error.to_string();
        assert!(
            message.contains(expected) && !message.contains('\n'),
            "{message}"
        );
    }
    assert_eq!(contents(folder.path()).len(), 0, "nothing was touched");
}

#[test]
fn wrong_pictures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for target in TARGETS {
        let mut sink = open(&folder.path().join(target), options());
        let mut wide = picture(0);
        wide.width += 1;
        let mut short = picture(0);
        short.pixels.pop();
        for (index, image) in [(0, &wide), (0, &short), (FRAMES, &picture(0))] {
            let error = sink.write(index, image).unwrap_err();
            assert!(matches!(error, OutputError::Misuse { .. }), "{error}");
        }
    }
    assert_eq!(
        contents(folder.path()).len(),
        0,
        "nothing is left of outputs without frames"
    );
}
