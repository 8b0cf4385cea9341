//! The page itself.

use anyhow::Context as _;
use base64::Engine as _;
use imaging::{Rgb8Image, encode_jpeg, encode_png_rgb8, read_confidence_exr, read_rgb_exr};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sequence::Recording;

use super::JPEG_QUALITY;
use super::pictures::{self, MeshPaint};
use super::{truth, views};
use crate::eval::Metrics;
use crate::eval::model::Model;
use crate::run_folder::{Manifest, RunFolder};
use crate::stages::geometry::GeometrySummary;
use crate::stages::linear::LinearSummary;
use crate::stages::observe::ColorView;
use crate::stages::poses::{PosesSummary, SUMMARY_FILE, poses_of_run, training_frames_at};
use crate::train::{CONFIDENCE_FILE, ObjectSummary, SRM_FILE, TrainConfig};

/// Confidence from which a texel is shown in the picture of everything reached.
const LEAST_SHOWN: f32 = 0.02;

const STYLE: &str = "
:root{--ink:#1d2328;--soft:#5b666f;--line:#dcdfe1;--paper:#fbfaf7;--accent:#8a4b12}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
main{max-width:1060px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:26px;margin:0 0 4px}h2{font-size:18px;margin:34px 0 8px;border-bottom:1px solid var(--line);padding-bottom:4px}
p{margin:6px 0;max-width:76ch}.soft{color:var(--soft)}.lead{font-size:17px}
img{max-width:100%;display:block;border-radius:3px}figure{margin:10px 0}figcaption{color:var(--soft);font-size:13px;margin-top:4px}
.row{display:grid;grid-template-columns:repeat(auto-fit,minmax(220px,1fr));gap:12px}
caption{caption-side:bottom;text-align:left;color:var(--soft);font-size:13px;padding-top:4px}table{border-collapse:collapse;margin:8px 0;font-variant-numeric:tabular-nums}
th,td{text-align:right;padding:3px 14px 3px 0;border-bottom:1px solid var(--line)}th:first-child,td:first-child{text-align:left}
th{font-weight:600;color:var(--soft);font-size:13px}.best{color:var(--accent);font-weight:600}
svg{max-width:100%;height:auto}.cols{display:grid;grid-template-columns:repeat(4,1fr);font-size:13px;color:var(--soft);text-align:center}
";

fn picture(image: &Rgb8Image, alt: &str) -> anyhow::Result<Markup> {
    let bytes = encode_jpeg(image, JPEG_QUALITY)?;
    Ok(embedded(&bytes, "jpeg", alt))
}

fn sharp_picture(image: &Rgb8Image, alt: &str) -> anyhow::Result<Markup> {
    Ok(embedded(&encode_png_rgb8(image)?, "png", alt))
}

/// A picture inside the page; `kind` is its format.
pub(super) fn embedded(bytes: &[u8], kind: &str, alt: &str) -> Markup {
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    html! { img alt=(alt) src={ "data:image/" (kind) ";base64," (PreEscaped(data)) }; }
}

/// The whole page as text.
pub(super) fn page(folder: &RunFolder) -> anyhow::Result<String> {
    let manifest = folder.manifest()?;
    let geometry: GeometrySummary = folder.read_json("geometry/summary.json")?;
    let object: ObjectSummary = folder.read_json("geometry/object.json")?;
    let linear: LinearSummary = folder.read_json("linear/summary.json")?;
    let metrics: Option<Metrics> = if folder.path("metrics.json").exists() {
        Some(folder.read_json("metrics.json")?)
    } else {
        None
    };
    let config: TrainConfig =
        toml::from_str(&std::fs::read_to_string(folder.path("config.toml"))?)?;
    let model = Model::load(folder)?;
    let name = manifest
        .recording
        .file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "glint: " (name) }
                style { (PreEscaped(STYLE)) }
            }
            body { main {
                h1 { (name) }
                p.lead { (linear.sentence) "." }
                (room(folder, &linear)?)
                (inputs(folder, &config, &model)?)
                (path(folder)?)
                (shape(folder, &config, &model, &geometry, &object, &linear)?)
                (views::held_out(folder, metrics.as_ref())?)
                (truth::environment(metrics.as_ref()))
                (solve(&linear))
                (cost(&manifest, metrics.as_ref()))
            } }
        }
    };
    Ok(markup.into_string())
}

