//! A VRPN tracker with several sensors: one is followed, over every connection.

#![allow(clippy::unwrap_used)]

use std::{
    io::{Read, Write},
    net::{Ipv4Addr, TcpListener},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use tilthex_mocap::{
    ClientParams, UpAxis,
    net::Client,
    vrpn::{COOKIE, Description, POSE_TYPE, TrackerPose, write_description, write_pose},
};

const PARAMS: ClientParams = ClientParams { up_axis: UpAxis::Z, latency: 0.0 };

/// Serves one connection after the other, each with its own order of sensors. A sensor of number n is at x = n.
/// A connection ends when `next` says so.
fn server(orders: Vec<Vec<i32>>, next: Arc<AtomicBool>) -> u16 {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for order in orders {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(&COOKIE).unwrap();
            stream.read_exact(&mut [0; COOKIE.len()]).unwrap();
            let mut bytes = [0; 512];
            for name in [Description::Sender(1, b"room/2"), Description::Type(4, POSE_TYPE)] {
                let length = write_description(&mut bytes, &name, 0);
                stream.write_all(&bytes[..length]).unwrap();
            }
            for i in 0.. {
                for &sensor in &order {
                    let position = [f64::from(sensor), 0.0, 1.0];
                    let pose = TrackerPose { sensor, position, quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] };
                    let length = write_pose(&mut bytes, (1, 4), (100, 5000 * i), &pose, 0);
                    if stream.write_all(&bytes[..length]).is_err() {
                        return;
                    }
                }
                if next.swap(false, Ordering::Relaxed) {
                    break;
                }
                thread::sleep(Duration::from_millis(5));
            }
        }
    });
    port
}

/// Follows an address over two connections; the places of all poses.
fn followed(path: &str) -> Vec<f64> {
    let next = Arc::new(AtomicBool::new(false));
    let port = server(vec![vec![3, 0, 2], vec![0, 2, 3]], Arc::clone(&next));
    let uri = format!("vrpn://127.0.0.1:{port}/{path}").parse().unwrap();
    let (client, mut poses) = Client::start(&uri, PARAMS).unwrap();
    next.store(true, Ordering::Relaxed);
    let (mut places, end) = (Vec::new(), Instant::now() + Duration::from_secs(20));
    let mut after = 0;
    while after < 20 && Instant::now() < end {
        while let Ok(pose) = poses.pop() {
            places.push(pose.position_w.x);
            after += usize::from(client.status().silences > 0);
        }
        thread::sleep(Duration::from_millis(2));
    }
    assert!(after >= 20, "no poses of the second connection");
    places
}

#[test]
fn the_numbered_sensor_is_followed_over_a_new_connection() {
    assert!(followed("room%2F2/2").iter().all(|&x| x == 2.0));
    assert!(followed("room/2/0").iter().all(|&x| x == 0.0));
}

#[test]
fn without_a_number_the_first_that_reported_is_kept() {
    assert!(followed("room%2F2").iter().all(|&x| x == 3.0));
}

#[test]
fn a_sensor_that_is_not_there_names_those_that_are() {
    let port = server(vec![vec![3, 0, 2]], Arc::default());
    let uri = format!("vrpn://127.0.0.1:{port}/room%2F2/7").parse().unwrap();
    let said = Client::start(&uri, PARAMS).unwrap_err().to_string();
    assert!(said.contains("has no sensor 7; its sensors that report are 3, 0, 2"), "{said}");
}
