//! Conversations with clients on virtual time. Their orders go into the real ring of the loop.

use std::sync::{Arc, atomic::AtomicBool};

use proptest::prelude::*;
use rtrb::{Consumer, RingBuffer};
use serde_json::{Value, json};
use tilthex_config::{Config, VehicleSection, orders::Orders};
use tilthex_core::{
    flight::{Command, Record},
    supervisor::Phase,
};
use tilthex_sim::feed::{Feed, Tick};

use super::{
    Desk, PROTOCOL, Shared, Token, Way,
    desk::Client,
    session::{PATIENCE, Reply, Session},
};
use crate::{
    carrier::Carrier,
    flags::Flags,
    log::Attachments,
    recorder::{Recorder, RecorderParams},
    waiting::Asked,
};

const SECOND: u64 = 1_000_000_000;
const FOLLOW: &str =
    r#"{"id": 1, "command": "follow", "position": [0,0,1], "rotation": [[1,0,0],[0,1,0],[0,0,1]]}"#;
const RING: usize = 4;

fn config() -> Config {
    Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"))
}

/// A desk, the rings and flags behind it, and a flight in hover.
struct Office {
    shared: Arc<Shared>,
    commands: Consumer<Command>,
    flags: Flags,
    recorder: Option<(Recorder, Feed)>,
    clients: u64,
}

impl Office {
    fn new(token: Option<Token>) -> Self {
        let (ring, commands) = RingBuffer::new(RING);
        Self::with(token, Way::Loop(ring), commands)
    }

    /// The office of a console, and what its vehicle is asked.
    fn of_console() -> (Self, Consumer<Asked>) {
        let (ring, asked) = RingBuffer::new(RING);
        let carrier = Carrier { admittance: config().controller().admittance };
        (Self::with(None, Way::Board(ring, Box::new(carrier)), RingBuffer::new(RING).1), asked)
    }

    fn with(token: Option<Token>, way: Way, commands: Consumer<Command>) -> Self {
        let orders = Orders::new(&config());
        let (recorder, feed, _) = Recorder::start(RecorderParams {
            log: None,
            black_box: "none".into(),
            attachments: Attachments::default(),
            rotor_count: 6,
            first: || (),
        })
        .expect("starts");
        let flags = Flags::default();
        let desk = Desk::new(orders, way, recorder.observer(), flags.clone());
        let shared = Arc::new(Shared {
            desk,
            token,
            stop: AtomicBool::new(false),
            refused: std::sync::atomic::AtomicU64::new(0),
        });
        let mut office = Self { shared, commands, flags, recorder: Some((recorder, feed)), clients: 0 };
        office.show(Phase::Flying);
        office
    }

    /// Lets the recorder see a tick.
    fn show(&mut self, phase: Phase) {
        let (_, feed) = self.recorder.as_mut().expect("running");
        let record = Record { phase, compliant: phase.in_flight(), ..Record::default() };
        feed.push(&Tick { record, ..Tick::default() });
        let seen = |latest: &crate::recorder::Latest| {
            latest.tick.as_ref().is_some_and(|tick| tick.record.phase == phase)
        };
        while !self.shared.desk.observer().look(seen) {
            std::thread::yield_now();
        }
    }

    fn client(&mut self) -> Session {
        self.clients += 1;
        let client = Client { id: self.clients, name: format!("client {}", self.clients) };
        Session::new(client, Arc::clone(&self.shared), 0)
    }
}

impl Drop for Office {
    fn drop(&mut self) {
        if let Some((recorder, _)) = self.recorder.take() {
            let _ = recorder.finish();
        }
    }
}

fn say(session: &mut Session, line: &str) -> Reply {
    session.line(line.as_bytes(), SECOND)
}

fn error(reply: &Reply) -> &str {
    reply.line.as_ref().and_then(|line| line["error"].as_str()).unwrap_or_default()
}

fn ok(reply: &Reply) -> bool {
    reply.line.as_ref().is_some_and(|line| line["ok"] == json!(true)) && !reply.ends
}

