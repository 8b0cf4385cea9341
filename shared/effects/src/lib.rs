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
//! Map: [`effect`] the effects and sets of them · [`request`] switches as typed.

pub mod effect;
pub mod request;

pub use effect::{Effect, EffectSet, Need, UnknownEffect};
pub use request::{EffectRequests, Request, RequestError};
