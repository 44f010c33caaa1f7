//! The agent's end of a session: it answers the client's requests, and finds the data of the topics that it knows.

use super::{
    entity::{Entity, TopicName},
    frame::{self, AGENT, CLIENT},
    message::{
        BEST_EFFORT, CLIENT_OBJECT, Draft, Header, Message, NO_STREAM, ObjectId, RELIABLE, Request, Time,
        WITHOUT_KEY,
    },
    submessages::{FromAgent, FromClient},
    topics::{Topic, TopicMessage},
};
use crate::{Outgoing, bump};

/// Number of answers that can wait for the end of a tick. The client sends three requests at a time.
const MAX_ANSWERS: usize = 16;
/// Longest message to the client, bytes.
const LONGEST: usize = 160;

/// An answer that has not been sent yet.
#[derive(Clone, Copy, Debug)]
enum Answer {
    Began,
    Ended(Request),
    Done(Request),
    /// The agent exists. The number is that of the session in which the client asked.
    There(Request, u8),
    Clock(Time),
}

/// The objects that a client has created for a topic.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    topic: Option<ObjectId>,
    writer: Option<ObjectId>,
    reader: Option<ObjectId>,
    /// The request that asks for its data.
    wanted: Option<Request>,
}

/// The agent of one client.
#[derive(Clone, Debug)]
pub(super) struct Agent {
    session: Option<u8>,
    known: [Known; Topic::COUNT],
    /// The number of the next message in the client's reliable stream, and that of the newest that it has announced.
    expected: u16,
    newest: u16,
    acknowledge: bool,
    /// The number of the newest message in its best-effort stream.
    last: Option<u16>,
    /// The number of the next message to the client.
    sequence: u16,
    answers: [Option<Answer>; MAX_ANSWERS],
    /// Whether any session has begun, and whether another one has begun since the last call of [`Self::began_anew`].
    earlier: bool,
    began_anew: bool,
    messages: u32,
    refused: u32,
}

impl Default for Agent {
    fn default() -> Self {
        Self {
            session: None,
            known: [Known::default(); Topic::COUNT],
            expected: 0,
            newest: u16::MAX,
            acknowledge: false,
            last: None,
            sequence: 0,
            answers: [None; MAX_ANSWERS],
            earlier: false,
            began_anew: false,
            messages: 0,
            refused: 0,
        }
    }
}

/// Whether a sequence number of a stream is newer than another one.
fn is_newer(number: u16, than: u16) -> bool {
    (1..0x8000).contains(&number.wrapping_sub(than))
}

impl Agent {
    /// Takes a message, and calls `each` with the data of known topics. Returns false if a part of it is malformed.
    pub(super) fn take(&mut self, bytes: &[u8], mut each: impl FnMut(Topic, &[u8])) -> bool {
        let Some(message) = Message::parse(bytes) else {
            bump(&mut self.refused);
            return false;
        };
        if !self.is_next(&message.header) {
            return true;
        }
        let mut understood = true;
        for submessage in message.from_client() {
            match submessage {
                Some(FromClient::WriteData(object, data)) if self.session == Some(message.header.session) => {
                    if let Some(topic) = self.written_by(object) {
                        each(topic, data);
                    }
                }
                Some(submessage) => self.obey(&submessage, message.header.session),
                None => understood = false,
            }
        }
        bump(if understood { &mut self.messages } else { &mut self.refused });
        understood
    }

