//! The body of the elephant at rest: bones, flesh and colours.

use glam::Vec3;

use crate::builtin::animal::Rig;
use crate::builtin::implicit::{Part, Section, section};
use crate::builtin::paint::{mottle, spot};

const HIDE: [u8; 3] = [122, 114, 108];
const BELLY: [u8; 3] = [112, 102, 96];
const EAR: [u8; 3] = [136, 122, 115];
const FOOT: [u8; 3] = [104, 96, 88];
const NAIL: [u8; 3] = [196, 186, 168];
const TUSK: [u8; 3] = [236, 226, 202];
const TUFT: [u8; 3] = [48, 42, 38];

/// The elephant standing square.
pub(super) fn rig() -> Rig {
    let mut rig = Rig::default();
    add_bones(&mut rig);
    add_barrel(&mut rig);
    add_head(&mut rig);
    add_ears(&mut rig);
    add_trunk_and_tusks(&mut rig);
    add_hind_legs(&mut rig);
    add_forelegs(&mut rig);
    add_tail(&mut rig);
    rig
}

fn add_bones(rig: &mut Rig) {
    let skeleton = &mut rig.skeleton;
    skeleton.bone("chest", "", [0.0, 2.1, 0.0], [1.0, 2.1, 0.0]);
    skeleton.bone("pelvis", "chest", [0.0, 2.1, 0.0], [-1.2, 2.1, 0.0]);
    skeleton.bone("neck", "chest", [1.0, 2.35, 0.0], [1.45, 2.50, 0.0]);
    skeleton.bone("head", "neck", [1.45, 2.50, 0.0], [2.0, 2.45, 0.0]);
    skeleton.chain(
        "trunk",
        "head",
        &[
            [2.03, 2.36, 0.0],
            [2.24, 2.13, 0.0],
            [2.37, 1.86, 0.0],
            [2.43, 1.57, 0.0],
            [2.44, 1.28, 0.0],
            [2.42, 1.01, 0.0],
            [2.42, 0.77, 0.0],
            [2.49, 0.56, 0.0],
            [2.62, 0.42, 0.0],
            [2.79, 0.37, 0.0],
        ],
    );
    skeleton.chain(
        "tail",
        "pelvis",
        &[
            [-1.44, 2.30, 0.0],
            [-1.58, 2.02, 0.0],
            [-1.65, 1.70, 0.0],
            [-1.69, 1.38, 0.0],
            [-1.72, 1.02, 0.0],
        ],
    );
    rig.bone_pairs(
        &["ear", "ear_middle", "ear_edge"],
        "head",
        &[
            [1.52, 2.62, 0.42],
            [1.37, 2.56, 0.66],
            [1.18, 2.46, 0.86],
            [0.98, 2.36, 1.02],
        ],
    );
    rig.bone_pairs(
        &["femur", "tibia", "metatarsus", "hind_foot"],
        "pelvis",
        &[
            [-0.98, 1.98, 0.36],
            [-0.82, 1.10, 0.42],
            [-0.98, 0.52, 0.40],
            [-0.95, 0.22, 0.40],
            [-0.66, 0.00, 0.40],
        ],
    );
    rig.bone_pairs(
        &["scapula", "humerus", "radius", "metacarpus", "fore_foot"],
        "chest",
        &[
            [0.70, 2.65, 0.30],
            [0.95, 1.98, 0.42],
            [0.76, 1.42, 0.44],
            [0.84, 0.62, 0.43],
            [0.85, 0.24, 0.43],
            [1.165, 0.00, 0.43],
        ],
    );
}

/// A cross-section in the middle, from its top and bottom.
const fn slice(x: f32, top: f32, bottom: f32, width: f32) -> Section {
    section([x, 0.5 * (top + bottom), 0.0], 0.5 * (top - bottom), width)
}

