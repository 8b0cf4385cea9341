//! The best pairs of two lists of times.
//!
//! Method: time is swept once. The state s is the number of frames that wait for a partner, s > 0 depth,
//! s < 0 colour (both at once never pays: partners on this side of the cut are nearer). A frame that arrives
//! is used (depth: s + 1, colour: s − 1) or left single, and waiting costs |s| dt, the sum of all |Δt|.
//! With f(s) the least (singles, cost) in that order:
//!
//! - an arrival is f ← min(f(s) + single, f(s ∓ 1)), the infimal convolution with a function of two points;
//! - time adds |s| dt;
//! - the window bounds s by the depth frames within it, −s by the colour frames. Nothing else is needed: if
//!   a used frame left the window while s keeps the bound, a later single of its stream could have replaced
//!   it at less cost.
//!
//! All three keep f convex, so f is the ascending list of its slopes f(s + 1) − f(s). Arrivals insert one:
//! depth (−1 single, 0 s), colour (+1 single, 0 s), so that all depth slopes come before all colour
//! slopes, and in each group only seconds count. Time lowers the slopes left of s = 0 and raises those right
//! of it; the window cuts slopes off the ends. Whether the frame is used by the best path through s is
//! whether its slope lies left of s, so one number for each frame is enough to walk back.
//!
//! A new slope belongs where the slopes of its group change sign. Time moves that place towards s = 0 only,
//! an arrival moves s = 0 by one slope, hence the place moves at most once for each frame and the sweep is
//! linear.

use std::collections::VecDeque;

/// Two frames that belong together, by their positions in the lists that were given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Position of the depth frame.
    pub depth: usize,
    /// Position of the colour frame.
    pub color: usize,
    /// Colour time less depth time, nanoseconds.
    pub skew_nanos: i64,
}

/// Every frame of two streams, in a pair or single.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pairing {
    /// Pairs in the order of both times.
    pub pairs: Vec<Pair>,
    /// Positions of depth frames without a partner, in the order of their times.
    pub unmatched_depth: Vec<usize>,
    /// Positions of colour frames without a partner, in the order of their times.
    pub unmatched_color: Vec<usize>,
}

/// Pairs depth with colour frames by their times, nanoseconds of one clock, in any order.
///
/// Of all pairings without a frame used twice and without |Δt| > `max_gap_nanos` the answer has the most
/// pairs, and of those the least sum of |Δt|; pairs never cross. Equal times are taken in the order of their
/// positions. A negative `max_gap_nanos` leaves every frame single. Time: sorting, then linear; memory: under
/// 100 bytes for each frame.
pub fn pair_by_time(depth_nanos: &[i64], color_nanos: &[i64], max_gap_nanos: i64) -> Pairing {
    let depth = in_order_of_time(depth_nanos);
    let color = in_order_of_time(color_nanos);
    let mut matcher = Matcher::new(max_gap_nanos);
    let (mut depth_next, mut color_next) = (depth.iter().peekable(), color.iter().peekable());
    loop {
        let is_depth = match (depth_next.peek(), color_next.peek()) {
            (Some(depth), Some(color)) => depth.nanos <= color.nanos,
            (depth, color) => {
                if depth.is_none() && color.is_none() {
                    break;
                }
                depth.is_some()
            }
        };
        if is_depth {
            depth_next.next().inspect(|frame| matcher.add_depth(frame));
        } else {
            color_next.next().inspect(|frame| matcher.add_color(frame));
        }
    }
    matcher.settle_run();
    matcher.pairing
}

#[derive(Clone, Copy)]
struct Frame {
    nanos: i64,
    index: usize,
}

fn in_order_of_time(nanos: &[i64]) -> Vec<Frame> {
    let frame = |(index, &nanos)| Frame { nanos, index };
    let mut frames: Vec<Frame> = nanos.iter().enumerate().map(frame).collect();
    // Stable, and linear for what is sorted.
    frames.sort_by_key(|frame| frame.nanos);
    frames
}

/// A frame of the run that is being swept.
struct Arrival {
    frame: Frame,
    is_depth: bool,
    /// The frame's slope lies left of s for every s above this.
    threshold: i64,
    is_used: bool,
}

/// One stream's slopes, ascending. A slope is stored less the time while it rises and plus the time while it
/// falls, so that time passes without touching it.
#[derive(Default)]
struct Slopes {
    /// Those below 0.
    below: VecDeque<i128>,
    /// The others.
    above: VecDeque<i128>,
}

impl Slopes {
    fn len(&self) -> usize {
        self.below.len() + self.above.len()
    }

    fn get_mut(&mut self, index: usize) -> Option<&mut i128> {
        match index.checked_sub(self.below.len()) {
            None => self.below.get_mut(index),
            Some(index) => self.above.get_mut(index),
        }
    }

    /// Moves the change of sign to where it is at `time`, when the first `falling_count` slopes fall.
    fn settle(&mut self, falling_count: usize, time: i128) {
        while self.below.len() < falling_count
            && let Some(key) = self.above.pop_front_if(|key| *key - time < 0)
        {
            self.below.push_back(key);
        }
        while self.below.len() > falling_count
            && let Some(key) = self.below.pop_back_if(|key| *key + time >= 0)
        {
            self.above.push_front(key);
        }
    }

    fn pop_first(&mut self) -> bool {
        self.below
            .pop_front()
            .or_else(|| self.above.pop_front())
            .is_some()
    }

