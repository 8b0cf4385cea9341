//! The hash table from block keys to block indices: open addressing, linear probing, no deletion.

use super::key::mix;

/// No key: a packed key has 63 bits.
const EMPTY: u64 = u64::MAX;

#[derive(Clone, Copy)]
struct Entry {
    key: u64,
    index: u32,
}

/// Maps keys of [`super::key::pack`] to block indices. At most half full, so a probe is short.
#[derive(Clone)]
pub struct BlockTable {
    entries: Vec<Entry>,
    block_count: usize,
}

impl Default for BlockTable {
    fn default() -> Self {
        Self {
            entries: vec![
                Entry {
                    key: EMPTY,
                    index: 0
                };
                1024
            ],
            block_count: 0,
        }
    }
}

impl BlockTable {
    /// Number of keys.
    pub fn len(&self) -> usize {
        self.block_count
    }

    /// Whether the table holds no key.
    pub fn is_empty(&self) -> bool {
        self.block_count == 0
    }

    /// The index stored for `key`. Compares the whole key, so an answer is exact.
    #[inline]
    pub fn get(&self, key: u64) -> Option<u32> {
        let mask = self.entries.len() - 1;
        let mut slot = mix(key) as usize & mask;
        loop {
            let entry = self.entries[slot];
            if entry.key == key {
                return Some(entry.index);
            }
            if entry.key == EMPTY {
                return None;
            }
            slot = (slot + 1) & mask;
        }
    }

    /// Stores `index` under `key`, replacing what was there.
    pub fn insert(&mut self, key: u64, index: u32) {
        if self.is_full() {
            self.grow();
        }
        if place(&mut self.entries, Entry { key, index }) {
            self.block_count += 1;
        }
    }

    /// Number of entries looked at to find `key` or its absence; for judging the hash.
    pub fn probe_length(&self, key: u64) -> usize {
        let mask = self.entries.len() - 1;
        let start = mix(key) as usize & mask;
        let mut probed = 1;
        let mut slot = start;
        while self.entries[slot].key != key && self.entries[slot].key != EMPTY {
            slot = (slot + 1) & mask;
            probed += 1;
        }
        probed
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.entries.len() * size_of::<Entry>()
    }

    /// Bytes that the next new key needs beyond these: the table grows by copying.
    pub fn growth_bytes(&self) -> usize {
        if self.is_full() { 2 * self.bytes() } else { 0 }
    }

    fn is_full(&self) -> bool {
        2 * (self.block_count + 1) > self.entries.len()
    }

    fn grow(&mut self) {
        let mut larger = vec![
            Entry {
                key: EMPTY,
                index: 0
            };
            self.entries.len() * 2
        ];
        for &entry in self.entries.iter().filter(|entry| entry.key != EMPTY) {
            place(&mut larger, entry);
        }
        self.entries = larger;
    }
}

/// Puts `entry` where its probe ends; `true` when its key is new.
fn place(entries: &mut [Entry], entry: Entry) -> bool {
    let mask = entries.len() - 1;
    let mut slot = mix(entry.key) as usize & mask;
    while entries[slot].key != EMPTY && entries[slot].key != entry.key {
        slot = (slot + 1) & mask;
    }
    let is_new = entries[slot].key == EMPTY;
    entries[slot] = entry;
    is_new
}
