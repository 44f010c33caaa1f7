//! Serves a body in a slow circle as a capture system does, to try out clients: `cargo run --example mocap_server --
//! natnet 3.0 1510 tilt-hex`, `-- natnet+multicast 4.1 1510 tilt-hex` or `-- vrpn - 3883 tilt-hex`. Prints its
//! address, and runs until its standard input ends.

use std::{
    env, io,
    net::{Ipv4Addr, SocketAddr, SocketAddrV4},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use tilthex_core::{Vector3, so3};
use tilthex_mocap::{
    UpAxis,
    natnet::{self, Version},
    net::{Clock, Monotonic, NatNetServer, NatNetServerParams, Publication, VrpnServer, VrpnServerParams},
};

type Publish = Box<dyn FnMut(Publication) -> bool>;

/// A pose on the circle, with a known rotation: 1 rad about the vertical.
fn pose() -> Publication {
    let time = Monotonic.now();
    let angle = time as f64 * 1e-9;
    Publication {
        time,
        position_w: Vector3::new(angle.cos(), angle.sin(), 1.5),
        rotation_wr: so3::exp(&Vector3::z()),
        tracking_valid: true,
    }
}

fn start(protocol: &str, version: &str, port: u16, body: &str) -> io::Result<(SocketAddr, Publish)> {
    let address = SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
    if protocol == "vrpn" {
        let params = VrpnServerParams { address, ..VrpnServerParams::new(body) };
        let mut server = VrpnServer::start(params)?;
        return Ok((server.address(), Box::new(move |pose| server.publish(pose))));
    }
    let group = SocketAddrV4::new(natnet::MULTICAST_GROUP.into(), natnet::DATA_PORT);
    let version = match version {
        "4.1" => Version::V4_1,
        "4.2" => Version::V4_2,
        _ => Version::V3_0,
    };
    let multicast = (protocol == "natnet+multicast").then_some(group);
    let params = NatNetServerParams {
        address,
        version,
        multicast,
        up_axis: UpAxis::Z,
        ..NatNetServerParams::new(body)
    };
    let mut server = NatNetServer::start(params)?;
    Ok((server.address(), Box::new(move |pose| server.publish(pose))))
}

fn main() -> io::Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [protocol, version, port, body] = arguments.as_slice() else {
        return Err(io::Error::other("expected PROTOCOL VERSION PORT BODY"));
    };
    let port = port.parse().map_err(io::Error::other)?;
    let (address, mut publish) = start(protocol, version, port, body)?;
    println!("{protocol}://{address}/{body}");
    static ENDED: AtomicBool = AtomicBool::new(false);
    thread::spawn(|| {
        let _ = io::copy(&mut io::stdin(), &mut io::sink());
        ENDED.store(true, Ordering::Relaxed);
    });
    while !ENDED.load(Ordering::Relaxed) {
        publish(pose());
        thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}