#[test]
fn a_web_page_gives_no_order() {
    let mut office = Office::new(None);
    let mut page = office.client();
    let reply = say(&mut page, "POST / HTTP/1.1\r\n");
    assert!(reply.ends && error(&reply).contains("not a JSON object"), "{reply:?}");
    for first in ["{}", "[]", "\"land\"", "", "\u{0}", "{\"command\": 3}"] {
        assert!(say(&mut office.client(), first).ends, "{first}");
    }
    assert!(!office.flags.kills() && !office.flags.lands());
    // A client that has sent a line of the protocol may send a wrong one.
    let mut client = office.client();
    assert!(ok(&say(&mut client, r#"{"command": "state"}"#)));
    let reply = say(&mut client, "garbage");
    assert!(!reply.ends && !error(&reply).is_empty());
}

#[test]
fn kill_and_land_pass_a_full_ring_and_whoever_holds_the_controls() {
    let mut office = Office::new(None);
    let (mut streamer, mut other) = (office.client(), office.client());
    for _ in 0..RING {
        assert!(ok(&say(&mut streamer, FOLLOW)));
    }
    assert!(error(&say(&mut streamer, FOLLOW)).contains("try again"));
    assert!(error(&say(&mut other, FOLLOW)).contains("client 1 holds the controls"));
    assert!(ok(&say(&mut other, r#"{"command": "land"}"#)) && office.flags.lands());
    // Other keys in the line do not matter.
    assert!(ok(&say(&mut other, r#"{"command": "kill", "why": "smoke"}"#)) && office.flags.kills());
    assert_eq!(office.commands.slots(), RING, "neither went through the ring");
    assert!(error(&say(&mut streamer, FOLLOW)).contains("killed"));
}

#[test]
fn one_holds_the_controls_until_they_are_taken_or_left() {
    let mut office = Office::new(None);
    let (mut first, mut second) = (office.client(), office.client());
    let zero = r#"{"command": "release_wrench"}"#;
    assert!(ok(&say(&mut first, zero)));
    assert!(error(&say(&mut second, zero)).contains("client 1"));
    let state = say(&mut second, r#"{"command": "state"}"#).line.expect("an answer");
    assert_eq!(state["state"]["controls"], "client 1");
    assert!(ok(&say(&mut second, r#"{"command": "take_controls"}"#)));
    assert!(error(&say(&mut first, zero)).contains("client 2"));
    drop(second);
    assert!(ok(&say(&mut first, zero)));
}

#[test]
fn an_operator_who_moves_the_vehicle_must_be_heard() {
    let mut office = Office::new(None);
    let (mut operator, mut viewer) = (office.client(), office.client());
    let patience = 2 * SECOND;
    let silent = |office: &Office, now| office.flags.operator_silent(now, patience);
    assert!(ok(&say(&mut operator, r#"{"command": "release_wrench"}"#)));
    assert!(!silent(&office, 100 * SECOND), "nothing is flown for anybody");
    assert!(ok(&operator.line(FOLLOW.as_bytes(), 100 * SECOND)));
    assert!(!silent(&office, 102 * SECOND) && silent(&office, 103 * SECOND));
    assert!(!viewer.line(br#"{"command": "state"}"#, 103 * SECOND).ends);
    assert!(silent(&office, 103 * SECOND), "others do not speak for the operator");
    let beat = operator.line(br#"{"command": "heartbeat"}"#, 103 * SECOND);
    assert_eq!(beat, Reply { line: None, ends: false });
    assert!(!silent(&office, 104 * SECOND));
    drop(operator);
    assert!(silent(&office, 106 * SECOND), "one who is gone is silent");
    assert!(ok(&viewer.line(br#"{"command": "take_controls"}"#, 106 * SECOND)));
    assert!(!silent(&office, 107 * SECOND));
}

#[test]
fn without_the_token_nothing_is_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("token");
    std::fs::write(&path, "0123456789abcdef").expect("written");
    let mut office = Office::new(Some(Token::read(&path).expect("long enough")));
    for line in [r#"{"command": "kill"}"#, r#"{"command": "state"}"#, r#"{"command": "authenticate"}"#] {
        let reply = say(&mut office.client(), line);
        assert!(reply.ends && error(&reply).contains("token"), "{line}: {reply:?}");
    }
    assert!(say(&mut office.client(), r#"{"command": "authenticate", "token": "0123456789abcdeX"}"#).ends);
    assert!(!office.flags.kills());
    let mut client = office.client();
    assert!(ok(&say(&mut client, r#"{"command": "authenticate", "token": "0123456789abcdef"}"#)));
    assert!(ok(&say(&mut client, r#"{"command": "kill"}"#)) && office.flags.kills());
}

#[test]
fn what_would_be_ignored_is_refused() {
    let mut office = Office::new(None);
    let mut client = office.client();
    let zero = r#"{"command": "zero_bias"}"#;
    assert!(ok(&say(&mut client, zero)));
    assert!(ok(&say(&mut client, FOLLOW)));
    assert!(error(&say(&mut client, zero)).contains("streamed"));
    assert!(error(&say(&mut client, r#"{"command": "take_off"}"#)).contains("already"));
    office.show(Phase::Landing);
    assert!(error(&say(&mut client, FOLLOW)).contains("lands"));
    assert!(ok(&say(&mut client, r#"{"command": "land"}"#)));
}

#[test]
fn everybody_reads_the_configuration_with_its_changes() {
    let mut office = Office::new(None);
    let (mut operator, mut reader) = (office.client(), office.client());
    let read = |reader: &mut Session| {
        let line = say(reader, r#"{"command": "configuration"}"#).line.expect("an answer");
        let text = line["configuration"].as_str().expect("a text").to_owned();
        Config::from_text(&text, std::path::Path::new("")).expect("a configuration")
    };
    assert_eq!(read(&mut reader), config());
    let order = r#"{"command": "set_admittance", "stiffness": [6, 6, 6, 10, 10, 5]}"#;
    assert!(ok(&say(&mut operator, order)));
    let stiffness = read(&mut reader).controller().admittance.stiffness;
    assert_eq!(stiffness.diagonal().as_slice(), [6.0, 6.0, 6.0, 10.0, 10.0, 5.0]);
    // A refused order changes nothing.
    assert!(!ok(&say(&mut operator, r#"{"command": "set_admittance", "stiffness": [-1, 6, 6, 10, 10, 5]}"#)));
    assert_eq!(read(&mut reader).controller().admittance.stiffness, stiffness);
}

/// A console's client is told what the vehicle has answered, and not that the order was passed on.
#[test]
fn an_order_is_answered_when_the_vehicle_has_answered() {
    let (mut office, mut asked) = Office::of_console();
    let mut client = office.client();
    let order = |id, k| {
        format!(r#"{{"id": {id}, "command": "set_admittance", "stiffness": [{k}, 6, 6, 10, 10, 5]}}"#)
    };
    let nothing = Reply { line: None, ends: false };
    let stiffness = |client: &mut Session| {
        let line = say(client, r#"{"command": "configuration"}"#).line.expect("an answer");
        let text = line["configuration"].as_str().expect("a text").to_owned();
        let config = Config::from_text(&text, std::path::Path::new("")).expect("a configuration");
        config.controller().admittance.stiffness[(0, 0)]
    };
    let mut answer = |done| asked.pop().expect("passed on").fate.set(done).expect("told once");
    assert_eq!(say(&mut client, &order(1, 7.0)), nothing);
    assert!(client.answers().is_empty());
    assert_eq!(stiffness(&mut client), 6.0, "what is not certain changes nothing");
    // The next change would return to what is not certain.
    assert!(error(&say(&mut client, &order(2, 8.0))).contains("not answered to the change before"));
    assert_eq!(say(&mut client, r#"{"id": 3, "command": "zero_bias"}"#), nothing);
    answer(Ok(()));
    assert_eq!(client.answers(), [json!({"id": 1, "ok": true})]);
    assert_eq!(stiffness(&mut client), 7.0);
    answer(Err("the vehicle refuses it: smoke".into()));
    assert_eq!(client.answers(), [json!({"id": 3, "error": "zero_bias: the vehicle refuses it: smoke"})]);
    // A client that is gone leaves no change of its own that the vehicle has refused.
    assert_eq!(say(&mut client, &order(4, 9.0)), nothing);
    drop(client);
    answer(Err("the vehicle refuses it".into()));
    let mut client = office.client();
    assert_eq!(stiffness(&mut client), 7.0, "what is refused changes nothing");
    assert_eq!(say(&mut client, &order(5, 10.0)), nothing);
    // Kill and land do not wait.
    assert!(ok(&say(&mut client, r#"{"command": "land"}"#)));
    drop(asked);
    assert_eq!(office.shared.refused.load(std::sync::atomic::Ordering::Relaxed), 2);
}

#[test]
fn a_console_that_has_ended_takes_no_orders() {
    let (mut office, asked) = Office::of_console();
    drop(asked);
    let reply = say(&mut office.client(), r#"{"command": "zero_bias"}"#);
    assert!(error(&reply).contains("the console has ended"), "{reply:?}");
}

/// The limits are those of a flight, before anything is sent.
#[test]
fn a_console_refuses_what_a_flight_refuses() {
    let (mut office, asked) = Office::of_console();
    let mut client = office.client();
    let place = r#""waypoint": [{"position": [0, 0, 1]}]"#;
    for (order, says) in [
        (format!(r#"{{"command": "play", {place}, "limits": {{"velocity": 100}}}}"#), "[orders]"),
        (
            r#"{"command": "play", "waypoint": [{"position": [0, 0, 1], "yaw_pitch_roll_deg": [0, 180, 0]}]}"#.into(),
            "attitude",
        ),
        (r#"{"command": "set_admittance", "mass": [1e-3, 1, 1, 0.01, 0.01, 0.02]}"#.into(), "lightest"),
        (r#"{"command": "set_wrench", "force": [500, 0, 0]}"#.into(), "max_force"),
        (r#"{"command": "set_wrench", "force": [1, 0, 0]}"#.into(), "no wrenches"),
        (FOLLOW.into(), "no set-points"),
    ] {
        let reply = say(&mut client, &order);
        assert!(error(&reply).contains(says), "{order}: {reply:?}");
    }
    assert_eq!(asked.slots(), 0);
}

#[test]
fn the_version_is_told_before_the_first_order() {
    let mut office = Office::new(None);
    let reply = say(&mut office.client(), r#"{"id": 1, "command": "state"}"#).line.expect("an answer");
    assert_eq!(reply["protocol"], json!(PROTOCOL));
    let reply = say(&mut office.client(), r#"{"command": "authenticate"}"#).line.expect("an answer");
    assert_eq!(reply["protocol"], json!(PROTOCOL));
}

#[test]
fn who_says_nothing_is_not_waited_for() {
    let mut office = Office::new(None);
    let mut client = office.client();
    assert!(client.overdue(false, PATIENCE).is_none());
    assert!(client.overdue(false, PATIENCE + 1).is_some(), "it never said an order");
    assert!(ok(&client.line(br#"{"command": "state"}"#, SECOND)));
    assert!(client.overdue(false, 1000 * SECOND).is_none(), "a viewer may be silent");
    assert!(client.overdue(true, 1000 * SECOND).is_some(), "but not in the middle of a line");
}

#[test]
fn a_stream_keeps_its_rate_and_leaves_out_what_was_missed() {
    let mut office = Office::new(None);
    let mut client = office.client();
    assert!(ok(&client.line(br#"{"command": "stream", "rate": 50}"#, SECOND)));
    let states = (0..1000).filter(|ms| client.due(SECOND + ms * 1_000_000).is_some()).count();
    assert_eq!(states, 50);
    assert!(client.due(10 * SECOND).is_some() && client.due(10 * SECOND).is_none());
    assert!(ok(&client.line(br#"{"command": "stream", "rate": 0}"#, 10 * SECOND)));
    assert!(client.due(100 * SECOND).is_none());
}

proptest! {
    // Each begins a recorder.
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_rate_is_in_range_or_refused(rate in prop_oneof![any::<f64>(), -1.0..200.0_f64], now in any::<u64>()) {
        let mut office = Office::new(None);
        let mut client = office.client();
        let line = json!({"command": "stream", "rate": rate}).to_string();
        let reply = client.line(line.as_bytes(), now / 2);
        prop_assert_eq!(ok(&reply), rate == 0.0 || (0.1..=100.0).contains(&rate), "{}", reply.line.unwrap_or_default());
        let _ = client.due(now);
        let _ = client.patience(now, std::time::Duration::from_millis(20));
    }

    #[test]
    fn no_line_panics_or_kills(line in prop::collection::vec(any::<u8>(), 0..200)) {
        let mut office = Office::new(None);
        let reply = office.client().line(&line, SECOND);
        prop_assert!(reply.line.is_some_and(|line| line["error"] != Value::Null));
        prop_assert!(!office.flags.kills());
    }
}
