use super::*;
use crate::random::Random;
use proptest::prelude::*;

const DT: f64 = 0.002;
const NOISE: (f64, f64) = (3e-4, 2e-3);
/// Age of a pose when it arrives, s.
const LATE: f64 = 0.01;

/// A vehicle that sways: position, m, world, and rotation at a time, s.
#[derive(Clone, Copy, Debug)]
struct Sway {
    way_w: Vector3,
    rate: f64,
    tilt: f64,
}

impl Sway {
    fn position_w(&self, t: f64) -> Vector3 {
        self.way_w * (1.0 - libm::cos(self.rate * t)) + Vector3::new(0.2, -0.1, 0.05) * t
    }

    fn velocity_w(&self, t: f64) -> Vector3 {
        (self.position_w(t + 1e-4) - self.position_w(t - 1e-4)) / 2e-4
    }

    fn rotation_wr(&self, t: f64) -> Matrix3 {
        so3::rot_z(0.4)
            * so3::exp(&(Vector3::new(libm::sin(3.0 * t), libm::sin(2.0 * t), 0.3 * t) * self.tilt))
    }

    /// What an accelerometer in the centre of mass reads, m/s^2, robot.
    fn force_r(&self, t: f64) -> Vector3 {
        let h = 1e-3;
        let felt_w = (self.position_w(t + h) - self.position_w(t) * 2.0 + self.position_w(t - h)) / (h * h);
        self.rotation_wr(t).transpose() * (felt_w + Vector3::new(0.0, 0.0, GRAVITY))
    }
}

/// Flies for 1.5 s with the poses that a function gives, and calls `look` with what is found at a time.
fn fly(
    sway: &Sway,
    (imu_off, rotors_off): (Vector3, Vector3),
    pose_at: impl Fn(f64) -> (Vector3, Matrix3),
    mut look: impl FnMut(f64, Option<Own>),
) {
    let (mut own_poses, mut random) = (OwnPoses::default(), Random::new(7));
    let (zero, level) = (Vector3::zeros(), Matrix3::identity());
    for k in 0..750 {
        let time = DT * f64::from(k);
        let force_r = sway.force_r(time - 0.5 * DT);
        own_poses.feel(&(force_r + imu_off + random.normal3(0.05)), &(force_r + rotors_off), time, DT);
        let taken = time - LATE;
        if k % 5 == 0 && taken > 0.0 {
            let (position_w, rotation_wr) = pose_at(taken);
            let position_w = position_w + random.normal3(NOISE.0);
            let rotation_wr = rotation_wr * so3::exp(&random.normal3(NOISE.1));
            let pose =
                PoseSample { time: taken, arrival: time, position_w, rotation_wr, tracking_valid: true };
            own_poses.see(&pose, 0.0, (&zero, &zero), (&zero, &level));
            look(time, own_poses.own());
        }
    }
}

fn sways() -> impl Strategy<Value = Sway> {
    let part = -1.0..1.0_f64;
    ((part.clone(), part.clone(), part), 3.0..7.0_f64, 0.0..0.3_f64).prop_filter_map(
        "moves",
        |(way, rate, tilt)| {
            let way_w = Vector3::new(way.0, way.1, way.2);
            (way_w.norm() > 0.3).then(|| Sway { way_w: way_w * (0.1 / way_w.norm()), rate, tilt })
        },
    )
}

proptest! {
    /// The vehicle's own poses are found, displaced or not, while the accelerometer or the rotors are right; and what is found is its
    /// motion.
    #[test]
    fn own_poses_are_found(
        sway in sways(), by_rotors in any::<bool>(), wrong in -4.0..4.0_f64, displaced in -2.0..2.0_f64
    ) {
        let wrong = Vector3::new(wrong, -wrong, 0.5 * wrong);
        let off = if by_rotors { (wrong, Vector3::zeros()) } else { (Vector3::zeros(), wrong) };
        let displaced_w = Vector3::new(displaced, 0.0, displaced);
        let (mut found, mut worst) = (false, 0.0_f64);
        fly(&sway, off, |t| (sway.position_w(t) + displaced_w, sway.rotation_wr(t)), |time, own| {
            if let Some(own) = own {
                found = true;
                worst = worst.max((own.velocity_w - sway.velocity_w(time)).norm());
            }
        });
        prop_assert!(found && worst < 0.15, "{found} {worst}");
    }

    /// Poses that do not move with the vehicle, or move otherwise, are never found to be its own.
    #[test]
    fn other_poses_are_not(sway in sways(), begin in 0.0..6.0_f64, away in 0.3..2.0_f64, turned in 0.0..1.0_f64) {
        let off = (Vector3::zeros(), Vector3::zeros());
        let frozen = (sway.position_w(begin), sway.rotation_wr(begin));
        let mut found = 0;
        fly(&sway, off, |_| frozen, |_, own| found += u32::from(own.is_some()));
        let circle = |t: f64| {
            let way = Vector3::new(0.3 * libm::sin(t + begin), 0.3 * libm::cos(t + begin), away);
            (way, so3::rot_z(turned + 0.2 * t))
        };
        fly(&sway, off, circle, |_, own| found += u32::from(own.is_some()));
        prop_assert_eq!(found, 0);
    }

    /// Poses of a level body that is turned by a wrong yaw are not, also where most of the motion is vertical.
    #[test]
    fn turned_poses_are_not(sway in sways(), yaw in 0.8..2.6_f64) {
        prop_assume!(sway.way_w.xy().norm() > 0.05);
        let way_w = Vector3::new(sway.way_w.x, sway.way_w.y, 4.0 * sway.way_w.xy().norm());
        let sway = Sway { tilt: 0.0, way_w, ..sway };
        let off = (Vector3::zeros(), Vector3::zeros());
        let mut found = 0;
        let turned = |t: f64| (sway.position_w(t), sway.rotation_wr(t) * so3::rot_z(yaw));
        fly(&sway, off, turned, |_, own| found += u32::from(own.is_some_and(|own| own.aside)));
        prop_assert_eq!(found, 0);
    }
}
