//! Views that teach how a tree works: nodes visited, leaf depth, split planes.

use glam::Vec3;
use splitcast::{KdTree, NodeKind};

use crate::color_map::heat_color;
use crate::surface::Surface;
use crate::{Image, RenderOptions, View, legend, srgb};

/// Behind the mesh in views that show data only.
pub(crate) const BACKGROUND: Vec3 = Vec3::splat(0.012);

/// Colours of planes across x, y and z: red, green, blue, by convention.
const AXIS_COLORS: [Vec3; 3] = [
    Vec3::new(0.78, 0.05, 0.04),
    Vec3::new(0.06, 0.42, 0.08),
    Vec3::new(0.03, 0.16, 0.78),
];

/// Width, in pixels of a picture of 540 rows, of the root's plane; the factor
/// from one level to the next; and the least width, below which lines break up.
const ROOT_LINE: f32 = 4.5;
const LINE_RATIO: f32 = 0.78;
const THINNEST_LINE: f32 = 1.0;
const ROWS_OF_WIDTHS: f32 = 540.0;

/// How much a surface that is seen edge on darkens a data colour: enough to
/// tell the shape, little enough to tell the colour.
const SHADING: f32 = 0.35;

/// The heat map's colour for a ray that visited `nodes` nodes.
pub(crate) fn steps_color(nodes: u32, options: &RenderOptions) -> Vec3 {
    heat_color(nodes as f32 / options.steps_scale as f32)
}

/// The colour of a leaf at `depth`.
pub(crate) fn depth_color(depth: u32, tree: &KdTree<'_>) -> Vec3 {
    heat_color(depth as f32 / depth_scale(tree) as f32)
}

/// The colour of a unit normal, coded as in normal maps: display bytes from 0
/// to 255 stand for components from -1 to 1.
pub(crate) fn normal_color(normal: Vec3) -> Vec3 {
    let bytes = (normal * 127.5 + Vec3::splat(128.0)).to_array();
    srgb::decode(bytes.map(|byte| byte as u8)).into()
}

/// A data colour with a hint of the surface's shape, seen along `direction`.
pub(crate) fn shaded(color: Vec3, surface: &Surface, direction: Vec3) -> Vec3 {
    let facing = surface.normal.dot(direction).abs().min(1.0);
    color * (1.0 - SHADING * (1.0 - facing))
}

/// The depth of the leaf whose cell holds `point`; the root has depth 0.
pub(crate) fn leaf_depth(tree: &KdTree<'_>, point: Vec3) -> u32 {
    way_down(tree, point).count() as u32
}

/// The colour of the highest of the top `levels` split planes whose line on
/// the surface covers `point`. `steps` are the ways along the surface from
/// one pixel to the next, to the right and down; `rows` is the picture's height.
pub(crate) fn split_line(
    tree: &KdTree<'_>,
    point: Vec3,
    steps: [Vec3; 2],
    levels: u32,
    rows: u32,
) -> Option<Vec3> {
    way_down(tree, point)
        .take(levels as usize)
        .enumerate()
        .find(|&(level, (axis, position))| {
            let to_plane = (point[axis] - position).abs();
            let [right, down] = steps.map(|step| step[axis]);
            let per_pixel = (right * right + down * down).sqrt();
            let width = ROOT_LINE * LINE_RATIO.powi(level as i32);
            let width = width.max(THINNEST_LINE) * (rows as f32 / ROWS_OF_WIDTHS).max(0.5);
            to_plane < 0.5 * width * per_pixel
        })
        .map(|(_, (axis, _))| AXIS_COLORS[axis])
}

/// Adds what the colours of a view stand for.
pub(crate) fn draw_legend(image: &mut Image, tree: &KdTree<'_>, options: &RenderOptions) {
    match options.view {
        View::Beauty => {}
        View::Steps => {
            let most = format!("{}+", options.steps_scale);
            legend::draw_bar(image, "nodes visited", ["0", &most], heat_color);
        }
        View::LeafDepth => {
            let deepest = format!("{}+", depth_scale(tree));
            legend::draw_bar(image, "leaf depth", ["0", &deepest], heat_color);
        }
        View::SplitPlanes => {
            let [x, y, z] = AXIS_COLORS;
            legend::draw_swatches(image, "planes across", &[("x", x), ("y", y), ("z", z)]);
        }
        View::Normals => {
            let [x, y, z] = Vec3::AXES.map(normal_color);
            legend::draw_swatches(image, "normals", &[("x", x), ("y", y), ("z", z)]);
        }
    }
}

/// The depth that the hottest colour stands for: `8 + 1.3 log2(triangles)`,
/// the usual bound of builders (Havran 2000). It depends on the number of
/// triangles only, hence stays the same throughout most animations.
fn depth_scale(tree: &KdTree<'_>) -> u32 {
    let triangles = tree.mesh().triangles().len().max(1);
    (8.0 + 1.3 * (triangles as f64).log2()) as u32
}

/// Axes and positions of the planes that part `point` from the rest of the
/// tree, from the root down to its leaf.
fn way_down<'t>(tree: &'t KdTree<'_>, point: Vec3) -> impl Iterator<Item = (usize, f32)> + 't {
    let mut index = 0;
    std::iter::from_fn(move || match tree.nodes()[index].kind() {
        NodeKind::Leaf { .. } => None,
        NodeKind::Inner {
            axis,
            position,
            right,
        } => {
            index = if point[axis] <= position {
                index + 1
            } else {
                right
            };
            Some((axis, position))
        }
    })
}

#[cfg(test)]
mod tests {
    use splitcast::{BuildOptions, CostModel, Mesh};

    use super::*;

    /// Two triangles far apart along x, and a tree of one split between them.
    fn with_split(test: impl Fn(&KdTree<'_>, f32)) {
        let mut positions = Vec::new();
        for x in [0.0, 10.0] {
            positions.extend([[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 1.0]]);
        }
        let triangles: Vec<[u32; 3]> = vec![[0, 1, 2], [3, 4, 5]];
        let options = BuildOptions {
            cost: CostModel {
                intersection: 100.0,
                leaf_width: 1,
                ..CostModel::default()
            },
            max_depth: Some(1),
            ..BuildOptions::default()
        };
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let tree = KdTree::build(mesh, &options).unwrap();
        if let NodeKind::Inner {
            axis: 0, position, ..
        } = tree.nodes()[0].kind()
        {
            test(&tree, position);
        } else {
            panic!("the root should be split across x: {:?}", tree.nodes());
        }
    }

    #[test]
    fn a_point_lies_in_a_leaf_below_the_root() {
        with_split(|tree, _| assert_eq!(leaf_depth(tree, Vec3::ZERO), 1));
    }

    #[test]
    fn a_line_is_as_wide_as_it_should_be() {
        with_split(|tree, position| {
            let steps = [Vec3::new(0.01, 0.0, 0.0), Vec3::new(0.0, 0.01, 0.0)];
            let at = |pixels: f32| {
                let point = Vec3::new(position + 0.01 * pixels, 0.0, 0.0);
                split_line(tree, point, steps, 1, 540)
            };
            assert_eq!(at(0.0), Some(AXIS_COLORS[0]));
            assert_eq!(at(-2.2), Some(AXIS_COLORS[0]));
            assert_eq!(at(2.3), None);
        });
    }
}
