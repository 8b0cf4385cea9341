//! Frames on their way through the threads, and the fixed pools they come from.

use ringbuf::traits::{Consumer as _, Producer as _, Split as _};
use ringbuf::{HeapCons, HeapProd, HeapRb};
use sequence::FrameTimes;

/// A depth frame: samples by rows.
#[derive(Debug, Default)]
pub struct DepthFrame {
    /// When it was taken and came in.
    pub times: FrameTimes,
    /// As many as the stream has pixels.
    pub samples: Vec<u16>,
}

/// A colour frame.
#[derive(Debug, Default)]
pub struct ColorFrame {
    /// When it was taken and came in.
    pub times: FrameTimes,
    /// The raw frame in the stream's format, or a JPEG.
    pub bytes: Vec<u8>,
}

/// Handles of the frames that are free: the source takes, the last user gives back.
pub struct FreeFrames<F> {
    free: HeapCons<Box<F>>,
    /// One that was taken and not used.
    spare: Option<Box<F>>,
}

/// Where a user gives frames back.
pub struct Returns<F> {
    free: HeapProd<Box<F>>,
}

/// A pool of `frames`. All memory that frames will ever use is made here.
pub fn pool<F>(frames: impl ExactSizeIterator<Item = F>) -> (FreeFrames<F>, Returns<F>) {
    let (mut give, take) = HeapRb::new(frames.len().max(1)).split();
    for frame in frames {
        // As many places as frames.
        let _ = give.try_push(Box::new(frame));
    }
    let free = FreeFrames {
        free: take,
        spare: None,
    };
    (free, Returns { free: give })
}

impl<F> FreeFrames<F> {
    /// A free frame, if there is one.
    pub fn take(&mut self) -> Option<Box<F>> {
        self.spare.take().or_else(|| self.free.try_pop())
    }

    /// Keeps the frame that was taken last for the next time.
    pub fn put_back(&mut self, frame: Box<F>) {
        self.spare = Some(frame);
    }
}

impl<F> Returns<F> {
    /// Gives a frame back.
    pub fn give(&mut self, frame: Box<F>) {
        // The ring has a place for every frame of the pool.
        let _ = self.free.try_push(frame);
    }
}
