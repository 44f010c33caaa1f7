//! Every preset flies on its default configuration: hover, a 6-D trajectory as far as
//! it can, a push; limits, lost rotors.

#![allow(clippy::unwrap_used)]

use tilthex_config::{Config, PRESETS, VehicleSection};
use tilthex_core::{
    Matrix3, Setpoint, Vector3, Wrench,
    allocation::{Allocator, AllocatorState, Priority, RotorStatus},
    controller::{Controller, ControllerInput, ControllerOutput, ControllerState},
    plant::{Plant, PlantState},
    so3,
    vehicle::Actuation,
};

const PERIOD: f64 = 0.002;

struct Flight {
    plant: Plant,
    controller: Controller,
    state: PlantState,
    memory: ControllerState,
    lost: u16,
}

fn flight(preset: &str, keys: &str) -> Flight {
    let config = Config::default_for(VehicleSection::preset(preset).unwrap());
    let config = config.overlaid(keys.parse().unwrap()).unwrap();
    let vehicle = *config.vehicle().vehicle();
    let plant = Plant::new(vehicle);
    Flight {
        plant,
        controller: Controller::new(vehicle, *config.controller()).unwrap(),
        state: plant.hover(Vector3::new(0.0, 0.0, 1.0)),
        memory: ControllerState::default(),
        lost: 0,
    }
}

impl Flight {
    fn tool(&self) -> (Vector3, Matrix3) {
        self.plant.tool_pose(&self.state)
    }

    fn hold(&self) -> Setpoint {
        let (position, rotation) = self.tool();
        Setpoint::hold(position, rotation)
    }

    /// One tick with exact sensors; rotors keep to their limits, lost ones stand.
    fn tick(&mut self, setpoint: &Setpoint, push_w: &Wrench) -> ControllerOutput {
        let external = self.plant.from_tool(&self.state, push_w);
        let gravity = Vector3::new(0.0, 0.0, tilthex_core::GRAVITY);
        let (acceleration, _) = self.plant.accelerations(&self.state, &external);
        let robot = self.state.robot;
        let input = ControllerInput {
            state: robot,
            specific_force_r: robot.rotation_wr.transpose() * (acceleration + gravity),
            rotor_speeds: self.state.rotor_speeds,
            setpoint: *setpoint,
            compliant: true,
            unyielding: None,
            learn_bias: false,
            lost_rotors: self.lost,
            fixed_attitude: false,
        };
        let out = self.controller.step(&mut self.memory, &input, PERIOD);
        let mut command = out.rotor_speeds;
        for (i, rotor) in self.plant.vehicle().rotors().iter().enumerate() {
            if self.lost >> i & 1 == 1 {
                self.state.rotor_speeds[i] = 0.0;
                command[i] = 0.0;
            } else {
                assert!(command[i] >= rotor.min_speed - 1e-9 && command[i] <= rotor.max_speed + 1e-9);
            }
        }
        self.plant.step(&mut self.state, &command, &external, PERIOD);
        out
    }

    fn fly(&mut self, seconds: f64, setpoint: &Setpoint, push_w: &Wrench) -> ControllerOutput {
        let mut last = self.tick(setpoint, push_w);
        for _ in 1..(seconds / PERIOD) as usize {
            last = self.tick(setpoint, push_w);
        }
        last
    }
}

fn push(x: f64, y: f64, z: f64) -> Wrench {
    Wrench { force: Vector3::new(x, y, z), torque: Vector3::zeros() }
}

/// The angle between two attitudes, degrees.
fn degrees(a: &Matrix3, b: &Matrix3) -> f64 {
    so3::angle(&(a.transpose() * b)).to_degrees()
}

#[test]
fn every_vehicle_hovers() {
    for (name, _) in PRESETS {
        let mut f = flight(name, "");
        let start = f.hold();
        // Set down 0.2 m away and turned: it comes back.
        f.state.robot.position_w += Vector3::new(0.1, -0.15, 0.1);
        f.state.robot.rotation_wr = so3::rot_x(0.1) * so3::rot_z(0.3);
        let out = f.fly(12.0, &start, &Wrench::ZERO);
        let (position, rotation) = f.tool();
        assert!((position - start.position_w).norm() < 1e-3, "{name} {position}");
        assert!(degrees(&rotation, &start.rotation_we) < 0.1, "{name}");
        assert!(!out.allocation.saturated, "{name}");
    }
}

