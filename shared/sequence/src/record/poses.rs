//! Where the camera was.

use geometry::Pose;
use serde::{Deserialize, Serialize};
use zerocopy::FromBytes as _;
use zerocopy::byteorder::little_endian::{F32, F64};

use crate::description::pose_from_numbers;
use crate::error::SequenceError;
use crate::layout::{PoseBytes, PosesHeader};

/// Whether tracking knew where the camera was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseState {
    /// All axes observed.
    #[default]
    Ok,
    /// Some axes kept their prediction: bits 0 to 2 rotation about x, y, z, bits 3 to 5 translation.
    Weak(u8),
    /// The pose is the last that was known.
    Lost,
}

/// A pose of one frame in a set (section 6.7).
#[derive(Clone, Debug, PartialEq)]
pub struct FramePose {
    /// Number of the frame in the set's stream.
    pub number: u64,
    /// World that the pose is in.
    pub map: u32,
    /// How far it can be trusted.
    pub state: PoseState,
    /// World from camera, metres.
    pub world_from_camera: Pose,
    /// Upper triangle by rows, of rotation (radians) and translation (metres) in camera axes.
    pub covariance: Option<[f32; 21]>,
}

impl FramePose {
    /// A pose that is known well, in map 0.
    pub fn ok(number: u64, world_from_camera: Pose) -> Self {
        Self {
            number,
            map: 0,
            state: PoseState::Ok,
            world_from_camera,
            covariance: None,
        }
    }

    /// The bytes of an entry of a poses record (section 6.7).
    pub fn bytes(&self) -> PoseBytes {
        let (state, weak_axes) = match self.state {
            PoseState::Ok => (1, 0),
            PoseState::Weak(axes) => (2, axes),
            PoseState::Lost => (3, 0),
        };
        let pose = &self.world_from_camera;
        PoseBytes {
            number: self.number.into(),
            map: self.map.into(),
            state,
            weak_axes,
            flags: u16::from(self.covariance.is_some()).into(),
            rotation: pose.rotation().to_array().map(Into::into),
            translation: pose.translation().to_array().map(Into::into),
            covariance: self.covariance.unwrap_or([0.0; 21]).map(Into::into),
            reserved: [0; 4],
        }
    }

    fn read(bytes: &PoseBytes, set: &str) -> Result<Self, SequenceError> {
        let number = bytes.number.get();
        let state = match bytes.state {
            1 => PoseState::Ok,
            2 => PoseState::Weak(bytes.weak_axes),
            3 => PoseState::Lost,
            other => {
                return Err(SequenceError::Value {
                    name: "the state of a stored pose",
                    value: f64::from(other),
                    expected: "1, 2 or 3",
                });
            }
        };
        let rotation = bytes.rotation.map(F64::get);
        let translation = bytes.translation.map(F64::get);
        let world_from_camera =
            pose_from_numbers(rotation, translation).map_err(|source| SequenceError::Pose {
                set: set.to_owned(),
                number,
                source,
            })?;
        Ok(Self {
            number,
            map: bytes.map.get(),
            state,
            world_from_camera,
            covariance: (bytes.flags.get() & 1 != 0).then(|| bytes.covariance.map(F32::get)),
        })
    }
}

/// Head of a pose set (section 6.6), as JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoseSetHead {
    /// Unique in the file.
    pub id: u16,
    /// `source`, `live`, `refined` …
    pub name: String,
    /// Program that made it.
    pub producer: String,
    /// Stream whose camera the poses are of.
    pub stream: u16,
}

/// Beginning of the payload of a poses record.
pub(crate) fn poses_header(set: u16) -> PosesHeader {
    PosesHeader {
        set: set.into(),
        reserved: [0; 6],
    }
}

/// Set and poses of a record; `set_name` names a set in errors.
pub(crate) fn read_poses(
    payload: &[u8],
    set_name: &dyn Fn(u16) -> String,
) -> Result<(u16, Vec<FramePose>), SequenceError> {
    let unfit = || SequenceError::Payload {
        what: "a record of poses",
    };
    let (head, entries) = PosesHeader::ref_from_prefix(payload).map_err(|_| unfit())?;
    let entries = <[PoseBytes]>::ref_from_bytes(entries).map_err(|_| unfit())?;
    let set = head.set.get();
    let name = set_name(set);
    let poses = entries
        .iter()
        .map(|entry| FramePose::read(entry, &name))
        .collect::<Result<_, _>>()?;
    Ok((set, poses))
}
