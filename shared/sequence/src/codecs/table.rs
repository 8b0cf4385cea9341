//! Millimetres brought back to the codes of a sensor that knows few of them.
//!
//! A structured-light sensor measures a shift of at most 2048 steps; the millimetres that it reports are
//! the entries of a table. Ranks in that table are 1.4 to 1.9 times smaller to code than millimetres.

use super::CodecError;

/// Most values that a table may have: the shifts of a PS1080.
pub const MAX_CODES: usize = 2048;
/// Samples that mean "no measurement" are their own codes in every table.
const MISSING: [u16; 2] = [0, u16::MAX];
/// A table is proven by samples that come back: this many on average for each value.
pub(super) const MIN_REPEATS: u64 = 8;
/// Above this share of all values between the nearest and the farthest there are no steps to gain from.
const MAX_FILLED_PERCENT: usize = 75;

/// The values of codes 1, 2, 3 …: strictly rising, none of them 0 or 65535, which are codes 0 and 65535.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CodeTable {
    id: u16,
    values: Vec<u16>,
}

impl CodeTable {
    /// A table of `values`, in any order and as often as they come; the two missing codes are left out.
    /// `id` is 1 or more and names the table in the payloads of one stream.
    ///
    /// A device's shift-to-depth table may be given as it is, with the zeros of shifts that it cannot see.
    ///
    /// # Errors
    /// [`CodecError::NoTable`] for id 0, no value, or more than [`MAX_CODES`].
    pub fn new(id: u16, values: &[u16]) -> Result<Self, CodecError> {
        let mut values: Vec<u16> = values
            .iter()
            .copied()
            .filter(|value| !MISSING.contains(value))
            .collect();
        values.sort_unstable();
        values.dedup();
        if id == 0 {
            return Err(CodecError::NoTable("its id is 0, which means no table"));
        }
        if values.is_empty() || values.len() > MAX_CODES {
            return Err(CodecError::NoTable("it has no values or more than 2048"));
        }
        Ok(Self { id, values })
    }

    /// Name of the table in payloads.
    pub fn id(&self) -> u16 {
        self.id
    }

    /// Values of codes 1, 2, 3 …, rising.
    pub fn values(&self) -> &[u16] {
        &self.values
    }

    /// The bytes of `docs/codecs.md` section 2: id, count, values, all u16 little-endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        // At most MAX_CODES values.
        let head = [self.id, self.values.len() as u16];
        head.iter()
            .chain(&self.values)
            .flat_map(|number| number.to_le_bytes())
            .collect()
    }

    /// The table of bytes that [`Self::to_bytes`] made.
    ///
    /// # Errors
    /// [`CodecError::NoTable`] for any other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CodecError> {
        let (numbers, odd) = bytes.as_chunks::<2>();
        let mut numbers = numbers.iter().map(|number| u16::from_le_bytes(*number));
        let (Some(id), Some(count), true) = (numbers.next(), numbers.next(), odd.is_empty()) else {
            return Err(CodecError::NoTable("it is cut"));
        };
        if usize::from(count) > MAX_CODES || usize::from(count) != numbers.len() {
            return Err(CodecError::NoTable("its length is not that of its values"));
        }
        let values: Vec<u16> = numbers.collect();
        let table = Self::new(id, &values)?;
        if table.values != values {
            return Err(CodecError::NoTable("its values do not rise"));
        }
        Ok(table)
    }

    /// The sample of a code; `None` for a code beyond the table.
    pub fn sample_of(&self, code: u16) -> Option<u16> {
        if MISSING.contains(&code) {
            return Some(code);
        }
        self.values.get(usize::from(code) - 1).copied()
    }

    /// Adds `new_values` and takes the next id; `false`, and no change, when there would be too many.
    pub(super) fn extend(&mut self, new_values: &[u16]) -> bool {
        let Some(id) = self.id.checked_add(1) else {
            return false;
        };
        if self.values.len() + new_values.len() > MAX_CODES {
            return false;
        }
        self.id = id;
        self.values.extend_from_slice(new_values);
        self.values.sort_unstable();
        self.values.dedup();
        true
    }

    /// Room for all the values that a table may ever have, so that [`Self::extend`] does not allocate.
    pub(super) fn reserve_all(&mut self) {
        self.values.reserve_exact(MAX_CODES - self.values.len());
    }

    /// A table with nothing in it, to be filled.
    pub(super) fn unfilled() -> Self {
        Self {
            id: 0,
            values: Vec::with_capacity(MAX_CODES),
        }
    }

    /// Takes over what `detector` has seen as table 1, if that proves to be a table.
    pub(super) fn fill_from(&mut self, detector: &CodeTableDetector) -> bool {
        if !detector.is_table() {
            return false;
        }
        self.id = 1;
        self.values.clear();
        self.values.extend(detector.values());
        true
    }
}

/// Counts the values of frames and says whether they are those of a table.
pub struct CodeTableDetector {
    seen: Box<[u64]>,
    sample_count: u64,
}

impl Default for CodeTableDetector {
    fn default() -> Self {
        Self::new()
    }
}

impl CodeTableDetector {
    /// Nothing seen.
    pub fn new() -> Self {
        Self {
            seen: vec![0; 1 << 10].into_boxed_slice(),
            sample_count: 0,
        }
    }

    /// Takes note of a frame. Cost: one pass, a bit set per sample.
    pub fn observe(&mut self, samples: &[u16]) {
        let seen: &mut [u64; 1 << 10] = (&mut *self.seen)
            .try_into()
            .expect("the set was made with a bit for every u16");
        let mut missing_count = 0;
        for &sample in samples {
            seen[usize::from(sample >> 6)] |= 1 << (sample & 63);
            missing_count += u64::from(sample == 0) + u64::from(sample == u16::MAX);
        }
        self.sample_count += samples.len() as u64 - missing_count;
    }

    /// The table, with id 1, if there is one: 1 to [`MAX_CODES`] different values, each seen eight times on
    /// average, with a quarter of the values between the smallest and the largest left out.
    pub fn table(&self) -> Option<CodeTable> {
        let mut table = CodeTable::unfilled();
        table.fill_from(self).then_some(table)
    }

    fn values(&self) -> impl Iterator<Item = u16> {
        (1..u16::MAX).filter(|value| self.seen[usize::from(value >> 6)] >> (value & 63) & 1 == 1)
    }

    fn is_table(&self) -> bool {
        let count = self.values().count();
        let (Some(first), Some(last)) = (self.values().next(), self.values().last()) else {
            return false;
        };
        let span = usize::from(last - first) + 1;
        count <= MAX_CODES
            && count as u64 * MIN_REPEATS <= self.sample_count
            && (count * 100 <= span * MAX_FILLED_PERCENT || count == 1)
    }
}
