//! Chunks on their way to the disk.

use std::time::Instant;

use sequence::SequenceError;

use super::Disk;

impl Disk<'_> {
    /// Looks whether a chunk has arrived, and sends the next on its way when it is time; goes on in another file where the
    /// rotation asks for it.
    pub(super) fn seal_if_due(&mut self) -> Result<(), SequenceError> {
        let now_nanos = (self.clock.monotonic)();
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        if self.report.failure.is_some() {
            return Ok(());
        }
        if self.sealing_since.is_some() && writer.is_sealed()? {
            self.note_sealed()?;
        }
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        if !writer.is_due(now_nanos) {
            return Ok(());
        }
        // A disk that is a whole chunk late is waited for, and frames meanwhile in the ring.
        self.await_seal()?;
        self.flush_poses()?;
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        let begun = Instant::now();
        writer.begin_seal()?;
        self.sealing_since = Some(begun);
        self.sealing_count = self.unsealed.len();
        let is_full = self
            .rotation
            .bytes
            .is_some_and(|bytes| writer.bytes() >= bytes);
        let is_old = self
            .rotation
            .age
            .is_some_and(|age| self.begun.elapsed() >= age);
        if is_full || is_old {
            self.rotate()?;
        }
        Ok(())
    }

    /// Waits for the chunk that is on its way.
    pub(super) fn await_seal(&mut self) -> Result<(), SequenceError> {
        match &mut self.writer {
            Some(writer) if self.sealing_since.is_some() => writer.await_seal()?,
            _ => return Ok(()),
        }
        self.note_sealed()
    }

    /// The chunk that was on its way has arrived.
    fn note_sealed(&mut self) -> Result<(), SequenceError> {
        if let Some(since) = self.sealing_since.take() {
            self.report.seals.add(since.elapsed());
        }
        self.unsealed.drain(..self.sealing_count);
        self.sealing_count = 0;
        if let Some(writer) = &mut self.writer {
            let bytes = self.report.bytes + writer.bytes();
            self.status.set_bytes(bytes, writer.room_bytes()?);
        }
        Ok(())
    }
}
