//! The simulated vehicle behaves as the vehicle's protocol says.

use tilthex_core::{Vector3, Vehicle, plant::SensorParams};
use tilthex_link::board::Board;
use tilthex_link::tk3::{HostMessage, ImuScales, MAX_FRAME, MotorValues, Receiver, Stream, VehicleMessage};
use tilthex_rt::{port::Port, sim::Server};
use tilthex_sim::{Simulation, SimulationParams};

fn vehicle() -> Vehicle {
    tilthex_core::examples::tilt_hex().expect("valid")
}

/// A host that talks to the simulation in virtual time.
struct Host {
    simulation: Simulation,
    receiver: Receiver<VehicleMessage>,
    heard: Vec<VehicleMessage>,
}

impl Host {
    fn new() -> Self {
        let mut params = SimulationParams::new(vehicle());
        params.sensors = SensorParams::IDEAL;
        Self { simulation: Simulation::new(params), receiver: Receiver::default(), heard: Vec::new() }
    }

    fn hear(&mut self, bytes: &[u8]) {
        self.heard.extend(bytes.iter().filter_map(|&byte| self.receiver.push(byte)));
    }

    fn say(&mut self, message: HostMessage) {
        let (mut frame, mut out) = ([0; MAX_FRAME], Vec::new());
        let length = message.encode(&mut frame);
        self.simulation.receive(&frame[..length], &mut out);
        self.hear(&out);
    }

    fn speeds(&mut self, hertz: f64) {
        self.say(HostMessage::Speeds(MotorValues::from_speeds(&[hertz; 6]).expect("six")));
    }

    fn wait(&mut self, milliseconds: usize) {
        let mut out = Vec::new();
        for _ in 0..milliseconds {
            self.simulation.advance(&mut out);
        }
        self.hear(&out);
    }

    fn count(&self, wanted: impl Fn(&VehicleMessage) -> bool) -> usize {
        self.heard.iter().filter(|m| wanted(m)).count()
    }

    fn texts(&self) -> Vec<String> {
        let text = |m: &VehicleMessage| match m {
            VehicleMessage::Text { text, .. } => Some(text.to_string()),
            _ => None,
        };
        self.heard.iter().filter_map(text).collect()
    }

    fn start_all(&mut self) {
        for motor in 1..=6 {
            self.say(HostMessage::Start(motor));
        }
        self.wait(500);
        assert!(self.simulation.firmware().all_spin());
    }

    /// Lowest and highest commanded speed, Hz.
    fn commands(&self) -> (f64, f64) {
        let commands = self.simulation.firmware().commands();
        let six = &commands.as_slice()[..6];
        (six.iter().copied().fold(f64::MAX, f64::min), six.iter().copied().fold(f64::MIN, f64::max))
    }
}

fn is_imu(m: &VehicleMessage) -> bool {
    matches!(m, VehicleMessage::Imu(_))
}

#[test]
fn it_says_nothing_unasked_and_identifies_itself() {
    let mut host = Host::new();
    host.wait(2000);
    assert_eq!(host.heard, []);
    host.say(HostMessage::Identify);
    assert!(matches!(&host.heard[..], [VehicleMessage::Identity(text)] if text.as_bytes() == b"chimera1.1"));
}

#[test]
fn streams_come_at_the_rate_that_was_asked_for() {
    let mut host = Host::new();
    host.say(HostMessage::Rate { stream: Stream::Imu, period_us: 2000 });
    host.say(HostMessage::Rate { stream: Stream::Motors, period_us: 10_000 });
    host.say(HostMessage::Rate { stream: Stream::Battery, period_us: 1_000_000 });
    host.wait(1000);
    assert_eq!(host.count(is_imu), 500);
    assert_eq!(host.count(|m| matches!(m, VehicleMessage::Motor(_))), 600);
    assert_eq!(host.count(|m| matches!(m, VehicleMessage::Battery { .. })), 1);
    host.say(HostMessage::Rate { stream: Stream::Imu, period_us: 0 });
    host.wait(1000);
    assert_eq!(host.count(is_imu), 500);
}

#[test]
fn at_rest_the_accelerometer_reads_gravity() {
    let mut host = Host::new();
    host.say(HostMessage::Rate { stream: Stream::Imu, period_us: 2000 });
    host.wait(100);
    let Some(VehicleMessage::Imu(imu)) = host.heard.last() else { panic!("an IMU sample") };
    let (force, gyro) = ImuScales::CHIMERA.decode(imu);
    assert!((force - Vector3::new(0.0, 0.0, 9.81)).norm() < 0.01, "{force}");
    assert!(gyro.norm() < 1e-3, "{gyro}");
    assert!(host.simulation.stands());
}

#[test]
fn speeds_neither_start_nor_stop_a_motor() {
    let mut host = Host::new();
    host.speeds(60.0);
    host.wait(1000);
    assert_eq!(host.commands(), (0.0, 0.0));
    host.start_all();
    assert_eq!(host.commands(), (16.0, 16.0), "the lowest speed");
    host.speeds(0.0);
    assert_eq!(host.commands(), (16.0, 16.0), "zero is the lowest speed");
    host.speeds(500.0);
    assert_eq!(host.commands(), (110.0, 110.0), "the highest speed");
    host.say(HostMessage::Stop(3));
    assert_eq!(host.commands().0, 0.0);
    host.say(HostMessage::StopAll);
    assert_eq!(host.commands(), (0.0, 0.0));
}

