//! `docs/faults.md` holds the table of faults that the code uses.
//! `TILTHEX_WRITE_DOCS=1 cargo test --test faults_document` writes it.

use std::fmt::Write as _;
use tilthex_core::supervisor::{Reaction, TABLE};

const HEAD: &str = "# Faults and reactions

This page lists every fault that the supervisor knows: the condition by which it is recognised, for how long the condition must last
before the fault counts, for how long the condition must be absent before the fault is over, and the reactions. The page is written from
`supervisor::TABLE` and `supervisor::limits`, which the code uses (`TILTHEX_WRITE_DOCS=1 cargo test -p tilthex-core --test
faults_document`); a test compares the two. The number of a fault is its bit in logs.

- **note**: the fault is counted and logged; the remark names a substitute, if there is one.
- **refuse**: on the ground, the motors do not start, or they stop.
- **hold**: the mission's clock slows down and stops; it continues when the fault is over.
- **land**: straight down from the reference, while the vehicle turns level; the supervisor does not take it back.
- **descend**: level attitude and a constant rate of descent with IMU and model, without a position. If the speed is not known either,
  the thrust is a little less than the weight. When the position returns, the reaction is *land* again.

If several faults are active, the reaction that is furthest down in this list is taken. Motors stop only when the ground carries the
vehicle (`flight/landing.rs` lists the signs), or by the order `kill`. If the program itself ends in flight, the vehicle's own watchdog
takes the rotors to their lowest speed, so that the vehicle falls, and disarms later. Nothing on the base PC can prevent this. Therefore
the program must not die: see the real-time notes in [loop.md](loop.md).

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
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/faults.md");
    if std::env::var_os("TILTHEX_WRITE_DOCS").is_some() {
        std::fs::write(path, &text).expect("docs/ is there");
    }
    let found = std::fs::read_to_string(path).unwrap_or_default();
    assert_eq!(found, text, "docs/faults.md is not the table: run with TILTHEX_WRITE_DOCS=1");
}
