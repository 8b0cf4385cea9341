//! The finest bar that a map resolves (effects-and-tradeoffs.md C1): phase-locked, because bars finer than a texel
//! alias to coarser ones that a measure of contrast would accept.

mod file;
mod fit;
#[cfg(test)]
mod tests;

use std::fmt;
use std::path::Path;

use anyhow::Context as _;
use geometry::PanoramaSize;
use serde::{Deserialize, Serialize};

pub use file::BarKind;
pub(super) use fit::MapView;

use file::{BarFile, BarGroup};

/// The file in the folder of a truth.
const BARS_FILE: &str = "bars.json";
/// Least modulation of a resolved group.
const LEAST_MTF: f64 = 0.2;
/// A resolved group's coefficient stands out of the null by so many deviations.
const LEAST_DEVIATIONS: f64 = 3.0;
/// Least share of a group that the map claims.
const LEAST_COVERAGE: f64 = 0.9;

/// One group of five bars as the map shows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BarScore {
    /// Number of its site.
    pub site: u32,
    /// How its bars follow each other.
    pub kind: BarKind,
    /// Width of a bar, degrees.
    pub width_deg: f64,
    /// Modulation, 1 = as in the room, negative = bright and dark exchanged; absent where the map claims too little
    /// of the group.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mtf: Option<f64>,
    /// Modulation that the plain panel of the site shows by chance, root mean square.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub null_mtf: Option<f64>,
    /// Share of the group that the map claims.
    pub coverage: f64,
    /// Modulation of at least 0.2 and three times the null's, right sign, coverage of at least 0.9.
    pub is_resolved: bool,
}

/// A resolved width, degrees. Beyond the widths there are it is a word.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "serde_json::Value", try_from = "serde_json::Value")]
pub enum BarWidth {
    /// The finest that is resolved.
    Width(f64),
    /// Not even the widest, which this is.
    WiderThan(f64),
    /// Even the finest, which this is.
    AtMost(f64),
}

impl fmt::Display for BarWidth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Width(width) => write!(f, "{width}"),
            Self::WiderThan(width) => write!(f, ">{width}"),
            Self::AtMost(width) => write!(f, "≤{width}"),
        }
    }
}

impl From<BarWidth> for serde_json::Value {
    fn from(width: BarWidth) -> Self {
        match width {
            BarWidth::Width(width) => width.into(),
            censored => censored.to_string().into(),
        }
    }
}

impl TryFrom<serde_json::Value> for BarWidth {
    type Error = String;

    fn try_from(value: serde_json::Value) -> Result<Self, String> {
        if let Some(width) = value.as_f64() {
            return Ok(Self::Width(width));
        }
        let words = value.as_str().unwrap_or_default();
        let number = |prefix: char| words.strip_prefix(prefix)?.parse().ok();
        number('>')
            .map(Self::WiderThan)
            .or_else(|| number('≤').map(Self::AtMost))
            .ok_or_else(|| format!("{value} is no width of bars"))
    }
}

/// Judges every group of the truth's `bars.json`; nothing where there is none.
pub(super) fn judge(view: &MapView<'_>, truth: &Path) -> anyhow::Result<Vec<BarScore>> {
    let Some(file) = BarFile::read(&truth.join(BARS_FILE))? else {
        return Ok(Vec::new());
    };
    scores(view, &file)
}

fn scores(view: &MapView<'_>, file: &BarFile) -> anyhow::Result<Vec<BarScore>> {
    let size = PanoramaSize::from_height(view.map.height())
        .filter(|size| size.width() == view.map.width())
        .filter(|_| {
            (view.confidence.width(), view.confidence.height())
                == (view.map.width(), view.map.height())
        })
        .context("the map is not twice as wide as high, or its confidence has another size")?;
    Ok(file
        .groups
        .iter()
        .filter_map(|group| {
            let plain = file
                .plain_of(group)
                .filter(|_| group.kind != BarKind::Plain)?;
            Some(score(view, size, file, group, plain))
        })
        .collect())
}

fn score(
    view: &MapView<'_>,
    size: PanoramaSize,
    file: &BarFile,
    group: &BarGroup,
    plain: &BarGroup,
) -> BarScore {
    let panel = view.sample(size, group, group);
    let full = 0.5 * (file.bright - file.dark);
    let modulation = |coefficient: f64| view.scale * coefficient / full;
    let mtf = panel.coefficient(0.0).map(modulation);
    let null_mtf = view
        .sample(size, group, plain)
        .null_deviation()
        .map(modulation);
    let stands_out = match (mtf, null_mtf) {
        (Some(mtf), Some(null)) => mtf >= LEAST_MTF && mtf > LEAST_DEVIATIONS * null,
        _ => false,
    };
    BarScore {
        site: group.site,
        kind: group.kind,
        width_deg: group.width_deg,
        mtf,
        null_mtf,
        coverage: panel.coverage,
        is_resolved: stands_out && panel.coverage >= LEAST_COVERAGE,
    }
}

/// The smallest width that, like all coarser ones, is resolved at two of three sites; `None` without such groups.
pub(super) fn finest(scores: &[BarScore], kind: BarKind) -> Option<BarWidth> {
    let of_kind = || scores.iter().filter(|score| score.kind == kind);
    let mut widths: Vec<f64> = of_kind().map(|score| score.width_deg).collect();
    widths.sort_by(|a, b| b.total_cmp(a));
    widths.dedup();
    let is_resolved = |width: f64| {
        let at_width = of_kind().filter(|score| score.width_deg == width);
        let (sites, resolved) = at_width.fold((0, 0), |(sites, resolved), score| {
            (sites + 1, resolved + usize::from(score.is_resolved))
        });
        resolved >= (2 * sites as usize).div_ceil(3)
    };
    let resolved_count = widths
        .iter()
        .take_while(|&&width| is_resolved(width))
        .count();
    let widest = *widths.first()?;
    Some(match resolved_count {
        0 => BarWidth::WiderThan(widest),
        count if count == widths.len() => BarWidth::AtMost(widths[count - 1]),
        count => BarWidth::Width(widths[count - 1]),
    })
}
