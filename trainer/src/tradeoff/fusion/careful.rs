//! The mesh of a run that spares nothing: what the meshes of the points are compared with where the true shape is
//! not known. It says what a cheaper setting loses, not how right the shape is.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, ensure};

use super::world::reference_from_live;
use super::{FusionRunner, LIVE_MESH, LIVE_RECORDING, judge};
use crate::eval::mesh::read_mesh;
use crate::ply::{PlyMesh, to_bytes};
use crate::progress::Progress;
use crate::run_folder::write_atomically;
use crate::tradeoff::child::{self, PointStatus};
use crate::tradeoff::subject::{PointRunner as _, Setting};

/// The finest level of every knob that stays within memory.
const LEVELS: &[(&str, &str)] = &[
    ("voxel-mm", "4"),
    ("truncation-voxels", "6"),
    ("fuse-stride", "1"),
    ("view-level", "0"),
    ("icp-iterations", "10/5/4"),
    ("photometric", "on"),
];

/// The mesh in `output`, in the world of the recording's `source` poses; made where it is not there yet.
/// `key` names recorder and recording: a mesh of others is not taken.
///
/// # Errors
/// When the recorder fails, its path cannot be aligned, or the mesh cannot be written.
pub fn careful_mesh(
    runner: &FusionRunner,
    output: &Path,
    key: &str,
    timeout: Duration,
    progress: &Progress,
) -> anyhow::Result<PathBuf> {
    let path = output.join(format!("fusion.reference-{key}.ply"));
    if path.exists() {
        return Ok(path);
    }
    progress.stage("reference");
    std::fs::create_dir_all(output).with_context(|| format!("cannot make {}", output.display()))?;
    let desk = tempfile::Builder::new()
        .prefix(".reference-")
        .tempdir_in(output)
        .with_context(|| format!("cannot write in {}", output.display()))?;
    let setting: Setting = LEVELS
        .iter()
        .map(|(knob, level)| ((*knob).to_owned(), (*level).to_owned()))
        .collect();
    let asking = FusionRunner {
        mesh: Some(path.clone()),
        ..runner.clone()
    };
    let ended = child::run(asking.command(&setting, desk.path())?, desk.path(), timeout)?;
    ensure!(
        ended.status == PointStatus::Ok,
        "the mesh to compare with could not be made ({}): {}; give one with --reference-mesh",
        ended.status,
        ended.reason
    );
    let recording = sequence::Recording::open(&desk.path().join(LIVE_RECORDING))?;
    let (source_from_live, _) = reference_from_live(&recording, &judge(&recording)?)?;
    let mesh = read_mesh(&desk.path().join(LIVE_MESH))?;
    let moved = |position: &glam::Vec3| {
        source_from_live
            .transform_point(mesh.origin + position.as_dvec3())
            .as_vec3()
    };
    let moved = PlyMesh {
        positions: mesh.positions.iter().map(moved).collect(),
        triangles: mesh.triangles,
        ..PlyMesh::default()
    };
    write_atomically(&path, &to_bytes(&moved))?;
    Ok(path)
}
