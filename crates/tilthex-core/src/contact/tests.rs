use super::*;
use crate::{random::Random, so3, vehicle::tests::tilt_hex};
use proptest::prelude::*;

const DT: f64 = 0.002;

fn params() -> ContactParams {
    ContactParams {
        discrimination: true,
        rotor_drag: RotorDrag { drag: 2.3e-4, flapping: 0.0 },
        body_drag: BodyDrag { area_r: Vector3::new(0.03, 0.03, 0.08), centre_r: Vector3::zeros() },
        ..ContactParams::default()
    }
}

/// A hover whose wrench is that of a wind and of a touch, with the noise of an observer.
struct Rig {
    vehicle: Vehicle,
    params: ContactParams,
    robot: RobotState,
    speeds: RotorVector,
    state: ContactState,
    noise: Vector3,
    random: Random,
}

impl Rig {
    fn new(params: ContactParams, rotation_wr: Matrix3, seed: u64) -> Self {
        let vehicle = tilt_hex();
        let robot = RobotState { rotation_wr, ..RobotState::at_rest(Vector3::zeros()) };
        let speeds = vehicle.hover_speeds(&Matrix3::identity());
        let (state, random) = (ContactState::default(), Random::new(seed));
        Self { vehicle, params, robot, speeds, state, noise: Vector3::zeros(), random }
    }

    /// What is told of a wind (m/s) and a force at the tool (N), held for a time.
    fn hold(&mut self, seconds: f64, wind_w: &Vector3, force_w: &Vector3) -> Contact {
        let mut told = None;
        for _ in 0..(seconds / DT) as usize {
            let share = 30.0 * DT;
            let fresh = Vector3::from_fn(|_, _| self.random.normal()) * (0.05 * libm::sqrt(2.0 / share));
            self.noise += (fresh - self.noise) * share;
            let mut wrench_tool_w = Wrench { force: *force_w + self.noise, torque: Vector3::zeros() };
            let seen = Seen {
                vehicle: &self.vehicle,
                robot: &self.robot,
                rotor_speeds: &self.speeds,
                wrench_tool_w: &Wrench::ZERO,
            };
            wrench_tool_w = wrench_tool_w + self.params.drag(&seen, wind_w);
            let seen = Seen { wrench_tool_w: &wrench_tool_w, ..seen };
            told = Some(self.params.step(&mut self.state, &seen, DT));
        }
        told.expect("a while")
    }
}

fn attitude() -> impl Strategy<Value = Matrix3> {
    (-0.3..0.3f64, -0.3..0.3f64, -3.0..3.0f64)
        .prop_map(|(x, y, z)| so3::rot_z(z) * so3::rot_x(x) * so3::rot_y(y))
}