#[test]
fn every_vehicle_follows_a_trajectory_as_far_as_it_can() {
    for (name, _) in PRESETS {
        let mut f = flight(name, "");
        let tool = *f.plant.vehicle().tool();
        let pose = f.plant.vehicle().actuation() == Actuation::Pose;
        let amplitude = if *name == "omnidirectional-octorotor" { 1.0 } else { 0.1 };
        let (mut place, mut attitude) = (0.0f64, 0.0f64);
        for k in 0..6000 {
            let t = f64::from(k) * PERIOD;
            // A slow figure of eight of the centre of mass with roll, pitch and yaw.
            let (w, ramp) = (0.8, (t / 2.0).min(1.0));
            let wave = |phase: f64, n: f64| ramp * (n * w * t + phase).sin();
            let centre = Vector3::new(
                0.5 * wave(0.0, 1.0),
                0.3 * wave(0.0, 2.0),
                1.0 + 0.2 * wave(1.0, 1.0) - 0.2 * ramp * 1f64.sin(),
            );
            let rotation = so3::rot_z(0.5 * wave(0.0, 1.0))
                * so3::rot_y(amplitude * wave(0.0, 1.0))
                * so3::rot_x(amplitude * wave(0.0, 2.0));
            let setpoint = Setpoint::hold(centre + rotation * tool.position_r, rotation * tool.rotation_r);
            f.tick(&setpoint, &Wrench::ZERO);
            if t > 4.0 {
                place = place.max((f.state.robot.position_w - centre).norm());
                attitude = attitude.max(degrees(&f.state.robot.rotation_wr, &rotation));
            }
        }
        println!("{name}: {place:.3} m, {attitude:.1} deg");
        // Without feed-forward the position lags by velocity times gain ratio.
        assert!(place < if pose { 0.2 } else { 0.8 }, "{name} {place} m");
        assert!(!pose || attitude < 8.0 * amplitude.max(0.5) * 2.0, "{name} {attitude} deg");
    }
}

#[test]
fn every_vehicle_yields_to_a_push_and_comes_back() {
    for (name, _) in PRESETS {
        let mut f = flight(name, "");
        let start = f.hold();
        let deviation = |f: &Flight| f.tool().0 - start.position_w;
        let out = f.fly(12.0, &start, &push(0.7, 0.0, 0.0));
        let spring = (0.7 - 0.2) / 6.0;
        let pose = f.plant.vehicle().actuation() == Actuation::Pose;
        println!(
            "{name}: {:?} wanted {spring:.3} tilt {:.1}",
            deviation(&f),
            so3::tilt(&f.state.robot.rotation_wr).to_degrees()
        );
        if pose {
            assert!((out.reference.position_w.x - start.position_w.x - spring).abs() < 0.01, "{name}");
        }
        f.fly(12.0, &start, &Wrench::ZERO);
        assert!(deviation(&f).norm() < 0.01, "{name} {:?}", deviation(&f));
    }
}

/// More than the rotors give sideways turns the vehicle, and the turn is about the tool: from any side, it is where the admittance
/// filter has it, and the vehicle rests.
#[test]
fn a_turn_for_lateral_force_leaves_the_tool_in_its_place() {
    let stiff = "admittance = { stiffness = [200.0, 200.0, 200.0, 50.0, 50.0, 50.0], damping = [60.0, 60.0, 60.0, 8.0, 8.0, 8.0] }";
    for name in ["tilt-hex", "tilt-hex-light", "hexarotor", "quadrotor", "coaxial-tilt-hex"] {
        for side in 0..3 {
            let mut f = flight(name, stiff);
            let start = f.hold();
            let force = 0.38 * f.plant.vehicle().weight();
            let (sine, cosine) = (2.3 * f64::from(side)).sin_cos();
            // Through the centre of mass: the rotors have little torque to spare.
            let mut push = push(force * cosine, force * sine, 0.0);
            let lever_w = start.position_w - f.state.robot.position_w;
            push.torque = -lever_w.cross(&push.force);
            let turned = f.fly(12.0, &start, &push);
            let away = f.tool().0 - turned.reference.position_w;
            let turn = degrees(&f.state.robot.rotation_wr, &start.rotation_we);
            println!("{name} {side}: turned by {turn:.1} deg, {:.2} mm", 1e3 * away.norm());
            assert!(turn > 2.0, "{name} {turn} deg");
            assert!(away.norm() < 5e-3, "{name} {side} {away}");
            let spin = f.state.robot.angular_velocity_r.norm();
            assert!(f.state.robot.velocity_w.norm() < 0.01 && spin < 0.05, "{name} {side}");
        }
    }
}

