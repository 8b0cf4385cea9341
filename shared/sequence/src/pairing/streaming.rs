//! Pairs while the frames arrive.

use std::collections::VecDeque;

/// Frames of one stream that wait for the other at most.
pub const MAX_WAITING: usize = 4;

/// What became of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<D, C = D> {
    /// A depth and a colour frame belong together.
    Pair(D, C),
    /// A depth frame has no partner.
    SingleDepth(D),
    /// A colour frame has no partner.
    SingleColor(C),
}

/// Pairs two streams whose frames arrive one by one, with handles `D` and `C` of the caller.
///
/// Each stream arrives in the order of its times; between the streams any delay is welcome as long as not
/// more than [`MAX_WAITING`] frames of one wait for the other, else the oldest becomes single. The oldest
/// frames of both streams are a pair as soon as both are there and at most the window apart; else the earlier
/// of them is single, since all that follows is later. This makes the most pairs that there are (in a pairing
/// without this one at most one of the two has a partner, whose place the other can take), and the result
/// does not depend on how the two streams interleave. See the [module](super) for where
/// [`pair_by_time`](super::pair_by_time) differs.
///
/// A frame that is earlier than its predecessor takes its place among those that wait; behind the last pair
/// it is single at once, so pairs never cross.
///
/// Every frame that was pushed comes out once. Nothing is allocated after `new`.
#[derive(Clone, Debug)]
pub struct StreamingPairer<D, C = D> {
    max_gap_nanos: i64,
    depth: Waiting<D>,
    color: Waiting<C>,
}

#[derive(Clone, Debug)]
struct Waiting<H> {
    /// Ascending in time.
    frames: VecDeque<(i64, H)>,
    paired_nanos: i64,
}

impl<H> Waiting<H> {
    fn new() -> Self {
        Self {
            frames: VecDeque::with_capacity(MAX_WAITING + 1),
            paired_nanos: i64::MIN,
        }
    }

    /// Gives the frame back when it comes too late.
    fn insert(&mut self, nanos: i64, handle: H) -> Option<H> {
        if nanos < self.paired_nanos {
            return Some(handle);
        }
        let place = self
            .frames
            .partition_point(|(waiting, _)| *waiting <= nanos);
        self.frames.insert(place, (nanos, handle));
        None
    }

    fn pop(&mut self) -> Option<H> {
        self.frames.pop_front().map(|(_, handle)| handle)
    }

    fn pop_paired(&mut self) -> Option<H> {
        let (nanos, handle) = self.frames.pop_front()?;
        self.paired_nanos = nanos;
        Some(handle)
    }
}

impl<D, C> StreamingPairer<D, C> {
    /// Both frames of a pair are at most `max_gap_nanos` apart; a negative one pairs nothing.
    pub fn new(max_gap_nanos: i64) -> Self {
        Self {
            max_gap_nanos,
            depth: Waiting::new(),
            color: Waiting::new(),
        }
    }

    /// A depth frame of time `nanos` arrived; `emit` gets all that this decides, in the order of time.
    pub fn push_depth(&mut self, nanos: i64, handle: D, mut emit: impl FnMut(Event<D, C>)) {
        if let Some(handle) = self.depth.insert(nanos, handle) {
            emit(Event::SingleDepth(handle));
            return;
        }
        self.decide(&mut emit);
        if self.depth.frames.len() > MAX_WAITING
            && let Some(handle) = self.depth.pop()
        {
            emit(Event::SingleDepth(handle));
        }
    }

    /// A colour frame of time `nanos` arrived; `emit` gets all that this decides, in the order of time.
    pub fn push_color(&mut self, nanos: i64, handle: C, mut emit: impl FnMut(Event<D, C>)) {
        if let Some(handle) = self.color.insert(nanos, handle) {
            emit(Event::SingleColor(handle));
            return;
        }
        self.decide(&mut emit);
        if self.color.frames.len() > MAX_WAITING
            && let Some(handle) = self.color.pop()
        {
            emit(Event::SingleColor(handle));
        }
    }

    /// Nothing more arrives: all that waits is single. The pairer may be used for other streams afterwards.
    pub fn flush(&mut self, mut emit: impl FnMut(Event<D, C>)) {
        while let Some(handle) = self.depth.pop() {
            emit(Event::SingleDepth(handle));
        }
        while let Some(handle) = self.color.pop() {
            emit(Event::SingleColor(handle));
        }
        self.depth.paired_nanos = i64::MIN;
        self.color.paired_nanos = i64::MIN;
    }

    /// Frames that wait, of depth and of colour; one of them is 0.
    pub fn waiting_counts(&self) -> (usize, usize) {
        (self.depth.frames.len(), self.color.frames.len())
    }

    /// Decides the oldest frames while both streams have one.
    fn decide(&mut self, emit: &mut impl FnMut(Event<D, C>)) {
        while let (Some(&(depth_nanos, _)), Some(&(color_nanos, _))) =
            (self.depth.frames.front(), self.color.frames.front())
        {
            let gap_nanos = i128::from(color_nanos) - i128::from(depth_nanos);
            if gap_nanos.abs() <= i128::from(self.max_gap_nanos) {
                if let (Some(depth), Some(color)) =
                    (self.depth.pop_paired(), self.color.pop_paired())
                {
                    emit(Event::Pair(depth, color));
                }
            } else if gap_nanos > 0 {
                self.depth.pop().map(Event::SingleDepth).map(&mut *emit);
            } else {
                self.color.pop().map(Event::SingleColor).map(&mut *emit);
            }
        }
    }
}
