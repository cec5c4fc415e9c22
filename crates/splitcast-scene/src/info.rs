//! What a sequence holds: counts, bounds, motion and topology.

use std::sync::Arc;

use crate::outline::Outline;
use crate::{Frame, FrameSource, SceneError};

/// An axis-aligned box in the units of the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least coordinates.
    pub min: [f32; 3],
    /// Greatest coordinates.
    pub max: [f32; 3],
}

impl Bounds {
    /// The least box around all finite positions, if there are any.
    pub fn around(positions: &[[f32; 3]]) -> Option<Bounds> {
        let finite = positions.iter().filter(|position| is_finite(position));
        let points = finite.map(|&position| Bounds {
            min: position,
            max: position,
        });
        points.reduce(|a, b| a.union(&b))
    }

    /// Length of the diagonal.
    pub fn diagonal(&self) -> f64 {
        distance(self.min, self.max)
    }

    /// The least box around both.
    pub fn union(&self, other: &Bounds) -> Bounds {
        Bounds {
            min: [0, 1, 2].map(|i| self.min[i].min(other.min[i])),
            max: [0, 1, 2].map(|i| self.max[i].max(other.max[i])),
        }
    }
}

/// How far the vertices went since the frame before, as fractions of the
/// diagonal of the box around the first frame: relative to the size of what
/// moves rather than of the way it goes, and by one measure for all frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Mean over the vertices; 0 where the first frame has no size.
    pub mean_step: f64,
    /// The longest step of any vertex.
    pub max_step: f64,
}

/// What one frame holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameInfo {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Vertices with a coordinate that is NaN or infinite; they count in
    /// neither bounds nor motion.
    pub non_finite: usize,
    /// Motion since the frame before. `None` for the first frame, and where
    /// the topology changed, since vertices then do not correspond.
    pub motion: Option<Motion>,
}

/// What a whole sequence holds.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceInfo {
    /// Name of the source.
    pub name: String,
    /// Frames per second at which the sequence is meant to play.
    pub frames_per_second: f32,
    /// Whether the last frame leads back into the first.
    pub is_periodic: bool,
    /// What each frame holds; at least one.
    pub frames: Vec<FrameInfo>,
    /// Box around all finite vertices of all frames; `None` if there are none.
    pub bounds: Option<Bounds>,
    /// Vertices that span nearly the convex hull of the whole motion: of each
    /// frame the finite ones that are extreme in some of 98 directions, the
    /// axes among them. Each point once, so at most 98 for a frame; the box
    /// around them is `bounds`. A camera that sees these sees the motion.
    pub outline: Vec<[f32; 3]>,
    /// Frames whose triangles differ from those of the frame before. Empty
    /// means that the topology is constant.
    pub topology_changes: Vec<usize>,
    /// Whether every frame has vertex normals.
    pub has_normals: bool,
    /// Whether every frame has vertex colours.
    pub has_colors: bool,
}

impl SequenceInfo {
    /// Goes through all frames of a source, two in memory at a time.
    ///
    /// # Errors
    /// What kept a frame from being read.
    pub fn measure(source: &mut dyn FrameSource) -> Result<Self, SceneError> {
        let mut info = SequenceInfo {
            name: source.name().to_owned(),
            frames_per_second: source.frames_per_second(),
            is_periodic: source.is_periodic(),
            frames: Vec::with_capacity(source.frame_count()),
            bounds: None,
            outline: Vec::new(),
            topology_changes: Vec::new(),
            has_normals: true,
            has_colors: true,
        };
        let mut previous: Option<Frame> = None;
        let mut unit = 0.0;
        let mut outline = Outline::default();
        for index in 0..source.frame_count() {
            let frame = source.frame(index)?;
            if index == 0 {
                unit = Bounds::around(&frame.positions).map_or(0.0, |bounds| bounds.diagonal());
            }
            info.add(index, previous.as_ref(), &frame, unit);
            outline.add(&frame.positions);
            previous = Some(frame);
        }
        info.outline = outline.into_points();
        Ok(info)
    }

    /// Fewest and most vertices of a frame.
    pub fn vertices(&self) -> (usize, usize) {
        range(self.frames.iter().map(|frame| frame.vertices))
    }

    /// Fewest and most triangles of a frame.
    pub fn triangles(&self) -> (usize, usize) {
        range(self.frames.iter().map(|frame| frame.triangles))
    }

    /// Motion over the whole sequence: the mean of the frames' mean steps, and
    /// the longest step. `None` if no two frames correspond.
    pub fn motion(&self) -> Option<Motion> {
        let motions: Vec<Motion> = self
            .frames
            .iter()
            .filter_map(|frame| frame.motion)
            .collect();
        let sum: f64 = motions.iter().map(|motion| motion.mean_step).sum();
        let max_step = motions
            .iter()
            .map(|motion| motion.max_step)
            .reduce(f64::max)?;
        Some(Motion {
            mean_step: sum / motions.len() as f64,
            max_step,
        })
    }

