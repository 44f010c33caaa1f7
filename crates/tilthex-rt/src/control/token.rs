//! The token that clients on other computers must send.

use std::path::Path;

use tilthex_config::files;

use crate::Failure;

/// Least length of a token, bytes. A shorter one could be guessed.
const SHORTEST: usize = 16;

/// A secret that a client must send before any request.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Token {
    /// Reads the token in a file, without the blanks around it.
    ///
    /// # Errors
    /// One sentence: the file cannot be read, or the token is too short.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let text = files::read_text(path).map_err(|e| {
            Failure::usage(format!("the control token {} cannot be read: {e}", path.display()))
        })?;
        let token = text.trim();
        if token.len() < SHORTEST {
            return Err(Failure::usage(format!(
                "the control token in {} has {} characters; expected {SHORTEST} or more, such as `openssl rand -hex 16` gives",
                path.display(),
                token.len()
            )));
        }
        Ok(Self(token.into()))
    }

    /// Whether `said` is this token. The time that this takes does not depend on where the two differ.
    pub(super) fn is(&self, said: &str) -> bool {
        let (own, said) = (self.0.as_bytes(), said.as_bytes());
        let differs = own.iter().zip(said).fold(0, |differs, (a, b)| differs | (a ^ b));
        own.len() == said.len() && differs == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_read_and_compared_whole() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        std::fs::write(&path, " 0123456789abcdef\n").expect("written");
        let token = Token::read(&path).expect("long enough");
        assert!(token.is("0123456789abcdef"));
        for other in ["", "0123456789abcdeF", "0123456789abcdef0", "0123456789abcde"] {
            assert!(!token.is(other), "{other}");
        }
        assert!(!format!("{token:?}").contains("0123"));
        std::fs::write(&path, "short\n").expect("written");
        assert!(Token::read(&path).expect_err("refused").message.contains("5 characters"));
    }
}
