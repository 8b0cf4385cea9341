//! The dense depth codec: each sample by its three neighbours above and the one before, through an adaptive
//! binary range coder.
//!
//! A sample is first missing (0) or not, in the light of which of left, up, up-left and up-right are
//! missing; then its difference to a prediction (left, else up, else up-right, else the last sample that
//! was not missing) in the light of how up, up-left and up-right differ from that prediction. Differences
//! wrap in 16 bits. Every frame begins with even probabilities: keeping them over frames gained 3 %.

use super::CodecError;
use super::range_coder::{EVEN, Probability, RangeDecoder, RangeEncoder};

/// Differences of neighbours are told apart up to this; beyond it they are one class each side.
const CLIP: i32 = 4;
/// Classes of a neighbour: -4 to 4, and missing.
const CLASSES: usize = 10;
/// Sixteen probabilities a context, of which 14 are used: a shift is cheaper than a product.
const CONTEXT_SHIFT: u32 = 4;
const MODEL_SIZE: usize = 1 << 14;
/// Magnitudes up to this are coded in unary, larger ones end in an Exp-Golomb code.
const UNARY_MAX: u32 = 12;

/// Probabilities and two rows with a missing sample at both ends.
pub(super) struct DenseModel {
    residual: Box<[Probability; MODEL_SIZE]>,
    missing: [Probability; 16],
    above: Vec<u16>,
    row: Vec<u16>,
}

/// What the neighbours of a sample say about it.
struct Neighbours {
    left: u16,
    up: u16,
    up_left: u16,
    up_right: u16,
}

impl Neighbours {
    /// Index of the probability that the sample is missing.
    #[inline(always)]
    fn presence(&self) -> usize {
        usize::from(self.left != 0)
            | usize::from(self.up != 0) << 1
            | usize::from(self.up_left != 0) << 2
            | usize::from(self.up_right != 0) << 3
    }

    #[inline(always)]
    fn prediction(&self, last: u16) -> u16 {
        if self.left != 0 {
            self.left
        } else if self.up != 0 {
            self.up
        } else if self.up_right != 0 {
            self.up_right
        } else {
            last
        }
    }

    /// Where the probabilities of the residual begin.
    #[inline(always)]
    fn context(&self, prediction: u16) -> usize {
        let class = |neighbour: u16| {
            let difference = i32::from(neighbour) - i32::from(prediction);
            let class = (difference.clamp(-CLIP, CLIP) + CLIP) as usize;
            if neighbour == 0 { CLASSES - 1 } else { class }
        };
        let context =
            (class(self.up) * CLASSES + class(self.up_left)) * CLASSES + class(self.up_right);
        context << CONTEXT_SHIFT
    }
}

impl DenseModel {
    pub(super) fn new(width: usize) -> Self {
        let residual = vec![EVEN; MODEL_SIZE].into_boxed_slice();
        Self {
            residual: residual
                .try_into()
                .expect("the slice was made with the size of the array"),
            missing: [EVEN; 16],
            above: vec![0; width + 2],
            row: vec![0; width + 2],
        }
    }

    fn reset(&mut self) {
        self.residual.fill(EVEN);
        self.missing.fill(EVEN);
        self.above.fill(0);
        self.row.fill(0);
    }

    /// Codes `samples` to the start of `out` and returns the length, or `None` when it does not fit.
    pub(super) fn encode(&mut self, samples: &[u16], out: &mut [u8]) -> Option<usize> {
        self.reset();
        let width = self.row.len() - 2;
        let mut coder = RangeEncoder::new(out);
        let mut last = 0;
        for samples in samples.chunks_exact(width) {
            std::mem::swap(&mut self.above, &mut self.row);
            self.row[1..=width].copy_from_slice(samples);
            let mut up_left = 0;
            let mut up = self.above[1];
            let mut left = 0;
            for (&sample, &up_right) in samples.iter().zip(&self.above[2..]) {
                let near = Neighbours {
                    left,
                    up,
                    up_left,
                    up_right,
                };
                coder.bit(&mut self.missing[near.presence()], sample != 0);
                if sample != 0 {
                    let prediction = near.prediction(last);
                    let context = near.context(prediction);
                    let difference = sample.wrapping_sub(prediction) as i16;
                    encode_residual(&mut coder, &mut self.residual, context, difference);
                    last = sample;
                }
                left = sample;
                up_left = up;
                up = up_right;
            }
            // Noise takes five times as long as a scene; most of that is not worth it.
            if coder.is_full() {
                return None;
            }
        }
        coder.finish()
    }

