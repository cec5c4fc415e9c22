//! The two figurines of `collision`: a porcelain dragon and a clay rabbit,
//! modelled part by part. Both stand on y = 0 and look along +x.

use glam::{Vec3, vec3};

use super::sculpture::{Sculpture, Style, spline};

const JADE: [u8; 3] = [74, 148, 116];
const BELLY: [u8; 3] = [206, 208, 160];
const SAIL: [u8; 3] = [38, 104, 104];
const IVORY: [u8; 3] = [236, 220, 178];
const GOLD: [u8; 3] = [222, 164, 56];
const DARK: [u8; 3] = [30, 26, 24];

const FUR: [u8; 3] = [188, 140, 104];
const PALE_FUR: [u8; 3] = [240, 226, 208];
const PINK: [u8; 3] = [232, 158, 146];

/// Spine of the dragon from the tip of the tail to the skull, with radii.
const SPINE: [(Vec3, f32); 11] = [
    (vec3(-0.62, 0.10, 0.50), 0.014),
    (vec3(-0.86, 0.07, 0.42), 0.036),
    (vec3(-0.98, 0.07, 0.16), 0.054),
    (vec3(-0.84, 0.10, -0.10), 0.074),
    (vec3(-0.56, 0.22, -0.12), 0.112),
    (vec3(-0.28, 0.36, -0.02), 0.172),
    (vec3(0.04, 0.40, 0.02), 0.192),
    (vec3(0.28, 0.50, 0.00), 0.152),
    (vec3(0.42, 0.70, -0.02), 0.106),
    (vec3(0.46, 0.90, 0.00), 0.088),
    (vec3(0.58, 1.00, 0.02), 0.092),
];

/// A winged dragon, 1.1 m high and 1.9 m from snout to tail.
pub(super) fn dragon() -> Sculpture {
    let mut dragon = Sculpture::default();
    let skin = Style {
        blend: 0.03,
        color: JADE,
    };
    dragon.limb(
        &SPINE,
        Style {
            blend: 0.006,
            color: JADE,
        },
    );
    dragon_belly(&mut dragon);
    dragon_head(&mut dragon);
    for side in [-1.0, 1.0] {
        dragon_legs(&mut dragon, side, skin);
        dragon_wing(&mut dragon, side);
    }
    dragon_crest(&mut dragon);
    dragon
}

/// Rounded plates along the throat, chest and belly.
fn dragon_belly(dragon: &mut Sculpture) {
    for span in 4..9 {
        for step in 0..4 {
            let t = step as f32 / 4.0;
            let (point, radius) = spline(&SPINE, span, t);
            let (ahead, _) = spline(&SPINE, span, t + 0.05);
            let forward = (ahead - point).normalize();
            let down = forward.cross(Vec3::Z).normalize();
            dragon.ellipsoid(
                point + down * (0.62 * radius),
                vec3(0.055, 0.44 * radius, 0.70 * radius),
                forward,
                down,
                Style {
                    blend: 0.012,
                    color: BELLY,
                },
            );
        }
    }
}

