//! Held-out photographs on the page: pictures, figures, and LPIPS against the angle.

use maud::{Markup, PreEscaped, html};

use super::angle_plot;
use super::page::embedded;
use crate::eval::Metrics;
use crate::eval::views::{AngleBin, AngleMetrics, CompositionMetrics, ViewError};
use crate::run_folder::RunFolder;

/// The methods as the page calls them, in the order of the metrics.
pub(super) const METHOD_NAMES: [&str; 3] = [
    "composition",
    "diffuse alone",
    "nearest photograph reprojected",
];

/// The whole section; nothing when no frame was held out.
pub(super) fn held_out(folder: &RunFolder, metrics: Option<&Metrics>) -> anyhow::Result<Markup> {
    let Some(composition) = metrics.and_then(|m| m.composition.as_ref()) else {
        return Ok(html! {});
    };
    Ok(html! {
        h2 { "Views nobody trained on" }
        div.cols { span { "photograph" } span { "D + gain · SRM" } span { "diffuse alone" } span { "nearest photograph" } }
        (strips(folder, composition)?)
        (figures(composition))
        @if let Some(angles) = &composition.lpips_by_angle { (by_angle(composition, angles)) }
    })
}

fn strips(folder: &RunFolder, composition: &CompositionMetrics) -> anyhow::Result<Markup> {
    #[derive(serde::Deserialize)]
    struct StripFile {
        frame: usize,
        file: String,
    }
    let files: Vec<StripFile> = folder.read_json("eval/strips.json")?;
    let mut strips = Vec::new();
    for strip in files {
        let bytes = std::fs::read(folder.path(&strip.file))?;
        let frame = composition.frames.iter().find(|f| f.frame == strip.frame);
        strips.push((
            strip.frame,
            frame.map_or(0.0, |f| f.angle_deg),
            embedded(&bytes, "jpeg", "held-out strip"),
        ));
    }
    Ok(html! {
        @for (frame, angle, strip) in &strips {
            figure { (strip) figcaption { "frame " (frame) (format!(", {angle:.1} degrees from the nearest training view")) } }
        }
    })
}

/// One row a method; the best L1 stands out.
fn figures(composition: &CompositionMetrics) -> Markup {
    let errors = [
        &composition.composition,
        &composition.diffuse_only,
        &composition.nearest_view,
    ];
    let least = errors.iter().map(|e| e.l1).fold(f64::INFINITY, f64::min);
    let row = |name: &str, error: &ViewError| {
        html! {
            tr class=[(error.l1 <= least).then_some("best")] {
                td { (name) } td { (format!("{:.4}", error.l1)) } td { (format!("{:.2}", error.psnr)) }
                td { (number(error.ssim, 3)) } td { (number(error.lpips, 3)) }
                td { (number(error.highlight_ratio, 2)) } td { (number(error.l1_full, 4)) }
            }
        }
    };
    html! {
        table {
            tr {
                th { "held out" } th { "L1" } th { "PSNR dB" } th { "SSIM" } th { "LPIPS" }
                th { "highlights kept" } th { "L1, whole frame" }
            }
            @for (name, error) in METHOD_NAMES.iter().zip(errors) { (row(name, error)) }
        }
        p.soft {
            (composition.frame_count) " frames, codes as 0 to 1, mask: " (composition.mask) ". "
            "LPIPS: AlexNet, " (composition.lpips_frame_count) " frames. Highlights kept: light above diffuse alone, predicted over photographed. \
             Whole frame: all pixels that see the surface."
        }
    }
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

/// The plot with its table: what no method knows is how far it is from what it was trained on.
fn by_angle(composition: &CompositionMetrics, angles: &AngleMetrics) -> Markup {
    let bins: Vec<&AngleBin> = angles
        .methods
        .first()
        .iter()
        .flat_map(|m| &m.bins)
        .collect();
    let cell = |bin: Option<&AngleBin>| {
        bin.map_or_else(String::new, |bin| {
            let interval = bin.interval.map_or_else(String::new, |[low, high]| {
                format!(" ({low:.3} to {high:.3})")
            });
            format!("{:.3}{interval}", bin.median)
        })
    };
    html! {
        figure {
            (PreEscaped(angle_plot::svg(composition, angles)))
            figcaption {
                "LPIPS against the angle at the object to the nearest training view. Small: frames; large: median of a bin \
                 with its 95 % interval over blocks; hollow: fewer than 3 blocks, which is no evidence."
            }
        }
        table {
            caption { "Median LPIPS (95 % interval over blocks): " (angles.blocks) "." }
            tr {
                th { "angle" } th { "frames" } th { "blocks" }
                @for name in METHOD_NAMES { th { (name) } }
            }
            @for (row, bin) in bins.iter().enumerate() {
                tr {
                    td { (range(bin)) } td { (bin.frame_count) }
                    td { (bin.block_count) @if bin.is_hollow { " (hollow)" } }
                    @for method in &angles.methods { td { (cell(method.bins.get(row))) } }
                }
            }
            tr {
                td { "for 10° more" } td {} td {}
                @for method in &angles.methods {
                    td { (method.slope_per_10_deg.map_or_else(|| "-".to_owned(), |slope| format!("{slope:+.4}"))) }
                }
            }
        }
    }
}

/// A bin's angles in words.
fn range(bin: &AngleBin) -> String {
    match bin.to_deg {
        Some(end) => format!("{} to {end}°", bin.from_deg),
        None => format!("above {}°", bin.from_deg),
    }
}
