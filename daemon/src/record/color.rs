//! Colour frames are encoded beside depth frames: both of a pair come at the same moment, and who waits for the file
//! waits for the longer of the two only.

use std::io;

use crossbeam::channel::{Receiver, Sender, bounded};
use sequence::encode::ColorStreamEncoder;
use sequence::{SequenceError, Streams};

use crate::frame::ColorFrame;
use crate::latency::Work;

/// What the colour thread does: frames one after the other, in a memory that stays.
pub(super) struct ColorTask {
    encoder: ColorStreamEncoder,
    previous: Vec<u8>,
    has_previous: bool,
    jobs: Receiver<Job>,
    results: Sender<Result<Encoded, SequenceError>>,
}

/// The way to the colour thread and back. One frame at a time.
pub(super) struct ColorLink {
    jobs: Sender<Job>,
    results: Receiver<Result<Encoded, SequenceError>>,
    /// Memory for the next payload.
    spare: Vec<u8>,
}

/// A frame, and memory for its payload.
struct Job {
    frame: Box<ColorFrame>,
    payload: Vec<u8>,
}

/// A frame whose payload is there.
pub(super) struct Encoded {
    /// With [`is_repeat`](sequence::FrameTimes::is_repeat) as it is.
    pub(super) frame: Box<ColorFrame>,
    pub(super) payload: Vec<u8>,
    /// What it took.
    pub(super) work: Work,
}

/// A task for the colour of `streams`, whose frames have at most `most_color_bytes`, with the way to it and the most
/// bytes of a payload.
pub(super) fn color_task(
    streams: &Streams,
    most_color_bytes: usize,
) -> Result<(ColorTask, ColorLink, usize), SequenceError> {
    let encoder = ColorStreamEncoder::new(streams)?;
    let most_payload_bytes = encoder.max_payload_bytes().max(most_color_bytes);
    let (to_task, jobs) = bounded(1);
    let (results, from_task) = bounded(1);
    let task = ColorTask {
        encoder,
        previous: Vec::with_capacity(most_color_bytes),
        has_previous: false,
        jobs,
        results,
    };
    let link = ColorLink {
        jobs: to_task,
        results: from_task,
        spare: Vec::with_capacity(most_payload_bytes),
    };
    Ok((task, link, most_payload_bytes))
}

impl ColorTask {
    /// Until the link is gone.
    pub(super) fn run(mut self) {
        while let Ok(job) = self.jobs.recv() {
            let encoded = self.encode(job);
            if self.results.send(encoded).is_err() {
                break;
            }
        }
    }

    fn encode(&mut self, job: Job) -> Result<Encoded, SequenceError> {
        let Job {
            mut frame,
            mut payload,
        } = job;
        let begun = Work::begin();
        frame.times.is_repeat = self.has_previous && self.previous == frame.bytes;
        if !frame.times.is_repeat {
            self.previous.clone_from(&frame.bytes);
            self.has_previous = true;
        }
        payload.clear();
        payload.extend_from_slice(self.encoder.encode(&frame.bytes)?);
        let work = begun.end();
        Ok(Encoded {
            frame,
            payload,
            work,
        })
    }
}

impl ColorLink {
    /// Begins with a frame.
    pub(super) fn begin(&mut self, frame: Box<ColorFrame>) {
        let payload = std::mem::take(&mut self.spare);
        // A thread that is gone shows when its result is asked for.
        let _ = self.jobs.send(Job { frame, payload });
    }

    /// Waits for the frame that was begun.
    pub(super) fn finish(&mut self) -> Result<Encoded, SequenceError> {
        let gone = || SequenceError::Io(io::Error::other("the colour thread is gone"));
        self.results.recv().map_err(|_| gone())?
    }

    /// Takes the memory of a payload back.
    pub(super) fn recycle(&mut self, payload: Vec<u8>) {
        self.spare = payload;
    }
}