#[test]
fn motors_fall_back_after_half_a_second_and_disarm_ten_seconds_later() {
    let mut host = Host::new();
    host.start_all();
    host.speeds(40.0);
    host.wait(499);
    assert_eq!(host.commands().0, host.commands().1);
    assert!(host.commands().0 > 39.0);
    host.wait(2);
    assert_eq!(host.commands(), (16.0, 16.0));
    host.wait(9990);
    assert_eq!(host.commands(), (16.0, 16.0));
    host.wait(20);
    assert_eq!(host.commands(), (0.0, 0.0));
    assert_eq!(host.texts().iter().filter(|t| t.contains("disarmed")).count(), 6);
}

#[test]
fn an_emergency_shows_its_bit_until_the_motor_is_started_again() {
    let mut host = Host::new();
    host.start_all();
    host.say(HostMessage::Rate { stream: Stream::Motors, period_us: 2000 });
    let mut out = Vec::new();
    host.simulation.firmware_mut().fail_motor(2, &mut out);
    host.hear(&out);
    host.wait(10);
    let emergencies = |host: &Host| {
        host.count(
            |m| matches!(m, VehicleMessage::Motor(m) if m.state.is_emergency() && m.state.motor() == 2),
        )
    };
    assert_eq!(emergencies(&host), 5);
    assert_eq!(host.commands().0, 0.0);
    host.speeds(50.0);
    host.wait(10);
    assert_eq!(host.commands().0, 0.0, "w does not bring it back");
    let before = emergencies(&host);
    host.say(HostMessage::Start(2));
    host.wait(500);
    assert_eq!(emergencies(&host), before);
    assert!(host.commands().0 > 0.0);
}

#[test]
fn a_board_that_reboots_forgets_its_streams_and_its_motors_go_on() {
    let mut host = Host::new();
    host.start_all();
    host.say(HostMessage::Rate { stream: Stream::Imu, period_us: 2000 });
    host.wait(100);
    let now = host.simulation.now();
    host.simulation.firmware_mut().reboot(now);
    let before = host.count(is_imu);
    host.say(HostMessage::Rate { stream: Stream::Imu, period_us: 2000 });
    host.wait(250);
    assert_eq!(host.count(is_imu), before, "deaf while it boots");
    assert!(host.commands().0 > 0.0);
    host.wait(100);
    host.say(HostMessage::Rate { stream: Stream::Imu, period_us: 2000 });
    host.wait(100);
    assert_eq!(host.count(is_imu), before + 50);
}

#[test]
fn the_battery_drains_and_sags_under_load() {
    let mut host = Host::new();
    let full = host.simulation.firmware().voltage();
    host.start_all();
    for _ in 0..100 {
        host.speeds(70.0);
        host.wait(100);
    }
    let loaded = host.simulation.firmware().voltage();
    host.say(HostMessage::StopAll);
    host.wait(1000);
    let rested = host.simulation.firmware().voltage();
    assert!(loaded < rested && rested < full, "{loaded} {rested} {full}");
}

#[test]
fn full_thrust_lifts_it_and_the_ground_catches_it() {
    let mut host = Host::new();
    host.start_all();
    let ground = host.simulation.truth().robot.position_w.z;
    for _ in 0..40 {
        host.speeds(80.0);
        host.wait(20);
    }
    assert!(host.simulation.truth().robot.position_w.z > ground + 0.3, "{:?}", host.simulation.truth());
    host.say(HostMessage::StopAll);
    host.wait(5000);
    let end = host.simulation.truth().robot;
    assert!(host.simulation.stands(), "{end:?}");
    assert!((end.position_w.z - ground).abs() < 0.01, "{end:?}");
}

#[test]
fn behind_a_pseudo_terminal_it_answers() {
    let server =
        Server::start(Simulation::new(SimulationParams::new(vehicle())), Box::new(|_, _| {}), None, None)
            .expect("a pseudo-terminal");
    let mut port = Port::open(server.path().to_str().expect("plain"), 0).expect("opens");
    let mut receiver = Receiver::<VehicleMessage>::default();
    let mut frame = [0; MAX_FRAME];
    for message in [HostMessage::Identify, HostMessage::Rate { stream: Stream::Imu, period_us: 2000 }] {
        let length = message.encode(&mut frame);
        port.write(&frame[..length]);
    }
    let (mut identity, mut samples) = (None, 0);
    while identity.is_none() || samples < 20 {
        let mut bytes = [0; 256];
        let count = port.read(&mut bytes).expect("the simulation is there");
        for message in bytes[..count].iter().filter_map(|&byte| receiver.push(byte)) {
            match message {
                VehicleMessage::Identity(text) => identity = Some(text),
                VehicleMessage::Imu(_) => samples += 1,
                other => panic!("{other:?} was not requested"),
            }
        }
    }
    assert_eq!(receiver.counters().frames.cut, 0);
}
