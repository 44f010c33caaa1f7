//! What the firmware needs from a board.

use tilthex_core::Vector3;

/// A sample of the IMU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuReading {
    /// When it was taken, us on the board's clock.
    pub time_us: u64,
    /// Angular velocity, rad/s, IMU coordinates.
    pub gyro_i: Vector3,
    /// Specific force, m/s^2, IMU coordinates.
    pub specific_force_i: Vector3,
    /// Whether a reading is at the end of its range.
    pub saturated: bool,
}

/// A rotor and its motor controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RotorReading {
    /// Measured speed, Hz; `None` without a new measurement since the last call.
    pub speed: Option<f64>,
    /// The motor is being started.
    pub starting: bool,
    /// The motor spins.
    pub spinning: bool,
    /// The motor has stopped by itself.
    pub emergency: bool,
    /// Current, A; 0 if it is not measured.
    pub current: f64,
}

/// The set-point of a rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Stand still.
    Stop,
    /// Start if it stands, then turn at this speed, Hz. A start also clears an emergency.
    Start(f64),
    /// Turn at this speed, Hz, if it spins. A motor that has stopped by itself stays still.
    Turn(f64),
}

/// A flight board. No function may wait.
pub trait Board {
    /// Time since the board was powered, us. It never goes back.
    fn now_us(&mut self) -> u64;

    /// The oldest sample of the IMU that was not read yet; `None` if there is no more.
    fn imu(&mut self) -> Option<ImuReading>;

    /// A rotor, from 0.
    fn rotor(&mut self, rotor: usize) -> RotorReading;

    /// Voltage of the battery, V; `None` if it is not known.
    fn battery(&mut self) -> Option<f64>;

    /// Sets what a rotor, from 0, does from now on. Called in every tick. If no tick comes any more, the board must stop its
    /// motors or keep them at their lowest speeds: the watchdog belongs to the board.
    fn drive(&mut self, rotor: usize, drive: Drive);

    /// Copies bytes that came from the base into `bytes`, and returns their number; 0 if there is none.
    fn read(&mut self, bytes: &mut [u8]) -> usize;

    /// Sends bytes to the base: complete frames. If there is no room for all of them, the board drops all of them.
    fn write(&mut self, bytes: &[u8]);
}
