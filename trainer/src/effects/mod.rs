//! Which effects a recording calls for: a survey of few small frames, bounds, probes, verdicts.
//!
//! [`views`] what the survey sees · [`texture`] what it shows from all sides · [`shifts`] how far views are off ·
//! [`noise`] of the photographs · [`bounds`] what each effect can change at most · [`trial`] a small solve with or
//! without an effect · [`fresnel`] how reflectance rises · [`evidence`] what that says of each
//! effect · [`decide`] the verdicts and their file.
//!
//! Everything here reads training frames only, and gives the same bits for any number of threads.

mod bounds;
mod decide;
mod evidence;
mod fresnel;
mod noise;
mod shifts;
mod texture;
mod trial;
mod views;

use std::collections::BTreeMap;

use effects::{Effect, EffectSet};

pub use self::decide::{Decided, EFFECTS_FILE, Request, decide, previous_file};
pub use self::fresnel::FresnelFit;
pub use self::noise::{NoiseCurve, NoiseSample};
pub use self::views::{ObjectPixels, object_pixels};

/// What the stages compute, and the parameters that the survey found for it.
#[derive(Clone, Debug)]
pub struct EffectPlan {
    /// The effects that are computed.
    pub computed: EffectSet,
    /// Whether anything may be specular.
    pub is_specular: bool,
    /// Noise by level.
    pub noise: NoiseCurve,
    /// Rise of the reflectance of every segment that has one.
    pub fresnel: BTreeMap<u16, FresnelFit>,
    /// What segments reflect of their first bounces over the common gain, as the survey found it.
    pub bounce_gains: BTreeMap<u16, f32>,
}

impl EffectPlan {
    /// The effects of a set with nothing measured: noise of a good camera, reflectance that does not rise.
    pub fn unmeasured(computed: EffectSet) -> Self {
        Self {
            computed,
            is_specular: true,
            noise: NoiseCurve::of(Vec::new()),
            fresnel: BTreeMap::new(),
            bounce_gains: BTreeMap::new(),
        }
    }

    /// What a segment reflects of its first bounces over the common gain. Blur and unsure normals draw what the survey
    /// finds towards 0, so that only more than 1 is believed.
    pub fn bounce_gain(&self, segment: u16) -> f32 {
        let found = self.bounce_gains.get(&segment);
        found.map_or(1.0, |gain| gain.max(1.0))
    }

    /// The rise of a segment's reflectance; `None` where it is not computed.
    pub fn fresnel_of(&self, segment: u16) -> Option<&FresnelFit> {
        if self.computed.contains(Effect::Fresnel) {
            self.fresnel.get(&segment)
        } else {
            None
        }
    }
}
