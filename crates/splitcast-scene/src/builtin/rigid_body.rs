//! Rigid bodies with contacts by impulses.
//!
//! Velocity impulses with Coulomb friction after J. Hahn ("Realistic
//! Animation of Rigid Bodies", SIGGRAPH 1988), in small steps. Orientation is
//! a rotation matrix that is made orthonormal after every step, which needs
//! no trigonometry and so gives the same bits everywhere.

use glam::{Mat3, Vec3};

use super::geodesic_sphere::geodesic_sphere;

const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);

/// Share of the approaching speed that a contact gives back.
const RESTITUTION: f32 = 0.25;
/// Coulomb coefficient of all contacts.
const FRICTION: f32 = 0.5;
/// Share of a contact's depth that is taken back in one step.
const PUSH_OUT: f32 = 0.2;

/// Where a body is: a turn about its centre of mass, then a shift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Centre of mass.
    pub(super) centre: Vec3,
    pub(super) rotation: Mat3,
}

/// A body of uniform density.
#[derive(Clone, Debug)]
pub(super) struct RigidBody {
    pub(super) pose: Pose,
    /// Metres a second.
    pub(super) velocity: Vec3,
    /// Radians a second.
    pub(super) spin: Vec3,
    /// In cubic metres: the density is one, since only ratios matter.
    pub(super) mass: f32,
    /// Centre of mass in the body's own coordinates.
    pub(super) rest_centre: Vec3,
    inverse_inertia: Mat3,
    /// Extreme points in many directions, relative to the centre of mass.
    pub(super) feelers: Vec<Vec3>,
    /// Radius of the smallest sphere around the centre of mass.
    pub(super) reach: f32,
}

impl RigidBody {
    /// A body at rest that fills the closed mesh of `positions` and
    /// counter-clockwise `triangles`, which may index from `first` on.
    pub(super) fn from_mesh(positions: &[Vec3], triangles: &[[u32; 3]], first: usize) -> Self {
        let corners = |triangle: &[u32; 3]| triangle.map(|index| positions[index as usize - first]);
        // About a point of the mesh, for the sake of small numbers.
        let about = positions[0];
        let mut volume = 0.0f32;
        let mut moment = Vec3::ZERO;
        let mut products = Mat3::ZERO;
        for triangle in triangles {
            let [a, b, c] = corners(triangle).map(|corner| corner - about);
            // The tetrahedron to the origin; covariance of a tetrahedron after
            // J. Blow and A. Binstock, "How to find the inertia tensor" (2004).
            let part = a.dot(b.cross(c)) / 6.0;
            let sum = a + b + c;
            volume += part;
            moment += sum * (0.25 * part);
            let outer = |v: Vec3| Mat3::from_cols(v * v.x, v * v.y, v * v.z);
            products += (outer(a) + outer(b) + outer(c) + outer(sum)) * (part / 20.0);
        }
        let offset = moment / volume;
        let outer = Mat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
        let covariance = products - outer * volume;
        let trace = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
        let inertia = Mat3::from_diagonal(Vec3::splat(trace)) - covariance;
        let centre = about + offset;

        let mut feelers: Vec<Vec3> = Vec::new();
        for direction in geodesic_sphere(4).0 {
            let extreme = positions
                .iter()
                .map(|&p| p - centre)
                .fold(Vec3::ZERO, |best, p| {
                    if p.dot(direction) > best.dot(direction) {
                        p
                    } else {
                        best
                    }
                });
            if !feelers.contains(&extreme) {
                feelers.push(extreme);
            }
        }
        Self {
            pose: Pose {
                centre,
                rotation: Mat3::IDENTITY,
            },
            velocity: Vec3::ZERO,
            spin: Vec3::ZERO,
            mass: volume,
            rest_centre: centre,
            inverse_inertia: inertia.inverse(),
            reach: feelers.iter().map(|p| p.length()).fold(0.0, f32::max),
            feelers,
        }
    }

