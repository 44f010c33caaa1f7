//! Records between a world and the simulated board: little-endian, with fixed sizes.
//!
//! A request of the board is the end of a cycle (u64, ns of the monotonic clock) and the speed to which each motor drives
//! its rotor (Hz). The world answers with this time and its state at this time. Before the first request it sends a
//! [`Greeting`], and its first state with the time 0.

use tilthex_core::{
    MAX_ROTORS, Matrix3, RobotState, RotorVector, Vector3, Wrench,
    plant::{PlantState, SensorParams},
    so3,
};

use crate::sleeper::Nanos;

/// The first bytes of a greeting. The last character is the version of these records.
const MAGIC: [u8; 8] = *b"tilthex2";
const NUMBER: usize = 8;
/// Length of a request, bytes.
pub const REQUEST: usize = NUMBER * (1 + MAX_ROTORS);
/// Length of a greeting, bytes.
pub const GREETING: usize = MAGIC.len() + NUMBER * 27;
/// Length of a state, bytes.
pub const STATE: usize = NUMBER * (1 + 33 + MAX_ROTORS);

/// What a world sends at its beginning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Greeting {
    /// Number of rotors of its vehicle.
    pub rotor_count: usize,
    /// The vehicle's mass, kg.
    pub mass: f64,
    /// Noise and biases of the sensors.
    pub sensors: SensorParams,
    /// Time between two captured poses, s.
    pub pose_period: f64,
    /// Shortest time from the capture of a pose to its sending, s.
    pub pose_latency: f64,
    /// Largest random time that is added to [`Self::pose_latency`], s.
    pub pose_jitter: f64,
}

/// The body in a world, at the end of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The end of the cycle, ns.
    pub at: Nanos,
    /// Pose, twist and rotor speeds.
    pub plant: PlantState,
    /// Specific force over the cycle at the IMU, m/s^2, IMU axes.
    pub specific_force_i: Vector3,
    /// Wrench of the contacts of the tool, world, at its tip.
    pub tool_wrench_w: Wrench,
    /// Wrench of contacts and pushes: force in world axes, torque in robot axes, about the centre of mass.
    pub external: Wrench,
}

/// The bytes of a request.
#[must_use]
pub fn request(at: Nanos, commands: &RotorVector) -> [u8; REQUEST] {
    let mut bytes = [0; REQUEST];
    let words = std::iter::once(at.to_le_bytes()).chain(commands.iter().map(|w| w.to_le_bytes()));
    for (slot, word) in bytes.chunks_exact_mut(NUMBER).zip(words) {
        slot.copy_from_slice(&word);
    }
    bytes
}

/// Reads a greeting.
///
/// # Errors
/// What is wrong with it.
pub fn greeting(bytes: &[u8; GREETING]) -> Result<Greeting, String> {
    let (magic, rest) = bytes.split_at(MAGIC.len());
    if magic != MAGIC {
        return Err(format!("it begins with {:?}", String::from_utf8_lossy(magic)));
    }
    let mut numbers = Numbers::new(rest);
    let rotor_count = numbers.next();
    let greeting = Greeting {
        rotor_count: rotor_count as usize,
        mass: numbers.next(),
        sensors: SensorParams {
            position: numbers.next(),
            orientation: numbers.next(),
            gyro: numbers.next(),
            accelerometer: numbers.next(),
            rotor_speed: numbers.next(),
            gyro_bias_i: numbers.vector(),
            accelerometer_bias_i: numbers.vector(),
            gyro_scale_i: numbers.vector(),
            gyro_misalignment_i: numbers.vector(),
            vibration: numbers.next(),
            captured_r: numbers.vector(),
            rotor_speed_age: numbers.next(),
        },
        pose_period: numbers.next(),
        pose_latency: numbers.next(),
        pose_jitter: numbers.next(),
    };
    let times = [greeting.pose_period, greeting.pose_latency, greeting.pose_jitter];
    if numbers.finite && times.iter().all(|time| (0.0..=10.0).contains(time)) {
        Ok(greeting)
    } else {
        Err("it holds an impossible number".into())
    }
}

