//! A whole flight of the real loop under an allocator that aborts the program
//! when the loop's thread allocates or frees: link, capture over the network,
//! log, orders.

use std::{path::Path, time::Duration};

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use rtrb::RingBuffer;
use tilthex_config::{Config, orders::Orders};
use tilthex_link::LinkedFlight;
use tilthex_mocap::{
    ClientParams,
    net::{Client, LineParams},
};
use tilthex_rt::{
    control_loop::{ControlLoop, End, LoopParams},
    flags::Flags,
    log::{Attachments, LogFile},
    port::Port,
    realtime::LOOP_STACK,
    recorder::{Recorder, RecorderParams},
    sim::{CAPTURE_EVERY, Capture, Server},
};
use tilthex_sim::{Simulation, SimulationParams};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn the_loop_never_allocates() {
    let config = Config::from_text("vehicle.preset = \"tilt-hex\"", Path::new("")).expect("valid");
    let params = config.linked_params(true).expect("valid");
    let up_axis = config.mocap().up_axis().expect("valid");
    let (mut capture, uri) = Capture::on_loopback(up_axis, LineParams::default()).expect("a free port");
    let mut cycle = 0_u64;
    let observer = move |at, simulation: &mut Simulation| {
        cycle += 1;
        if cycle.is_multiple_of(CAPTURE_EVERY) {
            capture.show(at, simulation);
        }
    };
    let simulation = Simulation::new(SimulationParams::new(params.flight.vehicle));
    let server = Server::start(simulation, Box::new(observer), None, None).expect("a pseudo-terminal");
    let directory = tempfile::tempdir().expect("a directory");
    let log = directory.path().join("flight.mcap");
    let (recorder, feed, _truth) = Recorder::start(RecorderParams {
        log: Some(LogFile::create(&log, false).expect("free")),
        black_box: directory.path().join("fault.mcap"),
        attachments: Attachments::default(),
        rotor_count: 6,
        first: || (),
    })
    .expect("starts");
    let (_client, poses) =
        Client::start(&uri, ClientParams { up_axis, latency: 0.0 }).expect("the capture is there");
    let mut orders = Orders::new(&config);
    let (mut give, commands) = RingBuffer::new(8);
    for line in [
        r#"{"command": "set_admittance", "stiffness": [8, 8, 8, 10, 10, 5]}"#,
        r#"{"command": "set_wrench", "force": [0, 0, 0.1]}"#,
        r#"{"command": "play", "waypoint": [{"position": [0.2, 0.0, 0.7]}]}"#,
    ] {
        give.push(orders.parse(line).expect("valid")).expect("room");
    }
    let mut control_loop = ControlLoop {
        linked: LinkedFlight::new(params, None).expect("valid"),
        port: Port::open(server.path().to_str().expect("plain"), 0).expect("opens"),
        poses,
        commands,
        feed,
        flags: Flags::default(),
        params: LoopParams {
            period: Duration::from_millis(2),
            duration: Some(4.0),
            land_after_route: false,
            operator_timeout: Some(Duration::from_secs(60)),
            patience: Some(60.0),
        },
    };
    let flown = std::thread::Builder::new()
        .stack_size(LOOP_STACK)
        .spawn(move || {
            let end = assert_no_alloc(|| control_loop.run());
            (end, control_loop)
        })
        .expect("a thread")
        .join()
        .expect("it neither panics nor allocates");
    let recorded = recorder.finish();
    // A machine that is busy with other things may make it land early.
    assert!(matches!(flown.0, End::Landed(_)), "{:?}", flown.0);
    assert!(recorded.latest.statistics.ticks > 1000);
    assert_eq!(recorded.latest.error, None);
}
