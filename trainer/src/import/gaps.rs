//! Gaps of a recording that is made anew: each hole in the numbers is in exactly one gap.

use std::ops::Range;

use sequence::{FrameTimes, Gap, GapCause};

/// Gaps by stream and first number, each cut where the one before still goes on.
pub(crate) fn disjoint(mut gaps: Vec<Gap>) -> Vec<Gap> {
    gaps.sort_by_key(|gap| (gap.stream, gap.first_number));
    let mut cut: Vec<Gap> = Vec::new();
    for mut gap in gaps {
        let end = gap.first_number + gap.count;
        if let Some(before) = cut.last()
            && before.stream == gap.stream
        {
            gap.first_number = gap.first_number.max(before.first_number + before.count);
        }
        if gap.first_number < end {
            gap.count = end - gap.first_number;
            cut.push(gap);
        }
    }
    cut
}

/// The gaps of `stream` around `frames`, which are the frames that are written, by rising numbers. What is
/// missing between two frames and is in none of `recorded` (see [`disjoint`]) gets a gap; outside of the frames
/// there are those of `recorded`, unless `is_excerpt`. Work is linear in both lists.
pub(crate) fn gaps_around(
    recorded: &[Gap],
    stream: u16,
    frames: &[FrameTimes],
    is_excerpt: bool,
) -> Vec<Gap> {
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
        return Vec::new();
    };
    let recorded: Vec<&Gap> = recorded.iter().filter(|gap| gap.stream == stream).collect();
    let mut holes = HoleFiller {
        recorded: &recorded,
        filled: Vec::new(),
    };
    if !is_excerpt {
        holes.take(0..first.number);
    }
    for pair in frames.windows(2) {
        holes.fill(stream, &pair[0], &pair[1]);
    }
    if !is_excerpt {
        holes.take(last.number + 1..u64::MAX);
    }
    holes.filled
}

/// Cuts the gaps of a file to the holes that are there.
struct HoleFiller<'a> {
    /// By first numbers, none overlapping another; those before the hole in work are gone.
    recorded: &'a [&'a Gap],
    filled: Vec<Gap>,
}

impl HoleFiller<'_> {
    /// The parts of recorded gaps in `hole`; holes come by rising numbers.
    fn take(&mut self, hole: Range<u64>) {
        let past = self
            .recorded
            .partition_point(|gap| gap.first_number + gap.count <= hole.start);
        self.recorded = &self.recorded[past..];
        for gap in self.recorded {
            let first_number = gap.first_number.max(hole.start);
            let end = (gap.first_number + gap.count).min(hole.end);
            if gap.first_number >= hole.end {
                break;
            }
            if first_number < end {
                self.filled.push(Gap {
                    first_number,
                    count: end - first_number,
                    ..(*gap).clone()
                });
            }
        }
    }

    /// All numbers between two frames, in recorded gaps or not.
    fn fill(&mut self, stream: u16, before: &FrameTimes, after: &FrameTimes) {
        let known_count = self.filled.len();
        self.take(before.number + 1..after.number);
        let known = self.filled.split_off(known_count);
        let unknown = |numbers: Range<u64>| Gap {
            stream,
            first_number: numbers.start,
            count: numbers.end - numbers.start,
            from_nanos: Some(before.device_nanos),
            to_nanos: Some(after.device_nanos),
            cause: Some(GapCause::Source),
            note: String::new(),
        };
        let mut next = before.number + 1;
        for gap in known {
            if gap.first_number > next {
                self.filled.push(unknown(next..gap.first_number));
            }
            next = gap.first_number + gap.count;
            self.filled.push(gap);
        }
        if after.number > next {
            self.filled.push(unknown(next..after.number));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gap(numbers: Range<u64>) -> Gap {
        Gap {
            stream: 1,
            first_number: numbers.start,
            count: numbers.end - numbers.start,
            from_nanos: None,
            to_nanos: None,
            cause: Some(GapCause::PacketLoss),
            note: String::new(),
        }
    }

    fn frame(number: u64) -> FrameTimes {
        FrameTimes {
            number,
            ..FrameTimes::default()
        }
    }

    /// Numbers of the gaps, and whether they were recorded.
    fn around(
        recorded: &[Range<u64>],
        frames: &[u64],
        is_excerpt: bool,
    ) -> Vec<(Range<u64>, bool)> {
        let mut gaps: Vec<Gap> = recorded.iter().cloned().map(gap).collect();
        gaps.push(Gap {
            stream: 2,
            ..gap(0..1000)
        });
        let frames: Vec<FrameTimes> = frames.iter().copied().map(frame).collect();
        gaps_around(&disjoint(gaps), 1, &frames, is_excerpt)
            .iter()
            .map(|gap| {
                let numbers = gap.first_number..gap.first_number + gap.count;
                (numbers, gap.cause != Some(GapCause::Source))
            })
            .collect()
    }

    #[test]
    fn gaps_are_cut_to_the_holes_and_holes_are_filled() {
        // Overlapping, over frames, before the first, behind the last, in no order.
        let recorded = [9..12, 2..4, 3..5, 0..2, 30..31, 20..26];
        let frames = [1, 5, 6, 10, 22, 29];
        assert_eq!(
            around(&recorded, &frames, false),
            [
                (0..1, true),
                (2..4, true),
                (4..5, true),
                (7..9, false),
                (9..10, true),
                (11..12, true),
                (12..20, false),
                (20..22, true),
                (23..26, true),
                (26..29, false),
                (30..31, true),
            ]
        );
    }

    #[test]
    fn an_excerpt_has_no_gaps_around_it() {
        assert_eq!(around(&[0..3, 4..5, 6..9], &[3, 5], true), [(4..5, true)]);
        assert_eq!(around(&[0..3, 5..6], &[], true), []);
    }

    #[test]
    fn one_gap_over_everything_gives_each_hole_its_part() {
        assert_eq!(
            around(&[0..3, 1..u64::from(u32::MAX)], &[0, 2, 4], true),
            [(1..2, true), (3..4, true)]
        );
    }
}
