//! OpenEXR files: panoramas, confidence maps, single channels.
//!
//! Written as f32 (flags as u32) scan lines, ZIP over 16 lines, attributes in the order of their names: the
//! same content gives the same bytes. A file appears under its name only when it is complete. Read are flat
//! files of any compression that `exr` knows, half or float.

mod container;
mod panorama;

pub use panorama::{PANORAMA_AXES, PanoramaAttributes};

use std::path::Path;

use exr::prelude::FlatSamples;

use crate::error::ImagingError;
use crate::image::{Image, LinearImage};
use container::{Content, read, write};

/// How sure a panorama is of its texels.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfidenceMap {
    /// 0 to 1, derived from `sigma`; 0.5 and more = claimed.
    pub confidence: Image<f32>,
    /// Standard deviation of each channel in the map's unit; infinite where nothing was seen.
    pub sigma: LinearImage,
    /// How much was seen of a texel, in samples.
    pub sample_count: Image<f32>,
    /// Bits per texel (saturated, offset unobserved); their meaning is the writer's.
    pub flags: Image<u32>,
}

/// Channel names of a confidence file.
const CONFIDENCE: &str = "confidence";
const SIGMA: [&str; 3] = ["sigma.R", "sigma.G", "sigma.B"];
const SAMPLE_COUNT: &str = "sample_count";
const FLAGS: &str = "flags";
const RGB: [&str; 3] = ["R", "G", "B"];

/// Writes a panorama with its attributes.
pub fn write_rgb_exr(
    path: &Path,
    map: &LinearImage,
    attributes: &PanoramaAttributes,
) -> Result<(), ImagingError> {
    let mut content = Content::new(map.width(), map.height());
    attributes.add_to(&mut content)?;
    add_rgb(&mut content, &RGB, map);
    write(path, content)
}

/// Reads a panorama's channels R, G and B. The attributes are `None` when the file carries none of ours;
/// those that it leaves out are the identity, the origin, an infinite radius and a gain of 1.
pub fn read_rgb_exr(
    path: &Path,
) -> Result<(LinearImage, Option<PanoramaAttributes>), ImagingError> {
    let content = read(path)?;
    let attributes =
        PanoramaAttributes::found_in(&content).map_err(|source| ImagingError::InFile {
            path: path.to_path_buf(),
            source: Box::new(source),
        })?;
    Ok((rgb_of(&content, &RGB, path)?, attributes))
}

/// Writes a confidence map: channels `confidence`, `sigma.R`, `sigma.G`, `sigma.B`, `sample_count` (f32) and
/// `flags` (u32). Refuses parts of different sizes.
pub fn write_confidence_exr(path: &Path, map: &ConfidenceMap) -> Result<(), ImagingError> {
    map.confidence.require_same_size(&map.sigma)?;
    map.confidence.require_same_size(&map.sample_count)?;
    map.confidence.require_same_size(&map.flags)?;
    let mut content = Content::new(map.confidence.width(), map.confidence.height());
    content.add_channel(
        CONFIDENCE,
        FlatSamples::F32(map.confidence.pixels().to_vec()),
    );
    add_rgb(&mut content, &SIGMA, &map.sigma);
    content.add_channel(
        SAMPLE_COUNT,
        FlatSamples::F32(map.sample_count.pixels().to_vec()),
    );
    content.add_channel(FLAGS, FlatSamples::U32(map.flags.pixels().to_vec()));
    write(path, content)
}

/// Reads what [`write_confidence_exr`] writes.
pub fn read_confidence_exr(path: &Path) -> Result<ConfidenceMap, ImagingError> {
    let content = read(path)?;
    let flags = match content.channel(FLAGS, path)? {
        FlatSamples::U32(flags) => content.image(flags.clone())?,
        _ => {
            return Err(ImagingError::PixelType {
                format: "exr",
                got: "flags that are not whole numbers".into(),
                expected: "a u32 channel",
            });
        }
    };
    Ok(ConfidenceMap {
        confidence: channel_of(&content, CONFIDENCE, path)?,
        sigma: rgb_of(&content, &SIGMA, path)?,
        sample_count: channel_of(&content, SAMPLE_COUNT, path)?,
        flags,
    })
}

/// A named part of a picture file.
#[derive(Debug, Clone, Copy)]
pub enum Layer<'a> {
    /// Channels `name.R`, `name.G`, `name.B`.
    Rgb(&'a str, &'a LinearImage),
    /// One channel `name`.
    Scalar(&'a str, &'a Image<f32>),
}

/// Writes layers of one size as f32 channels. Refuses layers of different sizes; no layer at all makes a file
/// without pixels, which is refused too.
pub fn write_layers_exr(path: &Path, layers: &[Layer<'_>]) -> Result<(), ImagingError> {
    let size = |layer: &Layer<'_>| match layer {
        Layer::Rgb(_, image) => (image.width(), image.height()),
        Layer::Scalar(_, image) => (image.width(), image.height()),
    };
    let (width, height) = layers.first().map_or((0, 0), size);
    let mut content = Content::new(width, height);
    let first = Image::new(width, height, ());
    for layer in layers {
        match layer {
            Layer::Rgb(name, image) => {
                first.require_same_size(image)?;
                let names = ["R", "G", "B"].map(|channel| format!("{name}.{channel}"));
                let names: [&str; 3] = std::array::from_fn(|channel| names[channel].as_str());
                add_rgb(&mut content, &names, image);
            }
            Layer::Scalar(name, image) => {
                first.require_same_size(image)?;
                content.add_channel(name, FlatSamples::F32(image.pixels().to_vec()));
            }
        }
    }
    write(path, content)
}

/// Reads one channel as f32: the one called `name`, else the first by name (files with one channel).
pub fn read_channel_exr(path: &Path, name: Option<&str>) -> Result<Image<f32>, ImagingError> {
    let content = read(path)?;
    let name = match name {
        Some(name) => name.to_owned(),
        None => content.first_channel(path)?,
    };
    channel_of(&content, &name, path)
}

fn add_rgb(content: &mut Content, names: &[&str; 3], image: &LinearImage) {
    for (channel, name) in names.iter().enumerate() {
        let samples = image.pixels().iter().map(|pixel| pixel[channel]).collect();
        content.add_channel(name, FlatSamples::F32(samples));
    }
}

fn rgb_of(content: &Content, names: &[&str; 3], path: &Path) -> Result<LinearImage, ImagingError> {
    let mut image = content.image(vec![[0.0; 3]; content.pixel_count()])?;
    for (channel, name) in names.iter().enumerate() {
        let samples = content.channel(name, path)?.values_as_f32();
        for (pixel, value) in image.pixels_mut().iter_mut().zip(samples) {
            pixel[channel] = value;
        }
    }
    Ok(image)
}

fn channel_of(content: &Content, name: &str, path: &Path) -> Result<Image<f32>, ImagingError> {
    content.image(content.channel(name, path)?.values_as_f32().collect())
}
