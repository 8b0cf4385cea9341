//! A small recording for the tests of this crate.

use geometry::{DVec3, Distortion, Intrinsics, Pose};
use imaging::{Image, Rgb8Image, encode_jpeg, encode_png_gray16};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::{
    ColorCamera, ColorCodec, DepthCamera, PoseSet, ResponseCurve, Split, Streams, VignettingCurve,
};

pub(crate) const FRAME_COUNT: u32 = 3;
const DEPTH_SIZE: (u32, u32) = (12, 9);
const COLOR_SIZE: (u32, u32) = (16, 8);

/// What goes into the recording.
pub(crate) struct Small {
    pub(crate) streams: Streams,
    pub(crate) times_nanos: Vec<i64>,
    pub(crate) depth: Vec<Image<u16>>,
    pub(crate) depth_png: Vec<Vec<u8>>,
    pub(crate) color_jpeg: Vec<Vec<u8>>,
    pub(crate) pose_sets: Vec<PoseSet>,
    pub(crate) split: Split,
}

pub(crate) fn streams() -> Streams {
    let distortion = Distortion {
        k1: 0.1,
        k2: -0.3 / 7.0,
        p1: 1e-3,
        p2: -1.0 / 3.0e3,
        k3: 0.01,
    };
    let (w, h) = DEPTH_SIZE;
    let depth = Intrinsics::pinhole(w, h, 11.0 + 1.0 / 3.0, 11.5, 5.5, 4.0 + 0.1).unwrap();
    let (w, h) = COLOR_SIZE;
    let color = Intrinsics::new(w, h, 15.1, 15.2, 7.5, 3.5, distortion).unwrap();
    let falloff = VignettingCurve::EvenPolynomial {
        center: [7.5, 3.5],
        radius: 9.0,
        a: [-0.3, 0.1, -1.0 / 30.0],
    };
    let gamma = ResponseCurve::Gamma { gamma: 2.2 };
    Streams {
        depth: DepthCamera::new(depth, 0.001, 0.3..=9.5).unwrap(),
        color: ColorCamera::new(color, ColorCodec::Jpeg, 0.7, gamma, falloff).unwrap(),
        color_from_depth: Pose::from_translation(DVec3::new(-0.0244, 0.008, 0.0))
            * Pose::from_axis_angle(DVec3::new(1.0, 2.0, 3.0), 0.01),
    }
}

impl Small {
    pub(crate) fn new() -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let depth: Vec<Image<u16>> = (0..FRAME_COUNT)
            .map(|_| {
                Image::from_fn(DEPTH_SIZE.0, DEPTH_SIZE.1, |x, _| match x {
                    0 => 0,
                    1 => u16::MAX,
                    _ => random.random_range(400..4000),
                })
            })
            .collect();
        let color: Vec<Rgb8Image> = (0..FRAME_COUNT)
            .map(|_| Image::from_fn(COLOR_SIZE.0, COLOR_SIZE.1, |_, _| random.random()))
            .collect();
        let pose = |k: u32| {
            Pose::from_translation(DVec3::new(0.1 * f64::from(k), 1.0 / 3.0, -2.0))
                * Pose::from_axis_angle(DVec3::Y, 0.3 * f64::from(k))
        };
        let source = (0..FRAME_COUNT).map(|k| Some(pose(k))).collect();
        let live = (0..FRAME_COUNT)
            .map(|k| (k != 1).then(|| pose(k + 5)))
            .collect();
        let named = |name: &str, world_from_depth| PoseSet {
            name: name.to_owned(),
            world_from_depth,
        };
        Self {
            streams: streams(),
            times_nanos: vec![-33_333_333, 0, 33_333_334],
            depth_png: depth
                .iter()
                .map(|codes| encode_png_gray16(codes).unwrap())
                .collect(),
            color_jpeg: color
                .iter()
                .map(|codes| encode_jpeg(codes, 90).unwrap())
                .collect(),
            depth,
            pose_sets: vec![named("source", source), named("live", live)],
            split: Split {
                train: vec![0],
                unused: vec![1],
                test: vec![2],
            },
        }
    }

    pub(crate) fn write(&self, path: &std::path::Path) -> Result<u64, sequence::SequenceError> {
        let mut writer = sequence::RecordingWriter::create(path, self.streams.clone())?;
        for (k, &time) in self.times_nanos.iter().enumerate() {
            writer.write_frame(time, &self.depth_png[k], &self.color_jpeg[k])?;
        }
        writer.finish(&self.pose_sets, &self.split)
    }
}
