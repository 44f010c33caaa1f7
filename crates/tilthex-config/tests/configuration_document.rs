//! `docs/configuration.md` holds every key that the code declares.
//! `TILTHEX_WRITE_DOCS=1 cargo test -p tilthex-config --test configuration_document` writes it.

use std::{fmt::Write as _, path::Path};
use tilthex_config::{Config, described};
use toml::{Table, Value};

const HEAD: &str = "# Configuration

A configuration is one TOML file. A key that is not given has its default; an unknown key is an error. `tilthex-rt --config FILE
--print-config` prints the complete configuration that a file gives. Some defaults of `[pose_control]`, `[wrench_observer]`,
`[attitude]` and `[supervisor]` depend on the vehicle: the printed configuration shows them.

This page is written from the declarations in `crates/tilthex-config`
(`TILTHEX_WRITE_DOCS=1 cargo test -p tilthex-config --test configuration_document`); a test compares the two. A unit of 1
means a number without a unit. *In flight* names the order of the control socket that changes the key
([protocols.md](protocols.md)). The sections under `[truth]` describe the simulated vehicle only ([truth.md](truth.md)).
";

/// A default as it would stand in a file.
fn default(value: Option<&Value>) -> String {
    match value {
        None => "not set".into(),
        Some(value) if holds_nan(value) => "must be given".into(),
        Some(value) => format!("`{value}`"),
    }
}

fn holds_nan(value: &Value) -> bool {
    match value {
        Value::Float(x) => x.is_nan(),
        Value::Array(all) => all.iter().any(holds_nan),
        _ => false,
    }
}

#[test]
fn the_document_is_the_declarations() {
    let mut text = String::from(HEAD);
    for section in described() {
        writeln!(text, "\n## `[{}]`\n", section.name).expect("a string takes all");
        for line in section.doc {
            writeln!(text, "{}", line.trim_start()).expect("a string takes all");
        }
        text += "\n| key | meaning | unit | range | default | in flight |\n|---|---|---|---|---|---|\n";
        for key in section.keys {
            let meaning: Vec<_> = key.doc.iter().map(|line| line.trim()).collect();
            let range = key.range.map_or_else(String::new, |(min, max)| format!("{min} to {max}"));
            let cells = [
                format!("`{}`", key.name),
                meaning.join(" ").replace('|', "\\|"),
                key.unit.into(),
                range,
                default(section.defaults.get(key.name)),
                key.order.map_or_else(String::new, |order| format!("`{order}`")),
            ];
            writeln!(text, "| {} |", cells.join(" | ")).expect("a string takes all");
        }
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/configuration.md");
    if std::env::var_os("TILTHEX_WRITE_DOCS").is_some() {
        std::fs::write(path, &text).expect("docs/ is there");
    }
    let found = std::fs::read_to_string(path).unwrap_or_default();
    assert_eq!(found, text, "docs/configuration.md is not the declarations: run with TILTHEX_WRITE_DOCS=1");
}

/// A number just outside its declared range is refused, with the section, the key and the range.
#[test]
fn a_declared_range_is_kept() {
    let config = |section: &str, key: &str, value: f64| {
        let changes = Table::from_iter([(key.to_owned(), Value::Float(value))]);
        let mut file: Table = "[vehicle]\npreset = \"tilt-hex\"\n".parse().expect("TOML");
        file.insert(section.into(), Value::Table(changes));
        Config::from_text(&file.to_string(), Path::new(""))
    };
    let mut checked = 0;
    for section in described().iter().filter(|s| !s.name.contains('.') && s.name != "vehicle") {
        for key in section.keys {
            let Some((min, max)) = key.range else { continue };
            let step = 1e-9 * (max - min);
            for outside in [min - step, max + step] {
                let refusal = config(section.name, key.name, outside).expect_err(key.name).to_string();
                let expected = format!("[{}]: {} is ", section.name, key.name);
                assert!(refusal.starts_with(&expected), "{refusal}");
                assert!(refusal.contains(&format!("from {min} to {max}")), "{refusal}");
                checked += 1;
            }
        }
    }
    assert!(checked > 80, "{checked}");
}

/// What the section accepts, the law behind it accepts too, where the key stands alone.
#[test]
fn the_ends_of_a_range_are_accepted() {
    // These depend on other keys, which the sentence says.
    let together = ["estimator.latency", "mocap.latency", "estimator.history"];
    for section in described()
        .iter()
        .filter(|s| ["pose_control", "mission", "supervisor", "estimator"].contains(&s.name))
    {
        for key in section
            .keys
            .iter()
            .filter(|k| !together.contains(&format!("{}.{}", section.name, k.name).as_str()))
        {
            let Some((min, max)) = key.range else { continue };
            for end in [min, max] {
                let text =
                    format!("[vehicle]\npreset = \"tilt-hex\"\n[{}]\n{} = {end:?}\n", section.name, key.name);
                let read = Config::from_text(&text, Path::new(""));
                assert!(
                    read.is_ok(),
                    "{}.{} = {end}: {}",
                    section.name,
                    key.name,
                    read.expect_err("refused")
                );
            }
        }
    }
}
