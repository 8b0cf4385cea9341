//! The kinds of frames: how payload becomes their samples.

use crossbeam::sync::Parker;
use ps1080::Damage;
use ps1080::color::ColorDecoder;
use ps1080::mode::Resolution;
use ps1080::samples::{DepthSensor, InfraredRows, SampleDecoder, SampleFormat};
use ps1080::stream::{Padding, StreamKind};
use sequence::{COLOR_STREAM, DEPTH_STREAM, FrameTimes};

use crate::frame::{ColorFrame, DepthFrame, FreeFrames};
use crate::pair::Sent;
use crate::source::SourceEnds;

/// The samples of one kind of frame: how payload becomes them, where free frames are, where full ones go.
pub(super) trait Samples {
    /// The frame.
    type Frame;
    /// Its stream in the recording.
    const STREAM: u16;
    /// Its packets.
    const KIND: StreamKind;

    /// Begins a frame.
    fn begin(&mut self, padding: Padding, frame: &mut Self::Frame);
    /// Decodes payload.
    fn push(&mut self, payload: &[u8], frame: &mut Self::Frame) -> Result<(), Damage>;
    /// Ends the frame.
    fn finish(&mut self, frame: &mut Self::Frame) -> Result<(), Damage>;
    /// Where free ones are.
    fn free(ends: &mut SourceEnds) -> (&mut FreeFrames<Self::Frame>, &Parker);
    /// Ready to be sent.
    fn sent(frame: Box<Self::Frame>, times: FrameTimes) -> Sent;
}

/// Depth.
pub(super) struct Shifts(pub(super) SampleDecoder);

impl Samples for Shifts {
    type Frame = DepthFrame;
    const STREAM: u16 = DEPTH_STREAM;
    const KIND: StreamKind = StreamKind::Depth;

    fn begin(&mut self, padding: Padding, _: &mut DepthFrame) {
        self.0.begin(padding);
    }

    fn push(&mut self, payload: &[u8], frame: &mut DepthFrame) -> Result<(), Damage> {
        self.0.push(payload, &mut frame.samples)
    }

    fn finish(&mut self, frame: &mut DepthFrame) -> Result<(), Damage> {
        self.0.finish(&mut frame.samples)
    }

    fn free(ends: &mut SourceEnds) -> (&mut FreeFrames<DepthFrame>, &Parker) {
        (&mut ends.depth_frames, &ends.parker)
    }

    fn sent(mut frame: Box<DepthFrame>, times: FrameTimes) -> Sent {
        frame.times = times;
        Sent::Depth(frame)
    }
}

/// What comes on the image endpoint.
pub(super) enum Picture {
    /// Colour; a JPEG frame is as long as its stream.
    Color {
        /// Of its format.
        decoder: ColorDecoder,
        /// Bytes of a frame; of JPEG the most.
        frame_bytes: usize,
    },
    /// Infrared.
    Infrared(Brightness),
}

/// Decodes infrared, with the rows that are sent and not shown.
pub(super) struct Brightness {
    decoder: SampleDecoder,
    /// Of the rows that are sent.
    samples: Vec<u16>,
    frame_bytes: usize,
}

impl Brightness {
    /// Of pictures of `resolution` from `sensor`.
    pub(super) fn new(sensor: DepthSensor, resolution: Resolution) -> Self {
        let rows = InfraredRows::of(sensor, resolution);
        let pixels_of = |rows: u16| usize::from(resolution.size().0) * usize::from(rows);
        Self {
            decoder: SampleDecoder::new(SampleFormat::Packed10, pixels_of(rows.sent)),
            samples: vec![0; pixels_of(rows.sent)],
            frame_bytes: 2 * pixels_of(rows.shown),
        }
    }

    /// Writes the rows that are shown, two bytes a pixel; those that were not sent are black.
    fn write(&self, bytes: &mut [u8]) {
        let (places, _) = bytes.as_chunks_mut();
        let sent = self.samples.iter().copied().chain(std::iter::repeat(0));
        for (place, sample) in places.iter_mut().zip(sent) {
            *place = sample.to_le_bytes();
        }
    }
}

impl Samples for Picture {
    type Frame = ColorFrame;
    const STREAM: u16 = COLOR_STREAM;
    const KIND: StreamKind = StreamKind::Image;

    fn begin(&mut self, _: Padding, frame: &mut ColorFrame) {
        match self {
            Self::Color {
                decoder,
                frame_bytes,
            } => {
                frame.bytes.resize(*frame_bytes, 0);
                decoder.begin();
            }
            Self::Infrared(brightness) => {
                frame.bytes.resize(brightness.frame_bytes, 0);
                brightness.decoder.begin(Padding::default());
            }
        }
    }

    fn push(&mut self, payload: &[u8], frame: &mut ColorFrame) -> Result<(), Damage> {
        match self {
            Self::Color { decoder, .. } => decoder.push(payload, &mut frame.bytes),
            Self::Infrared(brightness) => brightness.decoder.push(payload, &mut brightness.samples),
        }
    }

    fn finish(&mut self, frame: &mut ColorFrame) -> Result<(), Damage> {
        match self {
            Self::Color { decoder, .. } => frame.bytes.truncate(decoder.finish()?),
            Self::Infrared(brightness) => {
                brightness.decoder.finish(&mut brightness.samples)?;
                brightness.write(&mut frame.bytes);
            }
        }
        Ok(())
    }

    fn free(ends: &mut SourceEnds) -> (&mut FreeFrames<ColorFrame>, &Parker) {
        (&mut ends.color_frames, &ends.parker)
    }

    fn sent(mut frame: Box<ColorFrame>, times: FrameTimes) -> Sent {
        frame.times = times;
        Sent::Color(frame)
    }
}
