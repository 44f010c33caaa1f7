//! The machine: start, semihosting, the counter of instructions, the painted stack.

use core::{
    arch::{asm, global_asm},
    ffi::CStr,
    fmt,
    ptr::{read_volatile, write_volatile},
};

global_asm!(
    ".section .vectors, \"a\"",
    ".word stack_high",
    ".word reset",
    ".rept 14",
    ".word fault",
    ".endr",
    ".text",
    ".thumb_func",
    ".global reset",
    "reset:",
    // The floating-point unit: full access to coprocessors 10 and 11.
    "ldr r0, =0xE000ED88",
    "ldr r1, [r0]",
    "orr r1, r1, #0xF00000",
    "str r1, [r0]",
    "dsb",
    "isb",
    "bl board_main",
    ".thumb_func",
    ".global fault",
    "fault:",
    "bl board_fault",
);

unsafe extern "C" {
    static mut stack_low: u32;
}

/// Called by every exception.
#[unsafe(no_mangle)]
extern "C" fn board_fault() -> ! {
    Console::print(c"a fault of the processor\n");
    exit(102)
}

/// One request to the host.
fn request(operation: u32, argument: *const u32) -> u32 {
    let answer;
    // SAFETY: the semihosting call; the arguments are those of its operation.
    unsafe {
        asm!("bkpt 0xab", inlateout("r0") operation => answer, in("r1") argument, options(nostack));
    }
    answer
}

/// The address of an object as the host takes it; the target has 32 bits.
fn address<T: ?Sized>(object: &T) -> u32 {
    (&raw const *object).cast::<u8>() as usize as u32
}

/// Ends the program with a status.
pub(super) fn exit(status: u32) -> ! {
    const APPLICATION_EXIT: u32 = 0x20026;
    loop {
        request(0x20, [APPLICATION_EXIT, status].as_ptr());
    }
}

/// The host's terminal.
pub(super) struct Console;

impl Console {
    fn print(text: &CStr) {
        request(0x04, text.as_ptr().cast());
    }
}

impl fmt::Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            request(0x03, (&raw const byte).cast());
        }
        Ok(())
    }
}

/// A file of the host.
pub(super) struct File(u32);

impl File {
    fn open(name: &CStr, mode: u32) -> Option<Self> {
        let handle = request(0x01, [name.as_ptr() as u32, mode, name.count_bytes() as u32].as_ptr());
        (handle != u32::MAX).then_some(Self(handle))
    }

    pub(super) fn read_from(name: &CStr) -> Option<Self> {
        Self::open(name, 1)
    }

    pub(super) fn write_to(name: &CStr) -> Option<Self> {
        Self::open(name, 5)
    }

    /// Whether all bytes were read.
    pub(super) fn read(&self, bytes: &mut [u8]) -> bool {
        request(0x06, [self.0, address(bytes), bytes.len() as u32].as_ptr()) == 0
    }

    /// Whether all bytes were written.
    pub(super) fn write(&self, bytes: &[u8]) -> bool {
        request(0x05, [self.0, address(bytes), bytes.len() as u32].as_ptr()) == 0
    }
}

/// The system timer of the processor: 24 bits, downwards, 25 MHz on this board.
const TIMER: *mut u32 = 0xE000_E010 as *mut u32;
const TIMER_MASK: u32 = 0xFF_FFFF;

fn timer() -> u32 {
    // SAFETY: the register of the count.
    unsafe { read_volatile(TIMER.add(2)) }
}

/// The instructions of a function. With `-icount shift=6` an instruction takes 64 ns, and the timer counts 40 ns. At most
/// 10 million, within one instruction.
pub(super) fn instructions(mut run: impl FnMut()) -> u32 {
    // SAFETY: the registers of the timer: reload value, count, control (on, without interrupt, the processor's clock).
    unsafe {
        write_volatile(TIMER.add(1), TIMER_MASK);
        write_volatile(TIMER.add(2), 0);
        write_volatile(TIMER, 0b101);
    }
    let begin = timer();
    run();
    let ticks = begin.wrapping_sub(timer()) & TIMER_MASK;
    ticks * 5 / 8
}

/// Instructions of [`known_instructions`], which the counter must find.
pub(super) const KNOWN_INSTRUCTIONS: u32 = 1000;

/// 1000 instructions.
pub(super) fn known_instructions() {
    // SAFETY: they do nothing.
    unsafe { asm!(".rept 1000", "nop", ".endr") };
}

/// The part of the stack below the caller, painted.
pub(super) struct Stack {
    from: usize,
}

impl Stack {
    const PAINT: u32 = 0xC0DE_CAFE;

    /// Paints what lies below this call, and remembers where the caller's stack ends.
    #[inline(never)]
    pub(super) fn paint() -> Self {
        let here: usize;
        // SAFETY: reads a register.
        unsafe { asm!("mov {}, sp", out(reg) here) };
        let mut place = &raw mut stack_low;
        while (place as usize) < here {
            // SAFETY: below the stack pointer nothing is in use.
            unsafe {
                write_volatile(place, Self::PAINT);
                place = place.add(1);
            }
        }
        Self { from: here }
    }

    /// Bytes from there down to the lowest that has changed.
    pub(super) fn used(&self) -> usize {
        let mut place = &raw const stack_low;
        // SAFETY: within the stack.
        while unsafe { read_volatile(place) } == Self::PAINT && (place as usize) < self.from {
            place = unsafe { place.add(1) };
        }
        self.from - place as usize
    }
}