fn add_barrel(rig: &mut Rig) {
    rig.add(
        Part::loft(
            &[
                slice(1.12, 2.74, 1.55, 0.36),
                slice(0.90, 2.86, 1.38, 0.50),
                slice(0.50, 2.93, 1.18, 0.64),
                slice(0.10, 2.99, 1.10, 0.73),
                slice(-0.35, 3.00, 1.12, 0.75),
                slice(-0.75, 2.91, 1.26, 0.67),
                slice(-1.08, 2.74, 1.46, 0.54),
                slice(-1.33, 2.48, 1.68, 0.36),
            ],
            Vec3::Z,
            0.1,
        ),
        &["chest", "pelvis"],
        1.0,
        HIDE,
    );
    // The ridge of the spine, which shows on top.
    rig.add(
        Part::loft(
            &[
                section([0.85, 2.80, 0.0], 0.10, 0.10),
                section([0.20, 2.945, 0.0], 0.08, 0.08),
                section([-0.40, 2.955, 0.0], 0.08, 0.08),
                section([-1.00, 2.73, 0.0], 0.09, 0.09),
                section([-1.38, 2.40, 0.0], 0.09, 0.08),
            ],
            Vec3::Z,
            0.14,
        ),
        &["chest", "pelvis"],
        1.0,
        HIDE,
    );
    // The belly sags.
    rig.add(
        Part::ellipsoid(
            [-0.10, 1.42, 0.0],
            [1.0, 0.04, 0.0],
            Vec3::Z,
            [0.75, 0.36, 0.50],
            0.15,
        ),
        &["chest", "pelvis"],
        1.0,
        BELLY,
    );
}

fn add_head(rig: &mut Rig) {
    // Neck.
    rig.add(
        Part::loft(
            &[
                section([0.90, 2.15, 0.0], 0.60, 0.42),
                section([1.20, 2.36, 0.0], 0.50, 0.38),
                section([1.50, 2.48, 0.0], 0.44, 0.36),
            ],
            Vec3::Z,
            0.15,
        ),
        &["chest", "neck", "head"],
        1.0,
        HIDE,
    );
    // Skull from the crown down to the root of the trunk.
    rig.add(
        Part::loft(
            &[
                section([1.58, 2.80, 0.0], 0.30, 0.33),
                section([1.72, 2.60, 0.0], 0.36, 0.38),
                section([1.86, 2.40, 0.0], 0.33, 0.33),
                section([2.00, 2.25, 0.0], 0.26, 0.26),
            ],
            Vec3::Z,
            0.12,
        ),
        &["head"],
        0.6,
        HIDE,
    );
    // The two domes of the forehead.
    rig.add_pair(
        Part::ellipsoid(
            [1.58, 2.97, 0.15],
            [-0.4, 1.0, 0.1],
            Vec3::Z,
            [0.24, 0.24, 0.19],
            0.10,
        ),
        &["head"],
        0.6,
        HIDE,
    );
    // Cheek bones and brows.
    rig.add_pair(
        Part::ellipsoid(
            [1.72, 2.36, 0.25],
            [0.6, -1.0, 0.0],
            Vec3::Z,
            [0.30, 0.20, 0.13],
            0.10,
        ),
        &["head"],
        0.6,
        HIDE,
    );
    rig.add_pair(
        Part::ellipsoid(
            [1.90, 2.60, 0.27],
            [0.6, -1.0, 0.0],
            Vec3::Z,
            [0.12, 0.08, 0.08],
            0.06,
        ),
        &["head"],
        0.4,
        HIDE,
    );
    // Lower jaw with its pointed lip.
    rig.add(
        Part::loft(
            &[
                section([1.60, 2.12, 0.0], 0.19, 0.25),
                section([1.82, 1.98, 0.0], 0.15, 0.18),
                section([2.02, 1.88, 0.0], 0.09, 0.10),
                section([2.16, 1.85, 0.0], 0.04, 0.045),
            ],
            Vec3::Z,
            0.08,
        ),
        &["head"],
        0.6,
        HIDE,
    );
}

