//! What a function answers: a status, and the sentence of a refusal.

use core::{
    ffi::{CStr, c_char},
    fmt::{self, Write},
};
use tilthex_core::{Error, estimator::StartError};

/// The answer of every function. Unless it is `TILTHEX_STATUS_OK`, the function has changed nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TilthexStatus {
    /// Done.
    Ok = 0,
    /// A pointer is null.
    Null = 1,
    /// The block has not been initialised.
    NotReady = 2,
    /// A parameter is not possible; the message says which, and what is expected.
    Refused = 3,
    /// A number is NaN or infinite, or would be in the result.
    NotFinite = 4,
    /// A matrix is not a rotation: its columns are not orthonormal within 1e-6, or its determinant is not +1.
    NotRotation = 5,
    /// The time of a step is not from 0 to 1 s.
    Period = 6,
}

/// The sentence of each status, in their order.
const SENTENCES: [&CStr; 7] = [
    c"done",
    c"a pointer is null; expected the address of an object",
    c"the block is not initialised; call its init function first, and look at its status",
    c"a parameter is not possible; the message of the function says which",
    c"a number is NaN or infinite, or would be in the result; expected finite numbers of usual size",
    c"a matrix is not a rotation; expected orthonormal columns with determinant +1",
    c"the time of a step is out of range; expected 0 to 1 s",
];

impl TilthexStatus {
    pub(crate) fn of(done: Result<(), Self>) -> Self {
        done.err().unwrap_or(Self::Ok)
    }
}

/// The sentence of a `TilthexStatus`: static, ends with a zero byte.
#[unsafe(no_mangle)]
pub extern "C" fn tilthex_status_text(status: i32) -> *const c_char {
    let found = usize::try_from(status).ok().and_then(|i| SENTENCES.get(i));
    found.map_or(c"not a status", |sentence| *sentence).as_ptr()
}

/// Bytes of a message, with its zero byte.
pub const TILTHEX_MESSAGE_LENGTH: usize = 400;

/// Why a parameter is refused, in one sentence that ends with a zero byte; empty if nothing is refused.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct TilthexMessage {
    /// ASCII.
    pub text: [c_char; TILTHEX_MESSAGE_LENGTH],
}

/// Writes into a message, and cuts what is too long.
struct Pen<'a> {
    text: &'a mut [c_char],
}

impl Write for Pen<'_> {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        for byte in part.bytes() {
            // The last place stays zero.
            let [place, rest @ ..] = core::mem::take(&mut self.text) else { return Ok(()) };
            if rest.is_empty() {
                return Ok(());
            }
            *place = c_char::from_ne_bytes([byte]);
            self.text = rest;
        }
        Ok(())
    }
}

/// Where a function writes the sentence of a refusal; null for nowhere.
pub(crate) struct Complaint(*mut TilthexMessage);

impl Complaint {
    /// Empties the message.
    ///
    /// # Safety
    /// The pointer is null or valid.
    pub(crate) unsafe fn to(message: *mut TilthexMessage) -> Self {
        let complaint = Self(message);
        complaint.write(format_args!(""));
        complaint
    }

    fn write(&self, sentence: fmt::Arguments<'_>) {
        let mut message = TilthexMessage { text: [0; TILTHEX_MESSAGE_LENGTH] };
        // A pen does not fail.
        let _ = Pen { text: &mut message.text }.write_fmt(sentence);
        if !self.0.is_null() {
            // SAFETY: not null, and then valid by the contract of `to`.
            unsafe { self.0.write(message) };
        }
    }

    /// The status of a refusal, whose sentence is written.
    pub(crate) fn refused(&self, error: impl fmt::Display) -> TilthexStatus {
        self.write(format_args!("{error}"));
        TilthexStatus::Refused
    }

    pub(crate) fn check<T>(&self, done: Result<T, Error>) -> Result<T, TilthexStatus> {
        done.map_err(|error| self.refused(error))
    }

    pub(crate) fn check_start(&self, done: Result<(), StartError>) -> Result<(), TilthexStatus> {
        done.map_err(|error| self.refused(error))
    }
}
