//! `glint simulate`: a recording of a scene that does not exist, and everything that is true of it beside it.
//!
//! `recording` frames into the file, as a camera would send them · `truth` the folder beside it · `reach` which
//! directions the capture can know.
//!
//! The recording holds what a camera knows, and nothing else: shifts, a colour mosaic, poses of the set `source`, the
//! split. Training never sees the truth folder.

mod reach;
mod recording;
mod truth;

use std::path::{Path, PathBuf};

use effects::EffectRequests;
use imaging::read_rgb_exr;
use scene::{Film, FilmOptions, catalogue};
use serde::Serialize;

use self::recording::split_of;
pub use self::recording::write_recording;
use crate::clock::{Cost, Stopwatch};

/// What to film.
#[derive(Clone, Debug)]
pub struct SimulateOptions {
    /// Name of the scene.
    pub scene: String,
    /// Recording to write.
    pub output: PathBuf,
    /// Frames over the whole path; the scene's own number when absent.
    pub frame_count: Option<u32>,
    /// Width of the images, pixels.
    pub width: u32,
    /// Seed of all noise.
    pub seed: u64,
    /// Effects that are asked for or refused; the others are as the scene has them.
    pub effects: EffectRequests,
    /// Panorama in place of the room.
    pub environment: Option<PathBuf>,
    /// What is done to the capture on purpose.
    pub switches: Switches,
    /// Every how many frames have their truth written as pictures.
    pub truth_every: u32,
    /// Whether a truth folder that is there goes.
    pub may_replace: bool,
}

/// What is done to a capture on purpose, beside what the scene does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Switches {
    /// Seconds from the first row of the colour sensor to the last.
    pub readout: f64,
    /// Seconds that a row sees.
    pub exposure: f64,
    /// Whether the person who films is seen.
    pub has_operator: bool,
    /// Deviation of the recorded poses, millimetres and degrees.
    pub pose_noise: Option<[f64; 2]>,
    /// Deviation of the surface that the depth sensor meets, millimetres.
    pub mesh_noise_mm: Option<f64>,
    /// Factor of that surface.
    pub mesh_scale: Option<f64>,
}

/// What was filmed.
#[derive(Clone, Debug, Serialize)]
pub struct SimulateReport {
    /// The scene.
    pub scene: String,
    /// The recording.
    pub output: PathBuf,
    /// The folder of the truth.
    pub truth: PathBuf,
    /// Frames.
    pub frame_count: u32,
    /// Of these for training.
    pub train_count: usize,
    /// Left out.
    pub unused_count: usize,
    /// Held out.
    pub test_count: usize,
    /// Effects that were simulated.
    pub effects: String,
    /// Length of the recording.
    pub bytes: u64,
    /// Cost of the whole.
    pub cost: Cost,
}

/// Where the truth of a recording goes: `x.truth` for `x.glint`.
pub fn truth_folder(output: &Path) -> PathBuf {
    output.with_extension("truth")
}

/// Films a scene; `progress(done, of)` is called as frames are written. Neither the recording nor the folder has its
/// name before it is complete.
///
/// # Errors
/// Unknown scenes, an environment that cannot be read, and what the disk refuses.
pub fn simulate(
    options: &SimulateOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<SimulateReport> {
    let watch = Stopwatch::start();
    let film = film_of(options)?;
    let split = split_of(&film);
    let truth = truth::begin(options, &truth_folder(&options.output))?;
    let identity = SimulateOptions {
        output: PathBuf::new(),
        ..options.clone()
    };
    let identity = format!("{identity:?}");
    let bytes = write_recording(&film, &identity, &options.output, progress)?;
    truth::write(&film, options, &split, truth)?;
    Ok(SimulateReport {
        scene: options.scene.clone(),
        output: options.output.clone(),
        truth: truth_folder(&options.output),
        frame_count: film.frame_count(),
        train_count: split.train.len(),
        unused_count: split.unused.len(),
        test_count: split.test.len(),
        effects: film.effects().to_string(),
        bytes,
        cost: watch.cost(),
    })
}

/// The scene with what is asked of it.
fn film_of(options: &SimulateOptions) -> anyhow::Result<Film> {
    let mut design = catalogue::design(&options.scene)?;
    let switches = &options.switches;
    design.shutter.readout += switches.readout;
    design.shutter.exposure += switches.exposure;
    design.has_operator |= switches.has_operator;
    if let Some([millimetres, degrees]) = switches.pose_noise {
        design.errors.pose_translation = 1e-3 * millimetres;
        design.errors.pose_rotation = degrees.to_radians();
        design.effects = design.effects.with(effects::Effect::PoseRefinement);
    }
    if let Some(millimetres) = switches.mesh_noise_mm {
        design.errors.mesh_noise = (1e-3 * millimetres) as f32;
    }
    if let Some(scale) = switches.mesh_scale {
        design.errors.mesh_scale = Some(scale as f32);
    }
    let environment = match &options.environment {
        Some(path) => Some(read_rgb_exr(path)?.0),
        None => None,
    };
    let effects = options.effects.resolve(design.effects);
    let film = Film::of(
        design,
        FilmOptions {
            width: options.width,
            frame_count: options.frame_count,
            seed: options.seed,
            effects: Some(effects),
            environment,
            ..FilmOptions::default()
        },
    )?;
    Ok(film)
}