/// Reads the state that answers a request for the cycle that ends `at`.
///
/// # Errors
/// What is wrong with it.
pub fn state(bytes: &[u8; STATE], at: Nanos) -> Result<State, String> {
    let (time, rest) = bytes.split_at(NUMBER);
    let answered = Nanos::from_le_bytes(time.try_into().unwrap_or_default());
    if answered != at {
        return Err(format!("it is for the time {answered} ns; expected {at} ns"));
    }
    let mut numbers = Numbers::new(rest);
    let state = State {
        at,
        plant: PlantState::new(
            RobotState {
                position_w: numbers.vector(),
                velocity_w: numbers.vector(),
                rotation_wr: Matrix3::from_rows(&[(); 3].map(|()| numbers.vector().transpose())),
                angular_velocity_r: numbers.vector(),
            },
            RotorVector::from_fn(|_, _| numbers.next()),
        ),
        specific_force_i: numbers.vector(),
        tool_wrench_w: numbers.wrench(),
        external: numbers.wrench(),
    };
    if !numbers.finite {
        return Err("it holds a number that is not finite".into());
    }
    so3::check_rotation("the rotation in it", &state.plant.robot.rotation_wr).map_err(|e| e.to_string())?;
    Ok(state)
}

/// Reads numbers one after the other.
struct Numbers<'a> {
    rest: std::slice::ChunksExact<'a, u8>,
    finite: bool,
}

impl<'a> Numbers<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes.chunks_exact(NUMBER), finite: true }
    }

    fn next(&mut self) -> f64 {
        let bytes = self.rest.next().and_then(|word| word.try_into().ok());
        let number = bytes.map_or(f64::NAN, f64::from_le_bytes);
        self.finite &= number.is_finite();
        number
    }

    fn vector(&mut self) -> Vector3 {
        Vector3::from_fn(|_, _| self.next())
    }

    fn wrench(&mut self) -> Wrench {
        Wrench { force: self.vector(), torque: self.vector() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level state at rest at the time `at`. All its other numbers count up.
    fn bytes(at: Nanos) -> [u8; STATE] {
        let mut numbers: Vec<f64> = (1..=45).map(f64::from).collect();
        numbers[6..15].copy_from_slice(Matrix3::identity().as_slice());
        let mut bytes = [0; STATE];
        bytes[..8].copy_from_slice(&at.to_le_bytes());
        for (slot, number) in bytes[8..].chunks_exact_mut(8).zip(numbers) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn every_number_has_its_place() {
        let read = state(&bytes(7), 7).expect("valid");
        let robot = read.plant.robot;
        assert_eq!(robot.position_w, Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(robot.velocity_w, Vector3::new(4.0, 5.0, 6.0));
        assert_eq!(robot.angular_velocity_r, Vector3::new(16.0, 17.0, 18.0));
        assert_eq!((read.plant.rotor_speeds[0], read.plant.rotor_speeds[11]), (19.0, 30.0));
        assert_eq!(read.specific_force_i, Vector3::new(31.0, 32.0, 33.0));
        assert_eq!(read.tool_wrench_w.torque, Vector3::new(37.0, 38.0, 39.0));
        assert_eq!(read.external.torque, Vector3::new(43.0, 44.0, 45.0));
    }

    #[test]
    fn rotations_are_written_row_by_row() {
        let mut turned = bytes(0);
        let quarter = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0_f64];
        for (slot, number) in turned[8 + 48..].chunks_exact_mut(8).zip(quarter) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        let rotation_wr = state(&turned, 0).expect("valid").plant.robot.rotation_wr;
        assert_eq!(rotation_wr * Vector3::x(), Vector3::y());
    }

    #[test]
    fn what_can_not_be_is_refused() {
        assert!(state(&bytes(7), 8).expect_err("another time").contains("7 ns"));
        let mut spoilt = bytes(7);
        spoilt[8 + 48..8 + 56].copy_from_slice(&2.0_f64.to_le_bytes());
        assert!(state(&spoilt, 7).expect_err("no rotation").contains("rotation"));
        spoilt[16..24].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(state(&spoilt, 7).expect_err("not finite").contains("finite"));
        assert!(greeting(&[b'x'; GREETING]).expect_err("another program").contains("xxxxxxxx"));
        let mut late = [0; GREETING];
        late[..8].copy_from_slice(b"tilthex2");
        assert!(greeting(&late).is_ok());
        late[GREETING - 8..].copy_from_slice(&11.0_f64.to_le_bytes());
        assert!(greeting(&late).expect_err("poses 11 s late").contains("impossible number"));
    }

    #[test]
    fn a_request_is_a_time_and_speeds() {
        let mut commands = RotorVector::zeros();
        commands[1] = 16.0;
        let bytes = request(258, &commands);
        assert_eq!(bytes[..3], [2, 1, 0]);
        assert_eq!(bytes[16..24], 16.0_f64.to_le_bytes());
    }
}