    fn pop_last(&mut self) -> bool {
        self.above
            .pop_back()
            .or_else(|| self.below.pop_back())
            .is_some()
    }
}

struct Matcher {
    max_gap_nanos: i128,
    depth_slopes: Slopes,
    color_slopes: Slopes,
    /// Slopes left of s = 0, counted through depth and then colour; these fall with time.
    falling_count: usize,
    /// Times of the frames within the window.
    depth_within: VecDeque<i64>,
    color_within: VecDeque<i64>,
    /// Frames since s was last known to be 0.
    run: Vec<Arrival>,
    pairing: Pairing,
}

impl Matcher {
    fn new(max_gap_nanos: i64) -> Self {
        Self {
            max_gap_nanos: i128::from(max_gap_nanos),
            depth_slopes: Slopes::default(),
            color_slopes: Slopes::default(),
            falling_count: 0,
            depth_within: VecDeque::new(),
            color_within: VecDeque::new(),
            run: Vec::new(),
            pairing: Pairing::default(),
        }
    }

    fn add_depth(&mut self, frame: &Frame) {
        let time = self.advance(frame.nanos);
        let index = self.depth_slopes.below.len();
        let falling = self.falling_count;
        self.depth_within.push_back(frame.nanos);
        self.run.push(Arrival {
            frame: *frame,
            is_depth: true,
            threshold: index as i64 - falling as i64,
            is_used: false,
        });
        // The lowest s stays, so that one slope from the left of s = 0 comes to its right.
        if index < falling {
            if let Some(key) = self.slope_mut(falling - 1) {
                *key -= 2 * time;
            }
            self.depth_slopes.above.push_front(time);
        } else {
            self.depth_slopes.above.push_front(-time);
        }
    }

    fn add_color(&mut self, frame: &Frame) {
        let time = self.advance(frame.nanos);
        let index = self.depth_slopes.len() + self.color_slopes.below.len();
        let falling = self.falling_count;
        self.color_within.push_back(frame.nanos);
        self.run.push(Arrival {
            frame: *frame,
            is_depth: false,
            threshold: index as i64 - falling as i64 - 1,
            is_used: false,
        });
        // The lowest s is one less, so that one slope from the right of s = 0 comes to its left.
        if index > falling {
            if let Some(key) = self.slope_mut(falling) {
                *key += 2 * time;
            }
            self.color_slopes.above.push_front(-time);
        } else {
            self.color_slopes.above.push_front(time);
        }
        self.falling_count += 1;
    }

    fn slope_mut(&mut self, index: usize) -> Option<&mut i128> {
        match index.checked_sub(self.depth_slopes.len()) {
            None => self.depth_slopes.get_mut(index),
            Some(index) => self.color_slopes.get_mut(index),
        }
    }

    /// Lets time pass until `nanos` and answers the time since the run began.
    fn advance(&mut self, nanos: i64) -> i128 {
        let oldest = i128::from(nanos) - self.max_gap_nanos;
        let is_old = |within: &mut i64| i128::from(*within) < oldest;
        while self.depth_within.pop_front_if(is_old).is_some() {}
        while self.color_within.pop_front_if(is_old).is_some() {}
        // The greatest s is the number of slopes right of 0, the lowest that of those left of it.
        while self.slope_count() - self.falling_count > self.depth_within.len() {
            let _ = self.color_slopes.pop_last() || self.depth_slopes.pop_last();
        }
        while self.falling_count > self.color_within.len() {
            let _ = self.depth_slopes.pop_first() || self.color_slopes.pop_first();
            self.falling_count -= 1;
        }
        if self.slope_count() == 0 {
            self.settle_run();
        }
        let start = self.run.first().map_or(nanos, |first| first.frame.nanos);
        let time = i128::from(nanos) - i128::from(start);
        let depth_count = self.depth_slopes.len();
        self.depth_slopes
            .settle(self.falling_count.min(depth_count), time);
        self.color_slopes
            .settle(self.falling_count.saturating_sub(depth_count), time);
        time
    }

    fn slope_count(&self) -> usize {
        self.depth_slopes.len() + self.color_slopes.len()
    }

    /// Walks the best path back from s = 0 and writes down the run's frames.
    fn settle_run(&mut self) {
        let mut state = 0;
        for arrival in self.run.iter_mut().rev() {
            let is_left = state > arrival.threshold;
            arrival.is_used = is_left == arrival.is_depth;
            state -= match (arrival.is_used, arrival.is_depth) {
                (false, _) => 0,
                (true, true) => 1,
                (true, false) => -1,
            };
        }
        debug_assert_eq!(state, 0, "the path begins where the run does");
        let used = |is_depth| {
            let of_stream =
                move |arrival: &&Arrival| arrival.is_used && arrival.is_depth == is_depth;
            self.run.iter().filter(of_stream)
        };
        let pairs = used(true).zip(used(false)).map(|(depth, color)| Pair {
            depth: depth.frame.index,
            color: color.frame.index,
            // At most the window apart.
            skew_nanos: color.frame.nanos - depth.frame.nanos,
        });
        self.pairing.pairs.extend(pairs);
        for single in self.run.iter().filter(|arrival| !arrival.is_used) {
            if single.is_depth {
                self.pairing.unmatched_depth.push(single.frame.index);
            } else {
                self.pairing.unmatched_color.push(single.frame.index);
            }
        }
        self.run.clear();
    }
}
