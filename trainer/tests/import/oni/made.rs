//! `.oni` files made for tests: records, and encoders of 16z and 8z that flush runs in the right order.

/// Little-endian bytes of a record's fields.
#[derive(Default)]
pub(crate) struct Fields(pub(crate) Vec<u8>);

impl Fields {
    pub(crate) fn text(mut self, text: &str) -> Self {
        self = self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
        self
    }

    pub(crate) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn sized(mut self, bytes: &[u8]) -> Self {
        self = self.u32(bytes.len() as u32);
        self.0.extend(bytes);
        self
    }
}

/// A file that grows record by record.
#[derive(Clone)]
pub(crate) struct OniFile {
    pub(crate) bytes: Vec<u8>,
    is_32_bit: bool,
}

pub(crate) const NODE_ADDED: u32 = 0x0D;
pub(crate) const NEW_DATA: u32 = 0x0A;
pub(crate) const END: u32 = 0x0B;

impl OniFile {
    pub(crate) fn new() -> Self {
        Self::of_version([1, 0, 1, 0], false)
    }

    /// As OpenNI wrote it before 1.0.1.0: positions of 32 bits.
    pub(crate) fn old() -> Self {
        Self::of_version([1, 0, 0, 5], true)
    }

    pub(crate) fn of_version([major, minor, maintenance, build]: [u8; 4], is_32_bit: bool) -> Self {
        let mut bytes = b"NI10".to_vec();
        bytes.extend([major, minor, maintenance, 0, build, 0, 0, 0]);
        bytes.extend(u64::MAX.to_le_bytes());
        bytes.extend(2_u32.to_le_bytes());
        Self { bytes, is_32_bit }
    }

    pub(crate) fn record(&mut self, kind: u32, node: u32, fields: Fields, payload: &[u8]) {
        let header_len = if self.is_32_bit { 24 } else { 28 };
        self.bytes.extend(b"NIR\0");
        self.bytes.extend(kind.to_le_bytes());
        self.bytes.extend(node.to_le_bytes());
        self.bytes
            .extend((header_len + fields.0.len() as u32).to_le_bytes());
        self.bytes.extend((payload.len() as u32).to_le_bytes());
        self.bytes.extend(vec![0; header_len as usize - 20]);
        self.bytes.extend(fields.0);
        self.bytes.extend(payload);
    }

    pub(crate) fn node(&mut self, node: u32, kind: u32, codec: &[u8; 4], size: [u32; 2]) {
        let mut fields = Fields::default()
            .text(if kind == 2 { "Depth" } else { "Image" })
            .u32(kind)
            .u32(u32::from_le_bytes(*codec))
            .u32(4)
            .u64(0)
            .u64(0);
        if !self.is_32_bit {
            fields = fields.u64(0);
        }
        let added = if self.is_32_bit { 0x0C } else { NODE_ADDED };
        self.record(added, node, fields, &[]);
        let mode: Vec<u8> = [size[0], size[1], 30]
            .iter()
            .flat_map(|word| word.to_le_bytes())
            .collect();
        self.general(node, "xnMapOutputMode", &mode);
        self.general(node, "xnCropping", &[0; 12]);
    }

    pub(crate) fn int(&mut self, node: u32, name: &str, value: i64) {
        let fields = Fields::default().text(name).sized(&value.to_le_bytes());
        self.record(3, node, fields, &[]);
    }

    pub(crate) fn general(&mut self, node: u32, name: &str, value: &[u8]) {
        self.record(6, node, Fields::default().text(name).sized(value), &[]);
    }

    pub(crate) fn frame(&mut self, node: u32, timestamp_us: u64, number: u32, payload: &[u8]) {
        let fields = Fields::default().u64(timestamp_us).u32(number);
        self.record(NEW_DATA, node, fields, payload);
    }

    pub(crate) fn end(mut self) -> Vec<u8> {
        self.record(END, 0, Fields::default(), &[]);
        self.bytes
    }
}

