//! The effects by name, what each needs, and sets of them.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// One factor, term or estimator step of the image model that can be left out.
///
/// Ids are typed in kebab-case (`first-bounce`), in switches and files alike. The order is that of the list
/// everywhere: what an effect needs stands before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effect {
    /// V: a mirrored ray that the object itself blocks does not see the room.
    Visibility,
    /// FBI, diffuse: where it is blocked, the surface it meets is seen instead.
    FirstBounce,
    /// That surface is shiny itself, and shows the room by a second mirroring.
    FirstBounceSpecular,
    /// F(α): reflectance rises towards grazing angles.
    Fresnel,
    /// vig(u): the lens darkens towards the corners.
    Vignetting,
    /// resp(y): the camera's curve from light to code.
    Response,
    /// sat(y): clipped pixels are lower bounds, not values.
    Saturation,
    /// Noise that depends on the level, as weight of a pixel (in the simulator: the noise itself).
    Noise,
    /// The camera's path is refined before anything is made from it.
    PoseRefinement,
}

/// What an effect needs besides itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Need {
    /// The gate: something on the object must be specular.
    Specular,
    /// Another effect.
    #[serde(untagged)]
    Effect(Effect),
}

impl Effect {
    /// All effects; what one needs stands before it.
    pub const ALL: [Self; 9] = [
        Self::Visibility,
        Self::FirstBounce,
        Self::FirstBounceSpecular,
        Self::Fresnel,
        Self::Vignetting,
        Self::Response,
        Self::Saturation,
        Self::Noise,
        Self::PoseRefinement,
    ];

    /// The id as typed.
    pub fn id(self) -> &'static str {
        match self {
            Self::Visibility => "visibility",
            Self::FirstBounce => "first-bounce",
            Self::FirstBounceSpecular => "first-bounce-specular",
            Self::Fresnel => "fresnel",
            Self::Vignetting => "vignetting",
            Self::Response => "response",
            Self::Saturation => "saturation",
            Self::Noise => "noise",
            Self::PoseRefinement => "pose-refinement",
        }
    }

    /// What must be on for this effect to mean anything.
    pub fn needs(self) -> Option<Need> {
        match self {
            Self::Visibility | Self::Fresnel => Some(Need::Specular),
            Self::FirstBounce => Some(Need::Effect(Self::Visibility)),
            Self::FirstBounceSpecular => Some(Need::Effect(Self::FirstBounce)),
            Self::Vignetting
            | Self::Response
            | Self::Saturation
            | Self::Noise
            | Self::PoseRefinement => None,
        }
    }

    /// The effect that this one stands on, if it stands on another.
    pub fn needed_effect(self) -> Option<Self> {
        match self.needs() {
            Some(Need::Effect(effect)) => Some(effect),
            Some(Need::Specular) | None => None,
        }
    }

    /// Whether the effect is off by implication where nothing is specular.
    pub fn is_specular(self) -> bool {
        match self.needs() {
            Some(Need::Specular) => true,
            Some(Need::Effect(effect)) => effect.is_specular(),
            None => false,
        }
    }

    fn bit(self) -> u32 {
        1 << self as u32
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.id())
    }
}

/// A name that is no effect.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` is no effect; the effects are {}", all_ids())]
pub struct UnknownEffect {
    /// What was written.
    pub name: String,
}

fn all_ids() -> String {
    Effect::ALL.map(Effect::id).join(", ")
}

impl FromStr for Effect {
    type Err = UnknownEffect;

    fn from_str(text: &str) -> Result<Self, UnknownEffect> {
        let known = Self::ALL.into_iter().find(|effect| effect.id() == text);
        known.ok_or_else(|| UnknownEffect {
            name: text.to_owned(),
        })
    }
}

/// Which effects are computed.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EffectSet(u32);

impl EffectSet {
    /// No effect.
    pub const NONE: Self = Self(0);

    /// Every effect.
    pub fn all() -> Self {
        Effect::ALL.into_iter().collect()
    }

    /// Whether `effect` is computed.
    pub fn contains(self, effect: Effect) -> bool {
        self.0 & effect.bit() != 0
    }

    /// The set with `effect`.
    #[must_use]
    pub fn with(self, effect: Effect) -> Self {
        Self(self.0 | effect.bit())
    }

    /// The set without `effect`.
    #[must_use]
    pub fn without(self, effect: Effect) -> Self {
        Self(self.0 & !effect.bit())
    }

    /// The set without effects whose need is not in it.
    #[must_use]
    pub fn closed(self) -> Self {
        // What an effect needs stands before it in the list: one pass is enough.
        Effect::ALL
            .into_iter()
            .fold(self, |set, effect| match effect.needed_effect() {
                Some(needed) if !set.contains(needed) => set.without(effect),
                Some(_) | None => set,
            })
    }

    /// The effects in order.
    pub fn iter(self) -> impl Iterator<Item = Effect> {
        Effect::ALL
            .into_iter()
            .filter(move |&effect| self.contains(effect))
    }
}

impl FromIterator<Effect> for EffectSet {
    fn from_iter<I: IntoIterator<Item = Effect>>(effects: I) -> Self {
        effects.into_iter().fold(Self::NONE, Self::with)
    }
}

impl fmt::Debug for EffectSet {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_set().entries(self.iter()).finish()
    }
}

/// Ids with commas, `none` when empty.
impl fmt::Display for EffectSet {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::NONE {
            return formatter.pad("none");
        }
        let ids: Vec<&str> = self.iter().map(Effect::id).collect();
        formatter.pad(&ids.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_survive_text_and_json() {
        for effect in Effect::ALL {
            assert_eq!(effect.id().parse(), Ok(effect));
            let json = serde_json::to_string(&effect).unwrap();
            assert_eq!(json, format!("\"{effect}\""));
            assert_eq!(serde_json::from_str::<Effect>(&json).unwrap(), effect);
        }
        assert!("fog".parse::<Effect>().is_err());
    }

    #[test]
    fn a_need_is_the_gate_or_an_effect_that_stands_before() {
        for (position, effect) in Effect::ALL.into_iter().enumerate() {
            if let Some(needed) = effect.needed_effect() {
                assert!(Effect::ALL[..position].contains(&needed));
            }
        }
        let json = serde_json::to_string(&Effect::Fresnel.needs()).unwrap();
        assert_eq!(json, "\"specular\"");
        let json = serde_json::to_string(&Effect::FirstBounce.needs()).unwrap();
        assert_eq!(json, "\"visibility\"");
        let need: Need = serde_json::from_str("\"first-bounce\"").unwrap();
        assert_eq!(need, Need::Effect(Effect::FirstBounce));
    }

    #[test]
    fn closing_a_set_drops_what_stands_on_nothing() {
        let all = EffectSet::all();
        assert_eq!(all.closed(), all);
        let blind = all.without(Effect::Visibility).closed();
        assert!(!blind.contains(Effect::FirstBounce));
        assert!(!blind.contains(Effect::FirstBounceSpecular));
        assert!(blind.contains(Effect::Fresnel));
        assert_eq!(EffectSet::NONE.to_string(), "none");
    }
}
