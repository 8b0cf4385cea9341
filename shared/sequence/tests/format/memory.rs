//! A file in memory that fails when it should and knows what would survive a loss of power.

use std::collections::BTreeSet;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use sequence::file_layer::{FileLayer, Syncer};

const PAGE: usize = 4096;

/// What happens to a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The disk is full: space and writes are refused.
    Full,
    /// The disk reports an error. Of a sync it does so once: the pages count as clean afterwards.
    Broken,
    /// A signal came.
    Interrupted,
    /// A write takes half of its bytes.
    Short,
    /// It only takes time.
    Slow,
}

/// Which calls fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Plan {
    pub(crate) fault: Fault,
    /// The first call that it happens to, from 1.
    pub(crate) call: u64,
    /// To all later calls too.
    pub(crate) is_lasting: bool,
}

/// What a writer did, in order.
#[derive(Clone, Debug)]
pub(crate) enum Operation {
    Write { offset: usize, bytes: Vec<u8> },
    Sync { start: usize, end: usize },
    Length(usize),
}

#[derive(Debug, Default)]
struct State {
    bytes: Vec<u8>,
    /// What is on the disk for certain.
    durable: Vec<u8>,
    /// Pages that differ from it and will be written by the next sync.
    dirty: BTreeSet<usize>,
    plan: Option<Plan>,
    /// The disk has no more than this.
    capacity: Option<usize>,
    call_count: u64,
    fault_count: u64,
    /// End of what was written, as far as it goes.
    written_end: usize,
    log: Vec<Operation>,
}

/// Bytes that a writer fills and others can look at meanwhile.
#[derive(Clone, Debug, Default)]
pub(crate) struct MemoryFile {
    state: Arc<Mutex<State>>,
    written: Arc<Condvar>,
    /// What is synced beside the writer is so when the writer is so many bytes behind it.
    late_bytes: usize,
}

impl MemoryFile {
    /// A file whose calls fail by plan.
    pub(crate) fn failing(plan: Plan) -> Self {
        let file = Self::default();
        file.state().plan = Some(plan);
        file
    }

    /// A file on a disk with room for `capacity` bytes.
    pub(crate) fn on_disk_of(capacity: usize) -> Self {
        let file = Self::default();
        file.state().capacity = Some(capacity);
        file
    }

    /// A file whose disk is late: records are synced when the writer is in the next chunk.
    pub(crate) fn late() -> Self {
        Self {
            late_bytes: 512,
            ..Self::default()
        }
    }

    /// What a writer writes to.
    pub(crate) fn layer(&self) -> Box<dyn FileLayer> {
        Box::new(self.clone())
    }

    /// The file as it is now.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.state().bytes.clone()
    }

    /// The file as it is when the power goes now and nothing that was not synced had been written.
    pub(crate) fn durable_bytes(&self) -> Vec<u8> {
        self.state().durable.clone()
    }

    /// How often the plan struck.
    pub(crate) fn fault_count(&self) -> u64 {
        self.state().fault_count
    }

    /// All writes and syncs so far.
    pub(crate) fn log(&self) -> Vec<Operation> {
        self.state().log.clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }
}

impl State {
    /// The fault of the call that begins now.
    fn fault(&mut self, can_be_full: bool) -> Option<Fault> {
        self.call_count += 1;
        let plan = self.plan?;
        let strikes =
            self.call_count == plan.call || plan.is_lasting && self.call_count > plan.call;
        let fault =
            (strikes && (can_be_full || plan.fault != Fault::Full)).then_some(plan.fault)?;
        self.fault_count += 1;
        Some(fault)
    }

    fn resize(&mut self, length: usize) {
        self.bytes.resize(length, 0);
        self.durable.resize(length, 0);
    }

    fn sync(&mut self, start: usize, end: usize, is_kept: bool) {
        let pages: Vec<usize> = self
            .dirty
            .range(start / PAGE..end.div_ceil(PAGE))
            .copied()
            .collect();
        for page in pages {
            self.dirty.remove(&page);
            let bytes = page * PAGE..self.bytes.len().min((page + 1) * PAGE);
            if is_kept && !bytes.is_empty() {
                self.durable[bytes.clone()].copy_from_slice(&self.bytes[bytes]);
            }
        }
    }
}

fn error_of(fault: Option<Fault>) -> io::Result<()> {
    match fault {
        Some(Fault::Full) => Err(io::ErrorKind::StorageFull.into()),
        // EIO.
        Some(Fault::Broken) => Err(io::Error::from_raw_os_error(5)),
        Some(Fault::Interrupted) => Err(io::ErrorKind::Interrupted.into()),
        Some(Fault::Short | Fault::Slow) | None => Ok(()),
    }
}

impl FileLayer for MemoryFile {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        let mut state = self.state();
        error_of(state.fault(true))?;
        let end = (offset + bytes) as usize;
        if state.capacity.is_some_and(|capacity| end > capacity) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        if state.bytes.len() < end {
            state.resize(end);
        }
        Ok(())
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.state();
        let fault = state.fault(true);
        error_of(fault)?;
        let count = if fault == Some(Fault::Short) {
            bytes.len().div_ceil(2)
        } else {
            bytes.len()
        };
        let (start, bytes) = (offset as usize, &bytes[..count]);
        // As a map: what was not allocated cannot be written.
        let place = state.bytes.get_mut(start..start + count);
        place
            .ok_or(io::ErrorKind::InvalidInput)?
            .copy_from_slice(bytes);
        state
            .dirty
            .extend(start / PAGE..(start + count).div_ceil(PAGE));
        state.written_end = state.written_end.max(start + count);
        self.written.notify_all();
        state.log.push(Operation::Write {
            offset: start,
            bytes: bytes.to_vec(),
        });
        Ok(count)
    }

    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        let mut state = self.state();
        let fault = state.fault(true);
        let (start, end) = (offset as usize, (offset + bytes) as usize);
        let is_kept = error_of(fault).is_ok();
        if fault != Some(Fault::Interrupted) {
            state.sync(start, end, is_kept);
        }
        error_of(fault)?;
        state.log.push(Operation::Sync { start, end });
        Ok(())
    }

    fn syncer(&self) -> io::Result<Option<Box<dyn Syncer>>> {
        Ok(Some(Box::new(Beside(self.clone()))))
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        let mut state = self.state();
        error_of(state.fault(false))?;
        let length = bytes as usize;
        state.resize(length);
        state.sync(0, length, true);
        state.log.push(Operation::Length(length));
        Ok(())
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        error_of(self.state().fault(false))?;
        Ok(u64::MAX)
    }

    fn release_before(&mut self, _offset: u64) {}
}

/// Syncs a file in another thread.
struct Beside(MemoryFile);

impl Syncer for Beside {
    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        let Self(file) = self;
        let end = (offset + bytes) as usize;
        // A mark, which has a page for itself, may be the last that the writer waits for.
        let is_mark = bytes == PAGE as u64;
        let enough = if is_mark { 0 } else { end + file.late_bytes };
        let waited = file.written.wait_while(file.state(), |state| {
            file.late_bytes > 0 && state.written_end < enough
        });
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        file.sync(offset, bytes)
    }
}