/// Rolled to any attitude, a vehicle that can fly so gives up its place for its height: priorities are the world's.
#[test]
fn an_omnidirectional_vehicle_keeps_its_height_in_any_attitude() {
    let config = Config::default_for(VehicleSection::preset("omnidirectional-octorotor").unwrap());
    let vehicle = *config.vehicle().vehicle();
    let allocator = Allocator::new(&vehicle);
    for k in 0..200 {
        let k = f64::from(k);
        let r = so3::rot_z(0.7 * k) * so3::rot_x(1.1 * k) * so3::rot_y(0.3 * k);
        let wanted_w = Vector3::new(60.0 * k.cos(), 60.0 * k.sin(), vehicle.weight());
        let wrench = Wrench { force: r.transpose() * wanted_w, torque: Vector3::zeros() }.to_vector();
        let out = allocator.step(&mut AllocatorState::default(), &wrench, &r, &RotorStatus::default());
        let given_w = r * out.wrench.fixed_rows::<3>(0);
        assert!((given_w.z - vehicle.weight()).abs() < 1e-6, "{k} {given_w}");
        assert_eq!(out.given_up, Some(Priority::LateralForce), "{k}");
    }
}

/// Where a hover is left with a rotor lost (`tilthex.polytope.static_hover` says where), it is held.
#[test]
fn the_redundant_vehicles_hold_after_the_loss_of_any_rotor() {
    for name in ["omnidirectional-octorotor", "coaxial-tilt-hex"] {
        let count = flight(name, "").plant.vehicle().rotors().len();
        for rotor in 0..count {
            let mut f = flight(name, "");
            let start = f.hold();
            f.fly(1.0, &start, &Wrench::ZERO);
            f.lost = 1 << rotor;
            let mut farthest = 0.0f64;
            for _ in 0..2500 {
                f.tick(&start, &Wrench::ZERO);
                farthest = farthest.max((f.state.robot.position_w - Vector3::new(0.0, 0.0, 1.0)).norm());
            }
            let (position, rotation) = f.tool();
            println!(
                "{name} without {rotor}: {farthest:.3} m at most, {:.4} m and {:.2} deg at the end",
                (position - start.position_w).norm(),
                degrees(&rotation, &start.rotation_we)
            );
            assert!(farthest < 0.2, "{name} {rotor} {farthest}");
            assert!((position - start.position_w).norm() < 0.02, "{name} {rotor}");
            assert!(degrees(&rotation, &start.rotation_we) < 2.0, "{name} {rotor}");
        }
    }
}

/// A Tilt-Hex cannot hover at rest on five rotors that turn one way: yaw is given up, tilt and height are not.
#[test]
fn the_tilt_hexes_stay_upright_without_a_rotor() {
    for name in ["tilt-hex", "tilt-hex-light"] {
        for rotor in 0..6 {
            let mut f = flight(name, "");
            let start = f.hold();
            f.fly(1.0, &start, &Wrench::ZERO);
            f.lost = 1 << rotor;
            let mut worst = 0.0f64;
            for _ in 0..750 {
                f.tick(&start, &Wrench::ZERO);
                let tilt = so3::tilt(&f.state.robot.rotation_wr).to_degrees();
                worst = worst.max(tilt);
                assert!((f.state.robot.position_w.z - 1.0).abs() < 0.1, "{name} {rotor}");
            }
            println!("{name} without {rotor}: {worst:.1} deg of tilt at most");
            assert!(worst < 7.0, "{name} {rotor}");
            let out = f.tick(&start, &Wrench::ZERO);
            assert!(so3::tilt(&f.state.robot.rotation_wr).to_degrees() < 1.0, "{name} {rotor}");
            assert_eq!(out.allocation.given_up, Some(Priority::YawTorque), "{name} {rotor}");
        }
    }
}

/// Which rotors a lasting hover needs: all of a Tilt-Hex; pairs of opposite ones leave it, but hardly any yaw torque.
#[test]
fn what_can_not_hover_is_known() {
    let hovers = |name: &str, lost: u16| flight(name, "").controller.hovers_without(lost);
    for lost in 1..64u16 {
        assert!(!hovers("tilt-hex", lost), "{lost:06b}");
    }
    for rotor in 0..8 {
        assert!(hovers("omnidirectional-octorotor", 1 << rotor), "{rotor}");
    }
    assert!(hovers("tilt-hex", 0) && hovers("hexarotor", 0));
}