fn dragon_head(dragon: &mut Sculpture) {
    let skin = Style {
        blend: 0.04,
        color: JADE,
    };
    let fine = Style {
        blend: 0.012,
        color: JADE,
    };
    let bone = Style {
        blend: 0.012,
        color: IVORY,
    };
    // Skull, upper and lower jaw of an open mouth.
    dragon.round_cone(
        [vec3(0.60, 1.01, 0.02), vec3(0.72, 1.00, 0.02)],
        [0.098, 0.072],
        skin,
    );
    dragon.round_cone(
        [vec3(0.72, 1.005, 0.02), vec3(0.90, 0.985, 0.02)],
        [0.066, 0.044],
        skin,
    );
    dragon.round_cone(
        [vec3(0.64, 0.94, 0.02), vec3(0.83, 0.865, 0.02)],
        [0.052, 0.030],
        fine,
    );
    for side in [-1.0, 1.0] {
        let at = |x: f32, y: f32, z: f32| vec3(x, y, 0.02 + side * z);
        // Nostrils, brows, eyes with pupils.
        dragon.round_cone(
            [at(0.915, 1.015, 0.022), at(0.885, 1.02, 0.026)],
            [0.020, 0.014],
            fine,
        );
        dragon.round_cone(
            [at(0.745, 1.055, 0.046), at(0.64, 1.085, 0.066)],
            [0.022, 0.030],
            fine,
        );
        let eye = Style {
            blend: 0.004,
            color: GOLD,
        };
        dragon.round_cone(
            [at(0.715, 1.028, 0.064), at(0.713, 1.028, 0.064)],
            [0.022; 2],
            eye,
        );
        let pupil = Style {
            blend: 0.002,
            color: DARK,
        };
        dragon.round_cone(
            [at(0.727, 1.03, 0.075), at(0.726, 1.03, 0.075)],
            [0.012; 2],
            pupil,
        );
        // Horns, curved back, and a spiky frill of the cheek.
        dragon.limb(
            &[
                (at(0.60, 1.07, 0.055), 0.034),
                (at(0.50, 1.16, 0.085), 0.028),
                (at(0.38, 1.20, 0.115), 0.020),
                (at(0.27, 1.27, 0.125), 0.009),
            ],
            bone,
        );
        for (i, length) in [0.13, 0.15, 0.12].into_iter().enumerate() {
            let root = at(0.58, 1.02 - 0.04 * i as f32, 0.075);
            let tip = root + vec3(-0.75, 0.25 - 0.35 * i as f32, side * 0.7).normalize() * length;
            dragon.round_cone([root, tip], [0.024, 0.008], fine);
        }
        // Teeth of the upper jaw.
        for i in 0..4 {
            let root = at(0.885 - 0.04 * i as f32, 0.955, 0.032 + 0.006 * i as f32);
            let length = if i == 0 { 0.042 } else { 0.028 };
            let tip = root - Vec3::Y * length;
            dragon.round_cone(
                [root, tip],
                [0.013, 0.006],
                Style {
                    blend: 0.004,
                    color: IVORY,
                },
            );
        }
    }
    // Goatee and nose horn.
    dragon.round_cone(
        [vec3(0.81, 0.85, 0.02), vec3(0.80, 0.77, 0.02)],
        [0.020, 0.008],
        bone,
    );
    dragon.round_cone(
        [vec3(0.87, 1.02, 0.02), vec3(0.885, 1.085, 0.02)],
        [0.020, 0.008],
        bone,
    );
}

/// One front and one hind leg with toes and claws.
fn dragon_legs(dragon: &mut Sculpture, side: f32, skin: Style) {
    let at = |x: f32, y: f32, z: f32| vec3(x, y, side * z);
    let fine = Style {
        blend: 0.015,
        color: JADE,
    };
    let claw = Style {
        blend: 0.006,
        color: IVORY,
    };
    // The two sides stride, one foot ahead of the other.
    let stride = 0.05 * side;
    let legs = [
        [
            (at(0.20, 0.40, 0.12), 0.105),
            (at(0.16 + stride, 0.24, 0.21), 0.078),
            (at(0.25 + stride, 0.12, 0.23), 0.054),
            (at(0.25 + stride, 0.060, 0.23), 0.050),
        ],
        [
            (at(-0.32, 0.34, 0.10), 0.135),
            (at(-0.24 - stride, 0.22, 0.22), 0.098),
            (at(-0.36 - stride, 0.13, 0.24), 0.058),
            (at(-0.31 - stride, 0.064, 0.24), 0.054),
        ],
    ];
    for leg in legs {
        dragon.limb(&leg, skin);
        let foot = leg[3].0;
        for (i, spread) in [-0.5, 0.0, 0.5].into_iter().enumerate() {
            let ahead = vec3(1.0, 0.0, side * spread).normalize();
            let knuckle = vec3(foot.x, 0.036, foot.z) + ahead * 0.085;
            dragon.round_cone([foot, knuckle], [0.036, 0.030], fine);
            let tip = knuckle + ahead * (0.055 + 0.01 * (i % 2) as f32) - Vec3::Y * 0.022;
            dragon.round_cone([knuckle + ahead * 0.012, tip], [0.020, 0.010], claw);
        }
    }
}

