//! A number in two bytes, to save memory.

/// A number that is not negative, with about two significant digits: the upper half of its single precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coarse(u16);

impl Coarse {
    pub(super) const ZERO: Self = Self(0);

    pub(super) fn new(x: f64) -> Self {
        Self(((x.max(0.0) as f32).to_bits() >> 16) as u16)
    }

    pub(super) fn get(self) -> f64 {
        f64::from(f32::from_bits(u32::from(self.0) << 16))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_two_digits() {
        for x in [1.0, 3.25e-7, 1.7e9, 12.3] {
            let found = Coarse::new(x).get();
            assert!((found / x - 1.0).abs() < 0.008, "{x}: {found}");
        }
        assert_eq!(Coarse::new(0.0), Coarse::ZERO);
        assert_eq!(Coarse::new(f64::NAN), Coarse::ZERO);
    }
}
