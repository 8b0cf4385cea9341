//! The metrics in words for a terminal, and as the summary of `glint eval --json`.

use serde_json::json;

use crate::eval::environment::EnvironmentMetrics;
use crate::eval::views::{CompositionMetrics, ViewError};
use crate::eval::{self, Metrics};

/// The metrics in words for a terminal.
pub fn metrics_text(metrics: &Metrics) -> String {
    let mut lines = Vec::new();
    lines.extend(metrics.environment.as_ref().map(environment_text));
    lines.extend(metrics.composition.as_ref().map(views_text));
    lines.extend(metrics.trajectory.as_ref().map(eval::trajectory::text));
    lines.extend(metrics.mesh.as_ref().map(eval::mesh::text));
    if lines.is_empty() {
        lines.push(
            "nothing to measure: the recording has no test frames and no --truth was given"
                .to_owned(),
        );
    }
    lines.join("\n")
}

fn environment_text(e: &EnvironmentMetrics) -> String {
    let mut lines = vec![format!(
        "environment (lobe alpha {}): claimed corr {:.3}, log-RMSE {:.3}, coverage {:.2}; whole reach corr {:.3}, log-RMSE {:.3}, scale {:.2}",
        e.truth_alpha,
        e.env_corr,
        e.env_log_rmse,
        e.coverage,
        e.env_corr_reach,
        e.env_log_rmse_reach,
        e.scale_reach
    )];
    if let Some(verdict) = &e.verdict {
        lines.push(verdict.sentence("the claimed texels", e.env_corr));
    }
    lines.push(format!(
        "baselines on the whole reach: constant map {:.3} / {:.3}, true map turned by 90 degrees {:.3} / {:.3}; sharp truth {:.3} / {:.3}",
        e.constant.corr, e.constant.log_rmse, e.turned.corr, e.turned.log_rmse, e.sharp.corr, e.sharp.log_rmse
    ));
    lines.push(format!(
        "claimed texels within 1.64 sigma of the truth: {:.1} %",
        100.0 * e.within_sigma_fraction
    ));
    for (axis, width) in [
        ("longitude", e.env_bar_deg_h),
        ("latitude", e.env_bar_deg_v),
    ] {
        lines.extend(width.map(|width| format!("finest resolved bars in {axis}: {width} degrees")));
    }
    if let Some(angle) = e.map_rotation_deg {
        lines.push(format!(
            "the map was turned by {angle:.2} degrees: the alignment of its trajectory to the poses `source`"
        ));
    }
    lines.join("\n  ")
}

fn views_text(c: &CompositionMetrics) -> String {
    let figures = |error: &ViewError| {
        let beside = [
            ("SSIM", error.ssim),
            ("LPIPS", error.lpips),
            ("highlights kept", error.highlight_ratio),
        ]
        .map(|(name, value)| value.map_or_else(String::new, |v| format!(", {name} {v:.3}")));
        format!(
            "L1 {:.4}, PSNR {:.2} dB{}",
            error.l1,
            error.psnr,
            beside.concat()
        )
    };
    let mut text = format!(
        "held-out photographs ({} frames, {}):",
        c.frame_count, c.mask
    );
    for (name, error) in [
        ("composition", &c.composition),
        ("diffuse alone", &c.diffuse_only),
        ("nearest view", &c.nearest_view),
    ] {
        text += &format!("\n  {name}: {}", figures(error));
    }
    text
}

/// The summary event of `glint eval --json`.
pub fn metrics_summary(metrics: &Metrics) -> serde_json::Value {
    let mut summary = serde_json::Map::new();
    if let Some(e) = &metrics.environment {
        summary.insert("env_corr".into(), json!(e.env_corr));
        summary.insert("env_log_rmse".into(), json!(e.env_log_rmse));
        summary.insert("coverage".into(), json!(e.coverage));
        summary.insert("env_corr_reach".into(), json!(e.env_corr_reach));
        summary.insert("env_log_rmse_reach".into(), json!(e.env_log_rmse_reach));
        if let Some(angle) = e.map_rotation_deg {
            summary.insert("map_rotation_deg".into(), json!(angle));
        }
        if let Some(verdict) = &e.verdict {
            summary.insert("env_shows_detail".into(), json!(verdict.shows_detail));
        }
        let bars = [
            ("env_bar_deg_h", e.env_bar_deg_h),
            ("env_bar_deg_v", e.env_bar_deg_v),
        ];
        for (key, width) in bars {
            summary.extend(width.map(|width| (key.to_owned(), json!(width))));
        }
        summary.insert("env_corr_turned".into(), json!(e.turned.corr));
        summary.insert("env_log_rmse_constant".into(), json!(e.constant.log_rmse));
        summary.insert(
            "within_sigma_fraction".into(),
            json!(e.within_sigma_fraction),
        );
    }
    if let Some(c) = &metrics.composition {
        summary.insert("l1".into(), json!(c.composition.l1));
        summary.insert("psnr".into(), json!(c.composition.psnr));
        let optional = [
            ("ssim", c.composition.ssim),
            ("lpips", c.composition.lpips),
            ("highlight_ratio", c.composition.highlight_ratio),
            ("l1_full", c.composition.l1_full),
            ("lpips_diffuse", c.diffuse_only.lpips),
            ("lpips_nearest", c.nearest_view.lpips),
        ];
        for (key, value) in optional {
            summary.extend(value.map(|value| (key.to_owned(), json!(value))));
        }
        summary.insert("l1_diffuse".into(), json!(c.diffuse_only.l1));
        summary.insert("l1_nearest".into(), json!(c.nearest_view.l1));
    }
    if let Some(trajectory) = &metrics.trajectory {
        summary.extend(eval::trajectory::summary(trajectory));
    }
    if let Some(mesh) = &metrics.mesh {
        summary.extend(eval::mesh::summary(mesh));
    }
    summary.insert("cost".into(), json!(metrics.cost));
    summary.into()
}
