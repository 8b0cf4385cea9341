//! Frames on their way through the threads, and the fixed pools they come from.

use ringbuf::traits::{Consumer, Producer as _, Split as _};
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
    /// One for each user.
    free: Vec<HeapCons<Box<F>>>,
    /// One that was taken and not used.
    spare: Option<Box<F>>,
}

/// Where a user gives frames back.
pub struct Returns<F> {
    free: HeapProd<Box<F>>,
}

/// A pool of `frames`, with a way back for each of its `USERS`. All memory that frames will ever use is made here.
pub fn pool<F, const USERS: usize>(
    frames: impl ExactSizeIterator<Item = F>,
) -> (FreeFrames<F>, [Returns<F>; USERS]) {
    // As many places as frames, for each user.
    let places = frames.len().max(1);
    let mut free = Vec::with_capacity(USERS);
    let mut returns: [Returns<F>; USERS] = std::array::from_fn(|_| {
        let (give, take) = HeapRb::new(places).split();
        free.push(take);
        Returns { free: give }
    });
    if let Some(first) = returns.first_mut() {
        for frame in frames {
            first.give(Box::new(frame));
        }
    }
    (FreeFrames { free, spare: None }, returns)
}

impl<F> FreeFrames<F> {
    /// A free frame, if there is one.
    pub fn take(&mut self) -> Option<Box<F>> {
        let spare = self.spare.take();
        spare.or_else(|| self.free.iter_mut().find_map(Consumer::try_pop))
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
