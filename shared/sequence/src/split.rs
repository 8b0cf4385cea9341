//! Which frames training may see.

use serde::{Deserialize, Serialize};

use crate::error::SequenceError;

/// Every frame of a recording in exactly one of three lists, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// Frames that training reads.
    pub train: Vec<u32>,
    /// Frames that nobody reads: a gap between training and test.
    pub unused: Vec<u32>,
    /// Held-out frames, for judging.
    pub test: Vec<u32>,
}

impl Split {
    /// All frames for training.
    pub fn all_train(frame_count: u32) -> Self {
        Self {
            train: (0..frame_count).collect(),
            ..Self::default()
        }
    }

    /// Refuses a split that does not name every frame of `0..frame_count` exactly once.
    pub fn check(&self, frame_count: u32) -> Result<(), SequenceError> {
        let wrong = |frame, times| SequenceError::Split {
            frame,
            times,
            frame_count,
        };
        let mut named: Vec<u32> = [&self.train, &self.unused, &self.test]
            .into_iter()
            .flatten()
            .copied()
            .collect();
        named.sort_unstable();
        for (expected, frame) in (0..frame_count).zip(&named) {
            if *frame > expected {
                return Err(wrong(expected, 0));
            }
            if *frame < expected {
                return Err(wrong(*frame, 2));
            }
        }
        match named.get(frame_count as usize) {
            Some(&beyond) if beyond < frame_count => Err(wrong(beyond, 2)),
            Some(&beyond) => Err(wrong(beyond, 1)),
            None if named.len() < frame_count as usize => Err(wrong(named.len() as u32, 0)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(train: &[u32], unused: &[u32], test: &[u32]) -> Split {
        Split {
            train: train.to_vec(),
            unused: unused.to_vec(),
            test: test.to_vec(),
        }
    }

    #[test]
    fn only_a_partition_passes() {
        assert!(split(&[0, 1, 3], &[2], &[4]).check(5).is_ok());
        assert!(Split::all_train(7).check(7).is_ok());
        assert!(Split::default().check(0).is_ok());
        let named_wrong = |split: Split, count| match split.check(count) {
            Err(SequenceError::Split { frame, times, .. }) => Some((frame, times)),
            _ => None,
        };
        assert_eq!(named_wrong(split(&[0, 1], &[], &[1]), 2), Some((1, 2)));
        assert_eq!(named_wrong(split(&[0, 1], &[], &[1, 2]), 3), Some((1, 2)));
        assert_eq!(named_wrong(split(&[0], &[], &[2]), 3), Some((1, 0)));
        assert_eq!(named_wrong(split(&[0], &[], &[1]), 3), Some((2, 0)));
        assert_eq!(named_wrong(split(&[0], &[7], &[1]), 2), Some((7, 1)));
    }
}
