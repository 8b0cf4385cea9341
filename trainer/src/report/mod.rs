//! `glint report`: one self-contained page about a run.

mod page;
mod pictures;

use std::path::Path;

use imaging::{Rgb8Image, encode_jpeg};
use serde_json::json;

use crate::eval::views::Strip;
use crate::eval::{self, Metrics};
use crate::perceptual::{CROP_MARGIN, CropBox};
use crate::run_folder::{RunFolder, write_atomically};

/// Quality of the pictures inside the page.
const JPEG_QUALITY: u8 = 88;

/// Writes the page of a run; returns its size in bytes.
pub fn write(folder: &RunFolder, output: &Path) -> anyhow::Result<usize> {
    let html = page::page(folder)?;
    write_atomically(output, html.as_bytes())?;
    Ok(html.len())
}

/// Keeps pictures of a few held-out frames in the run folder for the page: photograph, composition,
/// diffuse alone and nearest view side by side, cropped to the object as LPIPS sees it.
pub fn write_strips(folder: &RunFolder, strips: &[Strip]) -> anyhow::Result<()> {
    let mut names = Vec::new();
    for strip in strips {
        let Some(area) = CropBox::around(&strip.mask, CROP_MARGIN) else {
            continue;
        };
        let parts: Vec<Rgb8Image> = [
            &strip.photograph,
            &strip.composition,
            &strip.diffuse_only,
            &strip.nearest_view,
        ]
        .into_iter()
        .map(|image| area.of(image))
        .collect();
        let name = format!("eval/strip-{:06}.jpg", strip.frame);
        folder.write(
            &name,
            &encode_jpeg(&pictures::side_by_side(&parts), JPEG_QUALITY)?,
        )?;
        names.push(json!({"frame": strip.frame, "file": name}));
    }
    folder.write_json("eval/strips.json", &names)
}

/// The metrics in words for a terminal.
pub fn metrics_text(metrics: &Metrics) -> String {
    let mut lines = Vec::new();
    if let Some(e) = &metrics.environment {
        lines.push(format!(
            "environment (lobe alpha {}): claimed corr {:.3}, log-RMSE {:.3}, coverage {:.2}; whole reach corr {:.3}, log-RMSE {:.3}, scale {:.2}",
            e.truth_alpha, e.env_corr, e.env_log_rmse, e.coverage, e.env_corr_reach, e.env_log_rmse_reach, e.scale_reach
        ));
        lines.push(format!(
            "  baselines on the whole reach: constant map {:.3} / {:.3}, true map turned by 90 degrees {:.3} / {:.3}; sharp truth {:.3} / {:.3}",
            e.constant.corr, e.constant.log_rmse, e.turned.corr, e.turned.log_rmse, e.sharp.corr, e.sharp.log_rmse
        ));
        lines.push(format!(
            "  claimed texels within 1.64 sigma of the truth: {:.1} %",
            100.0 * e.within_sigma_fraction
        ));
        if let Some(angle) = e.map_rotation_deg {
            lines.push(format!(
                "  the map was turned by {angle:.2} degrees: the alignment of its trajectory to the poses `source`"
            ));
        }
    }
    if let Some(c) = &metrics.composition {
        lines.push(format!(
            "held-out photographs ({} frames, {}): L1 {:.4} (PSNR {:.2} dB); diffuse alone {:.4} ({:.2}); nearest view {:.4} ({:.2})",
            c.frame_count, c.mask, c.composition.l1, c.composition.psnr, c.diffuse_only.l1, c.diffuse_only.psnr,
            c.nearest_view.l1, c.nearest_view.psnr
        ));
    }
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
