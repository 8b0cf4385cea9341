//! The pair thread: which colour frame belongs to which depth frame.

use crossbeam::sync::{Parker, Unparker};
use ringbuf::traits::{Consumer as _, Observer as _, Producer as _};
use ringbuf::{HeapCons, HeapProd};
use sequence::pairing::{Event, StreamingPairer};

use crate::frame::{ColorFrame, DepthFrame};
use crate::latency::Latencies;

/// A frame from a source.
#[derive(Debug)]
pub enum Sent {
    /// Of the depth stream.
    Depth(Box<DepthFrame>),
    /// Of the colour stream.
    Color(Box<ColorFrame>),
}

/// What is recorded together, and dropped together.
#[derive(Debug)]
pub enum Unit {
    /// Both.
    Pair(Box<DepthFrame>, Box<ColorFrame>),
    /// Depth without a partner.
    Depth(Box<DepthFrame>),
    /// Colour without a partner.
    Color(Box<ColorFrame>),
}

/// What was counted while pairing.
#[derive(Clone, Debug, Default)]
pub struct PairReport {
    /// Time between the frames of a pair.
    pub skews: Latencies,
    /// Frames without a partner.
    pub single_count: u64,
}

/// Pairs until the source is gone. Waits at `parker`, wakes the record thread with `record`.
pub fn pair_frames(
    mut from: HeapCons<Sent>,
    mut to: HeapProd<Unit>,
    widest_nanos: i64,
    parker: &Parker,
    record: &Unparker,
) -> PairReport {
    let mut report = PairReport::default();
    let mut pairer: StreamingPairer<Box<DepthFrame>, Box<ColorFrame>> =
        StreamingPairer::new(widest_nanos);
    let mut emit = |event: Event<Box<DepthFrame>, Box<ColorFrame>>| {
        let unit = match event {
            Event::Pair(depth, color) => {
                let skew = depth.times.device_nanos.abs_diff(color.times.device_nanos);
                report.skews.add(std::time::Duration::from_nanos(skew));
                Unit::Pair(depth, color)
            }
            Event::SingleDepth(depth) => {
                report.single_count += 1;
                Unit::Depth(depth)
            }
            Event::SingleColor(color) => {
                report.single_count += 1;
                Unit::Color(color)
            }
        };
        // The ring has a place for every frame of both pools.
        let _ = to.try_push(unit);
        record.unpark();
    };
    loop {
        match from.try_pop() {
            Some(Sent::Depth(frame)) => {
                pairer.push_depth(frame.times.device_nanos, frame, &mut emit);
            }
            Some(Sent::Color(frame)) => {
                pairer.push_color(frame.times.device_nanos, frame, &mut emit);
            }
            None if from.write_is_held() => parker.park_timeout(crate::capture::LONGEST_PARK),
            // What was pushed between the two looks.
            None if !from.is_empty() => {}
            None => break,
        }
    }
    pairer.flush(&mut emit);
    report
}
