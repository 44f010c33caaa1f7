//! Replays a recorded flight on a Cortex-M7 under QEMU: writes the outputs to a file, and prints the instructions of each
//! part, and the memory.
#![allow(unsafe_code)]

mod machine;

use core::{fmt::Write, mem::MaybeUninit, panic::PanicInfo};
use machine::{Console, File, Stack, exit, instructions};
use tilthex_core::{Matrix3, Vector3};
use tilthex_onboard::{Chain, INPUT_WORDS, Input, OUTPUT_WORDS, PARTS, PERIOD};

/// Static, as in a firmware: it does not count as stack.
static mut CHAIN: MaybeUninit<Chain> = MaybeUninit::uninit();

/// Instructions of one part over the flight.
#[derive(Clone, Copy, Default)]
struct Count {
    sum: u64,
    largest: u32,
    /// The tick of the largest, from 1.
    at: u32,
}

impl Count {
    fn add(&mut self, count: u32, tick: u32) {
        self.sum += u64::from(count);
        if count > self.largest {
            (self.largest, self.at) = (count, tick);
        }
    }
}

/// A row of the table.
fn row(console: &mut Console, name: &str, count: &Count, ticks: u32) {
    let (mean, at) = (count.sum / u64::from(ticks.max(1)), PERIOD * f64::from(count.at));
    let _ = writeln!(console, "{name:22} {mean:>10} {:>10} {at:>9.3}", count.largest);
}

/// Reads the numbers of one tick; false at the end of the flight.
fn read(file: &File, words: &mut [f64; INPUT_WORDS]) -> bool {
    let mut bytes = [[0; 8]; INPUT_WORDS];
    let complete = file.read(bytes.as_flattened_mut());
    for (word, bytes) in words.iter_mut().zip(bytes) {
        *word = f64::from_le_bytes(bytes);
    }
    complete
}

fn write(file: &File, words: &[f64; OUTPUT_WORDS]) -> bool {
    file.write(words.map(f64::to_le_bytes).as_flattened())
}

fn replay(console: &mut Console) -> Result<(), &'static str> {
    let flight = File::read_from(c"flight.bin").ok_or("flight.bin is missing")?;
    let board = File::write_to(c"board.bin").ok_or("board.bin cannot be written")?;
    let stack = Stack::paint();
    let (start_w, level) = (Vector3::new(0.0, 0.0, 1.0), Matrix3::identity());
    let made = Chain::new(&start_w, &level).map_err(|_| "the parameters are refused")?;
    // SAFETY: nothing else uses the static.
    let chain = unsafe { (*(&raw mut CHAIN)).write(made) };
    let begin = stack.used();

    let stack = Stack::paint();
    let (mut counts, mut tick, mut ticks) = ([Count::default(); PARTS.len()], Count::default(), 0);
    let mut words = [0.0; INPUT_WORDS];
    while read(&flight, &mut words) {
        let input = Input::from_words(&words);
        let mut found = [0; PARTS.len()];
        let output = chain.tick(&input, &mut |part, run| {
            let count = instructions(run);
            if let Some(place) = found.get_mut(part) {
                *place = count;
            }
        });
        ticks += 1;
        counts.iter_mut().zip(found).for_each(|(count, found)| count.add(found, ticks));
        tick.add(found.iter().take(2).sum(), ticks);
        if !write(&board, &chain.words(&output)) {
            return Err("board.bin cannot be written");
        }
    }
    let used = stack.used();

    let _ = writeln!(console, "instructions                 mean    largest  at (s)");
    row(console, "a tick", &tick, ticks);
    PARTS.iter().zip(&counts).for_each(|(name, count)| row(console, name, count, ticks));
    let state = size_of::<Chain>();
    let estimator = size_of_val(chain.estimator());
    let _ = writeln!(console, "\nmemory, bytes");
    let _ = writeln!(console, "state of all blocks    {state:>10} (estimator {estimator})");
    let _ = writeln!(console, "stack of the ticks     {used:>10}");
    let _ = writeln!(console, "stack of the start     {begin:>10}");
    let _ = writeln!(console, "\n{ticks} ticks, no panic, no fault");
    Ok(())
}

/// Called by `reset`.
#[unsafe(no_mangle)]
extern "C" fn board_main() -> ! {
    let mut console = Console;
    let known = machine::KNOWN_INSTRUCTIONS;
    let counted = instructions(machine::known_instructions);
    if counted.abs_diff(known) > 8 {
        let _ = writeln!(
            console,
            "{counted} instructions were counted; expected {known}: start QEMU with -icount shift=6"
        );
        exit(1);
    }
    match replay(&mut console) {
        Ok(()) => exit(0),
        Err(sentence) => {
            let _ = writeln!(console, "{sentence}");
            exit(1)
        }
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let _ = writeln!(Console, "{info}");
    exit(101)
}
