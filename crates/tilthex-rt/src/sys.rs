//! System calls for which no safe library exists.
#![allow(unsafe_code)]

use std::{
    io,
    mem::{self, MaybeUninit},
    os::fd::{AsRawFd, BorrowedFd, FromRawFd, IntoRawFd, OwnedFd},
};

/// Gives the calling thread the policy `SCHED_FIFO`. Its priority is the middle of the range plus `offset`.
///
/// # Errors
/// Errors of the kernel, usually a missing right.
pub(crate) fn set_fifo(offset: i32) -> io::Result<()> {
    // SAFETY: the arguments are integers and a pointer to an initialised structure that lives during the call.
    let status = unsafe {
        let mut parameter: libc::sched_param = mem::zeroed();
        let (low, high) =
            (libc::sched_get_priority_min(libc::SCHED_FIFO), libc::sched_get_priority_max(libc::SCHED_FIFO));
        parameter.sched_priority = (low + high) / 2 + offset;
        libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter)
    };
    if status == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Makes the program ignore a signal.
///
/// # Errors
/// Errors of the kernel.
pub(crate) fn ignore(signal: libc::c_int) -> io::Result<()> {
    // SAFETY: `SIG_IGN` is valid for every signal. The kernel returns an error for those that it does not allow.
    match unsafe { libc::signal(signal, libc::SIG_IGN) } {
        libc::SIG_ERR => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}

/// The descriptor of an open port. It becomes the only owner of the port.
pub(crate) fn descriptor(port: serialport::TTYPort) -> OwnedFd {
    // SAFETY: `into_raw_fd` gives up the port's own descriptor, which is open and has no other owner.
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

/// Asks a serial driver to pass on each byte at once.
///
/// # Errors
/// Errors of the kernel: `ENOTTY` and `EINVAL` if the driver does not support it.
pub(crate) fn set_low_latency(port: BorrowedFd<'_>) -> io::Result<()> {
    let mut serial = MaybeUninit::<SerialStruct>::zeroed();
    // SAFETY: both calls get a structure that lives during the call and has the expected layout. All zeros are valid.
    let status = unsafe {
        if libc::ioctl(port.as_raw_fd(), libc::TIOCGSERIAL, serial.as_mut_ptr()) != 0 {
            return Err(io::Error::last_os_error());
        }
        (*serial.as_mut_ptr()).flags |= ASYNC_LOW_LATENCY;
        libc::ioctl(port.as_raw_fd(), libc::TIOCSSERIAL, serial.as_ptr())
    };
    if status == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}
