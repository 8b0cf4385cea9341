//! A depth frame as a payload and back.

use super::CodecError;
use super::dense::DenseModel;
use super::error::pixel_count;
use super::packer::{Packer, Unpacker};
use super::range_coder::FLUSH_BYTES;
use super::rvl;
use super::table::{CodeTable, CodeTableDetector, MAX_CODES, MIN_REPEATS};

/// Bytes before the body of a payload: the codec, the table's id.
const HEAD_BYTES: usize = 3;
/// The codecs as they are written.
const RAW: u8 = 0;
const FAST: u8 = 1;
const DENSE: u8 = 2;
/// Frames in which values may prove to be a table; after that the encoder stops looking.
const MAX_DETECTION_FRAMES: u32 = 8;
/// What a value outside the table maps to: no code, since codes end at [`MAX_CODES`].
const NO_CODE: u16 = u16::MAX - 1;

/// How much work goes into a depth frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DepthCodec {
    /// RVL and zstd: about a tenth of the raw samples.
    Fast,
    /// Context range coder: about half of that, at three times the time (VGA: 3.5 ms of an EPYC core for a
    /// scene, 23 ms for noise, which no sensor sends).
    Dense,
}

/// What [`DepthEncoder::encode`] made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncodedDepth {
    /// Length of the payload.
    pub byte_count: usize,
    /// The payload is the first to need [`DepthEncoder::table`] as it now is: that must be stored before it.
    pub has_new_table: bool,
    /// The frame was stored as raw samples, because no codec made it smaller.
    pub is_raw: bool,
}

/// Encodes the depth frames of one stream.
pub struct DepthEncoder {
    pixel_count: usize,
    model: DenseModel,
    packer: Packer,
    tokens: Vec<u8>,
    domain: Domain,
}

/// What samples are to the codecs.
enum Domain {
    /// Codes themselves.
    Codes,
    /// Values that have codes, or may have.
    Values(Box<Coding>),
}

struct Coding {
    /// Id 0 while there is none.
    table: CodeTable,
    detector: CodeTableDetector,
    detection_frame_count: u32,
    code_of: Vec<u16>,
    codes: Vec<u16>,
    new_values: Vec<u16>,
}

impl DepthEncoder {
    /// For a stream whose samples are the sensor's own codes (shifts), 0 and 65535 being none.
    ///
    /// # Errors
    /// [`CodecError::Size`] for sides that are not 1 to 16384.
    pub fn of_codes(width: u32, height: u32) -> Result<Self, CodecError> {
        let pixel_count = pixel_count(width, height)?;
        Ok(Self {
            pixel_count,
            model: DenseModel::new(width as usize),
            packer: Packer::new()?,
            tokens: vec![0; rvl::max_bytes(pixel_count)],
            domain: Domain::Codes,
        })
    }

    /// For a stream of values (millimetres), which become codes as soon as they prove to be those of a table,
    /// or at once where the table is known. A value that is not in the table extends it, under the next id.
    ///
    /// # Errors
    /// As [`Self::of_codes`].
    pub fn of_values(
        width: u32,
        height: u32,
        table: Option<CodeTable>,
    ) -> Result<Self, CodecError> {
        let encoder = Self::of_codes(width, height)?;
        let mut coding = Coding {
            table: table.unwrap_or_else(CodeTable::unfilled),
            detector: CodeTableDetector::new(),
            detection_frame_count: 0,
            code_of: vec![NO_CODE; 1 << 16],
            codes: vec![0; encoder.pixel_count],
            new_values: Vec::with_capacity(MAX_CODES),
        };
        coding.table.reserve_all();
        coding.index();
        let domain = Domain::Values(Box::new(coding));
        Ok(Self { domain, ..encoder })
    }

    /// Packs with another level of zstd than 1, -7 (quick) to 19 (small), which is beyond what a recorder can
    /// afford: for measurements. What is written stays readable by every decoder.
    ///
    /// # Errors
    /// [`CodecError::Compressor`] where zstd has no memory for it.
    pub fn set_zstd_level(&mut self, level: i32) -> Result<(), CodecError> {
        self.packer.set_level(level)
    }

    /// The table of the payloads, as of the last frame; `None` while samples are coded as they are.
    pub fn table(&self) -> Option<&CodeTable> {
        match &self.domain {
            Domain::Values(coding) if coding.table.id() != 0 => Some(&coding.table),
            _ => None,
        }
    }

    /// The most that a payload takes: the raw samples and three bytes.
    pub fn max_payload_bytes(&self) -> usize {
        HEAD_BYTES + 2 * self.pixel_count
    }