fn wind() -> impl Strategy<Value = Vector3> {
    (0.0..5.0f64, -3.1..3.1f64, -1.0..1.0f64).prop_map(|(v, a, z)| Vector3::new(v * a.cos(), v * a.sin(), z))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// A wind that rises slowly is found, and moves nothing.
    #[test]
    fn a_wind_is_found_and_is_no_contact(wind in wind(), r in attitude(), seed in any::<u64>()) {
        let mut rig = Rig::new(params(), r, seed);
        for k in 0..100 {
            let told = rig.hold(0.1, &(wind * (f64::from(k) / 100.0)), &Vector3::zeros());
            prop_assert!(told.part == 0.0, "{k} {told:?}");
        }
        let told = rig.hold(6.0, &wind, &Vector3::zeros());
        prop_assert!(likelihood_of(told.log_odds) < 0.05, "{told:?}");
        prop_assert!((told.wind_w - wind).xy().norm() < 0.6, "{told:?} {wind}");
    }

    /// A touch in a wind is contact within a tenth of a second, stays contact while it lasts, whole and without the
    /// wind's part, and ends when it ends.
    #[test]
    fn a_touch_in_a_wind_is_contact(
        wind in wind(), r in attitude(), seed in any::<u64>(),
        size in 0.8..8.0f64, direction in prop::array::uniform3(-1.0..1.0f64), lasting in 1.0..40.0f64,
    ) {
        let direction = Vector3::from(direction);
        prop_assume!(direction.norm() > 0.1);
        let mut rig = Rig::new(params(), r, seed);
        rig.hold(6.0, &wind, &Vector3::zeros());
        let force = direction.normalize() * size;
        let soon = rig.hold(0.1, &wind, &force);
        prop_assert!(soon.part == 1.0, "{soon:?}");
        let told = rig.hold(lasting, &wind, &force);
        prop_assert!(told.part == 1.0, "{told:?}");
        let seen = Seen { vehicle: &rig.vehicle, robot: &rig.robot, rotor_speeds: &rig.speeds, wrench_tool_w: &Wrench::ZERO };
        let off = told.drag_tool_w - rig.params.drag(&seen, &wind);
        prop_assert!(off.force.norm() < 0.15, "{off:?}");
        let over = rig.hold(0.5, &wind, &Vector3::zeros());
        prop_assert!(over.part == 0.0, "{over:?}");
    }

    /// What a touch that begins slowly taught of the wind does not stay while the touch lasts, nor does a gust.
    #[test]
    fn during_a_touch_the_wind_is_its_mean(
        wind in wind(), r in attitude(), seed in any::<u64>(), size in 1.0..4.0f64, bearing in -3.1..3.1f64,
        gust in -1.5..1.5f64,
    ) {
        let mut rig = Rig::new(params(), r, seed);
        rig.hold(12.0, &wind, &Vector3::zeros());
        let force = Vector3::new(bearing.cos(), bearing.sin(), 0.0) * size;
        rig.hold(0.5, &(wind + Vector3::new(gust, 0.0, 0.0)), &Vector3::zeros());
        for k in 0..20 {
            rig.hold(0.1, &wind, &(force * (f64::from(k) / 20.0)));
        }
        let told = rig.hold(15.0, &wind, &force);
        prop_assert!(told.part == 1.0 && (told.wind_w - wind).xy().norm() < 0.5, "{told:?} {wind}");
    }

    /// During a touch at the tip, the torque of a wind that changes is seen, and no force of the touch is.
    #[test]
    fn a_gust_is_seen_during_a_touch_at_the_tip(
        wind in wind(), r in attitude(), seed in any::<u64>(), size in 0.8..8.0f64, bearing in -3.1..3.1f64,
        gust in prop::array::uniform2(-1.0..1.0f64),
    ) {
        prop_assume!(wind.xy().norm() > 0.5);
        let force = Vector3::new(bearing.cos(), bearing.sin(), 0.0) * size;
        let gust = Vector3::new(gust[0], gust[1], 0.0);
        let off = |point_contact: bool| {
            let mut rig = Rig::new(ContactParams { point_contact, ..params() }, r, seed);
            rig.hold(12.0, &wind, &Vector3::zeros());
            rig.hold(2.0, &wind, &force);
            let told = rig.hold(4.0, &(wind + gust), &force);
            (told.part, (told.wind_w - wind - gust).xy().norm())
        };
        let ((part, seen), (_, unseen)) = (off(true), off(false));
        prop_assert!(part == 1.0 && seen < 0.3 + 0.4 * gust.norm(), "{seen} {unseen} {gust}");
        prop_assert!(unseen > 0.8 * gust.norm() - 0.3, "{seen} {unseen} {gust}");
    }

    /// A wind that rises just before a touch is the wind during the touch.
    #[test]
    fn a_risen_wind_stays_during_a_touch(
        angle in -3.1..3.1f64, speed in 2.5..5.0f64, r in attitude(), seed in any::<u64>(), bearing in -3.1..3.1f64,
    ) {
        let wind = Vector3::new(angle.cos(), angle.sin(), 0.0) * speed;
        let mut rig = Rig::new(params(), r, seed);
        rig.hold(12.0, &Vector3::zeros(), &Vector3::zeros());
        for k in 0..20 {
            rig.hold(0.1, &(wind * (f64::from(k) / 20.0)), &Vector3::zeros());
        }
        rig.hold(2.0, &wind, &Vector3::zeros());
        let told = rig.hold(15.0, &wind, &(Vector3::new(bearing.cos(), bearing.sin(), 0.0) * 2.0));
        prop_assert!(told.part == 1.0 && (told.wind_w - wind).xy().norm() < 0.25 * speed, "{told:?} {wind}");
    }

    /// Whatever is observed, what is told is finite.
    #[test]
    fn anything_is_survived(observed in prop::array::uniform6(prop_oneof![-1e3..1e3f64, Just(0.0), Just(1e150), Just(f64::NAN)]), dt in 0.0..0.2f64, point_contact in any::<bool>()) {
        let mut rig = Rig::new(ContactParams { point_contact, ..params() }, Matrix3::identity(), 1);
        let wrench = Wrench::from_vector(&crate::Vector6::from(observed));
        for _ in 0..50 {
            let seen = Seen { vehicle: &rig.vehicle, robot: &rig.robot, rotor_speeds: &rig.speeds, wrench_tool_w: &wrench };
            let told = rig.params.step(&mut rig.state, &seen, dt);
            prop_assert!(told.part.is_finite() && told.log_odds.is_finite() && is_finite3(&told.wind_w));
            prop_assert!(told.drag_tool_w.is_finite(), "{told:?}");
        }
        let calm = rig.hold(3.0, &Vector3::zeros(), &Vector3::zeros());
        prop_assert!(calm.part == 0.0 || rig.state.wind_w.norm() > 0.5, "{calm:?}");
    }
}

/// Without the discrimination, and for a first look, nothing is taken away.
#[test]
fn off_is_as_before() {
    let mut rig = Rig::new(ContactParams { discrimination: false, ..params() }, Matrix3::identity(), 2);
    let told = rig.hold(1.0, &Vector3::new(3.0, 0.0, 0.0), &Vector3::zeros());
    assert_eq!((told.drag_tool_w, told.part), (Wrench::ZERO, 1.0));
    assert_eq!(rig.state, ContactState::default());
}

/// The wind that explained errors of a model does not stay when a better model explains them: as a drag that is not
/// there it would count as contact for ever.
#[test]
fn another_model_begins_with_another_wind() {
    let mut rig = Rig::new(params(), Matrix3::identity(), 3);
    rig.hold(6.0, &Vector3::new(3.0, 0.0, 0.0), &Vector3::zeros());
    let mut control = crate::controller::ControllerState { contact: rig.state, ..Default::default() };
    assert_ne!(control.contact, ContactState::default());
    let now = crate::wrench_observer::ObserverInput {
        rotation_wr: rig.robot.rotation_wr,
        angular_velocity_r: Vector3::zeros(),
        specific_force_r: Vector3::new(0.0, 0.0, crate::GRAVITY),
        rotor_speeds: rig.speeds,
    };
    control.forget_errors(&rig.vehicle, &now);
    assert_eq!(control.contact, ContactState::default());
}
