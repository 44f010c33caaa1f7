//! Any bytes on the vehicle's line: no panic, and whatever is read is written back as it was read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tilthex_link::tk3::{Decoder, Frame, HostMessage, MAX_FRAME, Message, VehicleMessage};

fuzz_target!(|bytes: &[u8]| {
    let mut decoder = Decoder::default();
    let mut frames = 0;
    for &byte in bytes {
        let Some(frame) = decoder.push(byte) else { continue };
        frames += 1;
        let mut wire = [0; MAX_FRAME];
        let length = frame.encode(&mut wire);
        let mut again = Decoder::default();
        let read: Vec<Frame> = wire[..length].iter().filter_map(|&byte| again.push(byte)).collect();
        assert_eq!(read, [frame]);
        if let Ok(message) = HostMessage::parse(frame.body()) {
            assert_eq!(message.frame(), frame);
        }
        if let Ok(message) = VehicleMessage::parse(frame.body()) {
            assert_eq!(message.frame(), frame);
            let _ = format!("{message:?}");
        }
    }
    // Every frame has its own end mark.
    assert!(frames <= bytes.iter().filter(|&&byte| byte == b'$').count());
    assert_eq!(decoder.counters().whole as usize, frames);
});
