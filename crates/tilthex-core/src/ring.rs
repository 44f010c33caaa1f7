//! The last entries of a sequence, without moving them.

/// The last `N` entries; before there are so many, the first ones are those it was made with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ring<T, const N: usize> {
    entries: [T; N],
    /// The place of the newest entry; older ones follow, after the last place those in the first.
    newest: usize,
}

impl<T: Copy, const N: usize> Ring<T, N> {
    /// A ring of equal entries.
    pub(crate) const fn new(entry: T) -> Self {
        Self { entries: [entry; N], newest: 0 }
    }

    /// Replaces the oldest entry.
    #[inline]
    pub(crate) fn push(&mut self, entry: T) {
        self.newest = (self.newest + N - 1) % N;
        if let Some(slot) = self.entries.get_mut(self.newest) {
            *slot = entry;
        }
    }

    /// The entries, the newest first.
    #[inline]
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        let (before, from) = self.entries.split_at(self.newest.min(N));
        from.iter().chain(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn it_holds_the_last_entries_the_newest_first() {
        let mut ring = Ring::<u32, 4>::new(0);
        for k in 1..20 {
            ring.push(k);
            let expected: Vec<u32> = (0..4).map(|age| k.saturating_sub(age)).collect();
            assert_eq!(ring.iter().copied().collect::<Vec<_>>(), expected);
        }
    }
}
