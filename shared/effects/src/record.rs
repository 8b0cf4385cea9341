//! `effects.json`: what was asked, measured and decided.

use serde::{Deserialize, Serialize};

use crate::effect::{Effect, EffectSet, Need};
use crate::request::Request;
use crate::survey::SurveyNumbers;
use crate::verdict::{DecidedBy, ProbeFigures, Verdict};

/// Version that this program writes and reads.
pub const FILE_VERSION: u32 = 1;

/// All of `effects.json`; unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectsFile {
    /// [`FILE_VERSION`].
    pub version: u32,
    /// What the survey measured.
    pub survey: SurveyNumbers,
    /// One record for each effect, in the order of [`Effect::ALL`].
    pub effects: Vec<EffectRecord>,
    /// Pairs that were judged together.
    pub interactions: Vec<[Effect; 2]>,
    /// Sentences for people: contradictions found by the audit, forced effects against their verdict.
    pub warnings: Vec<String>,
}

/// One effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectRecord {
    /// The effect.
    pub id: Effect,
    /// How it was asked for.
    pub requested: Request,
    /// Whether it is computed.
    pub verdict: Verdict,
    /// Who decided.
    pub by: DecidedBy,
    /// What it needs.
    pub needs: Vec<Need>,
    /// The most that it can change; absent where there is no such number.
    pub bound_codes: Option<f64>,
    /// Bound up to which it is off.
    pub off_below_codes: Option<f64>,
    /// The comparison, where one was made.
    pub probe: Option<ProbeFigures>,
    /// What it costs.
    pub cost: EffectCost,
    /// Verdict of the run before in this folder.
    pub previous: Option<Verdict>,
    /// Reason in words.
    pub note: String,
}

/// Cost of an effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectCost {
    /// Predicted before, core-seconds.
    pub predicted_s: f64,
    /// Measured, core-seconds; absent where it was not computed or not measured apart.
    pub measured_s: Option<f64>,
    /// Always core-seconds.
    pub unit: CostUnit,
    /// Predicted, core-milliseconds a frame.
    pub per_frame_ms: f64,
}

/// Unit of a cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CostUnit {
    /// Sum over threads of the time they computed.
    #[default]
    CoreSeconds,
}

impl EffectCost {
    /// A predicted cost over `frame_count` frames.
    pub fn predicted(seconds: f64, frame_count: usize) -> Self {
        Self {
            predicted_s: seconds,
            per_frame_ms: 1e3 * seconds / frame_count.max(1) as f64,
            ..Self::default()
        }
    }
}

impl EffectRecord {
    /// A record without numbers.
    pub fn new(id: Effect, verdict: Verdict, by: DecidedBy) -> Self {
        Self {
            id,
            requested: Request::Auto,
            verdict,
            by,
            needs: id.needs().into_iter().collect(),
            bound_codes: None,
            off_below_codes: None,
            probe: None,
            cost: EffectCost::default(),
            previous: None,
            note: String::new(),
        }
    }
}

impl EffectsFile {
    /// The effects that are computed.
    pub fn computed(&self) -> EffectSet {
        let on = self.effects.iter().filter(|r| r.verdict == Verdict::On);
        on.map(|record| record.id).collect()
    }

    /// The record of an effect.
    pub fn of(&self, effect: Effect) -> Option<&EffectRecord> {
        self.effects.iter().find(|record| record.id == effect)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// Unknown keys or ids, another version, an effect named twice.
    pub fn from_json(text: &str) -> Result<Self, EffectsFileError> {
        let file: Self = serde_json::from_str(text).map_err(EffectsFileError::Json)?;
        if file.version != FILE_VERSION {
            return Err(EffectsFileError::Version {
                found: file.version,
            });
        }
        for (position, record) in file.effects.iter().enumerate() {
            if file.effects[..position].iter().any(|r| r.id == record.id) {
                return Err(EffectsFileError::Twice { effect: record.id });
            }
        }
        Ok(file)
    }
}

/// Why a file of effects cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EffectsFileError {
    /// Not of the form.
    #[error("effects.json is not of the known form: {0}")]
    Json(serde_json::Error),
    /// Of another version.
    #[error("effects.json is of version {found}, this program reads {FILE_VERSION}")]
    Version {
        /// Version of the file.
        found: u32,
    },
    /// An effect has two records.
    #[error("effects.json names {effect} twice")]
    Twice {
        /// The effect.
        effect: Effect,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> EffectsFile {
        let mut record = EffectRecord::new(Effect::FirstBounce, Verdict::On, DecidedBy::Probe);
        record.probe = Some(ProbeFigures {
            l1_off: 7.91,
            l1_on: 6.02,
            delta: 1.89,
            ci: Some([1.2, 2.6]),
            blocks: 10,
            seeds: 1,
            on_above: 0.1,
        });
        EffectsFile {
            version: FILE_VERSION,
            survey: SurveyNumbers::default(),
            effects: vec![record],
            interactions: vec![[Effect::Visibility, Effect::FirstBounce]],
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_file_survives_writing_and_reading() {
        let text = serde_json::to_string(&file()).unwrap();
        assert_eq!(EffectsFile::from_json(&text).unwrap(), file());
        assert!(text.contains(r#""unit":"core-seconds""#));
        assert!(text.contains(r#""needs":["visibility"]"#));
    }

    #[test]
    fn what_is_not_known_is_refused() {
        let text = serde_json::to_string(&file()).unwrap();
        for (from, to) in [
            (r#""version":1"#, r#""version":2"#),
            (r#""warnings":[]"#, r#""warnings":[],"extra":1"#),
            (r#""delta_px":0.0"#, r#""delta_px":0.0,"delta":1"#),
            (r#""id":"first-bounce""#, r#""id":"fog""#),
            (r#""delta":1.89"#, r#""delta":1.89,"gain":1"#),
        ] {
            let changed = text.replace(from, to);
            assert_ne!(changed, text);
            assert!(EffectsFile::from_json(&changed).is_err(), "{to}");
        }
        let mut twice = file();
        twice.effects.push(twice.effects[0].clone());
        let text = serde_json::to_string(&twice).unwrap();
        assert!(matches!(
            EffectsFile::from_json(&text),
            Err(EffectsFileError::Twice { .. })
        ));
    }
}