    /// Encodes a frame, row by row from the top left, to the start of `out`. Allocates nothing.
    ///
    /// # Errors
    /// [`CodecError::SampleCount`] and [`CodecError::Room`] where slices are not of the stream's size
    /// (`out` has at least [`Self::max_payload_bytes`]).
    pub fn encode(
        &mut self,
        samples: &[u16],
        codec: DepthCodec,
        out: &mut [u8],
    ) -> Result<EncodedDepth, CodecError> {
        if samples.len() != self.pixel_count {
            return Err(CodecError::SampleCount {
                expected: self.pixel_count,
                got: samples.len(),
            });
        }
        let expected = self.max_payload_bytes();
        let got = out.len();
        let out = out
            .get_mut(..expected)
            .ok_or(CodecError::Room { expected, got })?;
        let table_before = self.table().map_or(0, CodeTable::id);
        let (codes, table_id) = match &mut self.domain {
            Domain::Codes => (samples, 0),
            Domain::Values(coding) => coding.codes_of(samples),
        };
        let (head, body) = out.split_at_mut(HEAD_BYTES);
        // One byte less than raw, so that raw is what is not smaller.
        let room = body.len() - 1;
        let length = match codec {
            DepthCodec::Fast => {
                let token_bytes = rvl::encode(codes, &mut self.tokens);
                self.packer
                    .pack(&self.tokens[..token_bytes], &mut body[..room])
            }
            DepthCodec::Dense => self.model.encode(codes, &mut body[..room]),
        };
        let (codec, table_id, length) = match (codec, length) {
            (DepthCodec::Fast, Some(length)) => (FAST, table_id, length),
            (DepthCodec::Dense, Some(length)) => (DENSE, table_id, length),
            (_, None) => {
                for (bytes, sample) in body.as_chunks_mut::<2>().0.iter_mut().zip(samples) {
                    *bytes = sample.to_le_bytes();
                }
                (RAW, 0, body.len())
            }
        };
        head[0] = codec;
        head[1..].copy_from_slice(&table_id.to_le_bytes());
        Ok(EncodedDepth {
            byte_count: HEAD_BYTES + length,
            has_new_table: self.table().map_or(0, CodeTable::id) != table_before,
            is_raw: codec == RAW,
        })
    }
}

impl Coding {
    /// Codes of `samples` and the table they are of; the samples themselves and 0 where there is none.
    fn codes_of<'a>(&'a mut self, samples: &'a [u16]) -> (&'a [u16], u16) {
        if self.table.id() == 0 && !self.detect(samples) {
            return (samples, 0);
        }
        if self.map(samples) || self.extend(samples) && self.map(samples) {
            (&self.codes, self.table.id())
        } else {
            (samples, 0)
        }
    }

    fn detect(&mut self, samples: &[u16]) -> bool {
        if self.detection_frame_count == MAX_DETECTION_FRAMES {
            return false;
        }
        self.detection_frame_count += 1;
        self.detector.observe(samples);
        let is_table = self.table.fill_from(&self.detector);
        if is_table {
            self.index();
        }
        is_table
    }

    fn index(&mut self) {
        self.code_of.fill(NO_CODE);
        self.code_of[0] = 0;
        self.code_of[usize::from(u16::MAX)] = u16::MAX;
        // At most MAX_CODES values.
        for (code, &value) in (1..).zip(self.table.values()) {
            self.code_of[usize::from(value)] = code;
        }
    }

    /// Fills `codes`; `false` when a sample has none.
    fn map(&mut self, samples: &[u16]) -> bool {
        let code_of: &[u16; 1 << 16] = self
            .code_of
            .as_slice()
            .try_into()
            .expect("the index was made with an entry for every u16");
        let mut is_whole = true;
        for (code, &sample) in self.codes.iter_mut().zip(samples) {
            *code = code_of[usize::from(sample)];
            is_whole &= *code != NO_CODE;
        }
        is_whole
    }

    /// Takes the values of `samples` that have no code into the table; `false` when they are too many.
    fn extend(&mut self, samples: &[u16]) -> bool {
        self.new_values.clear();
        for &sample in samples {
            let code = &mut self.code_of[usize::from(sample)];
            if *code == NO_CODE {
                if self.new_values.len() == MAX_CODES {
                    break;
                }
                self.new_values.push(sample);
                // Once is enough; `index` below writes it anew.
                *code = 0;
            }
        }
        // A frame of noise must not fill the table with values that never come back.
        let is_likely = self.new_values.len() as u64 * MIN_REPEATS <= samples.len() as u64;
        let is_extended = is_likely && self.table.extend(&self.new_values);
        self.index();
        is_extended
    }
}