    /// Whether a message holds data of a topic. Does not change the agent.
    pub(super) fn finds(&self, bytes: &[u8], topic: Topic) -> bool {
        let of_topic = |found: Option<FromClient<'_>>| match found {
            Some(FromClient::WriteData(object, _)) => self.written_by(object) == Some(topic),
            _ => false,
        };
        Message::parse(bytes)
            .filter(|message| self.session == Some(message.header.session))
            .is_some_and(|message| message.from_client().any(of_topic))
    }

    /// Whether the agent takes the message now: it is not old, and in a reliable stream no earlier one is missing.
    fn is_next(&mut self, header: &Header) -> bool {
        if header.stream == NO_STREAM {
            return true;
        }
        if self.session != Some(header.session) {
            return false;
        }
        if header.stream < RELIABLE {
            let next = self.last.is_none_or(|last| is_newer(header.sequence, last));
            if next {
                self.last = Some(header.sequence);
            }
            return next;
        }
        self.acknowledge = true;
        if is_newer(header.sequence, self.newest) {
            self.newest = header.sequence;
        }
        let next = header.sequence == self.expected;
        if next {
            self.expected = self.expected.wrapping_add(1);
        }
        next
    }

    fn obey(&mut self, submessage: &FromClient<'_>, session: u8) {
        let ours = self.session == Some(session);
        match *submessage {
            FromClient::CreateClient { session } if session >= WITHOUT_KEY => {
                *self = Self {
                    messages: self.messages,
                    refused: self.refused,
                    began_anew: self.earlier,
                    earlier: true,
                    ..Self::default()
                };
                self.session = Some(session);
                self.answer(Answer::Began);
            }
            FromClient::GetInfo(request) => self.answer(Answer::There(request, session)),
            FromClient::Create(request, entity) if ours => {
                self.create(request.object, &entity);
                self.answer(Answer::Done(request));
            }
            FromClient::Delete(request) if ours && request.object == CLIENT_OBJECT => {
                self.answer(Answer::Ended(request));
            }
            FromClient::Delete(request) if ours => {
                self.delete(request.object);
                self.answer(Answer::Done(request));
            }
            FromClient::ReadData(request) if ours => {
                let known = self.known.iter_mut().find(|known| known.reader == Some(request.object));
                if let Some(known) = known {
                    known.wanted = Some(request);
                }
            }
            FromClient::Heartbeat { last, stream: RELIABLE, .. } if ours => {
                self.acknowledge = true;
                if is_newer(last, self.newest) {
                    self.newest = last;
                }
            }
            FromClient::Timestamp(asked) if ours => self.answer(Answer::Clock(asked)),
            _ => {}
        }
    }

    fn create(&mut self, object: ObjectId, entity: &Entity<'_>) {
        match *entity {
            Entity::Topic(name) => {
                if let Some(known) = Topic::named(name).and_then(|topic| self.known.get_mut(topic as usize)) {
                    known.topic = Some(object);
                }
            }
            Entity::Writer(name) => {
                if let Some(known) = self.named(name) {
                    known.writer = Some(object);
                }
            }
            Entity::Reader(name) => {
                if let Some(known) = self.named(name) {
                    known.reader = Some(object);
                }
            }
            Entity::Other => {}
        }
    }

    fn delete(&mut self, object: ObjectId) {
        for known in &mut self.known {
            for found in [&mut known.topic, &mut known.writer, &mut known.reader] {
                *found = found.filter(|found| *found != object);
            }
            known.wanted = known.wanted.filter(|wanted| wanted.object != object);
        }
    }

    fn named(&mut self, name: TopicName<'_>) -> Option<&mut Known> {
        match name {
            TopicName::Object(object) => self.known.iter_mut().find(|known| known.topic == Some(object)),
            TopicName::Text(text) => self.known.get_mut(Topic::named(text)? as usize),
        }
    }

    fn written_by(&self, object: ObjectId) -> Option<Topic> {
        Topic::ALL
            .iter()
            .copied()
            .zip(&self.known)
            .find(|(_, k)| k.writer == Some(object))
            .map(|(topic, _)| topic)
    }

    /// Whether the client has created the writer of a topic.
    pub(super) fn publishes(&self, topic: Topic) -> bool {
        self.known.get(topic as usize).is_some_and(|known| known.writer.is_some())
    }

    /// Whether the client asks for the data of a topic.
    pub(super) fn wants(&self, topic: Topic) -> bool {
        self.known.get(topic as usize).is_some_and(|known| known.wanted.is_some())
    }

    /// Whether a client has begun a session.
    pub(super) fn begun(&self) -> bool {
        self.session.is_some()
    }

    /// Whether, since the last call, a client has begun a session that was not the first.
    pub(super) fn began_anew(&mut self) -> bool {
        core::mem::take(&mut self.began_anew)
    }

    /// Messages that were taken, and messages that were refused.
    pub(super) fn counts(&self) -> (u32, u32) {
        (self.messages, self.refused)
    }

    /// Sends a message of a topic, if the client asks for it.
    pub(super) fn send<T: TopicMessage>(&mut self, message: &T, out: &mut Outgoing) {
        let wanted = self.known.get(T::TOPIC as usize).and_then(|known| known.wanted);
        let Some((request, session)) = wanted.zip(self.session) else { return };
        let mut data = [0; LONGEST];
        let length = message.write(&mut data);
        let data = data.get(..length).unwrap_or(&[]);
        let header = Header { session, stream: BEST_EFFORT, sequence: self.sequence };
        let mut draft = Draft::<LONGEST>::new(header);
        if draft.agent(&FromAgent::Data(request, data)) && append(&draft, out) {
            self.sequence = self.sequence.wrapping_add(1);
        }
    }

    /// Sends the answers that wait, as many as fit. `now` is the agent's time that the client gets, s.
    pub(super) fn answer_all(&mut self, now: f64, out: &mut Outgoing) {
        for slot in 0..MAX_ANSWERS {
            let Some(answer) = self.answers.get(slot).copied().flatten() else { continue };
            if !self.send_answer(answer, now, out) {
                return;
            }
            if let Some(slot) = self.answers.get_mut(slot) {
                *slot = None;
            }
        }
        if let Some(session) = self.session.filter(|_| self.acknowledge) {
            let first = self.expected;
            // The client only tests whether any message is missing. If one is, it sends all of them again.
            let missing = u16::from(!is_newer(first, self.newest));
            let draft = stated(session, &FromAgent::AckNack { first, missing, stream: RELIABLE });
            self.acknowledge = !append(&draft, out);
        }
    }

    fn send_answer(&mut self, answer: Answer, now: f64, out: &mut Outgoing) -> bool {
        let Some(session) = self.session.or(match answer {
            Answer::There(_, session) => Some(session),
            _ => None,
        }) else {
            return true;
        };
        match answer {
            Answer::Began => append(&stated(session, &FromAgent::StatusAgent(0)), out),
            Answer::Ended(request) => {
                let sent = append(&stated(session, &FromAgent::Status(request, 0)), out);
                if sent {
                    self.session = None;
                }
                sent
            }
            Answer::Done(request) => {
                let header = Header { session, stream: BEST_EFFORT, sequence: self.sequence };
                let mut draft = Draft::<LONGEST>::new(header);
                let sent = draft.agent(&FromAgent::Status(request, 0)) && append(&draft, out);
                if sent {
                    self.sequence = self.sequence.wrapping_add(1);
                }
                sent
            }
            Answer::There(request, asked_in) => {
                let active = self.session == Some(asked_in);
                append(&stated(asked_in, &FromAgent::Info(request, active)), out)
            }
            Answer::Clock(asked) => {
                let now = Time::of(now);
                append(&stated(session, &FromAgent::TimestampReply { now, asked }), out)
            }
        }
    }

    /// Keeps an answer for the end of the tick. If there is no room, the answer is lost, and the client asks again.
    fn answer(&mut self, answer: Answer) {
        if let Some(free) = self.answers.iter_mut().find(|slot| slot.is_none()) {
            *free = Some(answer);
        }
    }
}

/// A message outside of any stream.
fn stated(session: u8, submessage: &FromAgent<'_>) -> Draft<LONGEST> {
    let mut draft = Draft::new(Header { session, stream: NO_STREAM, sequence: 0 });
    draft.agent(submessage);
    draft
}

/// Appends a message as a frame. Returns whether it fitted.
fn append<const N: usize>(draft: &Draft<N>, out: &mut Outgoing) -> bool {
    let before = out.bytes().len();
    out.append(|free| frame::encode(AGENT, CLIENT, draft.bytes(), free));
    out.bytes().len() > before
}
