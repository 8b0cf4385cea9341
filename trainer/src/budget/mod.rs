//! `glint train --budget`: the setting that a number of core-seconds buys, and keeping to it (effects-and-tradeoffs
//! B5).
//!
//! The measured tables of `glint tradeoff srm` are part of the program. The cost of a point is scaled to this
//! recording, by its frames and pixels, and to this machine, by a short measurement; with a reserve for what the
//! scaling cannot know, the point that errs least of those that fit is taken. Such a number is a plan: it never
//! enters a table.
//!
//! Map: [`bench`] how fast this machine is · [`table`] a measurement, read back · [`curve`] costs at other sizes ·
//! [`pick`] the choice · [`pace`] what gives way while it runs · [`spent`] what became of it.

pub mod bench;
pub mod curve;
pub mod pace;
pub mod pick;
pub mod spent;
pub mod table;
#[cfg(test)]
mod tests;

use anyhow::Context as _;

pub use pace::Pacer;
pub use pick::{Plan, Planned, Target, plan};
pub use spent::Spent;
pub use table::Table;

/// Reserve of a plan: what is chosen may cost this much more than was planned and still fits.
pub const SAFETY: f64 = 1.3;
/// What a run may spend of its budget.
pub const MOST_SPENT: f64 = 1.15;

/// Measurements that are part of the program: an independent renderer's scene and one of our own.
const TABLES: [(&str, &str); 2] = [
    (
        "mitsuba-dev",
        include_str!("../../../docs/tradeoff/mitsuba-dev/srm.csv"),
    ),
    (
        "bowls",
        include_str!("../../../docs/tradeoff/bowls/srm.csv"),
    ),
];

/// The measurements that are part of the program.
///
/// # Errors
/// Never for a program whose tests passed: when a table cannot be read.
pub fn tables() -> anyhow::Result<Vec<Table>> {
    let tables = TABLES.iter();
    tables
        .map(|(name, text)| Table::parse(text).with_context(|| format!("the table of {name}")))
        .collect()
}

/// Core-seconds of `90s`, `5min`, `1.5h`.
///
/// # Errors
/// A sentence for people.
pub fn parse_budget(text: &str) -> Result<f64, String> {
    let units = [("min", 60.0), ("h", 3600.0), ("s", 1.0)];
    let value = units.iter().find_map(|(unit, seconds)| {
        let number: f64 = text.strip_suffix(unit)?.trim().parse().ok()?;
        Some(number * seconds)
    });
    value
        .filter(|seconds| seconds.is_finite() && *seconds > 0.0)
        .ok_or_else(|| {
            format!("`{text}` is no budget: give core-seconds as 90s, minutes as 5min, hours as 1h")
        })
}
