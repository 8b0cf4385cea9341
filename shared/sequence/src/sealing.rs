//! A chunk on its way to being durable: `docs/sequence-format.md` section 4, in the order it demands, while the next
//! chunk is written or while the writer waits.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

use zerocopy::IntoBytes as _;

use crate::checksum::FileId;
use crate::file_layer::{FileLayer, Syncer, uninterrupted, write_all};
use crate::layout::{ChunkHeader, IndexBytes, PAGE, RECORDS_OFFSET};

/// Offset of the commit mark in its chunk.
const MARK_OFFSET: u64 = size_of::<ChunkHeader>() as u64;

/// A chunk whose records are all stored.
pub(crate) struct ClosedChunk {
    /// Where it begins.
    pub(crate) start: u64,
    /// Where the next one begins.
    pub(crate) end: u64,
    /// Its header, which is not stored yet.
    pub(crate) header: ChunkHeader,
    /// Its records.
    pub(crate) index: Vec<IndexBytes>,
}

/// What is being made durable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Header and records.
    Records,
    /// The commit mark, behind them.
    Mark,
}

/// Brings one chunk after the other onto the disk.
pub(crate) struct Sealer {
    /// Syncs while the writer goes on; begun when first wanted.
    thread: Option<SyncThread>,
    under_way: Option<(ClosedChunk, Stage)>,
    /// Of the sync that was asked for, where this thread did it itself.
    answer: Option<io::Result<()>>,
    is_beside: bool,
}

impl Sealer {
    pub(crate) fn new() -> Self {
        Self {
            thread: None,
            under_way: None,
            answer: None,
            is_beside: false,
        }
    }

    /// Whether a chunk is on its way.
    pub(crate) fn is_busy(&self) -> bool {
        self.under_way.is_some()
    }

    /// Sends a chunk on its way, when the one before has arrived. `is_beside`: its syncs are left to another thread where
    /// the layer and the system have one to give.
    pub(crate) fn begin(&mut self, layer: &mut dyn FileLayer, chunk: ClosedChunk, is_beside: bool) {
        if is_beside && self.thread.is_none() {
            let syncer = layer.syncer().ok().flatten();
            self.thread = syncer.and_then(|syncer| SyncThread::begin(syncer).ok());
        }
        self.is_beside = is_beside && self.thread.is_some();
        let stored = write_all(layer, chunk.start, chunk.header.as_bytes());
        let (start, bytes) = (chunk.start, chunk.end - chunk.start);
        self.under_way = Some((chunk, Stage::Records));
        match stored {
            Ok(()) => self.ask(layer, start, bytes),
            Err(error) => self.answer = Some(Err(error)),
        }
    }

    fn ask(&mut self, layer: &mut dyn FileLayer, offset: u64, bytes: u64) {
        match &self.thread {
            Some(thread) if self.is_beside => {
                layer.begin_writing(offset, bytes);
                thread.ask(offset, bytes);
            }
            _ => self.answer = Some(uninterrupted(|| layer.sync(offset, bytes))),
        }
    }

    fn take_answer(&mut self, waits: bool) -> Option<io::Result<()>> {
        let answer = self.answer.take();
        answer.or_else(|| self.thread.as_ref()?.answer(waits))
    }

    /// Goes on with what has been synced meanwhile; the chunk when it has arrived, and whether it is durable. A chunk that
    /// is not durable has been given up. With `waits` there is no `None` while a chunk is on its way.
    pub(crate) fn advance(
        &mut self,
        layer: &mut dyn FileLayer,
        file_id: FileId,
        waits: bool,
    ) -> Option<(ClosedChunk, bool)> {
        while self.under_way.is_some() {
            let answer = self.take_answer(waits)?;
            let (chunk, stage) = self.under_way.take()?;
            match (answer, stage) {
                (Ok(()), Stage::Mark) => return Some((chunk, true)),
                (Ok(()), Stage::Records) => {
                    let mark = chunk.header.commit_mark();
                    let start = chunk.start;
                    self.under_way = Some((chunk, Stage::Mark));
                    match write_all(layer, start + MARK_OFFSET, mark.as_bytes()) {
                        Ok(()) => self.ask(layer, start, PAGE),
                        Err(error) => self.answer = Some(Err(error)),
                    }
                }
                (Err(_), _) => {
                    give_up(layer, file_id, &chunk);
                    return Some((chunk, false));
                }
            }
        }
        None
    }
}

/// What the disk refused once it may report as written the next time: the chunk is given up. A void one takes its place,
/// so that readers hop over it.
fn give_up(layer: &mut dyn FileLayer, file_id: FileId, chunk: &ClosedChunk) {
    let void = ChunkHeader::sealed(
        file_id,
        chunk.header.number.get(),
        chunk.header.records_bytes.get(),
        0,
        RECORDS_OFFSET as u32,
        chunk.header.first_sequence.get(),
        0,
    );
    // When not even that can be written or made durable, readers look for the next chunk themselves, and a frame may then
    // be both in the file and in a gap.
    let _ = write_all(layer, chunk.start, void.as_bytes())
        .and_then(|()| {
            write_all(
                layer,
                chunk.start + MARK_OFFSET,
                void.commit_mark().as_bytes(),
            )
        })
        .and_then(|()| uninterrupted(|| layer.sync(chunk.start, PAGE)));
}

/// A thread that waits for the disk. One question at a time.
struct SyncThread {
    /// Offset and bytes. None when it is to end.
    questions: Option<SyncSender<(u64, u64)>>,
    answers: Receiver<io::Result<()>>,
    thread: Option<JoinHandle<()>>,
}

impl SyncThread {
    fn begin(mut syncer: Box<dyn Syncer>) -> io::Result<Self> {
        let (questions, asked) = sync_channel::<(u64, u64)>(1);
        let (answer, answers) = sync_channel(1);
        let thread = std::thread::Builder::new()
            .name("sync".to_owned())
            .spawn(move || {
                for (offset, bytes) in asked {
                    let synced = uninterrupted(|| syncer.sync(offset, bytes));
                    if answer.send(synced).is_err() {
                        break;
                    }
                }
            })?;
        Ok(Self {
            questions: Some(questions),
            answers,
            thread: Some(thread),
        })
    }

    fn ask(&self, offset: u64, bytes: u64) {
        // A thread that is gone shows in its answer.
        let _ = self
            .questions
            .as_ref()
            .map(|questions| questions.send((offset, bytes)));
    }

    fn answer(&self, waits: bool) -> Option<io::Result<()>> {
        let is_gone = || Some(Err(io::Error::other("the sync thread is gone")));
        if waits {
            return self.answers.recv().ok().or_else(is_gone);
        }
        match self.answers.try_recv() {
            Ok(answer) => Some(answer),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => is_gone(),
        }
    }
}

impl Drop for SyncThread {
    fn drop(&mut self) {
        self.questions = None;
        if let Some(thread) = self.thread.take() {
            // It panics only where a layer of a test does.
            let _ = thread.join();
        }
    }
}
