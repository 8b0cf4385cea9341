//! `glint eval`: the map against a known room, the model against photographs it never saw, the camera path and
//! the shape against references.

pub mod environment;
pub mod mesh;
pub mod model;
pub mod trajectory;
pub mod views;

use serde::{Deserialize, Serialize};

/// Everything `glint eval` measures, `metrics.json`. Absent values were not measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Metrics {
    /// The environment against the truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<environment::EnvironmentMetrics>,
    /// Held-out photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub composition: Option<views::CompositionMetrics>,
    /// The camera path against a reference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trajectory: Option<trajectory::TrajectoryMetrics>,
    /// The mesh against a reference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<mesh::MeshMetrics>,
    /// Cost of the evaluation.
    pub cost: crate::clock::Cost,
}
