//! The schema of the declared values: for the log, and for the documentation.

use std::sync::LazyLock;

use prost::Message as _;
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FileDescriptorProto, FileDescriptorSet,
};
use serde_json::{Map, Value};
use tilthex_core::{allocation::Priority, supervisor::Phase};
use tilthex_sim::feed::Tick;

use super::{
    value::{Message, PACKAGE, PARTS},
    values::{COMMAND, Content, POSE, QUATERNION, REPLAYED, TIMED, TRUTH, TickChannel, VECTOR, WRENCH},
};

/// The full name of a message in the schema.
pub(crate) fn full_name(message: &str) -> String {
    format!("{PACKAGE}.{message}")
}

impl TickChannel {
    /// The name of its message.
    pub(super) fn message(&self) -> &'static str {
        match self.content {
            Content::Tick(message) => message.name,
            Content::Target(message, _) => message.name,
        }
    }

    /// Appends its message of a tick.
    pub(super) fn encode(&self, tick: &Tick, rotor_count: usize, out: &mut Vec<u8>) {
        match self.content {
            Content::Tick(message) => message.encode(tick, rotor_count, out),
            Content::Target(message, of) => message.encode(of(tick), rotor_count, out),
        }
    }

    fn descriptor(&self) -> DescriptorProto {
        match self.content {
            Content::Tick(message) => message.descriptor(),
            Content::Target(message, _) => message.descriptor(),
        }
    }

    fn fields(&self) -> Vec<DescribedField> {
        match self.content {
            Content::Tick(message) => fields(message),
            Content::Target(message, _) => fields(message),
        }
    }
}

/// The values of a tick that clients get, with their names in the state.
pub(crate) fn state(tick: &Tick, rotor_count: usize) -> Map<String, Value> {
    let mut state = Map::new();
    for channel in &REPLAYED {
        let mut shown = Map::new();
        match channel.content {
            Content::Tick(message) => message.show(tick, rotor_count, &mut shown),
            Content::Target(message, of) => message.show(of(tick), rotor_count, &mut shown),
        }
        if channel.state.is_empty() {
            state.append(&mut shown);
        } else {
            state.insert(channel.state.into(), Value::Object(shown));
        }
    }
    state
}

/// The serialised `FileDescriptorSet` of all messages of a flight.
pub(super) static DESCRIPTORS: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut messages: Vec<DescriptorProto> = Vec::new();
    let own = [VECTOR.descriptor(), QUATERNION.descriptor(), WRENCH.descriptor(), POSE.descriptor()];
    let channels = REPLAYED.iter().chain([&TIMED]).map(TickChannel::descriptor);
    for message in own.into_iter().chain(channels).chain([COMMAND.descriptor(), TRUTH.descriptor()]) {
        if messages.iter().all(|known| known.name != message.name) {
            messages.push(message);
        }
    }
    let file = FileDescriptorProto {
        name: Some("tilthex.proto".into()),
        package: Some(PACKAGE.into()),
        message_type: messages,
        enum_type: vec![
            enumeration("Phase", Phase::ALL.map(Phase::name)),
            enumeration("Part", PARTS.map(|part| part.map_or("none", Priority::name))),
        ],
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
});

/// An enumeration; `Phase` and "flying" give `PHASE_FLYING`.
fn enumeration<const N: usize>(name: &str, values: [&str; N]) -> EnumDescriptorProto {
    let value = |(number, value): (i32, &str)| EnumValueDescriptorProto {
        name: Some(format!("{name}_{value}").to_uppercase().replace('-', "_")),
        number: Some(number),
        options: None,
    };
    EnumDescriptorProto {
        name: Some(name.into()),
        value: (0..).zip(values).map(value).collect(),
        ..EnumDescriptorProto::default()
    }
}

/// A logged value, for the documentation.
#[derive(Clone, Debug)]
pub struct DescribedField {
    /// Its number in the message.
    pub number: u32,
    /// Its name in the message.
    pub name: &'static str,
    /// Its type in the schema.
    pub kind: String,
    /// Its unit; empty if it has none.
    pub unit: &'static str,
    /// Its name in the state of the control socket; empty if the state does not hold it.
    pub state: &'static str,
    /// Its type in the state of the Python client.
    pub python: &'static str,
    /// Its meaning.
    pub doc: &'static str,
}

/// A channel, or a message inside others, for the documentation.
#[derive(Clone, Debug)]
pub struct DescribedChannel {
    /// Its topic; empty for a message inside others.
    pub topic: &'static str,
    /// The name of its message.
    pub message: &'static str,
    /// Its content.
    pub doc: &'static str,
    /// The name of the group of its values in the state; empty if they are not a group.
    pub state: &'static str,
    /// Its values.
    pub fields: Vec<DescribedField>,
}

fn fields<S>(message: &Message<S>) -> Vec<DescribedField> {
    let described = |f: &super::value::Field<S>| DescribedField {
        number: f.number,
        name: f.name,
        kind: f.kind_name(),
        unit: f.unit,
        state: f.state,
        python: f.python(),
        doc: f.doc,
    };
    message.fields.iter().map(described).collect()
}

fn other<S>(topic: &'static str, message: &Message<S>) -> DescribedChannel {
    DescribedChannel { topic, message: message.name, doc: message.doc, state: "", fields: fields(message) }
}

/// Every channel of a flight and every message inside them, for the documentation.
#[must_use]
pub fn described() -> Vec<DescribedChannel> {
    let of_a_tick = REPLAYED.iter().chain([&TIMED]).map(|channel| DescribedChannel {
        topic: channel.topic,
        message: channel.message(),
        doc: channel.doc,
        state: channel.state,
        fields: channel.fields(),
    });
    let others = [
        other("/command", &COMMAND),
        other("/truth", &TRUTH),
        other("", &POSE),
        other("", &VECTOR),
        other("", &QUATERNION),
        other("", &WRENCH),
    ];
    of_a_tick.chain(others).collect()
}
