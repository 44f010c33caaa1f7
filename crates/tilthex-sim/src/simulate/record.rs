//! What a simulation records.

use super::World;
use crate::Body;
use tilthex_core::{
    Matrix3, RotorVector, Vector3, Wrench,
    flight::Inertial,
    supervisor::{FaultSet, TABLE},
};

/// One recorded quantity: `width` numbers for each control period.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name of the quantity.
    pub name: &'static str,
    /// How many numbers a row has.
    pub width: usize,
    /// The numbers of all rows, one row after the other.
    pub values: Vec<f64>,
}

/// Adds the numbers of a quantity to a column.
type Read = fn(&World, &mut Vec<f64>);

/// All quantities that can be recorded.
const QUANTITIES: [(&str, Read); 29] = [
    ("time", |w, row| row.push(w.commanded.record.input.time)),
    ("position", |w, row| add(row, &w.body.state().robot.position_w)),
    ("velocity", |w, row| add(row, &w.body.state().robot.velocity_w)),
    ("rotation", |w, row| add_matrix(row, &w.body.state().robot.rotation_wr)),
    ("angular_velocity", |w, row| add(row, &w.body.state().robot.angular_velocity_r)),
    ("tool_position", |w, row| add(row, &w.tool_pose().0)),
    ("tool_rotation", |w, row| add_matrix(row, &w.tool_pose().1)),
    ("estimated_position", |w, row| add(row, &w.commanded.record.state.position_w)),
    ("estimated_velocity", |w, row| add(row, &w.commanded.record.state.velocity_w)),
    ("estimated_rotation", |w, row| add_matrix(row, &w.commanded.record.state.rotation_wr)),
    ("setpoint_position", |w, row| add(row, &w.commanded.record.setpoint.position_w)),
    ("setpoint_rotation", |w, row| add_matrix(row, &w.commanded.record.setpoint.rotation_we)),
    ("reference_position", |w, row| add(row, &w.commanded.record.reference.position_w)),
    ("reference_rotation", |w, row| add_matrix(row, &w.commanded.record.reference.rotation_we)),
    ("position_error", |w, row| add(row, &w.commanded.record.position_error_w)),
    ("rotation_error", |w, row| add(row, &w.commanded.record.rotation_error_r)),
    ("wrench_robot", |w, row| add_wrench(row, &w.commanded.record.wrench_robot)),
    ("wrench_tool", |w, row| add_wrench(row, &w.commanded.record.wrench_tool_w)),
    ("wrench_contact", |w, row| add_wrench(row, &w.commanded.record.wrench_contact_w)),
    ("wind", |w, row| add(row, &w.commanded.record.wind_w)),
    ("contact_likelihood", |w, row| row.push(w.commanded.record.contact_likelihood())),
    ("wrench_true", |w, row| add_wrench(row, &w.body.tool_wrench_w())),
    ("rotor_speeds", |w, row| add_rotors(row, w, &w.body.state().rotor_speeds)),
    ("rotor_command", |w, row| add_rotors(row, w, &w.commanded.record.rotor_command)),
    ("gyro", |w, row| add_sample(row, w, |sample| sample.gyro_i)),
    ("specific_force", |w, row| add_sample(row, w, |sample| sample.specific_force_i)),
    ("measured_rotor_speeds", |w, row| add_rotors(row, w, &w.commanded.record.rotor_speeds)),
    ("saturated", |w, row| row.push(f64::from(u8::from(w.commanded.record.saturated)))),
    ("phase", |w, row| row.push(f64::from(w.commanded.record.phase as u8))),
];

fn add(row: &mut Vec<f64>, v: &Vector3) {
    row.extend_from_slice(v.as_slice());
}

/// Row by row.
fn add_matrix(row: &mut Vec<f64>, m: &Matrix3) {
    row.extend_from_slice(m.transpose().as_slice());
}

fn add_wrench(row: &mut Vec<f64>, wrench: &Wrench) {
    row.extend_from_slice(wrench.to_vector().as_slice());
}

fn add_rotors(row: &mut Vec<f64>, world: &World, values: &RotorVector) {
    row.extend_from_slice(&values.as_slice()[..world.plant.vehicle().rotor_count()]);
}

/// Of the newest inertial sample.
fn add_sample(row: &mut Vec<f64>, world: &World, of: fn(&Inertial) -> Vector3) {
    add(row, &world.telemetry.inertial.samples().last().map_or_else(Vector3::zeros, of));
}

/// The names of all recorded quantities.
pub const NAMES: [&str; QUANTITIES.len()] = {
    let (mut names, mut number) = ([""; QUANTITIES.len()], 0);
    while number < names.len() {
        names[number] = QUANTITIES[number].0;
        number += 1;
    }
    names
};

/// A fault that begins or ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultChange {
    /// When, s.
    pub time: f64,
    /// The name of the fault.
    pub name: &'static str,
    /// Whether it begins.
    pub begins: bool,
}

/// The recorded quantities of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    columns: Vec<Column>,
    rows: usize,
    /// The numbers of the recorded quantities in [`NAMES`].
    wanted: Vec<usize>,
    faults: Vec<FaultChange>,
    active: FaultSet,
}

impl Record {
    /// An empty record of the wanted quantities with room for `rows` rows.
    pub(super) fn new(rows: usize, wanted: impl Fn(&str) -> bool) -> Self {
        let wanted = (0..NAMES.len()).filter(|number| wanted(NAMES[*number])).collect();
        Self { rows, wanted, ..Self::default() }
    }

    /// The columns, all of equal length.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The column with this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.name == name)
    }

    /// The faults that began and ended, in the order of their times.
    #[must_use]
    pub fn faults(&self) -> &[FaultChange] {
        &self.faults
    }

    /// Takes the faults that are active at a time, s.
    pub(super) fn watch(&mut self, time: f64, active: FaultSet) {
        if active == self.active {
            return;
        }
        for row in &TABLE {
            let begins = active.contains(row.fault);
            if begins != self.active.contains(row.fault) {
                self.faults.push(FaultChange { time, name: row.name, begins });
            }
        }
        self.active = active;
    }

    /// Adds a row to each column.
    pub(super) fn take(&mut self, world: &World) {
        if self.columns.len() < self.wanted.len() {
            self.columns = self.wanted.iter().map(|number| self.column(*number, world)).collect();
        }
        for (column, number) in self.columns.iter_mut().zip(&self.wanted) {
            (QUANTITIES[*number].1)(world, &mut column.values);
        }
    }

    /// An empty column with room for all rows.
    fn column(&self, number: usize, world: &World) -> Column {
        let (name, read) = QUANTITIES[number];
        let mut row = Vec::new();
        read(world, &mut row);
        Column { name, width: row.len(), values: Vec::with_capacity(self.rows * row.len()) }
    }
}
