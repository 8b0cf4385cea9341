//! What is asked for: `--effects +a,-b,auto:c`.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::effect::{Effect, EffectSet, UnknownEffect};

/// How an effect is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Request {
    /// The rule decides.
    #[default]
    Auto,
    /// Computed, whatever the rule says.
    On,
    /// Not computed, whatever the rule says.
    Off,
}

/// A list of switches that cannot be followed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// No effect has this id.
    #[error(transparent)]
    Unknown(#[from] UnknownEffect),
    /// Not of the form of a switch.
    #[error(
        "`{item}` is no switch: write +id, -id, auto:id, all, none or auto, with commas between"
    )]
    Syntax {
        /// What was written.
        item: String,
    },
    /// An effect is asked for without what it needs.
    #[error("+{wanted},-{needed} is impossible: {wanted} needs {needed}")]
    Impossible {
        /// The effect that is asked for.
        wanted: Effect,
        /// The effect that it needs, and that is refused.
        needed: Effect,
    },
}

/// A request for every effect, free of contradictions.
///
/// As text: items with commas between, applied from left to right. `+id` on, `-id` off, `auto:id` the rule
/// decides, `all`, `none` and `auto` the same for every effect. Empty text leaves everything to the rule.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct EffectRequests {
    /// Those that are not left to the rule.
    decided: BTreeMap<Effect, bool>,
}

impl EffectRequests {
    /// How `effect` is asked for.
    pub fn of(&self, effect: Effect) -> Request {
        match self.decided.get(&effect) {
            Some(true) => Request::On,
            Some(false) => Request::Off,
            None => Request::Auto,
        }
    }

    /// The effects that are computed where the rule would compute `automatic`: those asked for with what they
    /// need, none that is refused, none whose need is missing.
    pub fn resolve(&self, automatic: EffectSet) -> EffectSet {
        // From the last: an effect that is asked for asks for what stands before it.
        let mut set = automatic;
        for effect in Effect::ALL.into_iter().rev() {
            match self.of(effect) {
                Request::On => {
                    set = set.with(effect);
                    let mut needed = effect.needed_effect();
                    while let Some(below) = needed {
                        set = set.with(below);
                        needed = below.needed_effect();
                    }
                }
                Request::Off => set = set.without(effect),
                Request::Auto => {}
            }
        }
        set.closed()
    }

    /// Whether nothing is left to the rule.
    pub fn is_decided(&self) -> bool {
        self.decided.len() == Effect::ALL.len()
    }

    /// Effects that another one asks for: on although left to the rule.
    pub fn is_implied(&self, effect: Effect) -> bool {
        self.of(effect) == Request::Auto && self.resolve(EffectSet::NONE).contains(effect)
    }

    fn apply(&mut self, item: &str) -> Result<(), RequestError> {
        match item {
            "all" | "none" => {
                let is_on = item == "all";
                self.decided = Effect::ALL.into_iter().map(|e| (e, is_on)).collect();
            }
            "auto" => self.decided.clear(),
            _ => {
                if let Some(id) = item.strip_prefix('+') {
                    self.decided.insert(id.parse()?, true);
                } else if let Some(id) = item.strip_prefix('-') {
                    self.decided.insert(id.parse()?, false);
                } else if let Some(id) = item.strip_prefix("auto:") {
                    self.decided.remove(&id.parse()?);
                } else {
                    return Err(RequestError::Syntax {
                        item: item.to_owned(),
                    });
                }
            }
        }
        Ok(())
    }

    /// Refuses an effect that is asked for while what it needs is refused.
    fn checked(self) -> Result<Self, RequestError> {
        for (&wanted, &is_on) in &self.decided {
            let mut needed = wanted.needed_effect().filter(|_| is_on);
            while let Some(below) = needed {
                if self.of(below) == Request::Off {
                    return Err(RequestError::Impossible {
                        wanted,
                        needed: below,
                    });
                }
                needed = below.needed_effect();
            }
        }
        Ok(self)
    }
}

impl FromStr for EffectRequests {
    type Err = RequestError;

    fn from_str(text: &str) -> Result<Self, RequestError> {
        let mut requests = Self::default();
        for item in text.split(',').map(str::trim) {
            if !(item.is_empty() && text.trim().is_empty()) {
                requests.apply(item)?;
            }
        }
        requests.checked()
    }
}

impl fmt::Display for EffectRequests {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let items: Vec<String> = self
            .decided
            .iter()
            .map(|(effect, &is_on)| format!("{}{effect}", if is_on { '+' } else { '-' }))
            .collect();
        formatter.write_str(&items.join(","))
    }
}

impl From<EffectRequests> for String {
    fn from(requests: EffectRequests) -> Self {
        requests.to_string()
    }
}

impl TryFrom<String> for EffectRequests {
    type Error = RequestError;

    fn try_from(text: String) -> Result<Self, RequestError> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> EffectRequests {
        text.parse().unwrap()
    }

    #[test]
    fn the_last_word_on_an_effect_counts() {
        let requests = parse("all, -fresnel,auto:noise");
        assert_eq!(requests.of(Effect::Fresnel), Request::Off);
        assert_eq!(requests.of(Effect::Noise), Request::Auto);
        assert_eq!(requests.of(Effect::Visibility), Request::On);
        assert_eq!(parse("none,auto"), EffectRequests::default());
        assert_eq!(parse(""), EffectRequests::default());
    }

    #[test]
    fn an_impossible_request_names_both() {
        let error = "+first-bounce,-visibility".parse::<EffectRequests>();
        let error = error.unwrap_err().to_string();
        assert!(error.contains("first-bounce") && error.contains("visibility"));
        let through_two = "+first-bounce-specular,-visibility".parse::<EffectRequests>();
        assert_eq!(
            through_two.unwrap_err(),
            RequestError::Impossible {
                wanted: Effect::FirstBounceSpecular,
                needed: Effect::Visibility,
            }
        );
    }

    #[test]
    fn what_is_no_switch_is_refused() {
        for text in ["fresnel", "+fog", "+fresnel,", "++fresnel", "auto:", "ALL"] {
            assert!(text.parse::<EffectRequests>().is_err(), "{text}");
        }
    }

    #[test]
    fn an_effect_brings_what_it_needs_and_takes_what_needs_it() {
        let bounce = parse("+first-bounce-specular").resolve(EffectSet::NONE);
        assert_eq!(
            bounce.to_string(),
            "visibility,first-bounce,first-bounce-specular"
        );
        assert!(parse("+first-bounce").is_implied(Effect::Visibility));
        let blind = parse("-visibility").resolve(EffectSet::all());
        assert!(!blind.contains(Effect::FirstBounce));
        assert_eq!(parse("none").resolve(EffectSet::all()), EffectSet::NONE);
        assert_eq!(parse("all").resolve(EffectSet::NONE), EffectSet::all());
    }

    #[test]
    fn requests_survive_text_and_json() {
        for text in [
            "",
            "all",
            "none",
            "+fresnel,-noise",
            "none,+fresnel,auto:noise",
        ] {
            let requests = parse(text);
            assert_eq!(parse(&requests.to_string()), requests);
            let json = serde_json::to_string(&requests).unwrap();
            assert_eq!(
                serde_json::from_str::<EffectRequests>(&json).unwrap(),
                requests
            );
        }
        assert!(serde_json::from_str::<EffectRequests>("\"+fog\"").is_err());
    }
}
