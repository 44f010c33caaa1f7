//! Logs that were cut, damaged, packed otherwise, or never were logs of a flight.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::Path,
    sync::LazyLock,
};

use mcap::{Compression, WriteOptions, records::MessageHeader};
use proptest::prelude::*;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use tilthex_config::Config;
use tilthex_link::LinkedFlight;
use tilthex_rt::{
    log::{Attachments, Epoch, FlightLog, Index, LogFile, LogReader, Whereabouts},
    replay,
};
use tilthex_sim::{
    Simulation, SimulationParams,
    campaign::World,
    feed::{Tick, Timing},
};

/// The log of the first seconds of a flight.
static LOG: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let config = Config::from_text("vehicle.preset = \"tilt-hex\"", Path::new("")).expect("valid");
    let params = config.linked_params(true).expect("valid");
    let linked = LinkedFlight::new(params, None).expect("valid");
    let mut world = World::new(Simulation::new(SimulationParams::new(params.flight.vehicle)), linked, 3);
    let attachments = Attachments { config: config.to_toml(), take_off: true, ..Attachments::default() };
    let mut log = FlightLog::new(Vec::new(), Index::Written, Epoch::now(), 6, &attachments).expect("begins");
    let mut ticks = 0;
    while ticks < 1000 {
        if world.tick(None) {
            log.tick(&Tick::new(world.output(), Timing::default())).expect("logged");
            ticks += 1;
            if ticks % 250 == 0 {
                log.flush().expect("flushed");
            }
        }
    }
    log.finish().expect("ends")
});

/// What `tilthex-rt replay` makes of a log.
fn replayed(bytes: &[u8]) -> Result<replay::Replay, String> {
    LogReader::new(bytes.to_vec()).and_then(|log| replay::replay(&log))
}

/// A log of the same messages, packed otherwise.
fn packed(compression: Option<Compression>, chunked: bool) -> Vec<u8> {
    let reader = LogReader::new(LOG.clone()).expect("sound");
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(compression).use_chunks(chunked);
    let mut writer = options.create(&mut bytes).expect("begins");
    let attachment = mcap::Attachment {
        log_time: 0,
        create_time: 0,
        name: "config.toml".into(),
        media_type: "text/plain".into(),
        data: reader.attachments().config.as_bytes().into(),
    };
    writer.attach(&attachment).expect("attached");
    let texts = BTreeMap::from([("take_off".into(), "true".into())]);
    let metadata = mcap::records::Metadata { name: "tilthex".into(), metadata: texts };
    writer.write_metadata(&metadata).expect("written");
    let mut ids = BTreeMap::new();
    for channel in reader.channels().values() {
        let schema = writer.add_schema(&channel.schema, "protobuf", &[]).expect("added");
        let id = writer.add_channel(schema, &channel.topic, "protobuf", &BTreeMap::new()).expect("added");
        ids.insert(channel.topic.clone(), id);
    }
    let mut sequence = 0;
    reader.each(|channel, data| {
        let header = MessageHeader {
            channel_id: ids[&channel.topic],
            sequence,
            log_time: 1_000_000 * u64::from(sequence),
            publish_time: 0,
        };
        sequence += 1;
        writer.write_to_known_channel(&header, data).expect("written");
    });
    writer.finish().expect("ends");
    drop(writer);
    bytes.into_inner()
}

#[test]
fn a_log_cut_at_any_byte_is_read_as_far_as_it_goes_and_says_what_is_missing() {
    let whole = replayed(&LOG).expect("whole");
    assert_eq!((whole.ticks, &whole.missing), (1000, &None));
    let (mut last, mut seen) = (0, 0);
    let cuts = (0..LOG.len()).step_by(977).chain(LOG.len().saturating_sub(40)..LOG.len());
    for cut in cuts {
        match replayed(&LOG[..cut]) {
            Ok(part) => {
                assert_eq!(part.first_difference, None, "cut at {cut}");
                let missing = part.missing.expect("it says so");
                assert!(missing.contains("breaks off"), "cut at {cut}: {missing}");
                assert!(part.ticks >= last, "a longer log holds no less");
                let index_only = missing.contains("no message is missing");
                assert!(part.ticks == 1000 || !index_only, "cut at {cut}: {missing}");
                assert!(index_only || cut < LOG.len() - 40, "cut at {cut}: {missing}");
                (last, seen) = (part.ticks, seen + 1);
            }
            // Before the first whole tick.
            Err(reason) => {
                assert_eq!(last, 0, "cut at {cut}: {reason}");
                assert!(reason.contains("breaks off") || reason.contains("not an MCAP file"), "{reason}");
            }
        }
    }
    assert!(seen > 20 && last == 1000, "{seen} logs with ticks, at most {last}");
}