    /// Free flight for `dt` seconds.
    pub(super) fn fly(&mut self, dt: f32) {
        self.velocity += GRAVITY * dt;
        self.pose.centre += self.velocity * dt;
        let rotation = self.pose.rotation;
        let turned = |axis: Vec3| axis + self.spin.cross(axis) * dt;
        // Gram-Schmidt on the turned axes.
        let x = turned(rotation.x_axis).normalize();
        let y = turned(rotation.y_axis);
        let y = (y - x * x.dot(y)).normalize();
        self.pose.rotation = Mat3::from_cols(x, y, x.cross(y));
    }

    /// Bounces off the ground, the plane y = 0.
    pub(super) fn meet_ground(&mut self) {
        if self.pose.centre.y > self.reach {
            return;
        }
        let mut deepest = 0.0f32;
        for i in 0..self.feelers.len() {
            let arm = self.pose.rotation * self.feelers[i];
            let height = self.pose.centre.y + arm.y;
            if height < 0.0 {
                deepest = deepest.max(-height);
                let impulse = contact_impulse(self.velocity_at(arm), Vec3::Y, |direction| {
                    self.compliance(arm, direction)
                });
                self.push(arm, impulse);
            }
        }
        self.pose.centre.y += PUSH_OUT * deepest;
    }

    /// Bounces off `other` where this body's feelers are inside of it:
    /// `probe` tells depth (positive inside) and outward normal at a point.
    pub(super) fn meet(&mut self, other: &mut Self, probe: impl Fn(Vec3) -> Option<(f32, Vec3)>) {
        let clearance = self.reach + other.reach;
        if self.pose.centre.distance_squared(other.pose.centre) > clearance * clearance {
            return;
        }
        for i in 0..self.feelers.len() {
            let arm = self.pose.rotation * self.feelers[i];
            let point = self.pose.centre + arm;
            let Some((depth, normal)) = probe(point) else {
                continue;
            };
            let other_arm = point - other.pose.centre;
            let impulse = contact_impulse(
                self.velocity_at(arm) - other.velocity_at(other_arm),
                normal,
                |direction| {
                    self.compliance(arm, direction) + other.compliance(other_arm, direction)
                },
            );
            self.push(arm, impulse);
            other.push(other_arm, -impulse);
            let share = other.mass / (self.mass + other.mass);
            self.pose.centre += normal * (PUSH_OUT * depth * share);
            other.pose.centre -= normal * (PUSH_OUT * depth * (1.0 - share));
        }
    }

    /// Adds an impulse at `arm` from the centre of mass.
    pub(super) fn push(&mut self, arm: Vec3, impulse: Vec3) {
        self.velocity += impulse / self.mass;
        self.spin += self.inverse_world_inertia(arm.cross(impulse));
    }

    fn velocity_at(&self, arm: Vec3) -> Vec3 {
        self.velocity + self.spin.cross(arm)
    }

    /// Change of velocity at `arm` along `direction` by a unit impulse there.
    fn compliance(&self, arm: Vec3, direction: Vec3) -> f32 {
        let turn = self.inverse_world_inertia(arm.cross(direction));
        1.0 / self.mass + turn.cross(arm).dot(direction)
    }

    fn inverse_world_inertia(&self, torque: Vec3) -> Vec3 {
        let rotation = self.pose.rotation;
        rotation * (self.inverse_inertia * (rotation.transpose() * torque))
    }
}

impl Pose {
    /// Where a point at `offset` from the centre of mass has gone.
    pub(super) fn apply(&self, offset: Vec3) -> Vec3 {
        self.centre + self.rotation * offset
    }

    /// The inverse of [`Self::apply`].
    pub(super) fn unapply(&self, point: Vec3) -> Vec3 {
        self.rotation.transpose() * (point - self.centre)
    }
}

