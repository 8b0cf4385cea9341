//! `glint eval`: the map against a known room, and the model against photographs it never saw.

pub mod composition;
pub mod environment;
pub mod model;

use serde::{Deserialize, Serialize};

/// Everything `glint eval` measures, `metrics.json`. Absent values were not measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Metrics {
    /// The environment against the truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<environment::EnvironmentMetrics>,
    /// Held-out photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub composition: Option<composition::CompositionMetrics>,
    /// Cost of the evaluation.
    pub cost: crate::clock::Cost,
}
