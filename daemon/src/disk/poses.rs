//! Poses on their way into the file: held until their frames are in it, written a chunk at a time.

use sequence::layout::PoseBytes;
use sequence::{RecordingWriter, SequenceError};

/// Poses that may wait: several seconds of a fast camera.
const MOST_POSES: usize = 4096;

/// A pose set of the recording, in whichever of its files is being written.
#[derive(Debug)]
pub(super) struct PoseQueue {
    name: &'static str,
    producer: String,
    stream: u16,
    /// Id in the open file.
    set: Option<u16>,
    pending: Vec<PoseBytes>,
    /// Numbers of the first and the last frame of the stream in all files.
    frames: Option<[u64; 2]>,
}

impl PoseQueue {
    pub(super) fn new(name: &'static str, producer: String, stream: u16) -> Self {
        Self {
            name,
            producer,
            stream,
            set: None,
            pending: Vec::with_capacity(MOST_POSES),
            frames: None,
        }
    }

    /// The stream whose camera the poses are of.
    pub(super) fn stream(&self) -> u16 {
        self.stream
    }

    /// Takes entries in the order of their numbers.
    pub(super) fn push(&mut self, entries: &[PoseBytes]) {
        for entry in entries {
            // Before the trigger comes poses wait in vain; the newest matter.
            if self.pending.len() == MOST_POSES {
                self.pending.drain(..MOST_POSES / 2);
            }
            self.pending.push(*entry);
        }
    }

    /// Says that a frame of some stream is in the open file.
    pub(super) fn note_frame(&mut self, stream: u16, number: u64) {
        if stream == self.stream {
            let [first, _] = self.frames.unwrap_or([number; 2]);
            self.frames = Some([first, number]);
        }
    }

    /// Writes the poses of frames that are in the file; those of later frames wait on.
    pub(super) fn flush(&mut self, writer: &mut RecordingWriter) -> Result<(), SequenceError> {
        let Some([first, last]) = self.frames else {
            return Ok(());
        };
        let count = |bound: u64| {
            self.pending
                .partition_point(|entry| entry.number.get() < bound)
        };
        let (from, to) = (count(first), count(last.saturating_add(1)));
        if from < to {
            let set = match self.set {
                Some(set) => set,
                None => writer.begin_poses(self.name, &self.producer, self.stream)?,
            };
            self.set = Some(set);
            writer.write_pose_bytes(set, &self.pending[from..to])?;
        }
        self.pending.drain(..to);
        Ok(())
    }

    /// Goes on in another file.
    pub(super) fn begin_file(&mut self) {
        self.set = None;
    }
}
