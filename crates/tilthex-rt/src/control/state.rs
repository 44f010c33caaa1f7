//! The newest state of the flight, as clients get it.

use serde_json::{Value, json};
use tilthex_core::{Matrix3, Setpoint, Vector3};

use crate::recorder::Latest;

fn vector(v: &Vector3) -> Value {
    json!([v.x, v.y, v.z])
}

fn rotation(r: &Matrix3) -> Value {
    json!([0, 1, 2].map(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]]))
}

fn target(s: &Setpoint) -> Value {
    json!({
        "position": vector(&s.position_w), "rotation": rotation(&s.rotation_we),
        "velocity": vector(&s.velocity_w), "angular_velocity": vector(&s.angular_velocity_w),
        "force": vector(&s.wrench_w.force), "torque": vector(&s.wrench_w.torque),
    })
}

/// The newest state; numbers that are not finite are null. `controls`: who holds them.
pub(super) fn state(latest: &Latest, refused: u64, controls: Option<&str>) -> Value {
    let Some(tick) = &latest.tick else { return Value::Null };
    let r = &tick.record;
    let faults: Vec<_> = r.faults.rows().map(|row| row.name).collect();
    let rotors = |speeds: &[f64]| json!(&speeds[..latest.rotor_count.min(speeds.len())]);
    json!({
        "time": r.input.time,
        "tick": r.tick,
        "phase": r.phase.name(),
        "faults": faults,
        "position": vector(&r.state.position_w),
        "velocity": vector(&r.state.velocity_w),
        "rotation": rotation(&r.state.rotation_wr),
        "angular_velocity": vector(&r.state.angular_velocity_r),
        "setpoint": target(&r.setpoint),
        "reference": target(&r.reference),
        "force": vector(&r.wrench_tool_w.force),
        "torque": vector(&r.wrench_tool_w.torque),
        "position_error": vector(&r.position_error_w),
        "model": {
            "mass": r.model.mass, "centre_of_mass": vector(&r.model.centre_of_mass_r), "hovers": r.model.hovers,
            "false_force": r.model.false_force, "false_torque": r.model.false_torque,
        },
        "compliant": r.compliant,
        "saturated": r.saturated,
        "rotor_command": rotors(r.rotor_command.as_slice()),
        "rotor_speeds": rotors(r.rotor_speeds.as_slice()),
        "battery": r.battery,
        "late": latest.statistics.skipped,
        "refused": refused,
        "controls": controls,
    })
}
