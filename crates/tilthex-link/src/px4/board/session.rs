//! The client's session. It is opened in the same steps as by PX4's `uxrce_dds_client`.

use alloc::vec::Vec;

use crate::{
    board::Micros,
    px4::{
        AGENT, AGENT_OBJECT, BEST_EFFORT, CLIENT, Decoder, Draft, Entity, FromAgent, FromClient, Header,
        Message, NO_STREAM, ObjectId, RELIABLE, Request, Time, Topic, TopicMessage, TopicName, WITHOUT_KEY,
        encode,
    },
};

/// The session's number.
const SESSION: u8 = 0x81;
/// Longest message, bytes.
const LONGEST: usize = 512;
/// A request without an answer is sent again after this time.
const PATIENCE: Micros = 1_000_000;
/// A reliable message that is not acknowledged is announced again after this time.
const ANNOUNCE: Micros = 100_000;
/// Number of times that the client asks for the host's time before it creates its topics.
const SYNCHRONISED: u32 = 10;
/// A topic that the host does not know. PX4 too publishes more topics than the host uses.
const FOREIGN: &[u8] = b"rt/fmu/out/timesync_status";

/// The step that the session has reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Ping,
    Begin,
    Participant,
    Synchronise(u32),
    /// Creates the topics one after the other, [`FOREIGN`] last.
    Make(usize),
    Run,
}

/// A client's session.
#[derive(Clone, Debug)]
pub(super) struct Session {
    stage: Stage,
    asked: Option<Micros>,
    decoder: Decoder,
    without: Option<Topic>,
    /// The number of the newest request, and how many requests of this stage have no answer yet.
    request: u8,
    open: usize,
    reliable: u16,
    best_effort: u16,
    /// Reliable messages that are not acknowledged.
    kept: Vec<(u16, Vec<u8>)>,
    announced: Micros,
    /// The host's time minus the client's time, us.
    offset: i64,
    synchronised: Option<Micros>,
}

impl Session {
    pub(super) fn new(without: Option<Topic>) -> Self {
        Self {
            stage: Stage::Ping,
            asked: None,
            decoder: Decoder::new(CLIENT),
            without,
            request: 0,
            open: 0,
            reliable: 0,
            best_effort: 0,
            kept: Vec::new(),
            announced: 0,
            offset: 0,
            synchronised: None,
        }
    }

    /// Whether its streams run.
    pub(super) fn runs(&self) -> bool {
        self.stage == Stage::Run
    }

    /// Converts the client's time to the host's, us.
    pub(super) fn host_time(&self, now: Micros) -> u64 {
        now.saturating_add_signed(self.offset)
    }

    /// Sends a message of a topic, if the board has the topic.
    pub(super) fn send<T: TopicMessage>(&mut self, message: &T, out: &mut Vec<u8>) {
        if self.without == Some(T::TOPIC) {
            return;
        }
        let mut data = [0; LONGEST];
        let length = message.write(&mut data);
        let object = object(T::TOPIC as usize, DATA_WRITER);
        self.say(BEST_EFFORT, &[FromClient::WriteData(object, &data[..length])], out);
    }

    /// Takes a byte. If it completes a message, the data in it is appended to `heard`.
    pub(super) fn push(
        &mut self,
        byte: u8,
        now: Micros,
        heard: &mut Vec<(Topic, Vec<u8>)>,
        out: &mut Vec<u8>,
    ) {
        let Some(bytes) = self.decoder.push(byte).map(<[u8]>::to_vec) else { return };
        let Some(message) = Message::parse(&bytes) else { return };
        for submessage in message.from_agent().flatten() {
            self.take(&submessage, now, heard, out);
        }
    }

    fn take(
        &mut self,
        submessage: &FromAgent<'_>,
        now: Micros,
        heard: &mut Vec<(Topic, Vec<u8>)>,
        out: &mut Vec<u8>,
    ) {
        match (*submessage, self.stage) {
            (FromAgent::Info(..), Stage::Ping) => self.reach(Stage::Begin),
            (FromAgent::Info(_, false), _) => *self = Self::new(self.without),
            (FromAgent::StatusAgent(0), Stage::Begin) => self.reach(Stage::Participant),
            (FromAgent::Status(_, 0), Stage::Participant) => self.reach(Stage::Synchronise(0)),
            (FromAgent::TimestampReply { now: host, asked }, stage) => {
                let [host, asked] = [host, asked].map(micros);
                self.offset = host - (asked + now as i64) / 2;
                self.synchronised = Some(now);
                if let Stage::Synchronise(times) = stage {
                    let done = times + 1 >= SYNCHRONISED;
                    self.reach(if done { Stage::Make(0) } else { Stage::Synchronise(times + 1) });
                }
            }
            (FromAgent::Status(_, 0), Stage::Make(place)) => {
                self.open = self.open.saturating_sub(1);
                if self.open == 0 {
                    self.want(place, out);
                    self.reach(if place < Topic::COUNT { Stage::Make(place + 1) } else { Stage::Run });
                }
            }
            (FromAgent::AckNack { first, missing, .. }, _) => {
                self.kept.retain(|(number, _)| number.wrapping_sub(first) < 0x8000);
                if missing != 0 {
                    self.kept.iter().for_each(|(_, bytes)| out.extend_from_slice(bytes));
                }
            }
            (FromAgent::Data(request, data), _) => {
                let of = |topic: &&Topic| object(**topic as usize, DATA_READER) == request.object;
                if let Some(topic) = Topic::ALL.iter().find(of) {
                    heard.push((*topic, data.to_vec()));
                }
            }
            _ => {}
        }
    }

