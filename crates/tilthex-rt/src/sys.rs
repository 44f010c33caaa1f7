//! The few system calls that no safe library wraps.
#![allow(unsafe_code)]

use std::{
    io,
    mem::{self, MaybeUninit},
    os::fd::{AsRawFd, BorrowedFd, FromRawFd, IntoRawFd, OwnedFd},
};

/// Gives the calling thread the policy `SCHED_FIFO`, `offset` away from the middle of its range.
///
/// # Errors
/// The kernel's, mostly a missing right.
pub(crate) fn set_fifo(offset: i32) -> io::Result<()> {
    // SAFETY: the calls take plain integers and a pointer to a live, initialised structure.
    let status = unsafe {
        let mut parameter: libc::sched_param = mem::zeroed();
        let (low, high) =
            (libc::sched_get_priority_min(libc::SCHED_FIFO), libc::sched_get_priority_max(libc::SCHED_FIFO));
        parameter.sched_priority = (low + high) / 2 + offset;
        libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter)
    };
    if status == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Has the program ignore a signal.
///
/// # Errors
/// The kernel's.
pub(crate) fn ignore(signal: libc::c_int) -> io::Result<()> {
    // SAFETY: `SIG_IGN` is a disposition that every signal takes but those that the kernel refuses.
    match unsafe { libc::signal(signal, libc::SIG_IGN) } {
        libc::SIG_ERR => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}

/// The descriptor of an open port, which then is the only owner of it.
pub(crate) fn descriptor(port: serialport::TTYPort) -> OwnedFd {
    // SAFETY: `into_raw_fd` gives up the port's own descriptor, which is open and belongs to nobody else.
    unsafe { OwnedFd::from_raw_fd(port.into_raw_fd()) }
}

/// The kernel's `struct serial_struct` (include/uapi/linux/tty.h).
#[repr(C)]
struct SerialStruct {
    kind: libc::c_int,
    line: libc::c_int,
    port: libc::c_uint,
    irq: libc::c_int,
    flags: libc::c_int,
    xmit_fifo_size: libc::c_int,
    custom_divisor: libc::c_int,
    baud_base: libc::c_int,
    close_delay: libc::c_ushort,
    io_type: libc::c_char,
    reserved_char: [libc::c_char; 1],
    hub6: libc::c_int,
    closing_wait: libc::c_ushort,
    closing_wait2: libc::c_ushort,
    iomem_base: *mut libc::c_uchar,
    iomem_reg_shift: libc::c_ushort,
    port_high: libc::c_uint,
    iomap_base: libc::c_ulong,
}

const ASYNC_LOW_LATENCY: libc::c_int = 1 << 13;

/// Asks a serial driver to hand each byte on at once.
///
/// # Errors
/// The kernel's; `ENOTTY` and `EINVAL` where the driver knows no such thing.
pub(crate) fn set_low_latency(port: BorrowedFd<'_>) -> io::Result<()> {
    let mut serial = MaybeUninit::<SerialStruct>::zeroed();
    // SAFETY: both calls are given a live structure of the layout they expect; all-zero is a valid one.
    let status = unsafe {
        if libc::ioctl(port.as_raw_fd(), libc::TIOCGSERIAL, serial.as_mut_ptr()) != 0 {
            return Err(io::Error::last_os_error());
        }
        (*serial.as_mut_ptr()).flags |= ASYNC_LOW_LATENCY;
        libc::ioctl(port.as_raw_fd(), libc::TIOCSSERIAL, serial.as_ptr())
    };
    if status == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}
