//! Decodes a frame of samples from payload in pieces of any size.

use crate::damage::Damage;
use crate::samples::SampleFormat;
use crate::samples::compressed::RunningValue;
use crate::samples::packed::{MAX_GROUP_BYTES, group, unpack_bits, unpack_groups};
use crate::stream::Padding;

/// Code of the pixels that padding stands for: no measurement.
pub const NO_DEPTH: u16 = 0;

/// Decoder of the frames of one stream.
///
/// Per frame: [`begin`](Self::begin), [`push`](Self::push) for every piece of payload into the frame's one buffer,
/// [`finish`](Self::finish). The first damage is returned again by all calls until the next `begin`.
#[derive(Clone, Debug)]
pub struct SampleDecoder {
    format: SampleFormat,
    sample_count: usize,
    padding: Padding,
    /// Next sample to be written.
    position: usize,
    /// Bytes of a group that is not complete.
    carry: [u8; MAX_GROUP_BYTES],
    carry_bytes: usize,
    running: RunningValue,
    damage: Option<Damage>,
}

impl SampleDecoder {
    /// For frames of `sample_count` samples, padding included.
    pub fn new(format: SampleFormat, sample_count: usize) -> Self {
        Self {
            format,
            sample_count,
            padding: Padding::default(),
            position: 0,
            carry: [0; MAX_GROUP_BYTES],
            carry_bytes: 0,
            running: RunningValue::default(),
            damage: None,
        }
    }

    /// Begins a frame, of which `padding` samples are not sent.
    pub fn begin(&mut self, padding: Padding) {
        *self = Self::new(self.format, self.sample_count);
        self.padding = padding;
        self.position = usize::from(padding.before);
        if self.position + usize::from(padding.after) > self.sample_count {
            self.damage = Some(Damage::Padding);
        }
    }

    /// Decodes the next piece into `codes`, the buffer of the whole frame.
    ///
    /// # Errors
    /// What is wrong with the frame; [`Damage::BufferSize`] for a buffer of another size.
    pub fn push(&mut self, payload: &[u8], codes: &mut [u16]) -> Result<(), Damage> {
        let result = self.try_push(payload, codes);
        self.damage = result.err();
        result
    }

    /// Ends the frame: fills in the padding.
    ///
    /// # Errors
    /// What was wrong before; [`Damage::Short`] or [`Damage::Cut`] when payload is missing.
    pub fn finish(&mut self, codes: &mut [u16]) -> Result<(), Damage> {
        let result = self.try_finish(codes);
        self.damage = result.err();
        result
    }

    fn try_push(&mut self, payload: &[u8], codes: &mut [u16]) -> Result<(), Damage> {
        let codes = self.sent_of(codes)?;
        if self.format == SampleFormat::Compressed {
            return self.running.push(payload, codes, &mut self.position);
        }
        let (group_bytes, group_samples) = group(self.format);
        let payload = self.complete_group(payload, group_bytes, codes)?;
        let room = codes.get_mut(self.position..).unwrap_or_default();
        let group_count = (payload.len() / group_bytes).min(room.len() / group_samples);
        let (groups, rest) = payload.split_at(group_count * group_bytes);
        unpack_groups(self.format, groups, room);
        self.position += group_count * group_samples;
        self.carry_on(rest, codes.len())
    }

    /// The part of the frame that payload fills, from the first sample of the frame on.
    fn sent_of<'c>(&self, codes: &'c mut [u16]) -> Result<&'c mut [u16], Damage> {
        if let Some(damage) = self.damage {
            return Err(damage);
        }
        let got_count = codes.len();
        let end = self.sample_count.checked_sub(self.padding.after.into());
        match end.and_then(|end| codes.get_mut(..end)) {
            Some(sent) if got_count == self.sample_count => Ok(sent),
            _ => Err(Damage::BufferSize {
                expected_count: self.sample_count,
                got_count,
            }),
        }
    }

    /// Fills up the group that was begun and unpacks it; what is left of the payload.
    fn complete_group<'p>(
        &mut self,
        payload: &'p [u8],
        group_bytes: usize,
        codes: &mut [u16],
    ) -> Result<&'p [u8], Damage> {
        if self.carry_bytes == 0 {
            return Ok(payload);
        }
        let missing = group_bytes - self.carry_bytes;
        let (head, rest) = payload.split_at(missing.min(payload.len()));
        self.carry_on(head, codes.len())?;
        if self.carry_bytes < group_bytes {
            return Ok(rest);
        }
        let room = codes.get_mut(self.position..).unwrap_or_default();
        let group = self.carry.get(..group_bytes).unwrap_or_default();
        unpack_groups(self.format, group, room);
        let (_, group_samples) = crate::samples::packed::group(self.format);
        self.position += group_samples;
        self.carry_bytes = 0;
        Ok(rest)
    }

    /// Keeps bytes of a group that is not complete; at the end of the frame only as many as its last samples take.
    fn carry_on(&mut self, bytes: &[u8], end: usize) -> Result<(), Damage> {
        let carry_bytes = self.carry_bytes + bytes.len();
        if carry_bytes > self.group_bytes_left(end) {
            return Err(Damage::Excess);
        }
        let place = self.carry.get_mut(self.carry_bytes..carry_bytes);
        place.ok_or(Damage::Excess)?.copy_from_slice(bytes);
        self.carry_bytes = carry_bytes;
        Ok(())
    }

    /// Bytes of the next group, of which the end of the frame may leave only a part.
    fn group_bytes_left(&self, end: usize) -> usize {
        let (group_bytes, group_samples) = group(self.format);
        let left = end.saturating_sub(self.position);
        if left >= group_samples {
            return group_bytes;
        }
        (left * self.format.bits().unwrap_or(0)).div_ceil(8)
    }

    fn try_finish(&mut self, codes: &mut [u16]) -> Result<(), Damage> {
        let sent = self.sent_of(codes)?;
        let (end, position) = (sent.len(), self.position);
        let (_, group_samples) = group(self.format);
        let rest = sent.get_mut(position..).unwrap_or_default();
        let is_tail = (1..group_samples).contains(&rest.len());
        if is_tail && self.carry_bytes == self.group_bytes_left(end) {
            let tail = self.carry.get(..self.carry_bytes).unwrap_or_default();
            unpack_bits(self.format.bits().unwrap_or(16), tail, rest);
            self.position = end;
        } else if !rest.is_empty() {
            return Err(Damage::Short {
                missing_count: rest.len(),
            });
        } else if self.carry_bytes > 0 || !self.running.is_between_tokens() {
            return Err(Damage::Cut);
        }
        let before = codes.get_mut(..usize::from(self.padding.before));
        before.unwrap_or_default().fill(NO_DEPTH);
        codes.get_mut(end..).unwrap_or_default().fill(NO_DEPTH);
        Ok(())
    }
}
