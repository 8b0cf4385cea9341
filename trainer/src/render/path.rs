//! Where views are drawn from.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use geometry::{DQuat, DVec3, Pose};

/// Where to draw from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewPath {
    /// Every pose of the recording.
    Recorded,
    /// Every held-out pose of the recording.
    Test,
    /// A TUM file: `timestamp tx ty tz qx qy qz qw`, world from colour camera.
    File(PathBuf),
}

impl std::str::FromStr for ViewPath {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "recorded" => Self::Recorded,
            "test" => Self::Test,
            file => Self::File(file.into()),
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
