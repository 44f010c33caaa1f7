//! `docs/faults.md` holds the table of faults that the code uses.
//! `TILTHEX_WRITE_DOCS=1 cargo test --test faults_document` writes it anew.

use std::fmt::Write as _;
use tilthex_core::supervisor::{Reaction, TABLE};

const HEAD: &str = "# Faults and reactions

Every fault that the supervisor knows: how it is seen, for how long it must last before it counts, for how
long it must be gone before it is over, and what is done. This page is written from `supervisor::TABLE` and `supervisor::limits`, which
the code uses (`TILTHEX_WRITE_DOCS=1 cargo test -p tilthex-core --test faults_document`); a test compares the two. The number
of a fault is its bit in logs.

- **note**: counted and logged; a substitute stands in where one is named.
- **refuse**: on the ground, the motors do not start, or stop.
- **hold**: the mission's clock slows to a stop, and goes on when the fault is over.
- **land**: straight down from the reference, turning level; is not taken back.
- **descend**: level attitude and a constant rate of descent on IMU and model, without a position; where the speed is not
  known either, with a little less thrust than the weight; back to *land* when the position returns.

Where several faults last, the reaction that stands furthest down in this list is taken. Motors stop only when the ground carries the
vehicle (`flight/landing.rs` says by what signs), or on the operator's explicit kill. When the program itself dies, the
vehicle's own watchdog takes the rotors to their lowest speed (the vehicle falls) and disarms later: nothing on the base PC
can mend that, so the process must not die; see the real-time notes in [loop.md](loop.md).

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
