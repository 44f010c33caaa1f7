//! The newest state of the flight, in the form that clients get.

use serde_json::{Value, json};

use crate::{log::schema, recorder::Latest};

/// Values of the state that are not logged values: name, type in the Python client, meaning.
pub const BESIDES: [(&str, &str, &str); 3] = [
    ("late", "int", "Periods of the loop that were skipped, total."),
    ("refused", "int", "Requests on the control socket that were refused, total."),
    ("controls", "str | None", "Name of the client that holds the controls; None if no client holds them."),
];

/// The newest state. Numbers that are not finite are null. `controls` is the client that holds the controls.
pub(super) fn state(latest: &Latest, refused: u64, controls: Option<&str>) -> Value {
    let Some(tick) = &latest.tick else { return Value::Null };
    let mut state = schema::state(tick, latest.rotor_count);
    let besides = [json!(latest.statistics.skipped), json!(refused), json!(controls)];
    state.extend(BESIDES.iter().map(|(name, ..)| (*name).to_owned()).zip(besides));
    Value::Object(state)
}
