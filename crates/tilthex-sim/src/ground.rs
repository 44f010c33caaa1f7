//! The ground under the simulated vehicle, with springs, dampers and friction. It touches the four feet, and the
//! outline of the body if the vehicle lies on its side or upside down.

use tilthex_core::{RobotState, Vector3, Wrench};

/// Half the distance between neighbouring feet, m.
const STANCE: f64 = 0.3;
/// Half the width of the body, m.
const BODY: f64 = 0.4;
/// Height of the body's top above the centre of mass, m.
const TOP: f64 = 0.1;
/// Stiffness of a foot, N/m.
const STIFFNESS: f64 = 3000.0;
/// Damping of a foot, N s/m.
const DAMPING: f64 = 40.0;
/// Friction coefficient.
const FRICTION: f64 = 0.6;
/// Friction of a foot that slides slowly, N s/m: below the friction limit the force is proportional to the speed.
const STICKING: f64 = 20.0;

/// Flat ground at z = 0 and the legs of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Height of the centre of mass above the feet, m.
    pub leg: f64,
}

impl Ground {
    /// Whether a foot may touch the ground.
    #[must_use]
    pub fn is_near(&self, state: &RobotState) -> bool {
        state.position_w.z < self.leg + STANCE + 0.1
    }

    /// The points at which the vehicle can touch the ground, from the centre of mass, R, m.
    fn contacts(&self) -> [Vector3; 9] {
        let (s, l, b) = (STANCE, -self.leg, BODY);
        [
            Vector3::new(s, s, l),
            Vector3::new(s, -s, l),
            Vector3::new(-s, s, l),
            Vector3::new(-s, -s, l),
            Vector3::new(b, 0.0, 0.0),
            Vector3::new(-b, 0.0, 0.0),
            Vector3::new(0.0, b, 0.0),
            Vector3::new(0.0, -b, 0.0),
            Vector3::new(0.0, 0.0, TOP),
        ]
    }

    /// The wrench of the ground on the vehicle: force W, torque R about the centre of mass.
    #[must_use]
    pub fn wrench(&self, state: &RobotState) -> Wrench {
        let mut total = Wrench::ZERO;
        if !self.is_near(state) {
            return total;
        }
        for arm_r in self.contacts() {
            let foot = state.position_w + state.rotation_wr * arm_r;
            if foot.z >= 0.0 {
                continue;
            }
            let velocity = state.velocity_w + state.rotation_wr * state.angular_velocity_r.cross(&arm_r);
            let normal = (-STIFFNESS * foot.z - DAMPING * velocity.z).max(0.0);
            let slide = Vector3::new(velocity.x, velocity.y, 0.0);
            let friction = (STICKING * slide.norm()).min(FRICTION * normal);
            let force =
                Vector3::new(0.0, 0.0, normal) - slide.try_normalize(1e-12).unwrap_or_default() * friction;
            total.force += force;
            total.torque += arm_r.cross(&(state.rotation_wr.transpose() * force));
        }
        total
    }
}