fn room(folder: &RunFolder, linear: &LinearSummary) -> anyhow::Result<Markup> {
    let (map, _) = read_rgb_exr(&folder.path(SRM_FILE))?;
    let confidence = read_confidence_exr(&folder.path(CONFIDENCE_FILE))?;
    let texel = 180.0 / f64::from(map.height());
    Ok(html! {
        h2 { "The room in the reflections" }
        figure {
            (sharp_picture(&pictures::claimed_panorama(&map, &confidence.confidence, 0.5), "specular map")?)
            figcaption {
                (format!("Specular map, {} x {} texels of {texel:.2} degrees; ", map.width(), map.height()))
                "the middle looks along +z, right of it is +x, the top is up. \
                 Faded to grey where the confidence is below one half. "
                (format!("{:.0} % of the texels are claimed.", 100.0 * linear.claimed_fraction))
            }
        }
        div.row {
            figure {
                (sharp_picture(&pictures::claimed_panorama(&map, &confidence.confidence, LEAST_SHOWN), "whole specular map")?)
                figcaption { "All that any pixel reflects, sure or not." }
            }
            figure {
                (sharp_picture(&pictures::confidence(&confidence.confidence), "confidence")?)
                figcaption { "Confidence: black 0, white 1." }
            }
        }
    })
}

fn inputs(folder: &RunFolder, config: &TrainConfig, model: &Model) -> anyhow::Result<Markup> {
    let recording =
        Recording::open(&config.recording).context("the report shows frames of the recording")?;
    let frames = training_frames_at(
        &recording,
        &poses_of_run(folder, &recording, &config.poses)?,
    );
    let mut shown = Vec::new();
    for part in 0..4 {
        let frame = frames[part * (frames.len() - 1) / 3];
        shown.push((
            frame.index,
            picture(&recording.color(frame.index)?, "input frame")?,
        ));
    }
    Ok(html! {
        h2 { "Input" }
        p.soft { (frames.len()) " training frames; " (recording.split().test.len()) " held out, never read by training; "
            (model.surface.triangles.len()) " triangles." }
        div.row { @for (index, image) in &shown { figure { (image) figcaption { "frame " (index) } } } }
    })
}

/// Where the camera was, and how well that fits.
fn path(folder: &RunFolder) -> anyhow::Result<Markup> {
    if !folder.path(SUMMARY_FILE).exists() {
        return Ok(html! {});
    }
    let poses: PosesSummary = folder.read_json(SUMMARY_FILE)?;
    let Some(refinement) = &poses.refinement else {
        return Ok(html! {
            p.soft { "Poses: the set " (poses.set) " of the recording. " (left_out(&poses)) }
        });
    };
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
    Ok(html! {
        h2 { "Camera path" }
        p { "Refined from the set " (poses.started_from) ": " (refinement.reason) ". " (left_out(&poses)) }
        table {
            caption { "Judged on frames that are left out of the model that judges them; flow in full-size pixels of the photographs." }
            tr { th { "" } th { "residual flow, px" } th { "depth residual, mm" } th { "frames" } th { "patches" } }
            @for (name, figures) in [("start", &refinement.before), ("refined", &refinement.after)] {
                @if let Some(figures) = figures {
                    tr {
                        td { (name) } td { (number(figures.flow_px)) } td { (number(figures.depth_residual_mm)) }
                        td { (figures.frame_count) } td { (figures.patch_count) }
                    }
                }
            }
        }
        p.soft {
            (format!("{} keyframes; of {} pairs that see the same, {} stood up and {} of these were refused by the others. ",
                refinement.keyframe_count, refinement.tried_loop_count, refinement.verified_loop_count, refinement.refused_loop_count))
            (format!("Cameras were moved by {:.2} mm in the median, {:.2} mm at most.", refinement.shift_mm, refinement.largest_shift_mm))
        }
    })
}

/// The sentence about frames without a pose.
fn left_out(poses: &PosesSummary) -> String {
    let count = poses.lost_count + poses.other_map_count + poses.unknown_count;
    if count == 0 {
        return String::new();
    }
    format!(
        "{count} training frames were left out: {} lost, {} in another map, {} without a pose.",
        poses.lost_count, poses.other_map_count, poses.unknown_count
    )
}

