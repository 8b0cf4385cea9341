//! Frames on their way from the record thread to the fuse thread, and what both count of them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam::sync::{Parker, Unparker};
use ringbuf::traits::{Consumer as _, Observer as _, Producer as _, Split as _};
use ringbuf::{HeapCons, HeapProd, HeapRb};

use crate::capture::LONGEST_PARK;
use crate::frame::{ColorFrame, DepthFrame, Returns};
use crate::status::StopFlag;

/// Frames that may wait to be fused: a quarter of a second.
pub const RING_FRAMES: usize = 8;
/// Frames that may wait while fusion is in step.
const MOST_WAITING: usize = 2;

/// A depth frame to be fused, with the colour of its time where there is one.
#[derive(Debug)]
pub struct FuseUnit {
    /// Not a repeat.
    pub depth: Box<DepthFrame>,
    /// Not a repeat.
    pub color: Option<Box<ColorFrame>>,
}

/// What became of depth frames behind the record thread.
#[derive(Debug, Default)]
pub struct Progress {
    announced: AtomicU64,
    done: AtomicU64,
    skipped: AtomicU64,
    repeats: AtomicU64,
}

impl Progress {
    /// Frames that are handed on, or will be.
    pub fn announced(&self) -> u64 {
        self.announced.load(Ordering::Acquire)
    }

    /// Frames among them that have been tracked or skipped.
    pub fn done(&self) -> u64 {
        self.done.load(Ordering::Acquire)
    }

    /// Frames that were recorded and not tracked, for want of time.
    pub fn skipped(&self) -> u64 {
        self.skipped.load(Ordering::Relaxed)
    }

    /// Frames that repeat their predecessor: never fused (hard-cases B13).
    pub fn repeats(&self) -> u64 {
        self.repeats.load(Ordering::Relaxed)
    }
}

/// The end that the record thread has.
pub struct FuseLink {
    to: HeapProd<FuseUnit>,
    progress: Arc<Progress>,
    fuse: Unparker,
    /// The source can be paused: no frame is skipped.
    waits: bool,
    stop: StopFlag,
}

/// The end that the fuse thread has.
pub struct FuseSource {
    from: HeapCons<FuseUnit>,
    progress: Arc<Progress>,
    depth_returns: Returns<DepthFrame>,
    color_returns: Returns<ColorFrame>,
    /// Where the thread waits.
    parker: Parker,
    source: Unparker,
    record: Unparker,
    waits: bool,
    stop: StopFlag,
}

/// What a look into the ring finds.
#[derive(Debug)]
pub enum Next {
    /// A frame.
    Frame(FuseUnit),
    /// Nothing yet: the thread has waited.
    Nothing,
    /// Nothing any more.
    End,
}

/// The ring. `record` and `source` wake those threads.
pub fn ring(
    depth_returns: Returns<DepthFrame>,
    color_returns: Returns<ColorFrame>,
    source: Unparker,
    record: Unparker,
    waits: bool,
    stop: &StopFlag,
) -> (FuseLink, FuseSource) {
    let (to, from) = HeapRb::new(RING_FRAMES).split();
    let progress = Arc::<Progress>::default();
    let parker = Parker::new();
    let link = FuseLink {
        to,
        progress: Arc::clone(&progress),
        fuse: parker.unparker().clone(),
        waits,
        stop: stop.clone(),
    };
    let fuse_source = FuseSource {
        from,
        progress,
        depth_returns,
        color_returns,
        parker,
        source,
        record,
        waits,
        stop: stop.clone(),
    };
    (link, fuse_source)
}

impl FuseLink {
    /// What became of the frames.
    pub fn progress(&self) -> &Arc<Progress> {
        &self.progress
    }

    /// Counts a depth frame that repeats its predecessor.
    pub fn count_repeat(&self) {
        self.progress.repeats.fetch_add(1, Ordering::Relaxed);
    }

    /// Says that a frame will be handed on. Said before the frame is in the file: who closes the file and waits for the
    /// poses of all its frames must not miss this one.
    pub fn announce(&self) {
        self.progress.announced.fetch_add(1, Ordering::AcqRel);
    }

    /// Hands an announced frame on; gives it back, and counts it as skipped, when there is no room. Waits for room at `parker`
    /// where the source can be paused.
    pub fn hand(&mut self, unit: FuseUnit, parker: &Parker) -> Result<(), FuseUnit> {
        while self.waits && self.to.is_full() && self.to.read_is_held() && !self.stop.is_set() {
            self.fuse.unpark();
            parker.park_timeout(LONGEST_PARK);
        }
        let refused = if self.to.read_is_held() {
            self.to.try_push(unit)
        } else {
            Err(unit)
        };
        if refused.is_err() {
            self.progress.done.fetch_add(1, Ordering::AcqRel);
            self.progress.skipped.fetch_add(1, Ordering::Relaxed);
        }
        self.fuse.unpark();
        refused
    }
}

impl FuseSource {
    /// What became of the frames.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// The next frame to fuse: the oldest while few wait, or where the source can be paused; when fusion is late, the
    /// newest, and the others are skipped. A recording that ends before its source skips all.
    pub fn take(&mut self) -> Next {
        let kept = if self.stop.is_set() {
            0
        } else if !self.waits && self.from.occupied_len() > MOST_WAITING {
            1
        } else {
            usize::MAX
        };
        while self.from.occupied_len() > kept
            && let Some(unit) = self.from.try_pop()
        {
            self.skip(unit);
        }
        if let Some(unit) = self.from.try_pop() {
            self.record.unpark();
            return Next::Frame(unit);
        }
        if self.from.write_is_held() {
            self.parker.park_timeout(LONGEST_PARK);
            return Next::Nothing;
        }
        // What was pushed between the two looks.
        if self.from.is_empty() {
            Next::End
        } else {
            Next::Nothing
        }
    }

    /// Gives a frame back and counts it as done.
    pub fn give_back(&mut self, unit: FuseUnit) {
        self.depth_returns.give(unit.depth);
        if let Some(color) = unit.color {
            self.color_returns.give(color);
        }
        self.progress.done.fetch_add(1, Ordering::AcqRel);
        self.source.unpark();
        self.record.unpark();
    }

    /// Gives a frame back unfused.
    pub fn skip(&mut self, unit: FuseUnit) {
        self.progress.skipped.fetch_add(1, Ordering::Relaxed);
        self.give_back(unit);
    }
}
