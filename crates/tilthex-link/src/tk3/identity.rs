//! The identity of the vehicle's board.

/// A family of boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// `mkfl`: mikrokopter flight controller.
    Mkfl,
    /// `flymu`: flight management unit.
    Flymu,
    /// `chimera`: paparazzi chimera.
    Chimera,
    /// `teensy`.
    Teensy,
}

impl Board {
    const ALL: [Self; 4] = [Self::Mkfl, Self::Flymu, Self::Chimera, Self::Teensy];

    /// The name with which its identity starts.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mkfl => "mkfl",
            Self::Flymu => "flymu",
            Self::Chimera => "chimera",
            Self::Teensy => "teensy",
        }
    }
}

/// A board and the version of its firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The board.
    pub board: Board,
    /// Major version, before the dot.
    pub major: u16,
    /// Minor version, after the dot.
    pub minor: u16,
}

impl Identity {
    /// Reads an identity text, such as `chimera1.1`; `None` for any other text.
    #[must_use]
    pub fn parse(text: &[u8]) -> Option<Self> {
        Board::ALL.into_iter().find_map(|board| {
            let version = text.strip_prefix(board.name().as_bytes())?;
            let mut numbers = version.split(|&byte| byte == b'.');
            let major = number(numbers.next()?)?;
            let minor = number(numbers.next()?)?;
            numbers.next().is_none().then_some(Self { board, major, minor })
        })
    }
}

/// Decimal digits only: no sign, no spaces.
fn number(digits: &[u8]) -> Option<u16> {
    if digits.is_empty() {
        return None;
    }
    digits.iter().try_fold(0_u16, |number, digit| {
        let digit = digit.is_ascii_digit().then(|| digit - b'0')?;
        number.checked_mul(10)?.checked_add(u16::from(digit))
    })
}

impl core::fmt::Display for Identity {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}{}.{}", self.board.name(), self.major, self.minor)
    }
}
