//! Meshes for the peers' scripts.

use std::io::{BufWriter, Write as _};

use fusion::Mesh;

/// Writes a mesh as binary PLY, positions from its origin.
pub(crate) fn write_ply(mesh: &Mesh, path: &str) -> std::io::Result<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    writeln!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}",
        mesh.positions.len()
    )?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    writeln!(
        out,
        "element face {}\nproperty list uchar int vertex_indices\nend_header",
        mesh.triangles.len()
    )?;
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        for value in position.to_array().into_iter().chain(normal.to_array()) {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        for vertex in triangle {
            out.write_all(&vertex.to_le_bytes())?;
        }
    }
    out.flush()
}