fn shape(
    folder: &RunFolder,
    config: &TrainConfig,
    model: &Model,
    geometry: &GeometrySummary,
    object: &ObjectSummary,
    linear: &LinearSummary,
) -> anyhow::Result<Markup> {
    let recording = Recording::open(&config.recording)?;
    let view = ColorView::new(&recording);
    let frames = training_frames_at(
        &recording,
        &poses_of_run(folder, &recording, &config.poses)?,
    );
    let middle = frames[frames.len() / 2];
    let eye = view
        .surface_from_color(&model.surface, &middle.world_from_camera)
        .translation();
    let mut figures = Vec::new();
    if let Some((camera, pose)) = pictures::object_camera(model, eye) {
        for (paint, caption) in [
            (MeshPaint::Shape, "Shape"),
            (
                MeshPaint::Segments,
                "Segments: bright ones reflect, grey is left out",
            ),
            (MeshPaint::Diffuse, "Diffuse texture D, reflections removed"),
        ] {
            figures.push((
                picture(&pictures::mesh(model, &camera, &pose, paint), caption)?,
                caption,
            ));
        }
    }
    Ok(html! {
        h2 { "Shape" }
        div.row { @for (image, caption) in &figures { figure { (image) figcaption { (caption) } } } }
        p {
            (format!("{} frames fused at {:.1} mm: {} triangles. ", geometry.frame_count, geometry.voxel_mm, geometry.triangle_count))
            @if geometry.repeated_frame_count > 0 {
                (format!("{} frames were left out: their depth repeats the frame before. ", geometry.repeated_frame_count))
            }
            (format!("{:.1} % of the measured depth lies on the surface (median {:.2} mm off). ",
                100.0 * geometry.depth_fit_fraction, geometry.depth_residual_mm))
            (format!("Normals err by about {:.2} degrees after {} rounds of smoothing, which blurs a reflection by {:.2} degrees.",
                geometry.normal_noise_deg, geometry.normal_rounds, geometry.reflection_blur_deg))
        }
        p.soft { (format!("{} dominant planes left out. ", object.planes.len())) "No mask was given: each other part keeps reflections only where they predict held-out frames better." }
        table {
            tr { th { "segment" } th { "area cm²" } th { "held-out error, D alone" } th { "D and S" } th { "share of map" } th { "verdict" } }
            @for segment in &object.segments {
                @let judged = linear.segments.iter().find(|s| s.id == segment.id);
                tr {
                    td { (segment.id) }
                    td { (format!("{:.0}", 1e4 * segment.area)) }
                    td { (judged.map_or_else(|| "-".to_owned(), |s| format!("{:.4}", s.diffuse_error))) }
                    td { (judged.map_or_else(|| "-".to_owned(), |s| format!("{:.4}", s.joint_error))) }
                    td { (judged.filter(|s| s.is_specular).map_or_else(|| "-".to_owned(), |s| format!("{:.2}", s.relative_gain))) }
                    td { (judged.map_or("not seen well enough", |s| if s.is_specular { "shiny" } else { "matte" })) }
                }
            }
        }
    })
}

fn solve(linear: &LinearSummary) -> Markup {
    html! {
        h2 { "The solve" }
        p {
            (format!("{} pixels, {:.1} % of them clipped, {:.1} % with the mirrored ray blocked; ",
                linear.row_count, 100.0 * linear.clipped_fraction, 100.0 * linear.occluded_fraction))
            (format!("{:.1} % of the object's pixels dropped at silhouettes, slants and unsure normals. ", 100.0 * linear.dropped_fraction))
            (format!("Reflectance assumed: {} (its value only scales the map). ", linear.gain))
            (format!("Residual {:.4}, on held-out frames {:.4} of the white level.", linear.residual_sigma, linear.held_out_sigma))
        }
        p {
            (format!("Offset between texture and map: sigma {:.3}, {:.0} % from data, {} connected parts. ",
                linear.offset_sigma, 100.0 * linear.offset_data_fraction, linear.component_count))
            @if !linear.offset_observed { "The offset is not observed by the data: a stated prior decides it." }
        }
        table {
            caption { (format!("Taken: {:.2}, the largest within 5 % of the least error.", linear.diffuse_weight)) }
            tr { th { "pull of D to zero" } th { "held-out error" } }
            @for trial in &linear.weight_trials {
                tr {
                    td { (format!("{:.2}", trial.weight)) } td { (format!("{:.5}", trial.error)) }
                }
            }
        }
    }
}

fn cost(manifest: &Manifest, metrics: Option<&Metrics>) -> Markup {
    let order = ["poses", "geometry", "diffuse", "linear"];
    let total = manifest
        .stages
        .values()
        .fold((0.0, 0.0), |sum, c| (sum.0 + c.wall_s, sum.1 + c.core_s));
    html! {
        h2 { "What it cost" }
        table {
            tr { th { "stage" } th { "wall s" } th { "core-seconds" } }
            @for name in order {
                @if let Some(cost) = manifest.stages.get(name) {
                    tr { td { (name) } td { (format!("{:.1}", cost.wall_s)) } td { (format!("{:.1}", cost.core_s)) } }
                }
            }
            tr { td { "training" } td { (format!("{:.1}", total.0)) } td { (format!("{:.1}", total.1)) } }
            @if let Some(metrics) = metrics {
                tr { td { "evaluation" } td { (format!("{:.1}", metrics.cost.wall_s)) } td { (format!("{:.1}", metrics.cost.core_s)) } }
            }
        }
        p.soft { "glint " (manifest.glint_version) ", profile " (manifest.profile) ", " (manifest.threads) " threads, recording "
            (manifest.recording_hash.chars().take(16).collect::<String>()) "." }
    }
}
