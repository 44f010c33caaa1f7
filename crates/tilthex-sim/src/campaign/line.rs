//! Faults of the line to the vehicle.

use tilthex_link::tk3::{MAX_FRAME, Receiver, VehicleMessage};

use super::{Injection, acts::Bytes};
use crate::Micros;

/// One bit is flipped in some of the bytes.
pub(super) fn flip_bits(fault: &Injection, line: &mut Bytes<'_>) {
    let every = fault.between(20.0, 2000.0);
    for byte in line.bytes.iter_mut() {
        if line.random.uniform() * every < 1.0 {
            *byte ^= 1 << (line.random.bits() % 8);
        }
    }
}

/// All bytes are lost.
pub(super) fn silence(_: &Injection, line: &mut Bytes<'_>) {
    line.bytes.clear();
}

/// Some frames are lost.
pub(super) fn lose(fault: &Injection, line: &mut Bytes<'_>) {
    each_frame(fault, line, |_, hit, frame, out| {
        if !hit {
            out.extend_from_slice(frame);
        }
    });
}

/// Some frames arrive twice.
pub(super) fn duplicate(fault: &Injection, line: &mut Bytes<'_>) {
    each_frame(fault, line, |_, hit, frame, out| {
        out.extend_from_slice(frame);
        if hit {
            out.extend_from_slice(frame);
        }
    });
}

/// Some frames arrive incomplete.
pub(super) fn cut(fault: &Injection, line: &mut Bytes<'_>) {
    each_frame(fault, line, |draw, hit, frame, out| {
        let whole = frame.len();
        let kept = if hit { (draw % whole as u64) as usize } else { whole };
        out.extend_from_slice(&frame[..kept]);
    });
}

/// Frames arrive in another order.
pub(super) fn reorder(_: &Injection, line: &mut Bytes<'_>) {
    let mut parts = frames(line.bytes);
    for i in (1..parts.len()).rev() {
        parts.swap(i, (line.random.bits() % (i as u64 + 1)) as usize);
    }
    *line.bytes = parts.concat();
}

/// Random bytes between the frames.
pub(super) fn garbage(fault: &Injection, line: &mut Bytes<'_>) {
    if line.random.uniform() < 0.1 {
        let count = (300.0 * fault.strength * line.random.uniform()) as usize;
        line.bytes.extend((0..count).map(|_| line.random.bits() as u8));
    }
}

/// All bytes arrive late.
pub(super) fn delay(fault: &Injection, line: &mut Bytes<'_>) {
    let delay = (1e3 * fault.between(5.0, 60.0)) as Micros;
    line.held.push_back((line.now + delay, std::mem::take(line.bytes)));
    while line.held.front().is_some_and(|(due, _)| *due <= line.now) {
        line.bytes.extend(line.held.pop_front().into_iter().flat_map(|(_, bytes)| bytes));
    }
}

/// The IMU repeats a sample, with new sequence numbers.
pub(super) fn freeze_imu(_: &Injection, line: &mut Bytes<'_>) {
    let first = &mut *line.imu;
    *line.bytes = altered(line.bytes, |message| {
        if let VehicleMessage::Imu(frame) = message {
            let sequence = frame.sequence;
            *frame = *first.get_or_insert(*frame);
            frame.sequence = sequence;
        }
    });
}

/// The measured speed of one rotor is zero.
pub(super) fn zero_speed(fault: &Injection, line: &mut Bytes<'_>) {
    let hit = fault.rotor(line.rotors) as u8 + 1;
    *line.bytes = altered(line.bytes, |message| {
        if let VehicleMessage::Motor(frame) = message
            && frame.state.motor() == hit
        {
            frame.half_period = i16::MAX;
            frame.throttle = 0;
        }
    });
}

/// The messages in some bytes, after a change of each. Bytes that are no message are removed.
fn altered(bytes: &[u8], mut change: impl FnMut(&mut VehicleMessage)) -> Vec<u8> {
    let mut receiver = Receiver::<VehicleMessage>::default();
    let mut out = Vec::with_capacity(bytes.len());
    for mut message in bytes.iter().filter_map(|&byte| receiver.push(byte)) {
        change(&mut message);
        let mut frame = [0; MAX_FRAME];
        let length = message.encode(&mut frame);
        out.extend_from_slice(&frame[..length]);
    }
    out
}

/// Calls `pass` for each frame, with a random number and whether the fault hits the frame.
fn each_frame(fault: &Injection, line: &mut Bytes<'_>, pass: impl Fn(u64, bool, &[u8], &mut Vec<u8>)) {
    let mut out = Vec::with_capacity(line.bytes.len());
    for frame in frames(line.bytes) {
        let hit = line.random.uniform() < fault.between(0.05, 1.0);
        pass(line.random.bits(), hit, frame, &mut out);
    }
    *line.bytes = out;
}

/// The frames in some bytes, each from its mark to the next mark. Bytes before the first mark count as a frame.
fn frames(bytes: &[u8]) -> Vec<&[u8]> {
    let mut starts: Vec<_> = (0..bytes.len()).filter(|&i| i == 0 || bytes[i] == b'^').collect();
    starts.push(bytes.len());
    starts.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect()
}
