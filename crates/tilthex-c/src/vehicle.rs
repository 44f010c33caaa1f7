//! The vehicle as plain numbers.

use crate::{
    block::{read, write},
    numbers::{matrix, rows},
    status::{Complaint, TilthexMessage, TilthexStatus},
};
use tilthex_core::{MAX_ROTORS, Rotor, Vector3, Vehicle, examples, vehicle::Mounting};

/// Most rotors of a vehicle, and the length of every array with one number for each rotor.
pub const TILTHEX_MAX_ROTORS: usize = 12;
const _: () = assert!(TILTHEX_MAX_ROTORS == MAX_ROTORS);

/// One rotor, fixed to the airframe.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexRotor {
    /// Centre of rotation from the centre of mass, m, robot coordinates.
    pub position_r: [f64; 3],
    /// Direction of the thrust, unit vector, robot coordinates.
    pub axis_r: [f64; 3],
    /// +1 or -1: the sign of the drag moment about the thrust axis at positive speed.
    pub spin: f64,
    /// Thrust coefficient, N/Hz^2.
    pub thrust_coefficient: f64,
    /// Drag-moment coefficient, N m/Hz^2.
    pub drag_coefficient: f64,
    /// Lowest speed, Hz.
    pub min_speed: f64,
    /// Highest speed, Hz.
    pub max_speed: f64,
}

/// A pose that is fixed on the robot.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexMounting {
    /// Its origin from the centre of mass, m, robot coordinates.
    pub position_r: [f64; 3],
    /// Its orientation: maps its own coordinates to robot coordinates; `rotation_r[row][column]`.
    pub rotation_r: [[f64; 3]; 3],
}

/// A vehicle. Every init function that takes one checks it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilthexVehicle {
    /// Mass of vehicle and tool, kg.
    pub mass: f64,
    /// Inertia about the centre of mass, kg m^2, robot coordinates; `inertia[row][column]`, symmetric.
    pub inertia: [[f64; 3]; 3],
    /// Number of rotors, at most `TILTHEX_MAX_ROTORS`.
    pub rotor_count: u32,
    /// The rotors; those after `rotor_count` are not read.
    pub rotors: [TilthexRotor; TILTHEX_MAX_ROTORS],
    /// Time constant of the first-order lag of the rotor speeds, s.
    pub rotor_time_constant: f64,
    /// The tool: its tip, and its axes.
    pub tool: TilthexMounting,
    /// The inertial sensor.
    pub imu: TilthexMounting,
}

impl From<&Rotor> for TilthexRotor {
    fn from(r: &Rotor) -> Self {
        Self {
            position_r: r.position_r.into(),
            axis_r: r.axis_r.into(),
            spin: r.spin,
            thrust_coefficient: r.thrust_coefficient,
            drag_coefficient: r.drag_coefficient,
            min_speed: r.min_speed,
            max_speed: r.max_speed,
        }
    }
}

impl TilthexRotor {
    fn rotor(&self) -> Rotor {
        Rotor {
            position_r: self.position_r.into(),
            axis_r: self.axis_r.into(),
            spin: self.spin,
            thrust_coefficient: self.thrust_coefficient,
            drag_coefficient: self.drag_coefficient,
            min_speed: self.min_speed,
            max_speed: self.max_speed,
        }
    }
}

impl From<&Mounting> for TilthexMounting {
    fn from(m: &Mounting) -> Self {
        Self { position_r: m.position_r.into(), rotation_r: rows(&m.rotation_r) }
    }
}

impl TilthexMounting {
    fn mounting(&self) -> Mounting {
        Mounting { position_r: Vector3::from(self.position_r), rotation_r: matrix(&self.rotation_r) }
    }
}

impl TilthexVehicle {
    /// # Errors
    /// What the core refuses, with its sentence.
    pub(crate) fn vehicle(&self, complaint: &Complaint) -> Result<Vehicle, TilthexStatus> {
        let rotors = self.rotors.map(|rotor| rotor.rotor());
        // A number above the most refuses itself: the core gets one rotor too many.
        let padded: [Rotor; MAX_ROTORS + 1] = core::array::from_fn(|i| *rotors.get(i).unwrap_or(&rotors[0]));
        let count = usize::try_from(self.rotor_count).unwrap_or(usize::MAX).min(padded.len());
        let (tool, imu) = (self.tool.mounting(), self.imu.mounting());
        complaint.check(Vehicle::new(
            self.mass,
            matrix(&self.inertia),
            &padded[..count],
            self.rotor_time_constant,
            tool,
            imu,
        ))
    }
}

/// Reads and checks a vehicle.
///
/// # Safety
/// The pointer is null or valid.
pub(crate) unsafe fn checked(
    vehicle: *const TilthexVehicle,
    complaint: &Complaint,
) -> Result<Vehicle, TilthexStatus> {
    // SAFETY: by the contract of this function.
    unsafe { read(vehicle) }?.vehicle(complaint)
}

/// Writes the numbers of the Tilt-Hex: six tilted rotors, 2.4 kg, a tool 0.4 m below the centre of mass (Ryll et al.,
/// IJRR 38(9), 2019, table 1).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_vehicle_tilt_hex(vehicle: *mut TilthexVehicle) -> TilthexStatus {
    let Ok(known) = examples::tilt_hex() else { return TilthexStatus::Refused };
    let mut rotors = [TilthexRotor::default(); TILTHEX_MAX_ROTORS];
    for (place, rotor) in rotors.iter_mut().zip(known.rotors()) {
        *place = rotor.into();
    }
    let numbers = TilthexVehicle {
        mass: known.mass(),
        inertia: rows(known.inertia()),
        rotor_count: u32::try_from(known.rotor_count()).unwrap_or_default(),
        rotors,
        rotor_time_constant: known.rotor_time_constant(),
        tool: known.tool().into(),
        imu: known.imu().into(),
    };
    // SAFETY: the pointer is null or valid.
    TilthexStatus::of(unsafe { write(vehicle, numbers) })
}

/// Checks a vehicle. `message` (may be null) gets the sentence of a refusal.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tilthex_vehicle_check(
    vehicle: *const TilthexVehicle,
    message: *mut TilthexMessage,
) -> TilthexStatus {
    // SAFETY: the pointers are null or valid.
    TilthexStatus::of(unsafe { checked(vehicle, &Complaint::to(message)) }.map(drop))
}
