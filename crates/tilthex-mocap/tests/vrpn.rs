//! The VRPN codec: a recorded header, round trips, hostile bytes.

#![allow(clippy::unwrap_used)]

use proptest::{collection::vec, prelude::*};
use tilthex_mocap::vrpn::{
    COOKIE, Decoder, Description, MAX_MESSAGE, Message, TrackerPose, check_cookie, write_description,
    write_message, write_pose,
};

/// A message with its own payload.
type Owned = ((u32, u32), i32, i32, Vec<u8>);

fn decode(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Owned> {
    let mut found = Vec::new();
    for &byte in bytes {
        if let Ok(Some(message)) = decoder.push(byte) {
            found.push((message.time, message.sender, message.kind, message.payload.to_vec()));
        }
    }
    found
}

fn borrow((time, sender, kind, payload): &Owned) -> Message<'_> {
    Message { time: *time, sender: *sender, kind: *kind, payload }
}

fn encode(message: &Owned) -> Vec<u8> {
    let mut out = [0; 1024];
    let length = write_message(&mut out, &borrow(message), 1);
    out[..length].to_vec()
}

#[test]
fn the_published_header() {
    let header = [0x58, 0x6b02_ec48, 0x136, 1, 4, 0x18_u32].map(u32::to_be_bytes).concat();
    let pose = TrackerPose { sensor: 0, position: [1.0, 2.0, 3.0], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] };
    let mut out = [0; MAX_MESSAGE];
    let length = write_pose(&mut out, (1, 4), (0x6b02_ec48, 0x136), &pose, 0x18);
    assert_eq!((length, &out[..24]), (88, &header[..]));
    let messages = decode(&mut Decoder::default(), &out[..length]);
    assert_eq!(borrow(&messages[0]).pose(), Ok(pose));
}

#[test]
fn cookies() {
    assert_eq!(COOKIE.len(), 24);
    assert!(check_cookie(&COOKIE).is_ok());
    assert!(check_cookie(b"vrpn: ver. 07.20  3\0\0\0\0\0").is_ok());
    assert!(check_cookie(b"vrpn: ver. 06.04  0\0\0\0\0\0").is_err());
    assert!(check_cookie(b"HTTP/1.1 400 Bad Request").is_err());
}

#[test]
fn a_stream_of_something_else_is_noticed() {
    let mut decoder = Decoder::default();
    assert!(b"HTTP/1.1 400 Bad Request".iter().any(|&byte| decoder.push(byte).is_err()));
}

fn message() -> impl Strategy<Value = Owned> {
    (any::<(u32, u32)>(), any::<i32>(), any::<i32>(), vec(any::<u8>(), 0..MAX_MESSAGE - 24))
}

proptest! {
    #[test]
    fn messages_round_trip(messages in vec(message(), 1..5)) {
        let bytes: Vec<u8> = messages.iter().flat_map(encode).collect();
        prop_assert_eq!(bytes.len() % 8, 0);
        prop_assert_eq!(decode(&mut Decoder::default(), &bytes), messages);
    }

    #[test]
    fn long_messages_are_skipped(long in MAX_MESSAGE - 24 + 1..900, after in message()) {
        let bytes = [encode(&((0, 0), 1, 1, vec![7; long])), encode(&after)].concat();
        let mut decoder = Decoder::default();
        prop_assert_eq!(decode(&mut decoder, &bytes), vec![after]);
        prop_assert_eq!(decoder.skipped(), 1);
    }

    #[test]
    fn names_round_trip(id in any::<i32>(), name in vec(1..=255_u8, 0..99), is_type in any::<bool>()) {
        let description =
            if is_type { Description::Type(id, &name) } else { Description::Sender(id, &name) };
        let mut out = [0; MAX_MESSAGE];
        let length = write_description(&mut out, &description, 0);
        let messages = decode(&mut Decoder::default(), &out[..length]);
        prop_assert_eq!(borrow(&messages[0]).description(), Some(description));
    }

    #[test]
    fn poses_of_any_other_length_are_refused(message in message()) {
        let is_pose = borrow(&message).pose().is_ok();
        prop_assert_eq!(is_pose, message.3.len() == 64);
    }

    #[test]
    fn random_bytes_never_panic(bytes in vec(prop_oneof![3 => Just(0_u8), 1 => any::<u8>()], 0..2000)) {
        for message in decode(&mut Decoder::default(), &bytes) {
            let message = borrow(&message);
            prop_assert!(message.payload.len() <= MAX_MESSAGE);
            let _ = (message.description(), message.pose(), message.seconds());
        }
    }
}
