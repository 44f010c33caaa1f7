//! The blocks as C sees them: structs of fixed size, whose first word says what they hold.

use crate::status::TilthexStatus;
use core::mem::{align_of, size_of};
use tilthex_core::{
    admittance::{AdmittanceFilter, AdmittanceState},
    allocation::{Allocator, AllocatorState},
    controller::{Controller, ControllerState},
    estimator::Estimator,
    plant::{Plant, PlantState},
    types::Wrench,
    wrench_observer::{WrenchObserver, WrenchObserverState},
};

/// Words of 8 bytes of a `TilthexObserver`.
pub const TILTHEX_OBSERVER_WORDS: usize = 160;
/// Words of 8 bytes of a `TilthexAdmittance`.
pub const TILTHEX_ADMITTANCE_WORDS: usize = 900;
/// Words of 8 bytes of a `TilthexAllocator`.
pub const TILTHEX_ALLOCATOR_WORDS: usize = 450;
/// Words of 8 bytes of a `TilthexController`.
pub const TILTHEX_CONTROLLER_WORDS: usize = 3600;
/// Words of 8 bytes of a `TilthexEstimator`.
pub const TILTHEX_ESTIMATOR_WORDS: usize = 5000;
/// Words of 8 bytes of a `TilthexPlant`.
pub const TILTHEX_PLANT_WORDS: usize = 560;

/// The wrench observer of a vehicle, and its state. Its memory belongs to the caller, and it can be copied.
#[repr(C)]
pub struct TilthexObserver {
    /// Not for the caller.
    words: [u64; TILTHEX_OBSERVER_WORDS],
}

/// An admittance filter, and its state. Its memory belongs to the caller, and it can be copied.
#[repr(C)]
pub struct TilthexAdmittance {
    /// Not for the caller.
    words: [u64; TILTHEX_ADMITTANCE_WORDS],
}

/// The allocator of a vehicle, and its state. Its memory belongs to the caller, and it can be copied.
#[repr(C)]
pub struct TilthexAllocator {
    /// Not for the caller.
    words: [u64; TILTHEX_ALLOCATOR_WORDS],
}

/// The controller of a vehicle, and its state. Its memory belongs to the caller, and it can be copied.
#[repr(C)]
pub struct TilthexController {
    /// Not for the caller.
    words: [u64; TILTHEX_CONTROLLER_WORDS],
}

/// An estimator. Its memory belongs to the caller, and it can be copied.
#[repr(C)]
pub struct TilthexEstimator {
    /// Not for the caller.
    words: [u64; TILTHEX_ESTIMATOR_WORDS],
}

/// A simulated vehicle. Its memory belongs to the caller, and it can be copied.
#[repr(C)]
pub struct TilthexPlant {
    /// Not for the caller.
    words: [u64; TILTHEX_PLANT_WORDS],
}

/// A plant, its state, and the wrench at its tool in the last step, world.
#[derive(Clone, Copy)]
pub(crate) struct Flown {
    pub(crate) plant: Plant,
    pub(crate) state: PlantState,
    pub(crate) wrench_tool_w: Wrench,
}

/// Memory for one block.
pub(crate) trait Block {
    /// What it holds; it needs no destructor.
    type Content: Copy;
    /// The first word of a block that holds it.
    const TAG: u64;
}

macro_rules! blocks {
    ($($block:ident: $content:ty, $tag:literal;)*) => {$(
        impl Block for $block {
            type Content = $content;
            const TAG: u64 = u64::from_le_bytes(*$tag);
        }
        // If the content has grown, give the block more words.
        const _: () = assert!(
            size_of::<$content>() + 8 <= size_of::<$block>() && align_of::<$content>() <= align_of::<$block>()
        );
    )*};
}
blocks! {
    TilthexObserver: (WrenchObserver, WrenchObserverState), b"tilthobs";
    TilthexAdmittance: (AdmittanceFilter, AdmittanceState), b"tilthadm";
    TilthexAllocator: (Allocator, AllocatorState), b"tilthall";
    TilthexController: (Controller, ControllerState), b"tilthctl";
    TilthexEstimator: Estimator, b"tilthest";
    TilthexPlant: Flown, b"tilthpla";
}

/// Fills a block.
///
/// # Safety
/// The pointer is null, or points to a block.
pub(crate) unsafe fn fill<B: Block>(block: *mut B, content: &B::Content) -> Result<(), TilthexStatus> {
    if block.is_null() {
        return Err(TilthexStatus::Null);
    }
    let tag = block.cast::<u64>();
    // SAFETY: the block is valid, and has room and alignment for the tag and its content after it.
    unsafe {
        tag.write(B::TAG);
        tag.add(1).cast::<B::Content>().write(*content);
    }
    Ok(())
}

/// The content of a block that is initialised.
///
/// # Safety
/// The pointer is null, or points to a block that nothing else uses meanwhile.
pub(crate) unsafe fn content<'a, B: Block>(block: *mut B) -> Result<&'a mut B::Content, TilthexStatus> {
    if block.is_null() {
        return Err(TilthexStatus::Null);
    }
    let tag = block.cast::<u64>();
    // SAFETY: the block is valid; with this tag, `fill` has written its content.
    unsafe {
        if tag.read() != B::TAG {
            return Err(TilthexStatus::NotReady);
        }
        Ok(&mut *tag.add(1).cast::<B::Content>())
    }
}

/// Reads what a pointer names.
///
/// # Safety
/// The pointer is null or valid.
pub(crate) unsafe fn read<T: Copy>(from: *const T) -> Result<T, TilthexStatus> {
    if from.is_null() {
        return Err(TilthexStatus::Null);
    }
    // SAFETY: not null, and then valid.
    Ok(unsafe { from.read() })
}

/// Writes where a pointer points to.
///
/// # Safety
/// The pointer is null or valid.
pub(crate) unsafe fn write<T>(to: *mut T, value: T) -> Result<(), TilthexStatus> {
    if to.is_null() {
        return Err(TilthexStatus::Null);
    }
    // SAFETY: not null, and then valid.
    unsafe { to.write(value) };
    Ok(())
}