    fn add(&mut self, index: usize, previous: Option<&Frame>, frame: &Frame, unit: f64) {
        let same = previous.map(|previous| {
            previous.positions.len() == frame.positions.len()
                && (Arc::ptr_eq(&previous.triangles, &frame.triangles)
                    || previous.triangles == frame.triangles)
        });
        if same == Some(false) {
            self.topology_changes.push(index);
        }
        let bounds = Bounds::around(&frame.positions);
        self.bounds = match (self.bounds, bounds) {
            (Some(known), Some(new)) => Some(known.union(&new)),
            (known, new) => known.or(new),
        };
        self.has_normals &= frame.normals.is_some();
        self.has_colors &= frame.colors.is_some();
        self.frames.push(FrameInfo {
            vertices: frame.positions.len(),
            triangles: frame.triangles.len(),
            non_finite: frame.positions.iter().filter(|p| !is_finite(p)).count(),
            motion: previous
                .filter(|_| same == Some(true))
                .map(|previous| motion_between(&previous.positions, &frame.positions, unit)),
        });
    }
}

/// Steps between corresponding vertices, in parts of `unit`.
fn motion_between(before: &[[f32; 3]], after: &[[f32; 3]], unit: f64) -> Motion {
    let pairs = before.iter().zip(after);
    let finite = pairs.filter(|(a, b)| is_finite(a) && is_finite(b));
    let (mut sum, mut count, mut max_step) = (0.0, 0_u64, 0.0_f64);
    for (&a, &b) in finite {
        let step = distance(a, b);
        sum += step;
        count += 1;
        max_step = max_step.max(step);
    }
    if count == 0 || unit == 0.0 {
        return Motion {
            mean_step: 0.0,
            max_step: 0.0,
        };
    }
    Motion {
        mean_step: sum / count as f64 / unit,
        max_step: max_step / unit,
    }
}

fn is_finite(position: &[f32; 3]) -> bool {
    position.iter().all(|c| c.is_finite())
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let square = |i: usize| (f64::from(a[i]) - f64::from(b[i])).powi(2);
    (square(0) + square(1) + square(2)).sqrt()
}

fn range(counts: impl Iterator<Item = usize>) -> (usize, usize) {
    counts.fold((usize::MAX, 0), |(min, max), n| (min.min(n), max.max(n)))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Given(Vec<Frame>);

    impl FrameSource for Given {
        fn name(&self) -> &str {
            "given"
        }

        fn frame_count(&self) -> usize {
            self.0.len()
        }

        fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
            Ok(self.0[index].clone())
        }
    }

    fn frame(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Frame {
        Frame {
            positions: positions.to_vec(),
            triangles: Arc::new(triangles.to_vec()),
            ..Frame::default()
        }
    }

    #[test]
    fn motion_is_relative_to_the_first_frame_and_stops_at_changes() {
        let t = [[0, 1, 2]];
        let (a, b, c) = ([0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]);
        let nan = [f32::NAN, 0.0, 0.0];
        let info = SequenceInfo::measure(&mut Given(vec![
            frame(&[c, a, b], &t),
            frame(&[c, b, b], &t),
            frame(&[c, b, nan], &t),
            frame(&[a, b, c], &[[2, 1, 0]]),
            frame(&[a, b, c, c], &t),
        ]))
        .expect("five frames");
        let bounds = info.bounds.expect("finite vertices");
        assert_eq!((bounds.min, bounds.max), ([0.0; 3], [3.0, 4.0, 0.0]));
        assert_eq!(bounds.diagonal(), 5.0);
        assert_eq!(info.topology_changes, [3, 4]);
        assert_eq!((info.vertices(), info.triangles()), ((3, 4), (1, 1)));
        let motions: Vec<_> = info.frames.iter().map(|frame| frame.motion).collect();
        let step = |mean_step: f64, max_step: f64| {
            Some(Motion {
                mean_step,
                max_step,
            })
        };
        assert_eq!(motions[0], None);
        assert!((motions[1].expect("motion").mean_step - 0.2).abs() < 1e-12);
        assert!((motions[1].expect("motion").max_step - 0.6).abs() < 1e-12);
        assert_eq!(motions[2..], [step(0.0, 0.0), None, None]);
        assert_eq!(info.frames[2].non_finite, 1);
        assert!((info.motion().expect("motion").mean_step - 0.1).abs() < 1e-12);
        assert!(!info.has_normals && !info.has_colors);
    }

    #[test]
    fn a_single_point_has_no_size_to_relate_to() {
        let still = || frame(&[[1.0; 3]; 3], &[[0, 1, 2]]);
        let info = SequenceInfo::measure(&mut Given(vec![still(), still()])).expect("two frames");
        let motion = info.motion().expect("motion");
        assert_eq!((motion.mean_step, motion.max_step), (0.0, 0.0));
    }
}
