//! The split file: which frames train, which are held out.

use std::collections::BTreeSet;
use std::path::Path;

use sequence::Split;
use serde::Deserialize;

use super::error::{ImportError, read_text};
use super::source::Source;

/// A split file as it is written; frames are named by the numbers in their file names,
/// in TUM by the position of the depth image.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SplitText {
    train: Vec<u32>,
    #[serde(default)]
    unused: Vec<u32>,
    #[serde(default)]
    test: Vec<u32>,
}

/// The split of the frames of `source`, by their numbers in the recording, from a file or all for training;
/// notes for the report.
pub(crate) fn split_of(
    source: &Source,
    path: Option<&Path>,
) -> Result<(Split, Vec<String>), ImportError> {
    // Numbers of frames have 32 bits: whoever read the folder has seen to that.
    let numbered = source
        .depth
        .iter()
        .map(|image| (image.times.number as u32, image));
    let Some(path) = path else {
        let note = "no split file: every frame is for training, none is held out".to_owned();
        let split = Split {
            train: numbered.map(|(number, _)| number).collect(),
            ..Split::default()
        };
        return Ok((split, vec![note]));
    };
    let text = read_text(path)?;
    let named: SplitText = serde_json::from_str(&text).map_err(|error| ImportError::Text {
        path: path.to_path_buf(),
        line: Some(error.line()),
        message: format!("{error}; a split has the lists train, unused and test"),
    })?;
    let mut seen = BTreeSet::new();
    for &frame in named.train.iter().chain(&named.unused).chain(&named.test) {
        if !source.numbers.contains(&(frame as usize)) {
            return Err(ImportError::SplitBeyond {
                path: path.to_path_buf(),
                frame,
                first: source.numbers.start,
                stop: source.numbers.end,
            });
        }
        if !seen.insert(frame) {
            return Err(ImportError::SplitOverlap {
                path: path.to_path_buf(),
                frame,
            });
        }
    }
    let (train, test) = (
        BTreeSet::from_iter(named.train),
        BTreeSet::from_iter(named.test),
    );
    let mut split = Split::default();
    let mut unnamed_count = 0;
    for (number, image) in numbered {
        let is_in = |list: &BTreeSet<u32>| image.number.is_some_and(|name| list.contains(&name));
        if is_in(&train) {
            split.train.push(number);
        } else if is_in(&test) {
            split.test.push(number);
        } else {
            // A split names pairs: an image without a partner is in no list.
            unnamed_count += usize::from(image.number.is_some() && !is_in(&seen));
            split.unused.push(number);
        }
    }
    if split.train.is_empty() {
        return Err(ImportError::NothingToTrain {
            path: path.to_path_buf(),
        });
    }
    let note = format!("{unnamed_count} frames are in no list of the split: unused");
    let notes = if unnamed_count > 0 {
        vec![note]
    } else {
        Vec::new()
    };
    Ok((split, notes))
}
