//! The body of the horse at rest: bones, flesh and colours.

use glam::Vec3;

use crate::builtin::animal::Rig;
use crate::builtin::implicit::{Part, Section, section};
use crate::builtin::paint::{mottle, spot};

const COAT: [u8; 3] = [116, 67, 38];
const HAIR: [u8; 3] = [34, 26, 23];
const LEG: [u8; 3] = [44, 32, 27];
const HOOF: [u8; 3] = [78, 68, 60];
const MUZZLE: [u8; 3] = [62, 44, 38];
const WHITE: [u8; 3] = [226, 218, 208];

/// The horse standing square.
pub(super) fn rig() -> Rig {
    let mut rig = Rig::default();
    add_bones(&mut rig);
    add_trunk(&mut rig);
    add_neck_and_head(&mut rig);
    add_hind_legs(&mut rig);
    add_forelegs(&mut rig);
    add_hair(&mut rig);
    rig
}

fn add_bones(rig: &mut Rig) {
    let skeleton = &mut rig.skeleton;
    skeleton.bone("chest", "", [0.10, 1.30, 0.0], [0.60, 1.25, 0.0]);
    skeleton.bone("loin", "chest", [0.10, 1.30, 0.0], [-0.28, 1.36, 0.0]);
    skeleton.bone("pelvis", "loin", [-0.28, 1.36, 0.0], [-0.78, 1.32, 0.0]);
    skeleton.chain(
        "neck",
        "chest",
        &[
            [0.58, 1.33, 0.0],
            [0.82, 1.50, 0.0],
            [1.03, 1.66, 0.0],
            [1.21, 1.83, 0.0],
        ],
    );
    skeleton.bone("head", "neck2", [1.21, 1.83, 0.0], [1.66, 1.42, 0.0]);
    skeleton.chain(
        "tail",
        "pelvis",
        &[
            [-0.78, 1.44, 0.0],
            [-0.95, 1.47, 0.0],
            [-1.13, 1.42, 0.0],
            [-1.30, 1.31, 0.0],
            [-1.45, 1.15, 0.0],
            [-1.56, 0.94, 0.0],
        ],
    );
    rig.bone_pairs(
        &["femur", "tibia", "metatarsus", "hind_hoof"],
        "pelvis",
        &[
            [-0.52, 1.26, 0.13],
            [-0.34, 0.96, 0.19],
            [-0.67, 0.59, 0.15],
            [-0.64, 0.21, 0.15],
            [-0.51, 0.00, 0.15],
        ],
    );
    rig.bone_pairs(
        &["scapula", "humerus", "radius", "metacarpus", "fore_hoof"],
        "chest",
        &[
            [0.42, 1.48, 0.10],
            [0.65, 1.09, 0.16],
            [0.45, 0.92, 0.17],
            [0.49, 0.49, 0.14],
            [0.49, 0.20, 0.14],
            [0.62, 0.00, 0.14],
        ],
    );
}

/// A cross-section in the middle, from its top and bottom.
const fn slice(x: f32, top: f32, bottom: f32, width: f32) -> Section {
    section([x, 0.5 * (top + bottom), 0.0], 0.5 * (top - bottom), width)
}

fn add_trunk(rig: &mut Rig) {
    let trunk = ["chest", "loin", "pelvis"];
    rig.add(
        Part::loft(
            &[
                slice(0.70, 1.34, 1.00, 0.13),
                slice(0.56, 1.47, 0.89, 0.19),
                slice(0.36, 1.54, 0.835, 0.225),
                slice(0.12, 1.51, 0.815, 0.260),
                slice(-0.12, 1.495, 0.85, 0.270),
                slice(-0.32, 1.52, 0.955, 0.240),
                slice(-0.50, 1.545, 1.05, 0.22),
                slice(-0.68, 1.49, 1.08, 0.17),
                slice(-0.77, 1.42, 1.16, 0.12),
            ],
            Vec3::Z,
            0.05,
        ),
        &trunk,
        1.0,
        COAT,
    );
    // Withers, and the ridge of the back behind them.
    rig.add(
        Part::loft(
            &[
                section([0.62, 1.47, 0.0], 0.09, 0.06),
                section([0.42, 1.525, 0.0], 0.075, 0.05),
                section([0.20, 1.485, 0.0], 0.05, 0.05),
            ],
            Vec3::Z,
            0.10,
        ),
        &["chest"],
        1.0,
        COAT,
    );
    // Breast muscles to either side of the breastbone.
    rig.add_pair(
        Part::ellipsoid(
            [0.68, 1.10, 0.085],
            [0.3, 1.0, 0.0],
            Vec3::Z,
            [0.15, 0.10, 0.085],
            0.06,
        ),
        &["chest"],
        1.0,
        COAT,
    );
}