/// A half-spread bat wing: an arm, four fingers and the skin between.
fn dragon_wing(dragon: &mut Sculpture, side: f32) {
    let at = |x: f32, y: f32, z: f32| vec3(x, y, side * z);
    let bone = Style {
        blend: 0.015,
        color: JADE,
    };
    let sail = Style {
        blend: 0.012,
        color: SAIL,
    };
    let shoulder = at(0.14, 0.53, 0.10);
    let elbow = at(0.02, 0.78, 0.34);
    let wrist = at(0.16, 1.04, 0.52);
    dragon.round_cone(
        [shoulder, elbow],
        [0.060, 0.036],
        Style {
            blend: 0.05,
            color: JADE,
        },
    );
    dragon.round_cone([elbow, wrist], [0.036, 0.030], bone);
    dragon.round_cone(
        [wrist, wrist + at(0.07, 0.06, 0.03)],
        [0.022, 0.009],
        Style {
            blend: 0.01,
            color: IVORY,
        },
    );
    // Finger tips from the leading one back, and the last at the flank.
    let tips = [
        at(-0.02, 1.22, 1.02),
        at(-0.34, 0.98, 1.00),
        at(-0.52, 0.74, 0.80),
        at(-0.50, 0.56, 0.50),
        at(-0.30, 0.48, 0.12),
    ];
    // A finger bends: its middle lies above the chord.
    let middle = |tip: Vec3| (wrist + tip) * 0.5 + at(0.02, 0.075, 0.05);
    for (i, &tip) in tips[..4].iter().enumerate() {
        let radius = 0.022 - 0.002 * i as f32;
        dragon.round_cone([wrist, middle(tip)], [radius + 0.004, radius], bone);
        dragon.round_cone([middle(tip), tip], [radius, 0.011], bone);
    }
    for (i, pair) in tips.windows(2).enumerate() {
        // The last finger is the flank itself and does not bend.
        let flank = i == 3;
        let (near, far) = (middle(pair[0]), if flank { elbow } else { middle(pair[1]) });
        // The skin's edge hangs in an arc between two tips.
        let notch = (pair[0] + pair[1]) * 0.5 * 0.82 + (near + far) * 0.5 * 0.18;
        let thickness = 0.014;
        dragon.plate([wrist, near, far], thickness, sail);
        dragon.plate([near, notch, far], thickness, sail);
        dragon.plate([near, pair[0], notch], thickness, sail);
        dragon.plate([far, notch, pair[1]], thickness, sail);
    }
    dragon.plate([elbow, shoulder, tips[4]], 0.014, sail);
}

/// Spikes along the back, largest at the shoulders, and a barb on the tail.
fn dragon_crest(dragon: &mut Sculpture) {
    let spike = Style {
        blend: 0.014,
        color: GOLD,
    };
    for span in 1..SPINE.len() - 1 {
        for step in 0..3 {
            let t = step as f32 / 3.0;
            let (point, radius) = spline(&SPINE, span, t);
            let (ahead, _) = spline(&SPINE, span, t + 0.05);
            let forward = (ahead - point).normalize();
            let up = (Vec3::Y - forward * forward.y - forward * 0.35).normalize();
            let length = 0.035 + 0.30 * radius;
            let root = point + up * (0.92 * radius);
            let tip = point + up * (radius + length) - forward * (0.35 * length);
            dragon.round_cone([root, tip], [0.012 + 0.10 * radius, 0.008], spike);
        }
    }
    let tip = SPINE[0].0;
    for side in [-1.0, 1.0] {
        let barb = tip + vec3(0.04, side * 0.055, 0.02);
        dragon.plate([tip, barb, tip + vec3(0.12, 0.0, 0.03)], 0.011, spike);
    }
}

