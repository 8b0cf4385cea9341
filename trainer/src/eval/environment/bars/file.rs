//! `bars.json` of a truth: where the bar targets stand, as seen from the object.

use std::path::Path;

use anyhow::{Context as _, ensure};
use geometry::DVec3;
use serde::{Deserialize, Serialize};

/// Largest file that is read, bytes.
const MOST_BYTES: u64 = 1 << 20;
/// Most groups in a file.
const MOST_GROUPS: usize = 1000;
/// Widths a tangent plane can hold and a float can tell apart, degrees.
const WIDTH_RANGE_DEG: std::ops::RangeInclusive<f64> = 0.05..=30.0;
/// Longest bars, in widths and in degrees.
const LONGEST: f64 = 100.0;
const LONGEST_DEG: f64 = 90.0;
/// How far a unit vector may be from length 1, and two axes from a right angle.
const VECTOR_SLACK: f64 = 1e-3;

/// The whole file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BarFile {
    version: u32,
    /// Radiance of the border and of plain panels.
    grey: f64,
    /// Radiance of dark bars.
    pub(super) dark: f64,
    /// Radiance of bright bars.
    pub(super) bright: f64,
    pub(super) groups: Vec<BarGroup>,
}

/// How a group's bars follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BarKind {
    /// Along longitude.
    Horizontal,
    /// Along latitude.
    Vertical,
    /// No bars: grey of the same size.
    Plain,
}

/// One target. The point (t, s), in radians on the tangent plane, lies in direction center + t across + s along.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BarGroup {
    /// Targets near each other have one number.
    pub(super) site: u32,
    pub(super) kind: BarKind,
    /// Width of one of the five bars, degrees.
    pub(super) width_deg: f64,
    /// Length of the bars, degrees.
    pub(super) length_deg: f64,
    center: [f64; 3],
    across: [f64; 3],
    along: [f64; 3],
}

impl BarFile {
    /// Reads and checks a file; `None` where there is none.
    pub(super) fn read(path: &Path) -> anyhow::Result<Option<Self>> {
        let Ok(facts) = std::fs::metadata(path) else {
            return Ok(None);
        };
        let name = path.display();
        ensure!(
            facts.len() <= MOST_BYTES,
            "{name} has {} bytes: a list of bars has at most {MOST_BYTES}",
            facts.len()
        );
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {name}"))?;
        Self::parse(&text)
            .with_context(|| format!("{name} does not say where the bars are"))
            .map(Some)
    }

    /// Checks a text.
    pub(super) fn parse(text: &str) -> anyhow::Result<Self> {
        let file: Self = serde_json::from_str(text)?;
        ensure!(file.version == 1, "its version is {}, not 1", file.version);
        ensure!(
            [file.dark, file.grey, file.bright]
                .iter()
                .all(|v| v.is_finite() && *v >= 0.0)
                && file.dark < file.bright,
            "dark {}, grey {} and bright {} are no radiances of bars",
            file.dark,
            file.grey,
            file.bright
        );
        ensure!(
            file.groups.len() <= MOST_GROUPS,
            "it has {} groups, more than {MOST_GROUPS}",
            file.groups.len()
        );
        for (index, group) in file.groups.iter().enumerate() {
            group.check().with_context(|| format!("group {index}"))?;
            ensure!(
                group.kind == BarKind::Plain || file.plain_of(group).is_some(),
                "group {index}: site {} has no plain panel to compare with",
                group.site
            );
        }
        Ok(file)
    }

    /// The plain panel that a group is compared with: of its site, the smallest that is as large, else the largest.
    pub(super) fn plain_of(&self, group: &BarGroup) -> Option<&BarGroup> {
        let plain = || {
            self.groups
                .iter()
                .filter(|p| p.kind == BarKind::Plain && p.site == group.site)
        };
        plain()
            .filter(|p| p.width_deg >= group.width_deg)
            .min_by(|a, b| a.width_deg.total_cmp(&b.width_deg))
            .or_else(|| plain().max_by(|a, b| a.width_deg.total_cmp(&b.width_deg)))
    }
}

impl BarGroup {
    fn check(&self) -> anyhow::Result<()> {
        ensure!(
            WIDTH_RANGE_DEG.contains(&self.width_deg),
            "a width of {} degrees is outside {WIDTH_RANGE_DEG:?}",
            self.width_deg
        );
        let longest = LONGEST_DEG.min(LONGEST * self.width_deg);
        ensure!(
            self.length_deg > 0.0 && self.length_deg <= longest,
            "a length of {} degrees is outside 0 to {longest}",
            self.length_deg
        );
        let [center, across, along] = self.axes();
        for axis in [center, across, along] {
            ensure!(
                (axis.length() - 1.0).abs() <= VECTOR_SLACK,
                "{axis} is no unit vector"
            );
        }
        ensure!(
            [center.dot(across), center.dot(along), across.dot(along)]
                .iter()
                .all(|dot| dot.abs() <= VECTOR_SLACK),
            "its axes are not at right angles"
        );
        Ok(())
    }

    /// Centre, across and along.
    fn axes(&self) -> [DVec3; 3] {
        [self.center, self.across, self.along].map(DVec3::from_array)
    }

    /// The direction of (t, s), not normalised.
    pub(super) fn direction(&self, t: f64, s: f64) -> DVec3 {
        let [center, across, along] = self.axes();
        center + t * across + s * along
    }

    /// Half of the extent across and along, radians.
    pub(super) fn half_extent(&self) -> [f64; 2] {
        [2.5 * self.width_deg, 0.5 * self.length_deg].map(f64::to_radians)
    }

    /// Whether `other`'s bars run across this group's.
    pub(super) fn is_crossed_by(&self, other: &Self) -> bool {
        let ([_, own, _], [_, across, along]) = (self.axes(), other.axes());
        own.dot(along).abs() > own.dot(across).abs()
    }
}