/// Sheets that stand off the head, thick at the root.
fn add_ears(rig: &mut Rig) {
    const SHEET: Vec3 = Vec3::new(-0.62, -0.10, 0.62);
    let bones = ["ear.", "ear_middle.", "ear_edge."];
    // Each piece lies in the plane of the ear: long axis near upright, wide
    // along the sheet, thin across it.
    for (center, axis, half_sizes) in [
        ([1.24, 2.58, 0.72], [0.10, 1.0, 0.0], [0.50, 0.44]),
        ([1.20, 2.36, 0.78], [0.14, 1.0, -0.06], [0.56, 0.36]),
        ([1.31, 2.05, 0.68], [0.30, 1.0, -0.20], [0.30, 0.20]),
    ] {
        rig.add_pair(
            Part::plate(center, axis, SHEET, half_sizes, 0.036, 0.12),
            &bones,
            0.6,
            EAR,
        );
    }
    // The root along the side of the head.
    rig.add_pair(
        Part::loft(
            &[
                section([1.50, 2.92, 0.36], 0.08, 0.10),
                section([1.50, 2.65, 0.42], 0.09, 0.12),
                section([1.52, 2.36, 0.40], 0.07, 0.10),
            ],
            SHEET,
            0.08,
        ),
        &["head", "ear."],
        0.8,
        HIDE,
    );
}

fn add_trunk_and_tusks(rig: &mut Rig) {
    rig.add(
        Part::loft(
            &[
                section([1.86, 2.46, 0.0], 0.31, 0.28),
                section([2.03, 2.36, 0.0], 0.28, 0.26),
                section([2.24, 2.13, 0.0], 0.225, 0.215),
                section([2.37, 1.86, 0.0], 0.185, 0.180),
                section([2.43, 1.57, 0.0], 0.155, 0.155),
                section([2.44, 1.28, 0.0], 0.132, 0.134),
                section([2.42, 1.01, 0.0], 0.114, 0.118),
                section([2.42, 0.77, 0.0], 0.098, 0.103),
                section([2.49, 0.56, 0.0], 0.084, 0.090),
                section([2.62, 0.42, 0.0], 0.072, 0.080),
                section([2.76, 0.375, 0.0], 0.064, 0.072),
                section([2.82, 0.385, 0.0], 0.045, 0.055),
            ],
            Vec3::Z,
            0.12,
        ),
        &["head", "trunk"],
        0.9,
        HIDE,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([1.92, 2.22, 0.20], 0.115, 0.115),
                section([2.10, 2.06, 0.25], 0.105, 0.100),
            ],
            Vec3::Z,
            0.08,
        ),
        &["head"],
        0.4,
        HIDE,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([2.06, 2.10, 0.24], 0.072, 0.072),
                section([2.28, 1.88, 0.31], 0.070, 0.070),
                section([2.54, 1.73, 0.36], 0.062, 0.062),
                section([2.82, 1.70, 0.36], 0.050, 0.050),
                section([3.04, 1.80, 0.32], 0.034, 0.034),
                section([3.11, 1.87, 0.30], 0.024, 0.024),
            ],
            Vec3::Z,
            0.015,
        ),
        &["head"],
        0.0,
        TUSK,
    );
}

fn add_hind_legs(rig: &mut Rig) {
    // Haunch and the long thigh.
    rig.add_pair(
        Part::ellipsoid(
            [-0.98, 2.10, 0.36],
            [0.10, 1.0, 0.0],
            Vec3::Z,
            [0.55, 0.40, 0.27],
            0.12,
        ),
        &["pelvis", "femur."],
        1.0,
        HIDE,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([-0.96, 1.95, 0.34], 0.40, 0.28),
                section([-0.90, 1.55, 0.38], 0.335, 0.25),
                section([-0.86, 1.18, 0.41], 0.255, 0.215),
                section([-0.90, 0.85, 0.41], 0.205, 0.185),
                section([-0.97, 0.55, 0.40], 0.180, 0.172),
                section([-0.95, 0.30, 0.40], 0.190, 0.185),
            ],
            Vec3::Z,
            0.12,
        ),
        &["pelvis", "femur.", "tibia.", "metatarsus."],
        0.9,
        HIDE,
    );
    add_foot(rig, [-0.95, 0.30, 0.40], 0.20, "hind_foot.");
}

