//! The map against the true room on the page: scores, nulls, bars.

use maud::{Markup, html};

use crate::eval::Metrics;
use crate::eval::environment::{BarKind, EnvironmentMetrics};

/// The whole section; nothing without a truth.
pub(super) fn environment(metrics: Option<&Metrics>) -> Markup {
    let Some(e) = metrics.and_then(|m| m.environment.as_ref()) else {
        return html! {};
    };
    let row = |name: &str, corr: f64, log_rmse: f64, coverage: f64| {
        html! {
            tr { td { (name) } td { (format!("{corr:.3}")) } td {} td { (format!("{log_rmse:.3}")) } td { (format!("{coverage:.2}")) } }
        }
    };
    let best = e.verdict.as_ref().map(|v| v.best_null.as_str());
    html! {
        h2 { "Against the true room" }
        @if let Some(verdict) = &e.verdict { p { "Verdict: " (verdict.sentence("the claimed texels", e.env_corr)) "." } }
        table {
            caption { "Nulls are over the claimed texels, with the 95 % interval over blocks of 8 x 8 texels of the grid; the best stands out." }
            tr { th { (format!("truth blurred with GGX width {}", e.truth_alpha)) } th { "correlation" } th { "95 % interval" } th { "log-RMSE" } th { "coverage" } }
            (row("claimed texels", e.env_corr, e.env_log_rmse, e.coverage))
            (row("whole reach", e.env_corr_reach, e.env_log_rmse_reach, 1.0))
            (row("this map against the sharp truth, whole reach", e.sharp.corr, e.sharp.log_rmse, 1.0))
            @for null in &e.nulls {
                tr class=[(best == Some(null.name.as_str())).then_some("best")] {
                    td { "null: " (null.name) } td { (format!("{:.3}", null.claimed.corr)) }
                    td { (format!("{:.3} to {:.3}", null.claimed_interval[0], null.claimed_interval[1])) }
                    td { (format!("{:.3}", null.claimed.log_rmse)) } td { (format!("{:.2}", null.claimed.coverage)) }
                }
            }
        }
        p.soft { (format!("{:.1} % of the claimed texels lie within 1.64 sigma of the truth.", 100.0 * e.within_sigma_fraction)) }
        (bars(e))
    }
}

/// Modulation of every group of bars, a row a width, the sites side by side.
fn bars(e: &EnvironmentMetrics) -> Markup {
    if e.bars.is_empty() {
        return html! {};
    }
    let words =
        |width: Option<_>| width.map_or_else(|| "-".to_owned(), |width| format!("{width}°"));
    let mut widths: Vec<f64> = e.bars.iter().map(|bar| bar.width_deg).collect();
    widths.sort_by(|a, b| b.total_cmp(a));
    widths.dedup();
    let cell = |width: f64, kind: BarKind| {
        let of_row = e
            .bars
            .iter()
            .filter(|b| b.width_deg == width && b.kind == kind);
        let cells: Vec<String> = of_row
            .map(|bar| {
                let mtf = bar
                    .mtf
                    .map_or_else(|| "-".to_owned(), |mtf| format!("{mtf:.2}"));
                if bar.is_resolved {
                    format!("{mtf} ✓")
                } else {
                    mtf
                }
            })
            .collect();
        cells.join(", ")
    };
    html! {
        p { "Finest resolved bars: " (words(e.env_bar_deg_h)) " in longitude, " (words(e.env_bar_deg_v)) " in latitude." }
        table {
            caption { "Modulation of each site's bars, 1 as in the room; ✓ resolved." }
            tr { th { "width of a bar" } th { "in longitude" } th { "in latitude" } }
            @for width in widths {
                tr { td { (width) "°" } td { (cell(width, BarKind::Horizontal)) } td { (cell(width, BarKind::Vertical)) } }
            }
        }
    }
}
