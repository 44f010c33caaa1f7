//! Finds complete inertial frames in the raw bytes, without decoding them.

/// Position in the stream of bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Scan {
    #[default]
    Elsewhere,
    Start,
    InImu,
}

impl Scan {
    /// Scans bytes in the order of their arrival. Returns whether an inertial frame has ended in them.
    pub(super) fn finds_imu(&mut self, bytes: &[u8]) -> bool {
        let mut found = false;
        for &byte in bytes {
            *self = match (*self, byte) {
                (_, b'^') => Self::Start,
                (Self::Start, b'I') => Self::InImu,
                (Self::InImu, b'$') => {
                    found = true;
                    Self::Elsewhere
                }
                (Self::InImu, _) => Self::InImu,
                _ => Self::Elsewhere,
            };
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn frames_cut_anywhere_are_found_once(cut in 0usize..23) {
            let (before, after) = b"^M2345$^I12345678901$^M".split_at(cut);
            let mut scan = Scan::default();
            let found = [before, after].map(|bytes| scan.finds_imu(bytes));
            prop_assert_eq!(found.iter().filter(|found| **found).count(), 1);
            prop_assert!(!scan.finds_imu(b"2345$"));
        }
    }

    #[test]
    fn a_frame_in_pieces_is_found_at_its_end() {
        let mut scan = Scan::default();
        assert!(!scan.finds_imu(b"^M123$^I12"));
        assert!(!scan.finds_imu(b"34"));
        assert!(scan.finds_imu(b"5$^I"));
        assert!(!scan.finds_imu(b"^I123^"));
        assert!(!scan.finds_imu(b"B12$"));
    }
}
