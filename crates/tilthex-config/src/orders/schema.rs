//! `docs/schema/orders.json`: a JSON Schema of every line that a client can send to the control socket.
//! `TILTHEX_WRITE_DOCS=1 cargo test --workspace --lib orders::schema` writes it.

use schemars::{JsonSchema, SchemaGenerator, generate::SchemaSettings};
use serde_json::{Map, Value, json};

use super::text::{FollowText, Nothing, RouteText, WrenchText};
use crate::described;

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/schema/orders.json");

/// The schema of a command's arguments.
fn takes<T: JsonSchema>(generator: &mut SchemaGenerator) -> Value {
    Value::from(T::json_schema(generator))
}

/// The schema of the keys of `[admittance]` that may change in flight, from their declarations.
fn admittance() -> Value {
    let six = json!({"type": "array", "items": {"type": "number"}, "minItems": 6, "maxItems": 6});
    let rows = json!({"type": "array", "items": six, "minItems": 6, "maxItems": 6});
    let section = described().into_iter().find(|section| section.name == "admittance").expect("a section");
    let properties: Map<String, Value> = section
        .keys
        .iter()
        .filter(|key| key.order == Some("set_admittance"))
        .map(|key| {
            let mut schema = match section.defaults.get(key.name) {
                Some(toml::Value::Array(_)) => json!({"anyOf": [six, rows]}),
                _ => json!({"type": "number"}),
            };
            if let Some((least, most)) = key.range {
                schema["minimum"] = json!(least);
                schema["maximum"] = json!(most);
            }
            schema["description"] = json!(format!("{} [{}]", key.doc.join(" "), key.unit));
            (key.name.to_owned(), schema)
        })
        .collect();
    json!({"type": "object", "properties": properties, "additionalProperties": false})
}

/// A command with its name, an `id`, and its arguments.
fn command(name: &str, mut takes: Value) -> Value {
    let object = takes.as_object_mut().expect("an object's schema");
    object.remove("title");
    let properties =
        object.entry("properties").or_insert_with(|| json!({})).as_object_mut().expect("an object");
    properties.insert("command".into(), json!({"const": name}));
    properties.insert("id".into(), json!({"description": "The answer has the same id."}));
    let required = object.entry("required").or_insert_with(|| json!([])).as_array_mut().expect("a list");
    required.insert(0, json!("command"));
    takes
}

fn schema() -> Value {
    let mut generator = SchemaGenerator::new(SchemaSettings::draft2020_12());
    let g = &mut generator;
    let rate = json!({"anyOf": [{"const": 0}, {"type": "number", "minimum": 0.1, "maximum": 100}],
                      "description": "Number of states per second; 0 ends the stream. [Hz]"});
    let stream = json!({"type": "object", "properties": {"rate": rate}, "required": ["rate"]});
    let token = json!({"type": "object", "properties": {"token": {"type": "string"}}});
    let mut commands =
        vec![command("play", takes::<RouteText>(g)), command("follow", takes::<FollowText>(g))];
    commands.push(command("set_wrench", takes::<WrenchText>(g)));
    commands.push(command("set_admittance", admittance()));
    let strict = ["take_off", "release_wrench", "zero_bias"];
    commands.extend(strict.map(|name| command(name, takes::<Nothing>(g))));
    commands.extend(["authenticate"].map(|name| command(name, token.clone())));
    commands.extend(["stream"].map(|name| command(name, stream.clone())));
    let any = ["land", "kill", "take_controls", "heartbeat", "configuration", "state"];
    commands.extend(any.map(|name| command(name, json!({"type": "object"}))));
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A line of JSON to the control socket of tilthex-rt",
        "oneOf": commands,
        "$defs": generator.take_definitions(true),
    })
}

#[test]
fn the_schema_is_the_declarations() {
    let text = serde_json::to_string_pretty(&schema()).expect("JSON") + "\n";
    if std::env::var_os("TILTHEX_WRITE_DOCS").is_some() {
        std::fs::write(PATH, &text).expect("its folder is there");
    }
    let found = std::fs::read_to_string(PATH).unwrap_or_default();
    assert_eq!(found, text, "{PATH} is not the declarations: run with TILTHEX_WRITE_DOCS=1");
}

/// Every command that the parser names has its schema, and no other.
#[test]
fn the_schema_has_every_command() {
    let config = crate::Config::default_for(crate::VehicleSection::preset("tilt-hex").expect("a preset"));
    let refusal = super::Orders::new(&config).parse(r#"{"command": "fly"}"#).expect_err("no command");
    let (_, names) = refusal.split_once("expected ").expect("it names them");
    let mut known: Vec<&str> = names.split(", ").flat_map(|name| name.split(" or ")).collect();
    known.push("authenticate");
    known.sort_unstable();
    let schema = schema();
    let commands = schema["oneOf"].as_array().expect("commands");
    let mut found: Vec<&str> =
        commands.iter().filter_map(|command| command["properties"]["command"]["const"].as_str()).collect();
    found.sort_unstable();
    assert_eq!(found, known);
}
