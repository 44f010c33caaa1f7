//! Any bytes of a VRPN connection: no panic, and whatever is read is written back as it was read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tilthex_mocap::vrpn::{COOKIE, Decoder, MAX_MESSAGE, check_cookie, write_message};

fuzz_target!(|bytes: &[u8]| {
    if let Some(cookie) = bytes.first_chunk::<{ COOKIE.len() }>() {
        let _ = check_cookie(cookie);
    }
    let mut decoder = Decoder::default();
    for &byte in bytes {
        let Ok(Some(message)) = decoder.push(byte) else { continue };
        let _ = (message.pose(), message.description(), message.seconds());
        let mut wire = [0; MAX_MESSAGE + 8];
        let length = write_message(&mut wire, &message, 0);
        assert!(length > 0 && length % 8 == 0);
        let mut again = Decoder::default();
        let (last, first) = wire[..length].split_last().expect("a header at least");
        assert!(first.iter().all(|&byte| again.push(byte) == Ok(None)));
        assert_eq!(again.push(*last), Ok(Some(message)));
    }
});