#[test]
fn zeros_at_the_end_are_a_cut_as_a_lost_supply_leaves_it() {
    let mut bytes = LOG[..LOG.len() / 2].to_vec();
    let before = replayed(&bytes).expect("readable").ticks;
    let reader = LogReader::new(bytes.clone()).expect("sound");
    bytes.truncate(reader.cut().expect("cut").read as usize);
    bytes.resize(LOG.len(), 0);
    let found = replayed(&bytes).expect("readable");
    assert_eq!(found.ticks, before);
    assert!(found.missing.is_some());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Wherever it hits, one changed bit is called damage, with its place.
    #[test]
    fn a_flipped_bit_is_damage_with_its_place(part in 0.0..1.0f64, bit in 0..8u32) {
        let mut bytes = LOG.clone();
        let at = (part * bytes.len() as f64) as usize;
        bytes[at] ^= 1 << bit;
        let reason = LogReader::new(bytes).expect_err("damaged");
        prop_assert!(
            reason.contains("is damaged at byte") || (at < 8 && reason.contains("not an MCAP file")),
            "bit {bit} of byte {at}: {reason}"
        );
    }

    /// Many of them, or bytes of no meaning, are damage too, in a cut log at worst a shorter one; never a panic.
    #[test]
    fn garbage_and_cuts_never_panic(
        parts in prop::collection::vec((0.0..1.0f64, any::<u8>()), 1..40), cut in 0.5..1.0f64, lies in any::<u64>(),
    ) {
        let mut bytes = LOG.clone();
        for (part, value) in parts {
            let at = (part * bytes.len() as f64) as usize;
            bytes[at] = value;
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        let _ = replayed(&bytes);
        // The length of the second record, whatever it is.
        let mut bytes = LOG.clone();
        let second = 8 + 9 + u64::from_le_bytes(LOG[9..17].try_into().expect("eight")) as usize;
        bytes[second + 1..second + 9].copy_from_slice(&lies.to_le_bytes());
        prop_assert!(LogReader::new(bytes).is_err());
    }
}

#[test]
fn damage_at_each_end_and_at_heads_of_records_is_found() {
    // The frame of the file, byte by byte: its front, where lengths and kinds stand, and its end.
    let size = LOG.len();
    for at in (8..600).chain(size - 600..size) {
        for bit in 0..8 {
            let mut bytes = LOG.clone();
            bytes[at] ^= 1 << bit;
            let reason = LogReader::new(bytes).expect_err("damaged");
            assert!(reason.contains("is damaged at byte"), "bit {bit} of byte {at}: {reason}");
        }
    }
}

#[test]
fn chunks_of_any_compression_are_read() {
    for (compression, chunked) in
        [(None, true), (Some(Compression::Lz4), true), (Some(Compression::Zstd), true), (None, false)]
    {
        let found = replayed(&packed(compression, chunked)).expect("read");
        assert_eq!((found.ticks, found.first_difference), (1000, None), "{compression:?} {chunked}");
    }
}

/// An MCAP file with one chunk as it says, and nothing behind it.
fn with_chunk(compression: &str, size: u64, packed: &[u8]) -> Vec<u8> {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
    let record = |kind: u8, body: &[u8]| [&[kind], &(body.len() as u64).to_le_bytes()[..], body].concat();
    let header = record(1, &[text(""), text("bomb")].concat());
    let body = [
        &[0; 16],
        &size.to_le_bytes()[..],
        &[0; 4],
        &text(compression),
        &(packed.len() as u64).to_le_bytes(),
        packed,
    ]
    .concat();
    [mcap::MAGIC, &header, &record(6, &body)].concat()
}

#[test]
fn bombs_and_unknown_compressions_are_named() {
    let zeros = vec![0; 32 << 20];
    let mut lz4 = lz4::EncoderBuilder::new().build(Vec::new()).expect("begins");
    std::io::Write::write_all(&mut lz4, &zeros).expect("packed");
    let lz4 = lz4.finish().0;
    let zstd = zstd::encode_all(&zeros[..], 3).expect("packed");
    for (compression, bytes) in [("lz4", &lz4), ("zstd", &zstd)] {
        for (size, said) in [
            (32 << 20, "more than 50 times"),
            (1000, "unpacks to more than the 1000 bytes"),
            (u64::MAX, "more than 50 times"),
        ] {
            let reason = LogReader::new(with_chunk(compression, size, bytes)).expect_err("refused");
            assert!(reason.contains(said), "{compression} {size}: {reason}");
        }
    }
    let reason = LogReader::new(with_chunk("brotli", 1, b"x")).expect_err("refused");
    assert!(reason.contains("compressed with \"brotli\"; expected lz4 or zstd"), "{reason}");
}

#[test]
fn somebody_elses_file_is_one_sentence() {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut writer = WriteOptions::new().library("someone").create(&mut bytes).expect("begins");
    let schema = writer.add_schema("sensor_msgs/Imu", "ros1msg", b"").expect("added");
    let id = writer.add_channel(schema, "/input", "ros1", &BTreeMap::new()).expect("added");
    let header = MessageHeader { channel_id: id, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, b"what").expect("written");
    writer.finish().expect("ends");
    drop(writer);
    let reason = replayed(&bytes.into_inner()).expect_err("refused");
    assert!(
        reason.contains("written by \"someone\"") && reason.contains("not a log of tilthex-rt"),
        "{reason}"
    );
    for (what, bytes) in
        [("nothing", &b""[..]), ("a text", b"no log at all"), ("an archive", b"PK\x03\x04....")]
    {
        let reason = replayed(bytes).expect_err(what);
        assert!(reason.contains("not an MCAP file"), "{what}: {reason}");
    }
}

#[test]
fn a_pipe_or_a_device_is_no_log() {
    let directory = tempfile::tempdir().expect("a directory");
    let pipe = directory.path().join("pipe.mcap");
    mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
    for (path, what) in [(pipe.as_path(), "a pipe"), (Path::new("/dev/full"), "a device")] {
        let reason = LogReader::open(path).expect_err("refused");
        assert!(reason.contains(what) && reason.contains("expected a file"), "{reason}");
        for overwrite in [false, true] {
            let reason = LogFile::create(path, overwrite).expect_err("refused").message;
            assert!(reason.contains(what), "{reason}");
        }
    }
}

#[test]
fn a_log_that_is_there_is_replaced_only_by_order_and_never_under_a_flight() {
    let directory = tempfile::tempdir().expect("a directory");
    let (path, link) = (directory.path().join("log.mcap"), directory.path().join("link.mcap"));
    fs::write(&path, b"precious").expect("written");
    std::os::unix::fs::symlink(&path, &link).expect("linked");
    let dangling = directory.path().join("dangling.mcap");
    std::os::unix::fs::symlink(directory.path().join("none"), &dangling).expect("linked");
    for path in [&path, &link, &dangling] {
        let refused = LogFile::create(path, false).expect_err("refused");
        assert_eq!(refused.exit_status(), 2);
        assert!(refused.message.contains("--overwrite"), "{refused}");
    }
    assert_eq!(fs::read(&path).expect("there"), b"precious");
    let first = LogFile::create(&link, true).expect("replaced");
    let second = LogFile::create(&path, true).expect_err("in use").message;
    assert!(second.contains("another program"), "{second}");
    assert_eq!(first.whereabouts(), Whereabouts::InPlace);
    drop(first);
    let log = LogFile::create(&path, true).expect("free again");
    fs::rename(&path, directory.path().join("other.mcap")).expect("moved");
    assert_eq!(log.whereabouts(), Whereabouts::Moved);
    File::create(&path).expect("another in its place");
    assert_eq!(log.whereabouts(), Whereabouts::Moved);
    fs::remove_file(directory.path().join("other.mcap")).expect("removed");
    assert_eq!(log.whereabouts(), Whereabouts::Deleted);
}
