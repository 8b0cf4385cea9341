//! `glint report`: one self-contained page about a run.

mod angle_plot;
mod page;
mod pictures;
mod truth;
mod views;
mod words;

use std::path::Path;

use imaging::{Rgb8Image, encode_jpeg};
use serde_json::json;

pub use words::{metrics_summary, metrics_text};

use crate::eval::views::Strip;
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
