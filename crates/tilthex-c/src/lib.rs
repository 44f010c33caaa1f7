//! The blocks of tilthex for programs in C: vehicle, wrench observer, admittance filter, allocator, the whole
//! controller, the estimator, and a simulated vehicle to fly against.
//!
//! `include/tilthex.h` is the header; a test writes it from these files. A block is a struct of fixed size that the
//! caller owns (static, on the stack, or on the heap): `..._init` checks the parameters and fills it, `..._step` changes
//! it. Nothing is allocated, and no function keeps a pointer. Different blocks can be used by different threads.
//!
//! # Safety
//! Every pointer is null or points to a valid object of its type. A null pointer, or a block whose `..._init` did not
//! succeed and whose memory is zero, is refused with a status.
#![cfg_attr(not(feature = "std"), no_std)]
#![allow(unsafe_code)]
#![allow(
    clippy::missing_safety_doc,
    reason = "the rule is the same for all functions: the crate's documentation"
)]

mod block;
mod control;
mod estimate;
mod numbers;
mod plant;
mod status;
mod vehicle;

pub use block::{
    TILTHEX_ADMITTANCE_WORDS, TILTHEX_ALLOCATOR_WORDS, TILTHEX_CONTROLLER_WORDS, TILTHEX_ESTIMATOR_WORDS,
    TILTHEX_OBSERVER_WORDS, TILTHEX_PLANT_WORDS, TilthexAdmittance, TilthexAllocator, TilthexController,
    TilthexEstimator, TilthexObserver, TilthexPlant,
};
pub use control::*;
pub use estimate::*;
pub use numbers::*;
pub use plant::*;
pub use status::{TILTHEX_MESSAGE_LENGTH, TilthexMessage, TilthexStatus, tilthex_status_text};
pub use vehicle::*;

/// Without an operating system, a panic is the program's to handle. The step functions have none.
#[cfg(not(feature = "std"))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    unsafe extern "C" {
        fn tilthex_panic() -> !;
    }
    // SAFETY: the program defines it, and it does not return.
    unsafe { tilthex_panic() }
}