/// A sitting rabbit, 0.75 m high with its ears.
pub(super) fn rabbit() -> Sculpture {
    let mut rabbit = Sculpture::default();
    let fur = Style {
        blend: 0.05,
        color: FUR,
    };
    let pale = Style {
        blend: 0.03,
        color: PALE_FUR,
    };
    let ball = |rabbit: &mut Sculpture, centre: Vec3, radius: f32, style: Style| {
        rabbit.round_cone([centre, centre + Vec3::Y * 1.0e-3], [radius; 2], style);
    };
    // Rump, back and chest.
    rabbit.ellipsoid(
        vec3(-0.07, 0.19, 0.0),
        vec3(0.22, 0.185, 0.18),
        Vec3::X,
        Vec3::Y,
        fur,
    );
    rabbit.ellipsoid(
        vec3(0.10, 0.22, 0.0),
        vec3(0.17, 0.13, 0.12),
        vec3(0.6, 0.8, 0.0),
        Vec3::X,
        fur,
    );
    rabbit.ellipsoid(
        vec3(0.165, 0.20, 0.0),
        vec3(0.12, 0.075, 0.085),
        vec3(0.3, 1.0, 0.0),
        Vec3::X,
        pale,
    );
    ball(&mut rabbit, vec3(-0.285, 0.13, 0.0), 0.068, pale);
    // Head and muzzle.
    rabbit.ellipsoid(
        vec3(0.22, 0.425, 0.0),
        vec3(0.135, 0.105, 0.105),
        vec3(1.0, -0.2, 0.0),
        Vec3::Y,
        fur,
    );
    rabbit.ellipsoid(
        vec3(0.315, 0.390, 0.0),
        vec3(0.055, 0.048, 0.062),
        Vec3::X,
        Vec3::Y,
        pale,
    );
    ball(
        &mut rabbit,
        vec3(0.362, 0.412, 0.0),
        0.018,
        Style {
            blend: 0.006,
            color: PINK,
        },
    );
    for side in [-1.0, 1.0] {
        let at = |x: f32, y: f32, z: f32| vec3(x, y, side * z);
        // Haunch, feet, cheek.
        rabbit.ellipsoid(
            at(-0.08, 0.155, 0.125),
            vec3(0.155, 0.135, 0.085),
            vec3(1.0, 0.35, 0.0),
            Vec3::Y,
            fur,
        );
        rabbit.round_cone(
            [at(-0.06, 0.04, 0.155), at(0.11, 0.036, 0.165)],
            [0.042, 0.036],
            fur,
        );
        rabbit.round_cone(
            [at(0.17, 0.20, 0.07), at(0.21, 0.06, 0.075)],
            [0.058, 0.036],
            fur,
        );
        rabbit.round_cone(
            [at(0.21, 0.04, 0.075), at(0.265, 0.034, 0.078)],
            [0.036, 0.033],
            pale,
        );
        ball(
            &mut rabbit,
            at(0.275, 0.385, 0.055),
            0.056,
            Style {
                blend: 0.04,
                color: FUR,
            },
        );
        // Eyes with a glint.
        ball(
            &mut rabbit,
            at(0.275, 0.455, 0.078),
            0.026,
            Style {
                blend: 0.005,
                color: DARK,
            },
        );
        ball(
            &mut rabbit,
            at(0.293, 0.467, 0.090),
            0.008,
            Style {
                blend: 0.002,
                color: PALE_FUR,
            },
        );
        // Ears, laid back a little, with a pale inside.
        let outward = vec3(-0.35, 1.0, side * 0.22).normalize();
        let flat = vec3(1.0, 0.35, side * 0.55);
        let root = at(0.175, 0.50, 0.050);
        rabbit.ellipsoid(
            root + outward * 0.14,
            vec3(0.165, 0.026, 0.056),
            outward,
            flat,
            Style {
                blend: 0.025,
                color: FUR,
            },
        );
        let facing = (flat - outward * flat.dot(outward)).normalize();
        rabbit.ellipsoid(
            root + outward * 0.145 + facing * 0.016,
            vec3(0.125, 0.014, 0.034),
            outward,
            flat,
            Style {
                blend: 0.006,
                color: PINK,
            },
        );
    }
    rabbit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_stand_on_the_ground() {
        for (name, body) in [("dragon", dragon()), ("rabbit", rabbit())] {
            let mut lowest = f32::MAX;
            for i in 0..200 * 200 {
                let at = vec3(
                    (i % 200) as f32 * 0.01 - 1.0,
                    0.0,
                    (i / 200) as f32 * 0.01 - 1.0,
                );
                lowest = lowest.min(body.distance(at));
            }
            assert!(
                lowest.abs() < 0.012,
                "{name} stands {lowest} off the ground"
            );
        }
    }
}
