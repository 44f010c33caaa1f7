//! docs/log.md and the types of the Python client are those of the declared values; old logs keep their meaning.
//! `TILTHEX_WRITE_DOCS=1 cargo test --workspace --test log_document` writes both.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};
use tilthex_rt::{
    control::{BESIDES, PROTOCOL},
    log::{DescribedChannel, DescribedField, described},
};

const HEAD: &str = "# The log

A log is an MCAP file of protobuf messages; each channel carries its schema, so common tools read it. `tilthex.log` reads it
into arrays. Units are SI, rotor speeds in Hz. Frames are suffixes: `_w` world (z up), `_r` robot, `_e` tool, `_i` IMU. Times
are seconds of the host's monotonic clock; each message has the time since 1970 beside it. The column *state* names the value
in the state that the control socket and `tilthex.connect()` give; there, rotations are 3x3 matrices. Besides the channels
below, `/log` has lines of text and `/tf` the frames of robot and tool, as viewers know them.

This page, the schema of a log, the state of the control socket and the types of the Python client follow from
`crates/tilthex-rt/src/log/values.rs` (`TILTHEX_WRITE_DOCS=1 cargo test --workspace --test log_document` writes the page); a
test compares them. Numbers of fields never change: an old log keeps its meaning.
";

fn written(path: &str, text: &str) {
    let path = format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("TILTHEX_WRITE_DOCS").is_some() {
        std::fs::write(&path, text).expect("its folder is there");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(found, text, "{path} is not the declarations: run with TILTHEX_WRITE_DOCS=1");
}

/// The place of a value in the state; empty where it has none.
fn place(channel: &DescribedChannel, field: &DescribedField) -> String {
    let within = |name: &str| match channel.state {
        "" => format!("`{name}`"),
        outer => format!("`{outer}.{name}`"),
    };
    field.state.split(", ").filter(|name| !name.is_empty()).map(within).collect::<Vec<_>>().join(", ")
}

#[test]
fn the_document_is_the_declarations() {
    let mut text = String::from(HEAD);
    for channel in described() {
        let title = match channel.topic {
            "" => format!("`{}`, within the others", channel.message),
            topic => format!("`{topic}`: `{}`", channel.message),
        };
        write!(text, "\n## {title}\n\n{}\n\n", channel.doc).expect("a string takes all");
        text += "| number | value | type | unit | meaning | state |\n|---|---|---|---|---|---|\n";
        for f in &channel.fields {
            let state = place(&channel, f);
            writeln!(text, "| {} | `{}` | {} | {} | {} | {state} |", f.number, f.name, f.kind, f.unit, f.doc)
                .expect("a string takes all");
        }
    }
    text += "\n## Only in the state\n\n| value | meaning |\n|---|---|\n";
    for (name, _, doc) in BESIDES {
        writeln!(text, "| `{name}` | {doc} |").expect("a string takes all");
    }
    written("docs/log.md", &text);
}

/// The JSON Schema of a value whose type in Python is this.
fn json(python: &str, doc: &str, unit: &str) -> Value {
    let unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
    let kind = match python {
        "float | None" => json!(["number", "null"]),
        "bool" => json!("boolean"),
        "int" => json!("integer"),
        "str" => json!("string"),
        "str | None" => json!(["string", "null"]),
        "Array" | "list[str]" => json!("array"),
        other => panic!("{other} has no type of JSON here"),
    };
    json!({"type": kind, "description": format!("{doc}{unit}")})
}

fn object(properties: Map<String, Value>) -> Value {
    let required: Vec<&String> = properties.keys().collect();
    json!({"type": "object", "required": required, "properties": properties, "additionalProperties": false})
}

#[test]
fn the_schema_of_the_state_is_the_declarations() {
    let mut state = Map::new();
    for channel in described() {
        let names = |f: &DescribedField| f.state.split(", ").filter(|n| !n.is_empty()).collect::<Vec<_>>();
        let shown: Map<String, Value> = channel
            .fields
            .iter()
            .flat_map(|f| names(f).into_iter().map(|name| (name.to_owned(), json(f.python, f.doc, f.unit))))
            .collect();
        match channel.state {
            _ if shown.is_empty() => {}
            "" => state.extend(shown),
            name => {
                state.insert(name.into(), object(shown));
            }
        }
    }
    state.extend(BESIDES.map(|(name, python, doc)| (name.to_owned(), json(python, doc, ""))));
    let mut schema = object(state);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    schema["title"] = json!("The state of a flight, as the control socket of tilthex-rt tells it");
    let text = serde_json::to_string_pretty(&schema).expect("JSON") + "\n";
    written("docs/schema/state.json", &text);
}

/// What a client reads. A version of the protocol is for one schema: change it with [`PROTOCOL`].
#[test]
fn the_schema_of_the_answers_is_of_this_version() {
    let (id, state) = (json!({"description": "That of the request."}), json!({"$ref": "state.json"}));
    let or_none = json!({"anyOf": [state, {"type": "null"}], "description": "Null before the first tick."});
    let protocol = json!({"const": PROTOCOL, "description": "Version of the protocol; with `state` and `authenticate`."});
    let schema = json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A line of JSON from the control socket of tilthex-rt",
        "oneOf": [
            {
                "type": "object",
                "description": "A request is carried out.",
                "required": ["id", "ok"],
                "properties": {
                    "id": id,
                    "ok": {"const": true},
                    "protocol": protocol,
                    "state": or_none,
                    "configuration": {"type": "string", "description": "TOML."},
                },
            },
            {
                "type": "object",
                "description": "A request is refused, or the connection ends.",
                "required": ["error"],
                "properties": {"id": id, "error": {"type": "string", "description": "One sentence."}},
                "not": {"required": ["ok"]},
            },
            {
                "type": "object",
                "description": "A line of a stream of states.",
                "required": ["state"],
                "properties": {"state": or_none},
                "additionalProperties": false,
            },
        ],
    });
    let text = serde_json::to_string_pretty(&schema).expect("JSON") + "\n";
    written("docs/schema/answers.json", &text);
}

