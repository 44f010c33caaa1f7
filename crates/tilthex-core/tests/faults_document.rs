//! `docs/faults.md` and `python/tilthex/_faults.py` hold the table of faults that the code uses.
//! `TILTHEX_WRITE_DOCS=1 cargo test --test faults_document` writes both.

use std::fmt::Write as _;
use tilthex_core::supervisor::{Reaction, TABLE};

const HEAD: &str = "# Faults and reactions

This page lists every fault that the supervisor knows: the condition by which it is recognised, for how long the condition must last
before the fault counts, for how long the condition must be absent before the fault is over, and the reactions. The page is written from
`supervisor::TABLE` and `supervisor::limits`, which the code uses (`TILTHEX_WRITE_DOCS=1 cargo test -p tilthex-core --test
faults_document`); a test compares the two. The number of a fault is its bit in logs.

- **note**: the fault is counted and logged; the remark says what replaces a missing value.
- **refuse**: on the ground, the motors do not start, or they stop.
- **hold**: the mission's clock slows down and stops; it continues when the fault is over.
- **land**: straight down from the reference, while the vehicle turns level; the supervisor does not take it back.
- **descend**: level attitude and a rate of descent with IMU and model, without a position. If the speed is not known either, the thrust
  is less than the weight, and decreases. When the position returns, the reaction is *land* again.

If several faults are active, the reaction that is furthest down in this list is taken. The longer no pose comes, the faster *land* and
*descend* go down, because the error of the estimated speed grows.

Motors stop only when the ground carries the vehicle (`flight/landing.rs` lists the signs), by a fault of the lift-off just above the
ground, or by the order `kill`. If the program itself ends in flight, the vehicle's own watchdog takes the rotors to their lowest speed, so
that the vehicle falls, and stops them later. Nothing on the base PC can prevent this. Therefore the program must not die: see the
real-time notes in [loop.md](loop.md).

The *lagged command* is the commanded speed of a rotor after the lag of the model: the speed that the rotor should have.

| number | fault | seen by | after | over after | on the ground | in flight | remark |
|---|---|---|---|---|---|---|---|
";

fn name(reaction: Reaction) -> &'static str {
    match reaction {
        Reaction::Note => "note",
        Reaction::Refuse => "refuse",
        Reaction::Hold => "hold",
        Reaction::Land => "land",
        Reaction::Descend => "descend",
    }
}

#[test]
fn the_document_is_the_table() {
    let mut text = String::from(HEAD);
    for r in &TABLE {
        let (ground, flight) = (name(r.on_ground), name(r.in_flight));
        writeln!(
            text,
            "| {} | {} | {} | {} s | {} s | {ground} | {flight} | {} |",
            r.fault as u8, r.name, r.detection, r.after, r.over, r.remark
        )
        .expect("a string takes all");
    }
    written("docs/faults.md", &text);
}

const PYTHON_HEAD: &str =
    "\"\"\"The faults that the supervisor knows, and its reactions; docs/faults.md has the same as a table.

Written by `TILTHEX_WRITE_DOCS=1 cargo test --workspace --test faults_document`; do not change it by hand.
\"\"\"
# ruff: noqa: E501

from __future__ import annotations

from typing import NamedTuple


class Fault(NamedTuple):
    \"\"\"A row of the table.\"\"\"

    name: str
    on_ground: str
    \"\"\"Reaction before take-off: note or refuse.\"\"\"
    in_flight: str
    \"\"\"Reaction in flight: note, hold, land or descend.\"\"\"
    remark: str
    \"\"\"What replaces a missing value, and how to remove the cause; may be empty.\"\"\"


FAULTS = (
";

#[test]
fn the_python_table_is_the_table() {
    let mut text = String::from(PYTHON_HEAD);
    for (number, r) in TABLE.iter().enumerate() {
        assert_eq!(r.fault as usize, number, "the number of a fault is its place");
        text += "    Fault(\n";
        for word in [r.name, name(r.on_ground), name(r.in_flight), &r.remark.to_string()] {
            writeln!(text, "        {word:?},").expect("a string takes all");
        }
        text += "    ),\n";
    }
    text += ")\n\"\"\"All faults; the number of a fault, its bit in a log, is its place.\"\"\"\n";
    written("python/tilthex/_faults.py", &text);
}

/// Compares a file of the repository with what it should hold, or writes it.
fn written(file: &str, text: &str) {
    let path = format!("{}/../../{file}", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("TILTHEX_WRITE_DOCS").is_some() {
        std::fs::write(&path, text).expect("its folder is there");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(found, text, "{file} is not the table: run with TILTHEX_WRITE_DOCS=1");
}
