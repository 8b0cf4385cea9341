//! One line for people about each effect.

use crate::record::EffectRecord;
use crate::verdict::{DecidedBy, Verdict};

/// Verdict, bound, threshold, interval, cost and reason of an effect, one line.
pub fn line(record: &EffectRecord) -> String {
    let verdict = match record.verdict {
        Verdict::On => "on",
        Verdict::Off => "off",
    };
    let mut text = format!("{:<22} {verdict:<4} {}", record.id.id(), reason(record));
    if record.cost.predicted_s > 0.0 {
        text.push_str(&format!(
            "; costs {:.1} core-seconds",
            record.cost.predicted_s
        ));
    }
    text
}

/// Why, in words.
fn reason(record: &EffectRecord) -> String {
    if !record.note.is_empty() {
        return format!("{}: {}", words(record.by), record.note);
    }
    let bound = match (record.bound_codes, record.off_below_codes) {
        (Some(bound), Some(limit)) if bound <= limit => {
            format!("at most {bound:.2} codes, below {limit:.2}")
        }
        (Some(bound), Some(_)) => format!("at most {bound:.2} codes"),
        (Some(_) | None, None) | (None, Some(_)) => String::new(),
    };
    let probe = record.probe.as_ref().map(|probe| match probe.ci {
        Some([low, high]) => format!(
            "gains {:.2} codes ({low:.2} to {high:.2}, {} held-out blocks), threshold {:.2}",
            probe.delta, probe.blocks, probe.on_above
        ),
        None => format!(
            "gains {:.2} codes without an interval, threshold {:.2}; the recording is too short for a probe",
            probe.delta, probe.on_above
        ),
    });
    let parts: Vec<String> = [Some(bound), probe]
        .into_iter()
        .flatten()
        .filter(|part| !part.is_empty())
        .collect();
    if parts.is_empty() {
        words(record.by).to_owned()
    } else {
        format!("{}: {}", words(record.by), parts.join("; "))
    }
}

/// Who decided, in words.
fn words(by: DecidedBy) -> &'static str {
    match by {
        DecidedBy::Gate => "nothing specular",
        DecidedBy::Need => "what it needs is off",
        DecidedBy::Bound => "by bound",
        DecidedBy::Probe => "by probe",
        DecidedBy::Survey => "by survey",
        DecidedBy::Previous => "undecided, as before",
        DecidedBy::Profile => "undecided, by profile",
        DecidedBy::Budget => "beyond the budget",
        DecidedBy::Forced => "as asked",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effect;
    use crate::record::EffectCost;
    use crate::verdict::ProbeFigures;

    #[test]
    fn the_line_says_numbers_and_reason() {
        let mut record = EffectRecord::new(Effect::Fresnel, Verdict::Off, DecidedBy::Bound);
        record.bound_codes = Some(0.04);
        record.off_below_codes = Some(0.26);
        let text = line(&record);
        assert!(
            text.contains("off") && text.contains("at most 0.04 codes, below 0.26"),
            "{text}"
        );

        let mut record = EffectRecord::new(Effect::FirstBounce, Verdict::On, DecidedBy::Probe);
        record.bound_codes = Some(4.8);
        record.off_below_codes = Some(0.26);
        record.cost = EffectCost::predicted(14.0, 100);
        record.probe = Some(ProbeFigures {
            l1_off: 7.9,
            l1_on: 6.0,
            delta: 1.9,
            ci: Some([1.2, 2.6]),
            blocks: 10,
            seeds: 1,
            on_above: 0.1,
        });
        let text = line(&record);
        for part in [
            "on",
            "4.80",
            "1.90",
            "1.20 to 2.60",
            "10 held-out blocks",
            "14.0 core-seconds",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        record.probe = record.probe.map(|probe| ProbeFigures { ci: None, ..probe });
        record.by = DecidedBy::Survey;
        assert!(line(&record).contains("too short"));
    }
}
