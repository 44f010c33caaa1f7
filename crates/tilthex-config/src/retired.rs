//! Keys that existed in earlier versions. Files and logs with these keys can still be read; a warning says what replaces each
//! key.

use toml::{Table, Value};

/// A key that no longer exists.
struct Retired {
    section: &'static str,
    key: &'static str,
    /// The end of a sentence that says what replaces it.
    instead: &'static str,
}

const RETIRED: [Retired; 3] = [
    Retired {
        section: "estimator",
        key: "coast_after",
        instead: "poses count as lost after a fixed time (docs/faults.md, \"pose lost\")",
    },
    Retired {
        section: "estimator",
        key: "lost_position",
        instead: "the limit is fixed (docs/faults.md, \"estimate uncertain\")",
    },
    Retired {
        section: "estimator",
        key: "lost_rotation_deg",
        instead: "position and velocity tell when the state is lost (docs/faults.md, \"estimate uncertain\")",
    },
];

/// Removes retired keys from a file's table. Returns a sentence for each.
pub(super) fn take(file: &mut Table) -> Vec<String> {
    let mut found = Vec::new();
    for retired in &RETIRED {
        if let Some(Value::Table(section)) = file.get_mut(retired.section)
            && section.remove(retired.key).is_some()
        {
            let Retired { section, key, instead } = retired;
            found.push(format!(
                "[{section}] {key} has no effect: it is no longer a key, {instead}; delete its line"
            ));
        }
    }
    found
}
