//! Frames that arrive one by one.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::*;

/// Pushes both streams with one of them behind by up to `lag` frames, and counts what comes out.
fn streamed(streams: &Streams, random: &mut Pcg64Mcg, lag: usize) -> Vec<Event<usize>> {
    let mut pairer = StreamingPairer::new(HALF_PERIOD);
    let mut events = Vec::new();
    let (mut i, mut j) = (0, 0);
    while i < streams.depth.len() || j < streams.color.len() {
        let depth_leads = match (streams.depth.get(i), streams.color.get(j)) {
            (Some(depth), Some(color)) => depth <= color,
            (depth, _) => depth.is_some(),
        };
        let (waiting_depth, waiting_color) = pairer.waiting_counts();
        assert!(
            waiting_depth.min(waiting_color) == 0
                && waiting_depth.max(waiting_color) <= MAX_WAITING
        );
        let may_lead = |waiting: usize, more: bool| more && waiting < lag;
        let push_depth = if random.random_bool(0.5) {
            depth_leads || may_lead(waiting_depth, i < streams.depth.len())
        } else {
            depth_leads && !may_lead(waiting_color, j < streams.color.len())
        };
        if push_depth {
            pairer.push_depth(streams.depth[i], i, |event| events.push(event));
            i += 1;
        } else {
            pairer.push_color(streams.color[j], j, |event| events.push(event));
            j += 1;
        }
    }
    pairer.flush(|event| events.push(event));
    assert_eq!(pairer.waiting_counts(), (0, 0));
    events
}

fn as_pairing(events: &[Event<usize>]) -> (Vec<(usize, usize)>, Vec<usize>, Vec<usize>) {
    let mut pairing = (Vec::new(), Vec::new(), Vec::new());
    for event in events {
        match *event {
            Event::Pair(depth, color) => pairing.0.push((depth, color)),
            Event::SingleDepth(depth) => pairing.1.push(depth),
            Event::SingleColor(color) => pairing.2.push(color),
        }
    }
    pairing
}

#[test]
fn streaming_pairs_what_the_whole_lists_pair() {
    for seed in 0..NEIGHBOURS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut streams = any_streams(&mut random, HOUR);
        for times in [&mut streams.depth, &mut streams.color] {
            let mut latest = i64::MIN;
            times.retain(|&nanos| {
                let is_apart = nanos.saturating_sub(latest) > 2 * HALF_PERIOD;
                latest = if is_apart { nanos } else { latest };
                is_apart
            });
        }
        let whole = pair_by_time(&streams.depth, &streams.color, HALF_PERIOD);
        let events = streamed(&streams, &mut random, MAX_WAITING);
        let (pairs, depth, color) = as_pairing(&events);
        assert_eq!(pairs, positions(&whole));
        assert_eq!(
            (depth, color),
            (whole.unmatched_depth, whole.unmatched_color)
        );
    }
}

#[test]
fn streaming_makes_as_many_pairs_of_close_frames() {
    let mut costlier_count = 0;
    for seed in 0..NEIGHBOURS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        // Five frames span more than the window, so that none has to go before its time.
        let mut any = || {
            let mut nanos = 0;
            let mut next = |_| {
                nanos += random.random_range(HALF_PERIOD / 4 + 1..PERIOD);
                nanos
            };
            (0..200).map(&mut next).collect::<Vec<i64>>()
        };
        let (depth, color) = (any(), any());
        let whole = pair_by_time(&depth, &color, HALF_PERIOD);
        let mut frames: Vec<(i64, bool, usize)> = Vec::new();
        frames.extend(
            depth
                .iter()
                .zip(0..)
                .map(|(&nanos, index)| (nanos, true, index)),
        );
        frames.extend(
            color
                .iter()
                .zip(0..)
                .map(|(&nanos, index)| (nanos, false, index)),
        );
        frames.sort_unstable();
        let mut pairer = StreamingPairer::new(HALF_PERIOD);
        let mut events = Vec::new();
        for (nanos, is_depth, index) in frames {
            if is_depth {
                pairer.push_depth(nanos, index, |event| events.push(event));
            } else {
                pairer.push_color(nanos, index, |event| events.push(event));
            }
        }
        pairer.flush(|event| events.push(event));
        let pairs = as_pairing(&events).0;
        assert_eq!(events.len() + pairs.len(), depth.len() + color.len());
        assert_eq!(pairs.len(), whole.pairs.len());
        costlier_count += usize::from(pairs != positions(&whole));
    }
    assert!(costlier_count > 0, "close frames may make other pairs");
}

#[test]
fn frames_are_decided_as_soon_as_they_can_be() {
    let mut pairer = StreamingPairer::<char>::new(10);
    let mut events = Vec::new();
    pairer.push_depth(0, 'a', |event| events.push(event));
    assert_eq!(events, []);
    pairer.push_color(8, 'A', |event| events.push(event));
    assert_eq!(events, [Event::Pair('a', 'A')]);
    // A colour frame far ahead: no depth frame before it can be matched any more.
    pairer.push_depth(30, 'b', |event| events.push(event));
    pairer.push_depth(60, 'c', |event| events.push(event));
    pairer.push_color(95, 'D', |event| events.push(event));
    assert_eq!(
        events[1..],
        [Event::SingleDepth('b'), Event::SingleDepth('c')]
    );
    // A swapped frame takes its place; one behind the last pair has none.
    pairer.push_depth(90, 'd', |event| events.push(event));
    pairer.push_depth(150, 'f', |event| events.push(event));
    pairer.push_depth(120, 'e', |event| events.push(event));
    pairer.push_color(121, 'E', |event| events.push(event));
    pairer.push_color(80, 'C', |event| events.push(event));
    let expected = [
        Event::Pair('d', 'D'),
        Event::Pair('e', 'E'),
        Event::SingleColor('C'),
    ];
    assert_eq!(events[3..], expected);
    // A stream that fell silent holds no more than its share.
    for nanos in 0..4 {
        pairer.push_depth(200 + nanos, 'g', |event| events.push(event));
    }
    assert_eq!(events[6..], [Event::SingleDepth('f')]);
    assert_eq!(pairer.waiting_counts(), (MAX_WAITING, 0));
    pairer.flush(|event| events.push(event));
    assert_eq!(events.len(), 7 + MAX_WAITING);
}
