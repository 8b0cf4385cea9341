//! `glint render`: pictures from any path of views.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use geometry::{DQuat, DVec3, Pose};
use imaging::encode_png_rgb8;
use sequence::Recording;

use crate::color::srgb8_from_linear;
use crate::eval::model::Model;
use crate::progress::Progress;
use crate::run_folder::{RunFolder, write_atomically};
use crate::stages::observe::ColorView;
use crate::stages::poses::poses_of_run;
use crate::train::TrainConfig;

/// Where to draw from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewPath {
    /// Every pose of the recording.
    Recorded,
    /// A TUM file: `timestamp tx ty tz qx qy qz qw`, world from colour camera.
    File(PathBuf),
}

impl std::str::FromStr for ViewPath {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(if text == "recorded" {
            Self::Recorded
        } else {
            Self::File(text.into())
        })
    }
}

/// Reads a path of poses in TUM text; comments and empty lines are skipped.
pub fn read_tum(path: &Path) -> anyhow::Result<Vec<Pose>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read the path {}", path.display()))?;
    let mut poses = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let place = || format!("{} line {}", path.display(), number + 1);
        let values: Vec<f64> = line
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()
            .with_context(|| format!("{}: not a number", place()))?;
        let [_, tx, ty, tz, qx, qy, qz, qw] = values[..] else {
            bail!(
                "{}: a pose has 8 numbers (timestamp tx ty tz qx qy qz qw), here are {}",
                place(),
                values.len()
            );
        };
        let pose = Pose::new(DQuat::from_xyzw(qx, qy, qz, qw), DVec3::new(tx, ty, tz))
            .with_context(place)?;
        poses.push(pose);
    }
    if poses.is_empty() {
        bail!("{} holds no pose", path.display());
    }
    Ok(poses)
}

/// Draws every view of `path` into `output` as `NNNNNN.png` (sRGB, without vignetting); returns how many.
pub fn render(
    folder: &RunFolder,
    path: &ViewPath,
    output: &Path,
    progress: &Progress,
) -> anyhow::Result<usize> {
    let config: TrainConfig =
        toml::from_str(&std::fs::read_to_string(folder.path("config.toml"))?)?;
    let recording = Recording::open(&config.recording)?;
    let view = ColorView::new(&recording);
    let model = Model::load(folder)?;
    let world_from_color: Vec<(usize, Pose)> = match path {
        ViewPath::Recorded => poses_of_run(folder, &recording, &config.poses)?
            .iter()
            .enumerate()
            .filter_map(|(index, pose)| Some((index, (*pose)? * view.color_from_depth.inverse())))
            .collect(),
        ViewPath::File(file) => read_tum(file)?.into_iter().enumerate().collect(),
    };
    std::fs::create_dir_all(output).with_context(|| format!("cannot make {}", output.display()))?;
    progress.stage("render");
    for (done, (index, pose)) in world_from_color.iter().enumerate() {
        crate::interrupt::check()?;
        let surface_from_color = Pose::from_translation(-model.surface.origin) * *pose;
        let drawn = model.draw(&view.camera, &surface_from_color);
        let picture = drawn
            .composition
            .map(|linear| linear.map(srgb8_from_linear));
        write_atomically(
            &output.join(format!("{index:06}.png")),
            &encode_png_rgb8(&picture)?,
        )?;
        progress.step(done + 1, world_from_color.len());
    }
    Ok(world_from_color.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_file_is_read_and_bad_lines_name_their_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.txt");
        std::fs::write(
            &file,
            "# a comment\n\n0.0 1 2 3 0 0 0 1\n0.1 1 2 3 0 0 0 2\n",
        )
        .unwrap();
        let poses = read_tum(&file).unwrap();
        assert_eq!(poses.len(), 2);
        assert_eq!(poses[1].translation(), DVec3::new(1.0, 2.0, 3.0));
        for (bad, expected) in [
            ("0 1 2 3 0 0 0\n", "8 numbers"),
            ("0 1 2 x 0 0 0 1\n", "not a number"),
            ("0 1 2 3 0 0 0 0\n", "line 1"),
            ("# nothing\n", "holds no pose"),
        ] {
            std::fs::write(&file, bad).unwrap();
            let message = format!("{:#}", read_tum(&file).unwrap_err());
            assert!(message.contains(expected), "{message}");
        }
    }
}