/// The table that a depth payload refers to; `None` when it needs none.
///
/// # Errors
/// [`CodecError::Cut`] when the payload is shorter than its head.
pub fn depth_table_id(payload: &[u8]) -> Result<Option<u16>, CodecError> {
    let (_, table_id, _) = split_head(payload)?;
    Ok((table_id != 0).then_some(table_id))
}

fn split_head(payload: &[u8]) -> Result<(u8, u16, &[u8]), CodecError> {
    let (head, body) = payload
        .split_first_chunk::<HEAD_BYTES>()
        .ok_or(CodecError::Cut)?;
    Ok((head[0], u16::from_le_bytes([head[1], head[2]]), body))
}

/// Decodes the depth frames of one stream, in any order.
pub struct DepthDecoder {
    pixel_count: usize,
    model: DenseModel,
    unpacker: Unpacker,
    tokens: Vec<u8>,
    sample_of: Vec<u16>,
}

impl DepthDecoder {
    /// A decoder for frames of a stream's size.
    ///
    /// # Errors
    /// [`CodecError::Size`] for sides that are not 1 to 16384.
    pub fn new(width: u32, height: u32) -> Result<Self, CodecError> {
        let pixel_count = pixel_count(width, height)?;
        let mut sample_of = vec![0; 1 << 16];
        sample_of[usize::from(u16::MAX)] = u16::MAX;
        Ok(Self {
            pixel_count,
            model: DenseModel::new(width as usize),
            unpacker: Unpacker::new()?,
            tokens: vec![0; rvl::max_bytes(pixel_count)],
            sample_of,
        })
    }

    /// Fills `samples` from `payload`; `table` is the one that [`depth_table_id`] names. Allocates nothing.
    ///
    /// Work and memory are bounded by the stream's size, whatever the bytes. After an error the samples are
    /// undefined.
    ///
    /// # Errors
    /// [`CodecError`] says what no encoder writes; a damage may also decode to other samples (see the
    /// module).
    pub fn decode(
        &mut self,
        payload: &[u8],
        table: Option<&CodeTable>,
        samples: &mut [u16],
    ) -> Result<(), CodecError> {
        if samples.len() != self.pixel_count {
            return Err(CodecError::SampleCount {
                expected: self.pixel_count,
                got: samples.len(),
            });
        }
        let (codec, table_id, body) = split_head(payload)?;
        let table = match (table_id, table) {
            (0, _) => None,
            (_, Some(table)) if table.id() == table_id => Some(table),
            (expected, other) => {
                let got = other.map(CodeTable::id);
                return Err(CodecError::Table { expected, got });
            }
        };
        match codec {
            RAW if table_id != 0 => return Err(CodecError::Damaged("raw samples with a table")),
            RAW => return decode_raw(body, samples),
            FAST => {
                let token_bytes = self.unpacker.unpack(body, &mut self.tokens)?;
                rvl::decode(&self.tokens[..token_bytes], samples)?;
            }
            // A range coder can be asked for far more pixels than a few bytes hold; each costs bounded time.
            DENSE if body.len() < FLUSH_BYTES => return Err(CodecError::Cut),
            DENSE => self.model.decode(body, samples)?,
            other => return Err(CodecError::UnknownCodec(other)),
        }
        match table {
            Some(table) => self.samples_of(table, samples),
            None => Ok(()),
        }
    }

    /// Turns codes into the samples of `table`.
    fn samples_of(&mut self, table: &CodeTable, samples: &mut [u16]) -> Result<(), CodecError> {
        let values = table.values();
        // Code 65535 is kept, 0 too; any other without a value becomes 0 and is found by that.
        self.sample_of[1..=values.len()].copy_from_slice(values);
        self.sample_of[values.len() + 1..usize::from(u16::MAX)].fill(0);
        let sample_of: &[u16; 1 << 16] = self
            .sample_of
            .as_slice()
            .try_into()
            .expect("the look-up was made with an entry for every u16");
        let mut is_whole = true;
        for sample in samples {
            let code = *sample;
            *sample = sample_of[usize::from(code)];
            is_whole &= (*sample == 0) == (code == 0);
        }
        if is_whole {
            Ok(())
        } else {
            Err(CodecError::Damaged("a code beyond its table"))
        }
    }
}

fn decode_raw(body: &[u8], samples: &mut [u16]) -> Result<(), CodecError> {
    match body.len().cmp(&(2 * samples.len())) {
        std::cmp::Ordering::Less => return Err(CodecError::Cut),
        std::cmp::Ordering::Greater => return Err(CodecError::Surplus),
        std::cmp::Ordering::Equal => {}
    }
    for (sample, bytes) in samples.iter_mut().zip(body.as_chunks::<2>().0) {
        *sample = u16::from_le_bytes(*bytes);
    }
    Ok(())
}
