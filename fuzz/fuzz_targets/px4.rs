//! Any bytes on the line of a PX4: no panic, and whatever is read is written back as it was read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tilthex_link::px4::{
    ActuatorMotors, AGENT, BatteryStatus, CLIENT, Decoder, EscStatus, MAX_MESSAGE, Message, OffboardControlMode,
    SensorCombined, TopicMessage, VehicleCommand, VehicleStatus, encode,
};

fn again<T: TopicMessage>(data: &[u8]) {
    if let Some(message) = T::read(data) {
        assert!(message.write(&mut [0; 512]) > 0);
    }
}

fuzz_target!(|bytes: &[u8]| {
    let mut decoder = Decoder::new(AGENT);
    for &byte in bytes {
        let Some(message) = decoder.push(byte).map(<[u8]>::to_vec) else { continue };
        let mut wire = vec![0; 2 * MAX_MESSAGE + 13];
        let length = encode(CLIENT, AGENT, &message, &mut wire);
        let mut other = Decoder::new(AGENT);
        let read: Vec<Vec<u8>> =
            wire[..length].iter().filter_map(|byte| other.push(*byte).map(<[u8]>::to_vec)).collect();
        assert_eq!(read, [message]);
    }
    // The framing's CRC keeps most bytes out: what is behind it gets them directly, too.
    if let Some(message) = Message::parse(bytes) {
        message.from_client().for_each(drop);
        message.from_agent().for_each(drop);
    }
    again::<SensorCombined>(bytes);
    again::<EscStatus>(bytes);
    again::<BatteryStatus>(bytes);
    again::<VehicleStatus>(bytes);
    again::<ActuatorMotors>(bytes);
    again::<OffboardControlMode>(bytes);
    again::<VehicleCommand>(bytes);
});
