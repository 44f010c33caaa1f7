//! What a simulation records.

use tilthex_core::{
    Matrix3,
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

/// The names of all recorded quantities.
pub const NAMES: [&str; 29] = [
    "time",
    "position",
    "velocity",
    "rotation",
    "angular_velocity",
    "tool_position",
    "tool_rotation",
    "estimated_position",
    "estimated_velocity",
    "estimated_rotation",
    "setpoint_position",
    "setpoint_rotation",
    "reference_position",
    "reference_rotation",
    "position_error",
    "rotation_error",
    "wrench_robot",
    "wrench_tool",
    "wrench_contact",
    "wind",
    "contact_likelihood",
    "wrench_true",
    "rotor_speeds",
    "rotor_command",
    "gyro",
    "specific_force",
    "measured_rotor_speeds",
    "saturated",
    "phase",
];

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
    /// Which of [`NAMES`] are recorded.
    wanted: [bool; NAMES.len()],
    /// The next quantity of this row, and the next recorded column.
    next: (usize, usize),
    faults: Vec<FaultChange>,
    active: FaultSet,
}

impl Record {
    /// An empty record of the wanted quantities with room for `rows` rows.
    pub(super) fn new(rows: usize, wanted: impl Fn(&str) -> bool) -> Self {
        Self { rows, wanted: NAMES.map(wanted), ..Self::default() }
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

    /// Whether any quantity is recorded.
    pub(super) fn is_wanted(&self) -> bool {
        self.wanted.contains(&true)
    }

    /// Adds a row to the next column, if it is recorded. Every row adds to the columns in the order of [`NAMES`].
    pub(super) fn put(&mut self, name: &'static str, row: &[f64]) {
        let (number, column) = self.next;
        debug_assert_eq!(NAMES[number], name, "the order of the names");
        self.next.0 += 1;
        if !self.wanted[number] {
            return;
        }
        if column == self.columns.len() {
            let values = Vec::with_capacity(self.rows * row.len());
            self.columns.push(Column { name, width: row.len(), values });
        }
        self.columns[column].values.extend_from_slice(row);
        self.next.1 += 1;
    }

    /// Adds a matrix to the next column, row by row.
    pub(super) fn put_matrix(&mut self, name: &'static str, m: &Matrix3) {
        self.put(name, m.transpose().as_slice());
    }

    pub(super) fn end_row(&mut self) {
        self.next = (0, 0);
    }
}
