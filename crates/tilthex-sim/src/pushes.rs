//! A file of timed pushes: the wrenches of the environment on the tool.
//!
//! ```toml
//! [[push]]
//! at = 8.0                  # s since the first motor was ordered to start
//! duration = 6.0            # s
//! force = [1.4, 0.0, 0.0]   # N, world, at the tool tip
//! torque = [0.0, 0.0, 0.0]  # N m, world
//! ```

use std::path::Path;

use serde::Deserialize;
use tilthex_core::{Vector3, Wrench};

use tilthex_config::files;

use crate::SimError;

/// One push.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Push {
    /// When it begins, s since the first motor was ordered to start.
    pub at: f64,
    /// For how long it lasts, s.
    pub duration: f64,
    /// Force on the tool, N, world.
    #[serde(default)]
    pub force: [f64; 3],
    /// Torque on the tool, N m, world, about its tip.
    #[serde(default)]
    pub torque: [f64; 3],
}

/// All pushes of a run. Pushes that overlap are added.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pushes {
    #[serde(default)]
    push: Vec<Push>,
}

impl Pushes {
    /// Pushes from a list.
    #[must_use]
    pub fn new(push: Vec<Push>) -> Self {
        Self { push }
    }

    /// Reads a file of pushes.
    ///
    /// # Errors
    /// One sentence that names the file, the push and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, SimError> {
        let refuse = |what: String| SimError::refused(format!("{}: {what}", path.display()));
        let text = files::read_text(path).map_err(|e| refuse(format!("cannot be read: {e}")))?;
        let pushes: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            refuse(format!("line {line}: {}", e.message().replace('\n', " ")))
        })?;
        for (i, p) in pushes.push.iter().enumerate() {
            let numbers = [p.at, p.duration].into_iter().chain(p.force).chain(p.torque);
            if numbers.clone().any(|x| !x.is_finite()) || p.at < 0.0 || p.duration < 0.0 {
                return Err(refuse(format!(
                    "push {} has a number that is not finite, or a negative time; expected finite numbers and times from 0 s on",
                    i + 1
                )));
            }
        }
        Ok(pushes)
    }

    /// The wrench on the tool (world, at its tip) at a time, s.
    #[must_use]
    pub fn wrench(&self, time: f64) -> Wrench {
        let active = self.push.iter().filter(|p| (p.at..p.at + p.duration).contains(&time));
        active.fold(Wrench::ZERO, |sum, p| {
            sum + Wrench { force: Vector3::from(p.force), torque: Vector3::from(p.torque) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Pushes, SimError> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        Pushes::read(file.path())
    }

    #[test]
    fn pushes_begin_end_and_add_up() {
        let pushes = read(
            "[[push]]\nat = 1.0\nduration = 2.0\nforce = [1.4, 0.0, 0.0]\n\
             [[push]]\nat = 2.0\nduration = 5.0\nforce = [0.0, 1.0, 0.0]\ntorque = [0.0, 0.0, 0.1]\n",
        )
        .expect("valid");
        assert_eq!(pushes.wrench(0.99), Wrench::ZERO);
        assert_eq!(pushes.wrench(1.0).force, Vector3::new(1.4, 0.0, 0.0));
        assert_eq!(pushes.wrench(2.5).force, Vector3::new(1.4, 1.0, 0.0));
        assert_eq!(pushes.wrench(3.0).torque, Vector3::new(0.0, 0.0, 0.1));
        assert_eq!(pushes.wrench(7.0), Wrench::ZERO);
    }

    #[test]
    fn a_bad_file_says_where() {
        let error = |text: &str| read(text).expect_err("refused").to_string();
        assert!(
            error("[[push]]\nat = 1\nduration = 1\nforces = [1,0,0]\n").contains("line 4: unknown field")
        );
        assert!(error("[[push]]\nat = nan\nduration = 1\n").contains("push 1"));
        assert!(Pushes::read(Path::new("none.toml")).expect_err("absent").to_string().contains("none.toml"));
    }
}