fn add_neck_and_head(rig: &mut Rig) {
    rig.add(
        Part::loft(
            &[
                section([0.52, 1.27, 0.0], 0.26, 0.14),
                section([0.70, 1.41, 0.0], 0.225, 0.115),
                section([0.88, 1.555, 0.0], 0.175, 0.09),
                section([1.05, 1.70, 0.0], 0.135, 0.072),
                section([1.20, 1.80, 0.0], 0.105, 0.066),
            ],
            Vec3::Z,
            0.10,
        ),
        &["chest", "neck0", "neck1", "neck2"],
        1.0,
        COAT,
    );
    rig.add(
        Part::loft(
            &[
                section([1.20, 1.84, 0.0], 0.085, 0.07),
                section([1.29, 1.755, 0.0], 0.115, 0.088),
                section([1.40, 1.655, 0.0], 0.108, 0.080),
                section([1.52, 1.55, 0.0], 0.083, 0.060),
                section([1.62, 1.46, 0.0], 0.070, 0.055),
                section([1.665, 1.41, 0.0], 0.058, 0.053),
            ],
            Vec3::Z,
            0.05,
        ),
        &["head"],
        0.3,
        COAT,
    );
    // Jowl, and the brow over the eye.
    rig.add_pair(
        Part::ellipsoid(
            [1.285, 1.69, 0.035],
            [1.0, -0.8, 0.0],
            Vec3::Z,
            [0.10, 0.075, 0.045],
            0.04,
        ),
        &["head"],
        0.3,
        COAT,
    );
    rig.add_pair(
        Part::ellipsoid(
            [1.36, 1.765, 0.060],
            [1.0, -0.9, 0.0],
            Vec3::Z,
            [0.055, 0.035, 0.032],
            0.03,
        ),
        &["head"],
        0.3,
        COAT,
    );
    // Nostrils, lips and chin.
    rig.add_pair(
        Part::ellipsoid(
            [1.665, 1.445, 0.034],
            [1.0, -0.9, 0.0],
            Vec3::Z,
            [0.042, 0.034, 0.026],
            0.03,
        ),
        &["head"],
        0.2,
        MUZZLE,
    );
    rig.add(
        Part::ellipsoid(
            [1.61, 1.405, 0.0],
            [1.0, -0.8, 0.0],
            Vec3::Z,
            [0.055, 0.030, 0.036],
            0.03,
        ),
        &["head"],
        0.2,
        MUZZLE,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([1.205, 1.885, 0.045], 0.040, 0.030),
                section([1.195, 1.955, 0.062], 0.040, 0.026),
                section([1.200, 2.020, 0.068], 0.026, 0.020),
                section([1.212, 2.060, 0.066], 0.012, 0.012),
            ],
            Vec3::Z,
            0.025,
        ),
        &["head"],
        0.1,
        COAT,
    );
}