/// The impulse that stops two bodies from approaching at `velocity` along
/// `normal`, with restitution and friction.
fn contact_impulse(velocity: Vec3, normal: Vec3, compliance: impl Fn(Vec3) -> f32) -> Vec3 {
    let approach = velocity.dot(normal);
    if approach >= 0.0 {
        return Vec3::ZERO;
    }
    let push = -(1.0 + RESTITUTION) * approach / compliance(normal);
    let sliding = velocity - normal * approach;
    let speed = sliding.length();
    if speed <= f32::MIN_POSITIVE {
        return normal * push;
    }
    let direction = sliding / speed;
    let rub = (speed / compliance(direction)).min(FRICTION * push);
    normal * push - direction * rub
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box with edges 2, 4 and 6 times `scale`, centred at `centre`.
    fn block(scale: f32, centre: Vec3) -> RigidBody {
        let positions: Vec<Vec3> = (0..8)
            .map(|i| {
                let sign = |bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
                centre + Vec3::new(sign(0), 2.0 * sign(1), 3.0 * sign(2)) * scale
            })
            .collect();
        let quads = [
            [0, 4, 6, 2],
            [1, 3, 7, 5],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 2, 3, 1],
            [4, 5, 7, 6],
        ];
        let triangles: Vec<[u32; 3]> = quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
        RigidBody::from_mesh(&positions, &triangles, 0)
    }

    #[test]
    fn a_box_has_the_inertia_of_the_textbook() {
        let body = block(1.0, Vec3::new(5.0, -3.0, 2.0));
        assert!((body.mass - 48.0).abs() < 1.0e-3);
        assert!(body.rest_centre.distance(Vec3::new(5.0, -3.0, 2.0)) < 1.0e-5);
        let inertia = body.inverse_inertia.inverse();
        // m (b^2 + c^2) / 12 about each axis.
        let expected = Vec3::new(16.0 + 36.0, 4.0 + 36.0, 4.0 + 16.0) * 4.0;
        let found = Vec3::new(inertia.x_axis.x, inertia.y_axis.y, inertia.z_axis.z);
        assert!(found.distance(expected) < 0.01, "{found}");
        assert!(inertia.x_axis.y.abs() < 0.01 && inertia.x_axis.z.abs() < 0.01);
        assert_eq!(body.feelers.len(), 8);
    }

    #[test]
    fn rotation_stays_a_rotation_and_turns_at_its_rate() {
        let mut body = block(0.1, Vec3::Y * 50.0);
        body.spin = Vec3::Z * std::f32::consts::FRAC_PI_2;
        for _ in 0..1000 {
            body.fly(1.0e-3);
        }
        let turned = body.pose.rotation * Vec3::X;
        assert!(turned.distance(Vec3::Y) < 2.0e-3, "{turned}");
        assert!((body.pose.rotation.determinant() - 1.0).abs() < 1.0e-5);
        assert!((body.pose.centre.y - (50.0 - 0.5 * 9.81)).abs() < 0.01);
        let point = Vec3::new(0.3, 0.2, 0.1);
        assert!(body.pose.unapply(body.pose.apply(point)).distance(point) < 1.0e-5);
    }

    #[test]
    fn a_dropped_box_comes_to_rest_on_the_ground() {
        let mut body = block(0.1, Vec3::Y);
        body.pose.rotation = Mat3::from_rotation_z(0.3);
        body.spin = Vec3::new(1.0, 0.5, 0.0);
        for _ in 0..6000 {
            body.fly(1.0e-3);
            body.meet_ground();
        }
        assert!(body.velocity.length() < 0.1, "{}", body.velocity);
        let lowest = (body.feelers.iter().map(|&f| body.pose.apply(f).y)).fold(f32::MAX, f32::min);
        assert!(lowest.abs() < 0.005, "{lowest}");
    }

    #[test]
    fn a_meeting_keeps_the_momentum() {
        let mut body = block(0.1, Vec3::ZERO);
        let mut other = block(0.2, Vec3::new(0.25, 0.0, 0.0));
        body.velocity = Vec3::new(2.0, 0.3, 0.0);
        let momentum = |a: &RigidBody, b: &RigidBody| a.velocity * a.mass + b.velocity * b.mass;
        let before = momentum(&body, &other);
        let approach = body.velocity.x;
        // The other body as the half space x > 0.05; corners meet it one after
        // another, so it takes a few rounds to part.
        for _ in 0..20 {
            body.meet(&mut other, |p| {
                (p.x > 0.05).then_some((p.x - 0.05, Vec3::NEG_X))
            });
        }
        assert!(momentum(&body, &other).distance(before) < 1.0e-5);
        let parting = other.velocity.x - body.velocity.x;
        assert!(parting > 0.0 && parting < approach, "{parting}");
    }
}
