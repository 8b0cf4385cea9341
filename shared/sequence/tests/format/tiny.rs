//! Recordings of a few kilobytes, for the vectors and for looking at every byte.

use std::path::Path;

use geometry::{DQuat, DVec3, Intrinsics, Pose};
use sequence::chunk_writer::{DiskLimits, RecordLabel};
use sequence::codecs::{ColorFormat, DepthCodec};
use sequence::description::Part;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::file_layer::FileLayer;
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, DepthSamples,
    Description, Event, FileId, FramePose, FrameTimes, Gap, GapCause, Gravity, Histogram, Note,
    PoseState, RecordingWriter, ResponseCurve, SequenceError, Split, StreamTiming, Streams,
    TickClock, VignettingCurve,
};

/// The kind of a record of a later version that is skipped.
pub(crate) const UNKNOWN_KIND: u16 = 0x0200;
/// The number that is missing in both streams.
pub(crate) const MISSING: u64 = 3;
/// The number whose depth repeats the one before.
pub(crate) const REPEAT: u64 = 2;
/// The first number whose depth has values that need another table.
pub(crate) const NEW_VALUES: u64 = 4;

/// How a tiny recording looks.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) file_id: FileId,
    pub(crate) encoding: ColorEncoding,
    pub(crate) samples: DepthSamples,
    pub(crate) codec: DepthCodec,
    /// Samples that no codec makes smaller.
    pub(crate) is_noise: bool,
    /// Device times that go back and come twice.
    pub(crate) is_shuffled: bool,
    pub(crate) part: Option<Part>,
    /// Numbers after which a chunk is sealed.
    pub(crate) seal_after: Vec<u64>,
    /// One more than the last number.
    pub(crate) end_number: u64,
    /// Kind and payload of another record, in front of the last frames.
    pub(crate) extra: Option<(u16, Vec<u8>)>,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            width: 16,
            height: 12,
            file_id: FileId(*b"a tiny glint id "),
            encoding: ColorEncoding::BayerGrbg,
            samples: DepthSamples::Values,
            codec: DepthCodec::Fast,
            is_noise: false,
            is_shuffled: false,
            part: None,
            seal_after: vec![1, 4],
            end_number: 6,
            extra: Some((UNKNOWN_KIND, b"of a later version".to_vec())),
        }
    }
}

impl Scene {
    pub(crate) fn description(&self) -> Description {
        let (width, height) = (self.width, self.height);
        let center = (f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0);
        let intrinsics =
            Intrinsics::pinhole(width, height, 15.0, 15.0, center.0, center.1).unwrap();
        let timing = StreamTiming {
            rate_hz: (!self.is_shuffled).then_some(10.0),
            clock: Some(TickClock {
                tick_hz: 60_000_000,
                bits: 32,
            }),
        };
        Description {
            writer: "glint vectors".to_owned(),
            created: Created {
                unix_nanos: 1_700_000_000_123_456_789,
                host_nanos: 5_000_000_000,
            },
            part: self.part,
            streams: Streams {
                depth: DepthCamera {
                    samples: self.samples,
                    ..DepthCamera::new(intrinsics, 0.001, 0.4..=4.0).unwrap()
                },
                color: ColorCamera::new(
                    intrinsics,
                    self.encoding,
                    1.0,
                    ResponseCurve::Gamma { gamma: 2.2 },
                    VignettingCurve::None,
                )
                .unwrap(),
                color_from_depth: Pose::new(DQuat::IDENTITY, DVec3::new(0.025, 0.0, 0.0)).unwrap(),
                depth_timing: timing,
                color_timing: timing,
                device: None,
            },
            depth_id: DEPTH_STREAM,
            color_id: COLOR_STREAM,
        }
    }

