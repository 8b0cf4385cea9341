//! Which effects of the image model a scene calls for: numbers in, verdicts out.
//!
//! For: naming the effects, parsing switches, and deciding from survey numbers, bounds and held-out probes what
//! is computed and what is not. Not for: images, rays or solvers; how an effect is implemented.
//!
//! ```
//! use effects::{Effect, EffectRequests, EffectSet};
//! let requests: EffectRequests = "-noise,+fresnel".parse().unwrap();
//! let computed = requests.resolve(EffectSet::all());
//! assert!(computed.contains(Effect::Fresnel));
//! assert!(!computed.contains(Effect::Noise));
//! assert!("+first-bounce,-visibility".parse::<EffectRequests>().is_err());
//! ```
//!
//! Map: [`effect`] the effects and sets of them · [`request`] switches as typed · [`survey`] the shared numbers ·
//! [`gate`] whether anything is specular · [`probe`] blocks and intervals · [`verdict`] the rule for one effect ·
//! [`selection`] the rule over several, budget and audit · [`record`] `effects.json` · [`explain`] a line in words ·
//! [`counters`] of work done.
//!
//! Invariants: the same numbers give the same verdict; an effect never stands on one that is off; a number that is
//! not finite never switches the specular group off.

pub mod counters;
pub mod effect;
pub mod explain;
pub mod gate;
pub mod probe;
pub mod record;
pub mod request;
pub mod selection;
pub mod survey;
pub mod verdict;

#[cfg(test)]
mod random;

pub use counters::Counters;
pub use effect::{Effect, EffectSet, Need, UnknownEffect};
pub use gate::{Gate, ViewDependence, ViewResidual};
pub use probe::{BlockPlan, Interval};
pub use record::{EffectCost, EffectRecord, EffectsFile, EffectsFileError};
pub use request::{EffectRequests, Request, RequestError};
pub use selection::{Candidate, Judged, Selection};
pub use survey::SurveyNumbers;
pub use verdict::{Comparison, DecidedBy, Decision, ErrorPair, Habit, ProbeFigures, Rule, Verdict};