fn add_hind_legs(rig: &mut Rig) {
    // Haunch, thigh and the hamstrings behind it.
    rig.add_pair(
        Part::ellipsoid(
            [-0.54, 1.27, 0.115],
            [0.55, -1.0, 0.05],
            Vec3::Z,
            [0.31, 0.24, 0.125],
            0.10,
        ),
        &["pelvis", "femur."],
        1.0,
        COAT,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([-0.50, 1.20, 0.14], 0.21, 0.11),
                section([-0.43, 1.05, 0.165], 0.175, 0.095),
                section([-0.40, 0.95, 0.175], 0.125, 0.080),
            ],
            Vec3::Z,
            0.08,
        ),
        &["pelvis", "femur."],
        0.9,
        COAT,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([-0.70, 1.28, 0.10], 0.10, 0.085),
                section([-0.67, 1.10, 0.125], 0.095, 0.080),
                section([-0.57, 0.92, 0.145], 0.075, 0.060),
            ],
            Vec3::Z,
            0.10,
        ),
        &["pelvis", "femur.", "tibia."],
        1.0,
        COAT,
    );
    // Gaskin down to the hock.
    rig.add_pair(
        Part::loft(
            &[
                section([-0.39, 0.97, 0.175], 0.115, 0.075),
                section([-0.47, 0.84, 0.170], 0.105, 0.066),
                section([-0.57, 0.70, 0.158], 0.066, 0.048),
                section([-0.645, 0.60, 0.150], 0.052, 0.042),
            ],
            Vec3::Z,
            0.05,
        ),
        &["femur.", "tibia."],
        0.5,
        COAT,
    );
    // Hock with its point, cannon, fetlock and pastern.
    rig.add_pair(
        Part::loft(
            &[
                section([-0.725, 0.665, 0.150], 0.026, 0.026),
                section([-0.685, 0.60, 0.150], 0.046, 0.040),
                section([-0.665, 0.53, 0.150], 0.050, 0.042),
                section([-0.655, 0.42, 0.150], 0.038, 0.034),
                section([-0.645, 0.29, 0.150], 0.036, 0.034),
                section([-0.642, 0.21, 0.150], 0.050, 0.043),
            ],
            Vec3::Z,
            0.04,
        ),
        &["tibia.", "metatarsus."],
        0.25,
        LEG,
    );
    add_foot(rig, [-0.64, 0.21, 0.15], ["metatarsus.", "hind_hoof."], LEG);
}

fn add_forelegs(rig: &mut Rig) {
    // Shoulder blade with its muscles, and the triceps that fills the angle
    // between it and the elbow.
    rig.add_pair(
        Part::ellipsoid(
            [0.53, 1.27, 0.135],
            [0.23, -0.40, 0.05],
            Vec3::Z,
            [0.27, 0.13, 0.085],
            0.08,
        ),
        &["chest", "scapula."],
        1.0,
        COAT,
    );
    rig.add_pair(
        Part::ellipsoid(
            [0.48, 1.06, 0.150],
            [0.20, 0.20, 0.0],
            Vec3::Z,
            [0.19, 0.13, 0.080],
            0.07,
        ),
        &["scapula.", "humerus."],
        1.0,
        COAT,
    );
    rig.add_pair(
        Part::ellipsoid(
            [0.64, 1.10, 0.145],
            [0.1, -1.0, 0.0],
            Vec3::Z,
            [0.12, 0.085, 0.070],
            0.06,
        ),
        &["scapula.", "humerus."],
        1.0,
        COAT,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([0.475, 0.98, 0.160], 0.115, 0.072),
                section([0.475, 0.86, 0.160], 0.092, 0.062),
                section([0.485, 0.70, 0.150], 0.064, 0.050),
                section([0.490, 0.57, 0.143], 0.046, 0.040),
                section([0.493, 0.49, 0.140], 0.050, 0.043),
                section([0.490, 0.42, 0.140], 0.040, 0.036),
            ],
            Vec3::Z,
            0.05,
        ),
        &["humerus.", "radius.", "metacarpus."],
        0.35,
        COAT,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([0.493, 0.49, 0.140], 0.051, 0.044),
                section([0.488, 0.40, 0.140], 0.038, 0.034),
                section([0.486, 0.28, 0.140], 0.036, 0.033),
                section([0.488, 0.20, 0.140], 0.048, 0.042),
            ],
            Vec3::Z,
            0.03,
        ),
        &["radius.", "metacarpus."],
        0.25,
        LEG,
    );
    add_foot(rig, [0.49, 0.20, 0.14], ["metacarpus.", "fore_hoof."], LEG);
}