/// Classes of a state: those within it first.
fn classes(text: &mut String) {
    let mut outer = Vec::new();
    let mut inner: Vec<&str> = Vec::new();
    for channel in described() {
        let of = |f: &DescribedField| {
            let unit = if f.unit.is_empty() { String::new() } else { format!(" [{}]", f.unit) };
            f.state
                .split(", ")
                .filter(|name| !name.is_empty())
                .map(|name| format!("    {name}: {}\n    \"\"\"{}{unit}\"\"\"\n", f.python, f.doc))
                .collect::<String>()
        };
        let fields: String = channel.fields.iter().map(of).collect();
        match (channel.state, fields.is_empty()) {
            (_, true) => {}
            ("", _) => outer.push(fields),
            (name, _) => {
                outer.push(format!("    {name}: {}\n    \"\"\"{}\"\"\"\n", channel.message, channel.doc));
                if !inner.contains(&channel.message) {
                    inner.push(channel.message);
                    let doc =
                        if channel.message == "Target" { "A set-point of the tool." } else { channel.doc };
                    write!(
                        text,
                        "\n\nclass {}(TypedDict):\n    \"\"\"{doc}\"\"\"\n\n{fields}",
                        channel.message
                    )
                    .expect("a string takes all");
                }
            }
        }
    }
    for (name, kind, doc) in BESIDES {
        outer.push(format!("    {name}: {kind}\n    \"\"\"{doc}\"\"\"\n"));
    }
    let doc = "The newest state of a flight; docs/log.md has the same as a table.";
    write!(text, "\n\nclass State(TypedDict):\n    \"\"\"{doc}\"\"\"\n\n{}", outer.concat())
        .expect("a string takes all");
}

#[test]
fn the_python_types_are_the_declarations() {
    let mut text = String::from(
        "\"\"\"The topics of a log and the state of a flight, as tilthex-rt declares them.\n\n\
         Written by `TILTHEX_WRITE_DOCS=1 cargo test --workspace --test log_document`; do not change it by hand.\n\"\"\"\n\
         # ruff: noqa: E501\n\nfrom __future__ import annotations\n\nfrom typing import TypedDict\n\nimport numpy as np\n\
         from numpy.typing import NDArray\n\nArray = NDArray[np.float64]\n\nTOPICS = {\n",
    );
    for channel in described().iter().filter(|channel| !channel.topic.is_empty()) {
        writeln!(text, "    \"{}\": \"{}\",", channel.topic, channel.message).expect("a string takes all");
    }
    text += "}\n\"\"\"The topics of a flight and the messages that they hold.\"\"\"\n";
    classes(&mut text);
    written("python/tilthex/_logged.py", &text);
}

/// `log_format.txt` has every value that a log has ever had. Lines are added to it, never changed.
#[test]
fn old_logs_keep_their_meaning() {
    let mut now = Vec::new();
    for channel in described() {
        for f in &channel.fields {
            now.push(format!("{} {} {} {}", channel.message, f.number, f.name, f.kind));
        }
        let mut numbers: Vec<_> = channel.fields.iter().map(|f| f.number).collect();
        numbers.dedup();
        assert_eq!(numbers.len(), channel.fields.len(), "{}: a number stands twice", channel.message);
    }
    for line in include_str!("log_format.txt").lines() {
        assert!(now.iter().any(|known| known == line), "`{line}` is no longer declared so");
    }
}