/// Half bytes and runs of zero differences on their way out.
struct Tokens {
    bytes: Vec<u8>,
    half: Option<u8>,
    zero_pairs: u8,
}

impl Tokens {
    fn flush_run(&mut self) {
        if self.zero_pairs > 0 {
            self.bytes.push(0xE0 + self.zero_pairs);
            self.zero_pairs = 0;
        }
    }

    fn small(&mut self, nibble: u8) {
        let Some(high) = self.half.take() else {
            self.half = Some(nibble);
            return;
        };
        if (high, nibble) == (6, 6) {
            self.zero_pairs += 1;
            if self.zero_pairs == 15 {
                self.flush_run();
            }
        } else {
            self.flush_run();
            self.bytes.push(high << 4 | nibble);
        }
    }

    /// Closes an open half byte with F, or writes `alone`.
    fn before_large(&mut self, alone: &[u8]) {
        self.flush_run();
        match self.half.take() {
            Some(high) => self.bytes.push(high << 4 | 0xF),
            None => self.bytes.extend(alone),
        }
    }

    fn finish(mut self) -> Vec<u8> {
        self.flush_run();
        if let Some(high) = self.half {
            self.bytes.push(high << 4 | 0xD);
        }
        self.bytes
    }
}

/// 16z; values below 32768.
pub(crate) fn encode_16z(values: &[u16]) -> Vec<u8> {
    let mut tokens = Tokens {
        bytes: values[0].to_le_bytes().to_vec(),
        half: None,
        zero_pairs: 0,
    };
    for pair in values.windows(2) {
        let difference = i32::from(pair[0]) - i32::from(pair[1]);
        match difference {
            -6..=6 => tokens.small((difference + 6) as u8),
            -63..=63 => {
                tokens.before_large(&[0xFF]);
                tokens.bytes.push((difference + 192) as u8);
            }
            _ => {
                tokens.before_large(&[0xFF]);
                tokens.bytes.extend(pair[1].to_be_bytes());
            }
        }
    }
    tokens.finish()
}

/// 16z of places in the table of the values that occur.
pub(crate) fn encode_16z_with_table(values: &[u16]) -> Vec<u8> {
    let mut table = values.to_vec();
    table.sort_unstable();
    table.dedup();
    let place = |value| table.binary_search(value).unwrap() as u16;
    let places: Vec<u16> = values.iter().map(place).collect();
    let mut bytes = (table.len() as u16).to_le_bytes().to_vec();
    bytes.extend(table.iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend(encode_16z(&places));
    bytes
}

/// 8z. A full value in the high half stands alone: its second half goes into the next byte.
pub(crate) fn encode_8z(values: &[u8]) -> Vec<u8> {
    let mut tokens = Tokens {
        bytes: vec![values[0]],
        half: None,
        zero_pairs: 0,
    };
    // The low half of a full value, waiting for the token after it.
    let mut tail: Option<u8> = None;
    for pair in values.windows(2) {
        let difference = i32::from(pair[0]) - i32::from(pair[1]);
        let nibble = (-6..=6)
            .contains(&difference)
            .then_some((difference + 6) as u8);
        match (tail.take(), nibble) {
            (Some(high), Some(nibble)) => tokens.bytes.push(high << 4 | nibble),
            (Some(high), None) => tokens.bytes.extend([high << 4 | 0xF, pair[1]]),
            (None, Some(nibble)) => tokens.small(nibble),
            (None, None) if tokens.half.is_some() => {
                tokens.before_large(&[]);
                tokens.bytes.push(pair[1]);
            }
            (None, None) => {
                tokens.flush_run();
                tokens.bytes.push(0xF0 | pair[1] >> 4);
                tail = Some(pair[1] & 0xF);
            }
        }
    }
    if let Some(high) = tail {
        tokens.bytes.push(high << 4 | 0xD);
    }
    tokens.finish()
}
