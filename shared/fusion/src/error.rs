//! Why a fusion call refuses its input.

/// Errors of this crate. Every variant carries what was given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FusionError {
    /// The voxel edge is not a usable length.
    #[error("a voxel size of {voxel_size} m is outside 0.0002 to 1 m")]
    VoxelSize {
        /// Metres given.
        voxel_size: f32,
    },
    /// The truncation is below [`crate::volume::MIN_TRUNCATION_VOXELS`]: surfaces would have holes (D06).
    #[error(
        "a truncation of {truncation_voxels} voxels leaves holes; at least 4 and at most 64 are needed"
    )]
    Truncation {
        /// Voxels given.
        truncation_voxels: f32,
    },
    /// A weight setting that the running average cannot work with.
    #[error(
        "a weight cap of {weight_cap} with a reference depth of {reference_depth} m is not usable; the cap \
         must lie above 0 and up to 1000000, the depth from 0.001 to 1000 m"
    )]
    Weight {
        /// Cap given.
        weight_cap: f32,
        /// Reference depth given, metres.
        reference_depth: f32,
    },
    /// The depth step is not a length.
    #[error("a depth step of {depth_step} m at 1 m is outside 0 to 1 m")]
    DepthStep {
        /// Metres given.
        depth_step: f32,
    },
    /// The depth gate is empty, not a number, or reaches beyond 1000 m.
    #[error("the depth gate {min_depth}..{max_depth} m is empty, not a number, or beyond 1000 m")]
    DepthGate {
        /// Metres given.
        min_depth: f32,
        /// Metres given.
        max_depth: f32,
    },
    /// The volume origin is not finite.
    #[error("the volume origin is not finite")]
    Origin,
    /// The depth image does not have one value per pixel of its camera.
    #[error("a depth image of {width} x {height} pixels needs {expected} values, got {got}")]
    DepthSize {
        /// Columns of the camera.
        width: u32,
        /// Rows of the camera.
        height: u32,
        /// `width · height`.
        expected: usize,
        /// Values given.
        got: usize,
    },
    /// The colour image does not have one pixel per pixel of the depth camera.
    #[error("a colour image of {width} x {height} pixels needs {expected} values, got {got}")]
    ColorSize {
        /// Columns of the depth camera.
        width: u32,
        /// Rows of the depth camera.
        height: u32,
        /// `width · height`.
        expected: usize,
        /// Values given.
        got: usize,
    },
}

/// Errors of live tracking and fusion.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// A setting or image that the volume refuses.
    #[error(transparent)]
    Fusion(#[from] FusionError),
    /// Cameras or images that cannot be registered.
    #[error(transparent)]
    Imaging(#[from] imaging::ImagingError),
}
