//! From a time to the nearest frame without a search.

/// Frames by time. A steady stream is found in O(1): time is cut into as many equal buckets as there are
/// frames, and a bucket knows the first frame in it or behind it.
#[derive(Debug)]
pub(crate) struct TimeIndex {
    /// Times in rising order with the index of their frame.
    sorted: Vec<(i64, usize)>,
    first_of_bucket: Vec<usize>,
    bucket_nanos: i128,
}

impl TimeIndex {
    /// An index of the times of frames 0, 1, 2 …, in any order.
    pub(crate) fn new(nanos: &[i64]) -> Self {
        let mut sorted: Vec<(i64, usize)> = nanos.iter().copied().zip(0..).collect();
        sorted.sort_unstable();
        let span = match (sorted.first(), sorted.last()) {
            (Some(first), Some(last)) => i128::from(last.0) - i128::from(first.0),
            _ => 0,
        };
        let mut index = Self {
            first_of_bucket: Vec::with_capacity(sorted.len() + 1),
            bucket_nanos: span / (sorted.len().max(1) as i128) + 1,
            sorted,
        };
        for (position, (nanos, _)) in index.sorted.iter().enumerate() {
            let bucket = index.bucket_of(*nanos);
            while index.first_of_bucket.len() <= bucket {
                index.first_of_bucket.push(position);
            }
        }
        index
    }

    /// The frame whose time is nearest to `nanos`; of two equally near ones the earlier.
    pub(crate) fn nearest(&self, nanos: i64) -> Option<usize> {
        let last_bucket = self.first_of_bucket.len().checked_sub(1)?;
        let mut position = self.first_of_bucket[self.bucket_of(nanos).min(last_bucket)];
        while self
            .sorted
            .get(position)
            .is_some_and(|(time, _)| *time < nanos)
        {
            position += 1;
        }
        let distance = |(time, _): &(i64, usize)| (i128::from(*time) - i128::from(nanos)).abs();
        let before = position.checked_sub(1).map(|before| &self.sorted[before]);
        let nearest = match (before, self.sorted.get(position)) {
            (Some(before), Some(at)) if distance(before) <= distance(at) => before,
            (_, Some(at)) => at,
            (before, None) => before?,
        };
        Some(nearest.1)
    }

    fn bucket_of(&self, nanos: i64) -> usize {
        let first = self.sorted.first().map_or(0, |(time, _)| *time);
        let bucket = (i128::from(nanos) - i128::from(first)).max(0) / self.bucket_nanos;
        usize::try_from(bucket).unwrap_or(usize::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a search through all frames finds.
    fn nearest_of_all(nanos: &[i64], time: i64) -> Option<i64> {
        let distance = |candidate: &i64| (i128::from(*candidate) - i128::from(time)).abs();
        nanos
            .iter()
            .copied()
            .min_by_key(|candidate| (distance(candidate), *candidate))
    }

    #[test]
    fn finds_what_a_full_search_finds() {
        let shuffled = [70, 10, 40, 40, 1000, -5, i64::MIN, i64::MAX];
        for nanos in [&[][..], &[3], &[5, 5, 5], &[0, 33, 66, 100, 133], &shuffled] {
            let index = TimeIndex::new(nanos);
            for time in [
                i64::MIN,
                -100,
                -1,
                0,
                9,
                25,
                34,
                41,
                66,
                500,
                1001,
                i64::MAX,
            ] {
                let found = index.nearest(time).map(|frame| nanos[frame]);
                assert_eq!(found, nearest_of_all(nanos, time), "{nanos:?} at {time}");
            }
        }
    }

    #[test]
    fn hc_k04_a_time_in_a_hundred_hours_is_found_exactly() {
        // Bite: 32-bit milliseconds and microseconds wrap long before.
        let frame_nanos = |frame: i64| frame * 1_000_000_000 / 30;
        let count = 100 * 3600 * 30;
        let last = frame_nanos(count - 1);
        assert!(i128::from((last / 1000) as u32) != i128::from(last / 1000));
        // Hold: every frame by its own time, with one in a thousand asked for.
        let nanos: Vec<i64> = (0..count).map(frame_nanos).collect();
        let index = TimeIndex::new(&nanos);
        for frame in (0..count as usize).step_by(997) {
            assert_eq!(index.nearest(nanos[frame]), Some(frame));
            assert_eq!(index.nearest(nanos[frame] + 16_000_000), Some(frame));
        }
        println!("k04: 0 of 10833 frames wrong, tolerance 0");
    }
}
