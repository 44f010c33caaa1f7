//! The recorder keeps what it is given, counts what it must drop, and never stops a flight.

use std::{
    fs::{self, File},
    io::Read,
    path::Path,
};

use mcap::MessageStream;
use prost::Message;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use tilthex_core::{
    flight::Record,
    supervisor::{Fault, FaultSet, Phase},
};
use tilthex_rt::{
    log::{Attachments, LogFile},
    recorder::{Recorder, RecorderParams},
};
use tilthex_sim::feed::Tick;

fn params(directory: &Path, log: &Path) -> RecorderParams {
    let file = File::create(log).expect("opens");
    RecorderParams {
        log: Some(LogFile::new(file, log.into())),
        black_box: directory.join("fault.mcap"),
        attachments: Attachments { config: "[vehicle]\n".into(), ..Attachments::default() },
        rotor_count: 6,
        first: || (),
    }
}

fn tick(number: u64) -> Tick {
    let mut record = Record { tick: number, phase: Phase::Flying, ..Record::default() };
    record.input.time = 1.0 + number as f64 * 0.002;
    Tick { record, ..Tick::default() }
}

/// What a message of the channel `/flight` begins with.
#[derive(Clone, PartialEq, Message)]
struct Flight {
    #[prost(uint64, tag = "1")]
    tick: u64,
}

/// Ticks of the channel `/flight`.
fn ticks(path: &Path) -> Vec<u64> {
    let bytes = fs::read(path).expect("a file");
    let messages = MessageStream::new(&bytes).expect("a log").map(|m| m.expect("whole"));
    let flight = messages.filter(|m| m.channel.topic == "/flight");
    flight.map(|m| Flight::decode(&*m.data).expect("decodes").tick).collect()
}

#[test]
fn every_tick_is_either_written_in_order_or_counted_as_dropped() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("log.mcap");
    let (recorder, mut feed, _truth) = Recorder::start(params(directory.path(), &path)).expect("starts");
    for number in 0..20_000 {
        feed.push(&tick(number));
    }
    let recorded = recorder.finish();
    let written = ticks(&path);
    assert!(recorded.latest.dropped > 0, "forty times the ring at once must overflow it");
    assert_eq!(written.len() as u64 + recorded.latest.dropped, 20_000);
    assert!(written.is_sorted());
    assert_eq!(recorded.latest.error, None);
    assert_eq!(recorded.black_box, None, "no fault, no report");
}

/// A pipe that nobody reads is a disk that stands still: the loop's end goes on all the same.
#[test]
fn a_disk_that_stands_still_costs_ticks_and_never_the_loop() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("pipe.mcap");
    mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
    // Open both ways, the writer does not wait for a reader.
    let mut pipe = File::options().read(true).write(true).open(&path).expect("opens");
    let (recorder, mut feed, _truth) = Recorder::start(params(directory.path(), &path)).expect("starts");
    for number in 0..5000 {
        feed.push(&tick(number));
        if number.is_multiple_of(50) {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
    let dropped = feed.dropped();
    assert!(dropped > 3000, "a pipe and the ring hold few ticks: {dropped} dropped");
    let end = std::thread::spawn(move || recorder.finish());
    let (mut log, mut some) = (Vec::new(), [0; 1 << 16]);
    while log.len() <= mcap::MAGIC.len() || !log.ends_with(mcap::MAGIC) {
        let count = pipe.read(&mut some).expect("reads");
        log.extend_from_slice(&some[..count]);
    }
    let recorded = end.join().expect("ends");
    let copy = directory.path().join("log.mcap");
    fs::write(&copy, &log).expect("writes");
    assert_eq!(ticks(&copy).len() as u64 + dropped, 5000, "what was not dropped is written in the end");
    assert_eq!((recorded.latest.error, recorded.latest.dropped), (None, dropped));
}

#[test]
fn a_disk_that_is_full_at_the_start_is_said_before_the_flight() {
    let directory = tempfile::tempdir().expect("a directory");
    // Opening /dev/full works, writing to it does not.
    let failure = Recorder::start(params(directory.path(), Path::new("/dev/full"))).expect_err("full");
    assert_eq!(failure.exit_status(), 2);
    assert!(failure.message.contains("No space left on device"), "{failure}");
}

#[test]
fn after_a_fault_the_last_ten_seconds_are_kept() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("log.mcap");
    let (recorder, mut feed, _truth) = Recorder::start(params(directory.path(), &path)).expect("starts");
    let total = 10_000;
    for number in 0..total {
        let mut tick = tick(number);
        if number >= 9000 {
            tick.record.phase = Phase::Landing;
            tick.record.faults = FaultSet(1 << Fault::ImuSilent as u8);
        }
        feed.push(&tick);
        if number.is_multiple_of(200) {
            std::thread::sleep(std::time::Duration::from_millis(30));
        }
    }
    let recorded = recorder.finish();
    let report = recorded.black_box.expect("a report");
    let kept = ticks(&report);
    assert_eq!(*kept.last().expect("ticks"), total - 1);
    assert!(kept[0] <= total - 5000, "at least 10 s: from tick {}", kept[0]);
    assert!(kept[0] >= total - 6500, "and not all of it: from tick {}", kept[0]);
}