/// Pastern and hoof below a fetlock.
fn add_foot(rig: &mut Rig, [x, y, z]: [f32; 3], bones: [&str; 2], color: [u8; 3]) {
    rig.add_pair(
        Part::loft(
            &[
                section([x, y, z], 0.047, 0.043),
                section([x + 0.035, y - 0.06, z], 0.038, 0.037),
                section([x + 0.060, y - 0.11, z], 0.042, 0.042),
            ],
            Vec3::Z,
            0.03,
        ),
        &bones,
        0.25,
        color,
    );
    rig.add_pair(
        Part::loft(
            &[
                section([x + 0.050, y - 0.115, z], 0.050, 0.049),
                section([x + 0.062, 0.025, z], 0.064, 0.060),
                section([x + 0.066, -0.03, z], 0.068, 0.064),
            ],
            Vec3::Z,
            0.012,
        ),
        &bones[1..],
        0.1,
        HOOF,
    );
}

fn add_hair(rig: &mut Rig) {
    // The mane: locks along the crest that stream back.
    const CREST: [([f32; 2], f32, &str); 7] = [
        ([0.72, 1.60], 0.11, "neck0"),
        ([0.80, 1.665], 0.14, "neck0"),
        ([0.88, 1.73], 0.11, "neck1"),
        ([0.96, 1.79], 0.16, "neck1"),
        ([1.04, 1.845], 0.12, "neck2"),
        ([1.12, 1.885], 0.17, "neck2"),
        ([1.19, 1.91], 0.13, "neck2"),
    ];
    for ([x, y], length, bone) in CREST {
        rig.add(
            Part::loft(
                &[
                    section([x + 0.03, y - 0.05, 0.0], 0.055, 0.030),
                    section([x - 0.3 * length, y + 0.20 * length, 0.004], 0.050, 0.030),
                    section([x - 0.95 * length, y + 0.36 * length, 0.014], 0.044, 0.026),
                    section([x - 1.6 * length, y + 0.22 * length, 0.022], 0.018, 0.016),
                ],
                Vec3::Z,
                0.03,
            ),
            &[bone],
            0.6,
            HAIR,
        );
    }
    // Forelock.
    rig.add(
        Part::loft(
            &[
                section([1.215, 1.915, 0.0], 0.035, 0.035),
                section([1.29, 1.86, 0.0], 0.030, 0.035),
                section([1.35, 1.80, 0.0], 0.014, 0.018),
            ],
            Vec3::Z,
            0.02,
        ),
        &["head"],
        0.1,
        HAIR,
    );
    // The tail: a dock, then hair that widens and thins out again.
    rig.add(
        Part::loft(
            &[
                section([-0.72, 1.42, 0.0], 0.050, 0.045),
                section([-0.86, 1.47, 0.0], 0.048, 0.042),
                section([-1.00, 1.465, 0.0], 0.068, 0.052),
                section([-1.16, 1.40, 0.0], 0.092, 0.062),
                section([-1.31, 1.29, 0.0], 0.098, 0.062),
                section([-1.45, 1.13, 0.0], 0.078, 0.052),
                section([-1.55, 0.96, 0.0], 0.044, 0.036),
                section([-1.60, 0.86, 0.0], 0.014, 0.014),
            ],
            Vec3::Z,
            0.05,
        ),
        &["pelvis", "tail"],
        0.8,
        HAIR,
    );
}

/// A coat that is not all one brown, eyes, nostrils and a star.
pub(super) fn paint(position: Vec3, color: [u8; 3]) -> [u8; 3] {
    let color = mottle(color, position, 5.0, 0.10);
    let aside = Vec3::new(position.x, position.y, position.z.abs());
    let eye = aside.distance(Vec3::new(1.365, 1.745, 0.09));
    let nostril = aside.distance(Vec3::new(1.70, 1.425, 0.045));
    let star = position.distance(Vec3::new(1.42, 1.775, 0.0));
    let color = spot(color, WHITE, star, 0.03, 0.065);
    let color = spot(color, [20, 14, 14], nostril, 0.01, 0.04);
    spot(color, [14, 10, 10], eye, 0.018, 0.045)
}
