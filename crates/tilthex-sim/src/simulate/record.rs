//! What a simulation records.

use tilthex_core::Matrix3;

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

/// The recorded quantities of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    columns: Vec<Column>,
    rows: usize,
    next: usize,
}

impl Record {
    /// An empty record with room for `rows` rows.
    pub(super) fn with_rows(rows: usize) -> Self {
        Self { rows, ..Self::default() }
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

    /// Adds a row to the next column. Every row adds to the same columns in the same order.
    pub(super) fn put(&mut self, name: &'static str, row: &[f64]) {
        if self.next == self.columns.len() {
            let values = Vec::with_capacity(self.rows * row.len());
            self.columns.push(Column { name, width: row.len(), values });
        }
        self.columns[self.next].values.extend_from_slice(row);
        self.next += 1;
    }

    /// Adds a matrix to the next column, row by row.
    pub(super) fn put_matrix(&mut self, name: &'static str, m: &Matrix3) {
        self.put(name, m.transpose().as_slice());
    }

    pub(super) fn end_row(&mut self) {
        self.next = 0;
    }
}
