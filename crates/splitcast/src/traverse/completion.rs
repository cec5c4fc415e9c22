//! Hits that are sure, completed for a group of rays at once: the numbers of the
//! [exact test](super::triangle), lane by lane.

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, f64x8};

use super::packet::GROUP;
use super::triangle::{Crossing, TriangleInFrame, area_normal, unit};
use crate::Hit;
use crate::simd::Kernel;
use crate::wide::Blocks;

/// A point or a vector for each ray of a group.
type Points<S> = [f32x16<S>; 3];

/// The same in double precision, half of a group.
type WidePoints<S> = [f64x8<S>; 3];

/// A number for each ray of a group.
type Row = [f32; GROUP];

/// Where the rays of a group begin, and where they go.
#[derive(Clone, Copy)]
pub(super) struct Lines<'a> {
    pub(super) origin: [&'a Row; 3],
    pub(super) direction: [&'a Row; 3],
}

/// Puts down what the lanes of `hit` hit. Gives the set of those that have to be found one by one;
/// nothing is put down there.
pub(super) struct Completion<'a> {
    pub(super) blocks: &'a Blocks,
    /// The directions of these lanes have their largest component on the last of them.
    pub(super) axes: [usize; 3],
    pub(super) lines: Lines<'a>,
    /// The places of the triangles.
    pub(super) places: &'a [u32; GROUP],
    pub(super) hit: u32,
    /// For no more than the lanes that there are.
    pub(super) hits: &'a mut [Option<Hit>],
}

impl Kernel for Completion<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> u32 {
        let Self {
            blocks,
            axes,
            lines,
            places,
            hit,
            hits,
        } = self;
        let mut corners = [[[0.0; GROUP]; 3]; 3];
        let mut triangles = [0; GROUP];
        let mut rest = hit;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % GROUP;
            rest &= rest - 1;
            let (block, place) = blocks.at(places[lane]);
            let own = block.corners_of(place);
            triangles[lane] = block.triangles[place];
            for corner in 0..3 {
                for axis in 0..3 {
                    corners[corner][axis][lane] = own[corner][axis];
                }
            }
        }
        let points = |[x, y, z]: [&Row; 3]| {
            widened(&[
                f32x16::simd_from(simd, *x),
                f32x16::simd_from(simd, *y),
                f32x16::simd_from(simd, *z),
            ])
        };
        let (origin, direction) = (points(lines.origin), points(lines.direction));
        let [a, b, c] = &corners;
        let (a, b, c) = (
            points(a.each_ref()),
            points(b.each_ref()),
            points(c.each_ref()),
        );
        let low = Solution::new(axes, &origin.0, &direction.0, &[a.0, b.0, c.0]);
        let high = Solution::new(axes, &origin.1, &direction.1, &[a.1, b.1, c.1]);
        let rows = [
            narrowed(low.crossing[0], high.crossing[0]),
            narrowed(low.crossing[1], high.crossing[1]),
            narrowed(low.crossing[2], high.crossing[2]),
            narrowed(low.normal[0], high.normal[0]),
            narrowed(low.normal[1], high.normal[1]),
            narrowed(low.normal[2], high.normal[2]),
        ];
        let open = hit & (low.doubtful | high.doubtful << 8);
        let mut rest = hit & !open;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % GROUP;
            rest &= rest - 1;
            let Crossing { t, u, v } = Crossing::new(rows[0][lane], rows[1][lane], rows[2][lane]);
            hits[lane] = Some(Hit {
                t,
                u,
                v,
                triangle: triangles[lane],
                normal: [rows[3][lane], rows[4][lane], rows[5][lane]],
            });
        }
        open
    }
}

/// Crossings of eight rays and triangles.
struct Solution<S: Simd> {
    crossing: WidePoints<S>,
    normal: WidePoints<S>,
    /// Those in which a sign is not certain.
    doubtful: u32,
}

impl<S: Simd> Solution<S> {
    #[inline(always)]
    fn new(
        axes: [usize; 3],
        origin: &WidePoints<S>,
        direction: &WidePoints<S>,
        corners: &[WidePoints<S>; 3],
    ) -> Self {
        let triangle = TriangleInFrame::new(axes, origin, direction, corners);
        let [u, v, w] = triangle.edges();
        let bound = triangle.doubtful_below();
        let certain = u.abs().simd_gt(bound) & v.abs().simd_gt(bound) & w.abs().simd_gt(bound);
        Self {
            crossing: triangle.crossing([u, v, w]),
            normal: unit(area_normal(corners)),
            doubtful: (!certain).to_bitmask() as u32,
        }
    }
}

#[inline(always)]
fn widened<S: Simd>([x, y, z]: &Points<S>) -> (WidePoints<S>, WidePoints<S>) {
    let (x, y, z) = (x.widen(), y.widen(), z.widen());
    ([x.0, y.0, z.0], [x.1, y.1, z.1])
}

#[inline(always)]
fn narrowed<S: Simd>(low: f64x8<S>, high: f64x8<S>) -> Row {
    low.narrow(high).into()
}