    fn reach(&mut self, stage: Stage) {
        (self.stage, self.asked) = (stage, None);
    }

    /// One cycle: sends the requests that the stage needs.
    pub(super) fn advance(&mut self, now: Micros, out: &mut Vec<u8>) {
        if !self.kept.is_empty() && now - self.announced >= ANNOUNCE {
            let (first, last) = (self.kept[0].0, self.reliable.wrapping_sub(1));
            self.announced = now;
            self.say(NO_STREAM, &[FromClient::Heartbeat { first, last, stream: RELIABLE }], out);
        }
        let long_ago = |then: Option<Micros>| then.is_none_or(|then| now - then >= PATIENCE);
        if !long_ago(self.asked) {
            return;
        }
        match self.stage {
            Stage::Ping => {
                let request = Request { number: [0, 10], object: AGENT_OBJECT };
                self.say_in(WITHOUT_KEY, &FromClient::GetInfo(request), out);
            }
            Stage::Begin => self.say_in(WITHOUT_KEY, &FromClient::CreateClient { session: SESSION }, out),
            Stage::Participant => {
                let request = self.numbered(object(1, 1));
                self.say(RELIABLE, &[FromClient::Create(request, Entity::Other)], out);
            }
            Stage::Synchronise(_) => self.say(NO_STREAM, &[FromClient::Timestamp(time(now))], out),
            Stage::Make(place) => self.make(place, out),
            Stage::Run => {
                // The host may have been replaced by another one that does not know the session.
                let request = Request { number: [0, 10], object: AGENT_OBJECT };
                self.say(NO_STREAM, &[FromClient::GetInfo(request), FromClient::Timestamp(time(now))], out);
            }
        }
        self.asked = Some(now);
    }

    /// Creates a topic, its publisher or subscriber, and its writer or reader.
    fn make(&mut self, place: usize, out: &mut Vec<u8>) {
        let topic = Topic::ALL.get(place).copied();
        if topic.is_some() && topic == self.without {
            self.reach(Stage::Make(place + 1));
            return;
        }
        let name = topic.map_or(FOREIGN.to_vec(), |topic| [b"rt", topic.name().as_bytes()].concat());
        let of = TopicName::Object(object(place, TOPIC));
        let (kind, end) = if topic.is_some_and(Topic::is_taken) {
            (DATA_READER, Entity::Reader(of))
        } else {
            (DATA_WRITER, Entity::Writer(of))
        };
        let made = [
            FromClient::Create(self.numbered(object(place, TOPIC)), Entity::Topic(&name)),
            FromClient::Create(self.numbered(object(place, PUBLISHER)), Entity::Other),
            FromClient::Create(self.numbered(object(place, kind)), end),
        ];
        self.open = made.len();
        self.say(RELIABLE, &made, out);
    }

    /// Asks for the data of a topic, if the board subscribes to it.
    fn want(&mut self, place: usize, out: &mut Vec<u8>) {
        if Topic::ALL.get(place).is_some_and(|topic| topic.is_taken()) {
            let request = self.numbered(object(place, DATA_READER));
            self.say(RELIABLE, &[FromClient::ReadData(request)], out);
        }
    }

    fn numbered(&mut self, object: ObjectId) -> Request {
        self.request = self.request.wrapping_add(1);
        Request { number: [0, self.request], object }
    }

    /// Sends a message of the session.
    fn say(&mut self, stream: u8, submessages: &[FromClient<'_>], out: &mut Vec<u8>) {
        let count = match stream {
            RELIABLE => &mut self.reliable,
            BEST_EFFORT => &mut self.best_effort,
            _ => &mut 0,
        };
        let sequence = *count;
        *count = count.wrapping_add(1);
        let mut draft = Draft::<LONGEST>::new(Header { session: SESSION, stream, sequence });
        for submessage in submessages {
            draft.client(submessage);
        }
        let bytes = framed(draft.bytes());
        out.extend_from_slice(&bytes);
        if stream == RELIABLE {
            self.kept.push((sequence, bytes));
        }
    }

    /// Sends a message before the session has begun.
    fn say_in(&mut self, session: u8, submessage: &FromClient<'_>, out: &mut Vec<u8>) {
        let mut draft = Draft::<LONGEST>::new(Header { session, stream: NO_STREAM, sequence: 0 });
        draft.client(submessage);
        out.extend_from_slice(&framed(draft.bytes()));
    }
}

const TOPIC: u8 = 2;
const PUBLISHER: u8 = 3;
const DATA_WRITER: u8 = 5;
const DATA_READER: u8 = 6;

/// The object of a kind that belongs to the topic with this index in [`Topic::ALL`].
fn object(place: usize, kind: u8) -> ObjectId {
    let [high, low] = ((place as u16 + 16) << 4 | u16::from(kind)).to_be_bytes();
    ObjectId([high, low])
}

fn framed(message: &[u8]) -> Vec<u8> {
    let mut out = alloc::vec![0; 2 * message.len() + 13];
    let length = encode(CLIENT, AGENT, message, &mut out);
    out.truncate(length);
    out
}

fn time(now: Micros) -> Time {
    Time { seconds: (now / 1_000_000) as i32, nanoseconds: (1000 * (now % 1_000_000)) as u32 }
}

fn micros(time: Time) -> i64 {
    1_000_000 * i64::from(time.seconds) + i64::from(time.nanoseconds / 1000)
}
