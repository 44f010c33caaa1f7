//! How a declared value is read from its source, written to a message, described in the schema, and sent to clients.

use prost::encoding::{self, WireType};
use prost_types::{
    DescriptorProto, FieldDescriptorProto,
    field_descriptor_proto::{Label, Type},
};
use serde_json::{Map, Value, json};
use tilthex_core::{
    Matrix3, RotorVector, Vector3, Wrench,
    allocation::Priority,
    so3,
    supervisor::{FaultSet, Phase},
    types::PoseSample,
};

use super::values::{POSE, QUATERNION, VECTOR, WRENCH};

/// How to read a value from a source `S`. The kind of the value decides how it is logged and sent to clients.
pub(super) enum Get<S> {
    Number(fn(&S) -> f64),
    Flag(fn(&S) -> bool),
    Count(fn(&S) -> u32),
    Total(fn(&S) -> u64),
    Faults(fn(&S) -> FaultSet),
    Phase(fn(&S) -> Phase),
    Part(fn(&S) -> Option<Priority>),
    Vector(fn(&S) -> Vector3),
    /// Logged as a quaternion.
    Rotation(fn(&S) -> Matrix3),
    /// Logged as nine numbers, row by row, so that no bit is lost.
    Matrix(fn(&S) -> Matrix3),
    Wrench(fn(&S) -> Wrench),
    Rotors(fn(&S) -> RotorVector),
    Bytes(fn(&S) -> &[u8]),
    Text(fn(&S) -> &str),
    Poses(fn(&S) -> &[PoseSample]),
}

/// A logged value, declared once.
pub(super) struct Field<S> {
    /// Its number in the message. It never changes.
    pub(super) number: u32,
    pub(super) name: &'static str,
    /// Its unit; empty if it has none.
    pub(super) unit: &'static str,
    /// Its name in the state of the control socket; empty if the state does not hold it. A wrench has two names there,
    /// of its force and of its torque.
    pub(super) state: &'static str,
    pub(super) doc: &'static str,
    pub(super) get: Get<S>,
}

/// A message of the log.
pub(super) struct Message<S: 'static> {
    pub(super) name: &'static str,
    pub(super) doc: &'static str,
    pub(super) fields: &'static [Field<S>],
}

/// A line of the table.
pub(super) const fn field<S>(
    number: u32,
    name: &'static str,
    unit: &'static str,
    state: &'static str,
    doc: &'static str,
    get: Get<S>,
) -> Field<S> {
    Field { number, name, unit, state, doc, get }
}

/// The parts that the allocator can give up, in the order of their numbers in the log. Numbers never change.
pub(super) const PARTS: [Option<Priority>; 5] = [
    None,
    Some(Priority::RollPitchTorque),
    Some(Priority::VerticalForce),
    Some(Priority::YawTorque),
    Some(Priority::LateralForce),
];

fn number_in<T: PartialEq>(all: &[T], value: &T) -> i32 {
    all.iter().position(|one| one == value).unwrap_or(0) as i32
}

impl<S> Message<S> {
    /// Appends the message of a source, for a vehicle with `rotor_count` rotors.
    pub(super) fn encode(&self, source: &S, rotor_count: usize, out: &mut Vec<u8>) {
        for field in self.fields {
            field.encode(source, rotor_count, out);
        }
    }

    fn nested(&self, number: u32, source: &S, out: &mut Vec<u8>) {
        let mut inner = Vec::with_capacity(64);
        self.encode(source, 0, &mut inner);
        encoding::encode_key(number, WireType::LengthDelimited, out);
        encoding::encode_varint(inner.len() as u64, out);
        out.extend_from_slice(&inner);
    }

    pub(super) fn descriptor(&self) -> DescriptorProto {
        DescriptorProto {
            name: Some(self.name.into()),
            field: self.fields.iter().map(Field::descriptor).collect(),
            ..DescriptorProto::default()
        }
    }

    /// Adds the values of a source that clients get to their state.
    pub(super) fn show(&self, source: &S, rotor_count: usize, state: &mut Map<String, Value>) {
        for field in self.fields.iter().filter(|field| !field.state.is_empty()) {
            if let Get::Wrench(get) = field.get {
                let wrench = get(source);
                let parts = [&wrench.force, &wrench.torque];
                for (name, part) in field.state.split(", ").zip(parts) {
                    state.insert(name.into(), vector(part));
                }
            } else {
                state.insert(field.state.into(), field.value(source, rotor_count));
            }
        }
    }
}