    /// Fills `samples` from a stream that must end with them.
    pub(super) fn decode(&mut self, bytes: &[u8], samples: &mut [u16]) -> Result<(), CodecError> {
        self.reset();
        let width = self.row.len() - 2;
        let mut coder = RangeDecoder::new(bytes)?;
        let mut last = 0;
        for samples in samples.chunks_exact_mut(width) {
            let mut up_left = 0;
            let mut up = self.above[1];
            let mut left = 0;
            for (sample, &up_right) in samples.iter_mut().zip(&self.above[2..]) {
                let near = Neighbours {
                    left,
                    up,
                    up_left,
                    up_right,
                };
                *sample = if coder.bit(&mut self.missing[near.presence()]) {
                    let prediction = near.prediction(last);
                    let context = near.context(prediction);
                    let difference = decode_residual(&mut coder, &mut self.residual, context)?;
                    last = prediction.wrapping_add(difference);
                    if last == 0 {
                        return Err(CodecError::Damaged("a sample that is there and missing"));
                    }
                    last
                } else {
                    0
                };
                left = *sample;
                up_left = up;
                up = up_right;
            }
            self.above[1..=width].copy_from_slice(samples);
            if coder.is_past_end() {
                return Err(CodecError::Cut);
            }
        }
        coder.finish()
    }
}

/// Bins of a context: 0 "differs", 1 "negative", 1 + k "the magnitude is above k" for k = 1 to 12.
#[inline(always)]
fn encode_residual(
    coder: &mut RangeEncoder<'_>,
    model: &mut [Probability; MODEL_SIZE],
    context: usize,
    difference: i16,
) {
    let mut bin = |index: u32, bit: bool| {
        coder.bit(
            &mut model[(context + index as usize) & (MODEL_SIZE - 1)],
            bit,
        );
    };
    bin(0, difference != 0);
    if difference == 0 {
        return;
    }
    bin(1, difference < 0);
    let magnitude = u32::from(difference.unsigned_abs());
    for k in 1..=UNARY_MAX {
        bin(1 + k, magnitude > k);
        if magnitude <= k {
            return;
        }
    }
    // Exp-Golomb of order 0: as many zeros as bits follow the leading one of value + 1, then those bits.
    let value = magnitude - UNARY_MAX;
    let bits = 31 - value.leading_zeros();
    coder.even_bits(1, bits + 1);
    coder.even_bits(value, bits);
}

#[inline(always)]
fn decode_residual(
    coder: &mut RangeDecoder<'_>,
    model: &mut [Probability; MODEL_SIZE],
    context: usize,
) -> Result<u16, CodecError> {
    let mut bin = |index: u32| coder.bit(&mut model[(context + index as usize) & (MODEL_SIZE - 1)]);
    if !bin(0) {
        return Ok(0);
    }
    let is_negative = bin(1);
    let mut magnitude = 1;
    while magnitude <= UNARY_MAX && bin(1 + magnitude) {
        magnitude += 1;
    }
    if magnitude > UNARY_MAX {
        let mut bits = 0;
        while coder.even_bits(1) == 0 {
            bits += 1;
            if bits == 16 {
                return Err(CodecError::Damaged("a difference of more than 16 bits"));
            }
        }
        magnitude = UNARY_MAX + (1 << bits | coder.even_bits(bits));
        if magnitude > 1 << 15 {
            return Err(CodecError::Damaged("a difference of more than 16 bits"));
        }
    }
    let magnitude = magnitude as u16;
    Ok(if is_negative {
        magnitude.wrapping_neg()
    } else {
        magnitude
    })
}