    /// Numbers of the frames that are written.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = u64> + use<> {
        (0..self.end_number).filter(|number| *number != MISSING)
    }

    /// Depth of a frame: two steps with a hole, or noise.
    pub(crate) fn depth(&self, number: u64) -> Vec<u16> {
        let shown = if number == REPEAT { REPEAT - 1 } else { number } as u32;
        let sample = |index: u32| {
            let (column, row) = (index % self.width, index / self.width);
            if self.is_noise {
                hash(index + 1000 * shown) as u16
            } else if column == (shown + 2) % self.width && row > 2 {
                0
            } else {
                let step = column / 4 + row / 3 + 4 * u32::from(number >= NEW_VALUES);
                700 + 9 * step as u16
            }
        };
        (0..self.width * self.height).map(sample).collect()
    }

    /// A raw frame in the format of the scene; of JPEG the file.
    pub(crate) fn color(&self, number: u64) -> Vec<u8> {
        let Some(format) = self.encoding.lossless() else {
            return self.jpeg(number);
        };
        let bytes = format.frame_bytes(self.width, self.height).unwrap() as u32;
        let row_bytes = bytes / self.height;
        let sample = |index: u32| {
            let (place, row) = (index % row_bytes, index / row_bytes);
            if format == ColorFormat::Infrared10 {
                // 0 to 1023, the low byte first; steps that carry.
                let brightness = 200 + 13 * (place / 2) + 37 * row + 5 * number as u32;
                brightness.to_le_bytes()[place as usize % 2]
            } else if self.is_noise {
                hash(index + 7000 * (number as u32 + 1)) as u8
            } else {
                (40 + place / 2 + 3 * row + 9 * (place % 2) + 5 * number as u32) as u8
            }
        };
        (0..bytes).map(sample).collect()
    }

    fn jpeg(&self, number: u64) -> Vec<u8> {
        let pixel = |column: u32, row: u32| {
            image::Rgb([
                (10 * column) as u8,
                (15 * row) as u8,
                (40 * number % 256) as u8,
            ])
        };
        let image = image::RgbImage::from_fn(self.width, self.height, pixel);
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 80);
        image.write_with_encoder(encoder).unwrap();
        bytes
    }

    pub(crate) fn times(&self, stream: u16, number: u64) -> FrameTimes {
        let nanos = if self.is_shuffled {
            [500_000_000, 100_000_000, 100_000_000, 0, 300_000_000, -1][number as usize % 6]
        } else {
            100_000_000 * number as i64
        };
        FrameTimes {
            number,
            device_ticks: Some((4_294_000_000 + 6_000_000 * number) & 0xffff_ffff),
            device_nanos: nanos,
            host_nanos: Some([5_000_000_000 + nanos, 5_020_000_000 + nanos]),
            is_repeat: stream == DEPTH_STREAM && number == REPEAT,
        }
    }

    pub(crate) fn pose(&self, number: u64) -> FramePose {
        let turn = DQuat::from_rotation_y(0.01 * number as f64);
        let shift = DVec3::new(0.02 * number as f64, 0.0, 0.1);
        FramePose {
            state: if number == 4 {
                PoseState::Weak(0b100_001)
            } else {
                PoseState::Ok
            },
            covariance: (number == 4).then(|| std::array::from_fn(|index| index as f32)),
            ..FramePose::ok(number, Pose::new(turn, shift).unwrap())
        }
    }

    pub(crate) fn gap(&self, stream: u16) -> Gap {
        Gap {
            stream,
            first_number: MISSING,
            count: 1,
            from_nanos: Some(self.times(stream, MISSING - 1).device_nanos),
            to_nanos: Some(self.times(stream, MISSING + 1).device_nanos),
            cause: Some(GapCause::PacketLoss),
            note: "two packets".to_owned(),
        }
    }

    pub(crate) fn event(&self) -> Event {
        Event {
            stream: COLOR_STREAM,
            host_nanos: 5_000_000_000,
            details: serde_json::json!({"event": "settings", "exposure_us": 8000}),
        }
    }

    pub(crate) fn gravity(&self) -> Gravity {
        Gravity {
            number: 0,
            down: DVec3::Y,
            sigma: 0.02,
        }
    }

    pub(crate) fn histogram(&self) -> Histogram {
        Histogram {
            name: "pair-skew".to_owned(),
            unit: "ms".to_owned(),
            edges: vec![0.0, 1.0, 2.5],
            counts: vec![4, 1],
        }
    }

    pub(crate) fn note(&self) -> Note {
        Note {
            host_nanos: 5_900_000_000,
            text: "weiß auf schwarz".to_owned(),
        }
    }

    pub(crate) fn split(&self) -> Split {
        let numbers: Vec<u32> = self.numbers().map(|number| number as u32).collect();
        let (train, test) = numbers.split_at(numbers.len() / 2 + 1);
        Split {
            train: train.to_vec(),
            unused: Vec::new(),
            test: test.to_vec(),
        }
    }

    /// Begins the recording of this scene.
    pub(crate) fn begin(
        &self,
        layer: Box<dyn FileLayer>,
    ) -> Result<RecordingWriter, SequenceError> {
        let limits = DiskLimits {
            extent_bytes: 4096,
            floor_bytes: 0,
        };
        let path = Path::new("tiny.glint");
        RecordingWriter::on(layer, self.file_id, path, &self.description(), limits)
    }

    /// Writes all records and closes the file.
    pub(crate) fn write(&self, layer: Box<dyn FileLayer>) -> Result<(), SequenceError> {
        let mut writer = self.begin(layer)?;
        self.write_frames(&mut writer)?;
        writer.write_gravity(DEPTH_STREAM, &self.gravity())?;
        writer.write_histogram(0, &self.histogram())?;
        writer.write_note(&self.note())?;
        writer.write_split(&self.split())?;
        writer.finish("complete")?;
        Ok(())
    }

    /// Writes the frames and what belongs to them, and seals the chunks in between.
    pub(crate) fn write_frames(&self, writer: &mut RecordingWriter) -> Result<(), SequenceError> {
        let streams = self.description().streams;
        let mut depth_encoder = DepthStreamEncoder::new(&streams, self.codec)?;
        let mut color_encoder = ColorStreamEncoder::new(&streams)?;
        let set = writer.begin_poses("source", "glint vectors", DEPTH_STREAM)?;
        writer.write_event(&self.event())?;
        for number in self.numbers() {
            if number == MISSING + 1 {
                writer.write_gap(&self.gap(DEPTH_STREAM))?;
                writer.write_gap(&self.gap(COLOR_STREAM))?;
            }
            if number + 1 == self.end_number
                && let Some((kind, payload)) = &self.extra
            {
                let label = RecordLabel {
                    kind: *kind,
                    ..RecordLabel::default()
                };
                writer.write_copy(label, payload)?;
            }
            let (payload, table) = depth_encoder.encode(&self.depth(number))?;
            if let Some(table) = table {
                writer.write_table(DEPTH_STREAM, table)?;
            }
            writer.write_frame(DEPTH_STREAM, &self.times(DEPTH_STREAM, number), payload)?;
            let frame = self.color(number);
            let payload = color_encoder.encode(&frame)?;
            writer.write_frame(COLOR_STREAM, &self.times(COLOR_STREAM, number), payload)?;
            // The first of two poses of a frame does not count.
            let early = FramePose::ok(number, Pose::IDENTITY);
            writer.write_poses(set, &[early, self.pose(number)])?;
            if self.seal_after.contains(&number) {
                writer.seal()?;
            }
        }
        Ok(())
    }
}

/// Noise that is the same everywhere.
fn hash(seed: u32) -> u32 {
    let mixed = (seed ^ seed >> 16).wrapping_mul(0x45d9_f3b3);
    (mixed ^ mixed >> 15).wrapping_mul(0x2c1b_3c6d) >> 8
}