impl<S> Field<S> {
    /// Encodes the field like `prost`: a number that has its default value is left out, a message never is.
    fn encode(&self, source: &S, rotor_count: usize, out: &mut Vec<u8>) {
        use encoding as e;
        let n = self.number;
        match self.get {
            Get::Number(get) => encode_unless(get(source), 0.0, |v| e::double::encode(n, v, out)),
            Get::Flag(get) => encode_unless(get(source), false, |v| e::bool::encode(n, v, out)),
            Get::Count(get) => encode_unless(get(source), 0, |v| e::uint32::encode(n, v, out)),
            Get::Total(get) => encode_unless(get(source), 0, |v| e::uint64::encode(n, v, out)),
            Get::Faults(get) => encode_unless(get(source).0, 0, |v| e::fixed64::encode(n, v, out)),
            Get::Phase(get) => {
                encode_unless(number_in(&Phase::ALL, &get(source)), 0, |v| e::int32::encode(n, v, out));
            }
            Get::Part(get) => {
                encode_unless(number_in(&PARTS, &get(source)), 0, |v| e::int32::encode(n, v, out));
            }
            Get::Vector(get) => VECTOR.nested(n, &get(source), out),
            Get::Rotation(get) => QUATERNION.nested(n, &so3::to_quaternion_xyzw(&get(source)), out),
            Get::Wrench(get) => WRENCH.nested(n, &get(source), out),
            Get::Matrix(get) => e::double::encode_packed(n, get(source).transpose().as_slice(), out),
            Get::Rotors(get) => {
                let speeds = get(source);
                let count = rotor_count.min(speeds.len());
                e::double::encode_packed(n, &speeds.as_slice()[..count], out);
            }
            Get::Bytes(get) => {
                let bytes = get(source).to_vec();
                encode_unless(bytes, Vec::new(), |v| e::bytes::encode(n, v, out));
            }
            Get::Text(get) => {
                encode_unless(get(source).to_owned(), String::new(), |v| e::string::encode(n, v, out));
            }
            Get::Poses(get) => get(source).iter().for_each(|pose| POSE.nested(n, pose, out)),
        }
    }

    fn descriptor(&self) -> FieldDescriptorProto {
        let (kind, message) = self.kind();
        FieldDescriptorProto {
            name: Some(self.name.into()),
            number: Some(self.number as i32),
            label: Some(if self.is_list() { Label::Repeated } else { Label::Optional }.into()),
            r#type: Some(kind.into()),
            type_name: message.map(|name| format!(".{PACKAGE}.{name}")),
            ..FieldDescriptorProto::default()
        }
    }

    fn is_list(&self) -> bool {
        matches!(self.get, Get::Matrix(_) | Get::Rotors(_) | Get::Poses(_))
    }

    /// Its type in the schema; for a message or an enumeration also the name of that.
    fn kind(&self) -> (Type, Option<&'static str>) {
        match self.get {
            Get::Number(_) | Get::Matrix(_) | Get::Rotors(_) => (Type::Double, None),
            Get::Flag(_) => (Type::Bool, None),
            Get::Count(_) => (Type::Uint32, None),
            Get::Total(_) => (Type::Uint64, None),
            Get::Faults(_) => (Type::Fixed64, None),
            Get::Phase(_) => (Type::Enum, Some("Phase")),
            Get::Part(_) => (Type::Enum, Some("Part")),
            Get::Vector(_) => (Type::Message, Some(VECTOR.name)),
            Get::Rotation(_) => (Type::Message, Some(QUATERNION.name)),
            Get::Wrench(_) => (Type::Message, Some(WRENCH.name)),
            Get::Bytes(_) => (Type::Bytes, None),
            Get::Text(_) => (Type::String, None),
            Get::Poses(_) => (Type::Message, Some(POSE.name)),
        }
    }

    /// The name of its type in the schema.
    pub(super) fn kind_name(&self) -> String {
        let (kind, message) = self.kind();
        let name = message.map_or_else(|| kind.as_str_name()[5..].to_lowercase(), str::to_owned);
        if self.is_list() { format!("repeated {name}") } else { name }
    }

    /// Its type in the state of the Python client.
    pub(super) fn python(&self) -> &'static str {
        match self.get {
            Get::Number(_) => "float | None",
            Get::Flag(_) => "bool",
            Get::Count(_) | Get::Total(_) => "int",
            Get::Faults(_) => "list[str]",
            Get::Phase(_) | Get::Text(_) => "str",
            Get::Part(_) => "str | None",
            Get::Bytes(_) | Get::Poses(_) => "object",
            Get::Vector(_) | Get::Rotation(_) | Get::Matrix(_) | Get::Wrench(_) | Get::Rotors(_) => "Array",
        }
    }

    /// The JSON value that a client gets. A number that is not finite is null.
    fn value(&self, source: &S, rotor_count: usize) -> Value {
        match self.get {
            Get::Number(get) => json!(get(source)),
            Get::Flag(get) => json!(get(source)),
            Get::Count(get) => json!(get(source)),
            Get::Total(get) => json!(get(source)),
            Get::Faults(get) => get(source).rows().map(|row| row.name).collect(),
            Get::Phase(get) => json!(get(source).name()),
            Get::Part(get) => json!(get(source).map(Priority::name)),
            Get::Vector(get) => vector(&get(source)),
            Get::Rotation(get) | Get::Matrix(get) => {
                let r = get(source);
                json!([0, 1, 2].map(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]]))
            }
            Get::Rotors(get) => {
                let speeds = get(source);
                json!(&speeds.as_slice()[..rotor_count.min(speeds.len())])
            }
            Get::Text(get) => json!(get(source)),
            Get::Wrench(_) | Get::Bytes(_) | Get::Poses(_) => Value::Null,
        }
    }
}

/// The package of all names in the schema.
pub(super) const PACKAGE: &str = "tilthex";

fn encode_unless<T: PartialEq>(value: T, default: T, encode: impl FnOnce(&T)) {
    if value != default {
        encode(&value);
    }
}

fn vector(v: &Vector3) -> Value {
    json!([v.x, v.y, v.z])
}
