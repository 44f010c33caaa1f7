//! Any datagram as a NatNet packet of any version: no panic, no endless list,
//! and what the builders can write of a frame is read back the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tilthex_mocap::{
    UpAxis,
    natnet::{
        BodyName, Frame, MessageId, ModelDef, RigidBody, ServerInfo, Version, parse_connect, parse_echo_request,
        parse_echo_response, parse_packet, write_frame, write_model_def, write_server_info,
    },
};

const VERSIONS: [Version; 4] =
    [Version::V3_0, Version { major: 4, minor: 0 }, Version::V4_1, Version::V4_2];

fn payload(packet: &[u8], length: usize, id: MessageId) -> &[u8] {
    let (found, payload) = parse_packet(&packet[..length]).expect("a packet of our own");
    assert_eq!(found, id);
    payload
}

fn bits(body: &RigidBody) -> (i32, [u32; 3], [u32; 4], u32, bool) {
    let quaternion = body.quaternion_xyzw.map(f32::to_bits);
    (body.id, body.position.map(f32::to_bits), quaternion, body.mean_error.to_bits(), body.tracking_valid)
}

fuzz_target!(|datagram: &[u8]| {
    let Ok((_, bytes)) = parse_packet(datagram) else { return };
    let mut out = vec![0; 70_000];
    for version in VERSIONS {
        if let Ok((frame, _)) = Frame::parse_either(bytes, version) {
            let bodies: Vec<RigidBody> = frame.bodies().collect();
            assert!(bodies.len() * 38 <= bytes.len());
            for body in &bodies {
                let (position, quaternion) = (body.position.map(f64::from), body.quaternion_xyzw.map(f64::from));
                if let Some((position, rotation)) = UpAxis::Y.to_world(position, quaternion) {
                    assert!(position.iter().chain(rotation.iter()).all(|x| x.is_finite()));
                }
            }
            let length = write_frame(&mut out, frame.number, &bodies, &frame.times, version);
            if length > 0 {
                let again = Frame::parse(payload(&out, length, MessageId::Frame), version).expect("our own");
                assert!(again.bodies().map(|body| bits(&body)).eq(bodies.iter().map(bits)));
            }
        }
        if let Ok(models) = ModelDef::new(bytes, version) {
            let names: Vec<BodyName<'_>> = models.map_while(Result::ok).collect();
            assert!(names.len() * 5 <= bytes.len());
            let length = write_model_def(&mut out, &names, version);
            if length > 0 {
                let again = ModelDef::new(payload(&out, length, MessageId::ModelDef), version).expect("our own");
                assert!(again.map_while(Result::ok).eq(names));
            }
        }
    }
    if let Ok(info) = ServerInfo::parse(bytes) {
        let length = write_server_info(&mut out, &info);
        let again = ServerInfo::parse(payload(&out, length, MessageId::ServerInfo)).expect("our own");
        assert_eq!(again.version, info.version);
    }
    let _ = (parse_connect(bytes), parse_echo_request(bytes), parse_echo_response(bytes));
});