fn add_forelegs(rig: &mut Rig) {
    // Shoulder and upper arm.
    rig.add_pair(
        Part::ellipsoid(
            [0.80, 2.22, 0.45],
            [0.22, -1.0, 0.06],
            Vec3::Z,
            [0.56, 0.27, 0.19],
            0.10,
        ),
        &["chest", "scapula."],
        1.0,
        HIDE,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([0.90, 1.98, 0.38], 0.32, 0.24),
                section([0.82, 1.60, 0.42], 0.27, 0.215),
                section([0.79, 1.30, 0.44], 0.225, 0.195),
                section([0.81, 0.98, 0.435], 0.190, 0.178),
                section([0.84, 0.64, 0.43], 0.182, 0.175),
                section([0.85, 0.32, 0.43], 0.195, 0.195),
            ],
            Vec3::Z,
            0.12,
        ),
        &["scapula.", "humerus.", "radius.", "metacarpus."],
        0.9,
        HIDE,
    );
    add_foot(rig, [0.85, 0.32, 0.43], 0.215, "fore_foot.");
}

/// The round cushion of a foot below `[x, y, z]`, with its nails.
fn add_foot(rig: &mut Rig, [x, y, z]: [f32; 3], radius: f32, bone: &str) {
    rig.add_pair(
        Part::loft(
            &[
                section([x, y, z], radius - 0.02, radius - 0.02),
                section([x + 0.02, 0.12, z], radius + 0.02, radius + 0.015),
                section([x + 0.03, -0.08, z], radius + 0.045, radius + 0.03),
            ],
            Vec3::Z,
            0.06,
        ),
        &[bone],
        0.3,
        FOOT,
    );
    // Toes stand in an arc; sine and cosine of 0, 35 and 70 degrees.
    for (sin, cos) in [
        (0.0f32, 1.0f32),
        (0.573_6, 0.819_2),
        (-0.573_6, 0.819_2),
        (0.939_7, 0.342_0),
        (-0.939_7, 0.342_0),
    ] {
        let reach = radius + 0.012;
        rig.add_pair(
            Part::ellipsoid(
                [x + 0.025 + reach * cos, 0.065, z + reach * sin],
                [0.0, 1.0, 0.0],
                Vec3::new(-sin, 0.0, cos),
                [0.055, 0.030, 0.050],
                0.02,
            ),
            &[bone],
            0.1,
            NAIL,
        );
    }
}

fn add_tail(rig: &mut Rig) {
    rig.add(
        Part::loft(
            &[
                section([-1.36, 2.40, 0.0], 0.10, 0.10),
                section([-1.48, 2.24, 0.0], 0.070, 0.075),
                section([-1.58, 2.02, 0.0], 0.056, 0.060),
                section([-1.65, 1.70, 0.0], 0.046, 0.050),
                section([-1.69, 1.40, 0.0], 0.040, 0.042),
            ],
            Vec3::Z,
            0.10,
        ),
        &["pelvis", "tail"],
        0.8,
        HIDE,
    );
    rig.add(
        Part::loft(
            &[
                section([-1.69, 1.42, 0.0], 0.040, 0.042),
                section([-1.70, 1.28, 0.0], 0.065, 0.050),
                section([-1.71, 1.14, 0.0], 0.060, 0.046),
                section([-1.72, 0.98, 0.0], 0.016, 0.016),
            ],
            Vec3::Z,
            0.03,
        ),
        &["tail"],
        0.8,
        TUFT,
    );
}

/// Dusty skin, and eyes.
pub(super) fn paint(position: Vec3, color: [u8; 3]) -> [u8; 3] {
    let color = mottle(color, position, 4.0, 0.10);
    let color = mottle(color, position, 14.0, 0.08);
    let aside = Vec3::new(position.x, position.y, position.z.abs());
    spot(
        color,
        [18, 14, 12],
        aside.distance(Vec3::new(1.93, 2.545, 0.335)),
        0.03,
        0.05,
    )
}
