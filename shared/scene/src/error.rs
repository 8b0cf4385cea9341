//! What a simulation refuses.

/// Something that cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// There is no scene of that name.
    #[error("there is no scene {name:?}; there are {known}")]
    UnknownScene {
        /// What was asked for.
        name: String,
        /// All names, in order.
        known: String,
    },
    /// A number outside its range.
    #[error("{name} is {value}; it has to be {expected}")]
    Value {
        /// What it is.
        name: &'static str,
        /// What it was.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// An environment that is no 2:1 panorama.
    #[error(
        "the environment has {width} x {height} texels; a panorama is twice as wide as high, up to 8192 rows"
    )]
    NoPanorama {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// An environment with light that is none.
    #[error("the environment's texel ({x}, {y}) is {value}; radiance is a number from 0 to 1e6")]
    Radiance {
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// What stands there.
        value: f32,
    },
    /// The mesh cannot be traced.
    #[error(transparent)]
    Mesh(#[from] raytrace::RaytraceError),
    /// A camera or lens that is none.
    #[error(transparent)]
    Imaging(#[from] imaging::ImagingError),
}
