//! The mesh at the end of a recording: the surface of the volume with its colours, as PLY.

use std::fmt;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fusion::live::LiveFusion;
use fusion::{Mesh, MeshConfig, extract_mesh};
use imaging::Srgb8;
use serde::Serialize;

use crate::status::AnotherSignal;

/// What came of the mesh.
#[derive(Clone, Debug, Serialize)]
pub struct MeshOutcome {
    /// Where it is, or should be.
    pub path: PathBuf,
    /// Its vertices.
    pub vertices: u64,
    /// Its triangles.
    pub triangles: u64,
    /// Why it was not written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

/// Time between two looks at the signal while the surface is looked for.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);
/// Vertices or triangles between two looks while writing.
const LOOK_EVERY: usize = 1 << 14;

/// Writes the surface of `map` beside `path` and gives it its name when it is whole. Another signal stops it.
pub fn write(live: LiveFusion, map: u32, path: &Path, signal: &AnotherSignal) -> MeshOutcome {
    let mut outcome = MeshOutcome {
        path: path.to_path_buf(),
        vertices: 0,
        triangles: 0,
        problem: None,
    };
    tracing::info!("mesh: looking for the surface of map {map}");
    if let Err(error) = find_and_write(live, map, path, signal, &mut outcome) {
        outcome.problem = Some(format!("{error:#}"));
    }
    outcome
}

fn find_and_write(
    live: LiveFusion,
    map: u32,
    path: &Path,
    signal: &AnotherSignal,
    outcome: &mut MeshOutcome,
) -> anyhow::Result<()> {
    // A thread of its own, which ends with the program when the user does not want to wait for it.
    let finding = std::thread::spawn(move || {
        let volume = live.map_volume(map).unwrap_or_else(|| live.volume());
        extract_mesh(volume, &MeshConfig::default())
    });
    while !finding.is_finished() {
        anyhow::ensure!(!signal.is_set(), "stopped by a signal");
        std::thread::sleep(LOOK_INTERVAL);
    }
    let found = finding.join();
    let mesh = found.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    outcome.vertices = mesh.positions.len() as u64;
    outcome.triangles = mesh.triangles.len() as u64;
    tracing::info!("mesh: writing {} triangles", outcome.triangles);
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let part = tempfile::Builder::new()
        .prefix(".glint-")
        .suffix(".part")
        .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666))
        .tempfile_in(folder)?;
    let mut file = BufWriter::new(part);
    write_ply(&mut file, &mesh, signal)?;
    let part = file.into_inner()?;
    part.as_file().sync_all()?;
    part.persist(path)?;
    std::fs::File::open(folder)?.sync_all()?;
    Ok(())
}

/// Binary little-endian PLY as the trainer writes it: position and normal, and with colours `red green blue` (sRGB)
/// and `linear_r linear_g linear_b`.
fn write_ply(
    file: &mut impl std::io::Write,
    mesh: &Mesh,
    signal: &AnotherSignal,
) -> anyhow::Result<()> {
    writeln!(file, "ply\nformat binary_little_endian 1.0")?;
    writeln!(file, "comment metres; world axes x-right y-down z-forward")?;
    let origin = mesh.origin;
    writeln!(
        file,
        "comment origin {} {} {}",
        origin.x, origin.y, origin.z
    )?;
    writeln!(file, "element vertex {}", mesh.positions.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(file, "property float {name}")?;
    }
    if !mesh.radiance.is_empty() {
        for name in ["red", "green", "blue"] {
            writeln!(file, "property uchar {name}")?;
        }
        for name in ["linear_r", "linear_g", "linear_b"] {
            writeln!(file, "property float {name}")?;
        }
    }
    writeln!(file, "element face {}", mesh.triangles.len())?;
    writeln!(file, "property list uchar int vertex_indices\nend_header")?;
    for (index, (position, normal)) in mesh.positions.iter().zip(&mesh.normals).enumerate() {
        if index % LOOK_EVERY == 0 {
            anyhow::ensure!(!signal.is_set(), "stopped by a signal");
        }
        for value in position.to_array().into_iter().chain(normal.to_array()) {
            file.write_all(&value.to_le_bytes())?;
        }
        if let Some(linear) = mesh.radiance.get(index) {
            file.write_all(&Srgb8::from_linear(*linear).0)?;
            for value in linear {
                file.write_all(&value.to_le_bytes())?;
            }
        }
    }
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        if index % LOOK_EVERY == 0 {
            anyhow::ensure!(!signal.is_set(), "stopped by a signal");
        }
        file.write_all(&[3])?;
        for vertex in triangle {
            file.write_all(&vertex.to_le_bytes())?;
        }
    }
    file.flush()?;
    Ok(())
}

impl fmt::Display for MeshOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.display();
        match &self.problem {
            Some(problem) => write!(f, "no mesh in {path}: {problem}"),
            None => write!(f, "mesh: {path}, {} triangles", self.triangles),
        }
    }
}
