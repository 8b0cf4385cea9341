//! The mesh at the end of a recording: the surface of the volume with its colours, as PLY.

use std::fmt;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fusion::live::LiveFusion;
use fusion::{Mesh, MeshConfig, Volume, extract_mesh};
use geometry::DVec3;
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

/// Writes the surface beside `path` and gives it its name when it is whole. Another signal stops it.
pub fn write(live: LiveFusion, path: &Path, signal: &AnotherSignal) -> MeshOutcome {
    let mut outcome = MeshOutcome {
        path: path.to_path_buf(),
        vertices: 0,
        triangles: 0,
        problem: None,
    };
    tracing::info!(
        "mesh: looking for the surface of {} blocks",
        live.volume().block_count()
    );
    if let Err(error) = find_and_write(live, path, signal, &mut outcome) {
        outcome.problem = Some(format!("{error:#}"));
    }
    outcome
}

fn find_and_write(
    live: LiveFusion,
    path: &Path,
    signal: &AnotherSignal,
    outcome: &mut MeshOutcome,
) -> anyhow::Result<()> {
    // A thread of its own, which ends with the program when the user does not want to wait for it.
    let finding = std::thread::spawn(move || {
        let mesh = extract_mesh(live.volume(), &MeshConfig::default());
        let radiances = radiances(live.volume(), &mesh);
        (mesh, radiances)
    });
    while !finding.is_finished() {
        anyhow::ensure!(!signal.is_set(), "stopped by a signal");
        std::thread::sleep(LOOK_INTERVAL);
    }
    let found = finding.join();
    let (mesh, radiances) = found.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
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
    write_ply(&mut file, &mesh, radiances.as_deref(), signal)?;
    let part = file.into_inner()?;
    part.as_file().sync_all()?;
    part.persist(path)?;
    std::fs::File::open(folder)?.sync_all()?;
    Ok(())
}

/// Linear radiance of each vertex, mean of the coloured voxels around it; `None` in a volume without colour.
fn radiances(volume: &Volume, mesh: &Mesh) -> Option<Vec<[f32; 3]>> {
    if !volume.has_color() {
        return None;
    }
    let config = volume.config();
    let voxel_size = f64::from(config.voxel_size);
    let radiance = |vertex: usize| {
        let voxels = (mesh.world_position(vertex) - config.origin) / voxel_size;
        radiance_at(volume, voxels)
    };
    Some((0..mesh.positions.len()).map(radiance).collect())
}

/// Trilinear mean over the coloured ones of the eight voxels around a position; black where none is.
fn radiance_at(volume: &Volume, voxels: DVec3) -> [f32; 3] {
    let low = voxels.floor();
    let inside = voxels - low;
    let low = low.as_ivec3().to_array();
    let (mut sum, mut weight_sum) = ([0.0_f64; 3], 0.0_f64);
    for corner in 0..8 {
        let bits: [i32; 3] = std::array::from_fn(|axis| corner >> axis & 1);
        let voxel = std::array::from_fn(|axis| low[axis].saturating_add(bits[axis]));
        let Some((radiance, _)) = volume.voxel_radiance(voxel) else {
            continue;
        };
        // A voxel at the far end still counts a little: there may be no other.
        let weight: f64 = (0..3)
            .map(|axis| {
                if bits[axis] == 1 {
                    inside[axis]
                } else {
                    1.0 - inside[axis]
                }
            })
            .product::<f64>()
            .max(1e-6);
        weight_sum += weight;
        for (sum, radiance) in sum.iter_mut().zip(radiance) {
            *sum += weight * f64::from(radiance);
        }
    }
    sum.map(|sum| {
        if weight_sum > 0.0 {
            (sum / weight_sum) as f32
        } else {
            0.0
        }
    })
}

/// Binary little-endian PLY as the trainer writes it: position and normal, and with colours `red green blue` (sRGB)
/// and `linear_r linear_g linear_b`.
fn write_ply(
    file: &mut impl std::io::Write,
    mesh: &Mesh,
    radiances: Option<&[[f32; 3]]>,
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
    if radiances.is_some() {
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
        if let Some(linear) = radiances.and_then(|radiances| radiances.get(index)) {
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
