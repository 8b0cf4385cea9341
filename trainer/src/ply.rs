//! Binary little-endian PLY: meshes as other programs read them, and our own read back.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, bail, ensure};
use glam::{DVec3, Vec3};

/// A mesh as it lies in a file: positions in world metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyMesh {
    /// World positions minus `origin`, metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, facing away from the surface.
    pub normals: Vec<Vec3>,
    /// Linear radiance a vertex, or empty.
    pub linear: Vec<[f32; 3]>,
    /// Segment of the object a vertex belongs to, 0 = background, or empty.
    pub segments: Vec<u16>,
    /// Vertex indices, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// World position that `positions` count from.
    pub origin: DVec3,
}

/// The file's bytes. Colours are written twice: `red green blue` (sRGB, 8 bit, for viewers) and
/// `linear_r linear_g linear_b` (f32, white level 1).
pub fn to_bytes(mesh: &PlyMesh) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    let _ = writeln!(
        header,
        "comment metres; world axes x-right y-down z-forward"
    );
    let _ = writeln!(
        header,
        "comment origin {} {} {}",
        mesh.origin.x, mesh.origin.y, mesh.origin.z
    );
    let _ = writeln!(header, "element vertex {}", mesh.positions.len());
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        let _ = writeln!(header, "property float {name}");
    }
    let (has_color, has_segment) = (!mesh.linear.is_empty(), !mesh.segments.is_empty());
    if has_color {
        for name in ["red", "green", "blue"] {
            let _ = writeln!(header, "property uchar {name}");
        }
        for name in ["linear_r", "linear_g", "linear_b"] {
            let _ = writeln!(header, "property float {name}");
        }
    }
    if has_segment {
        let _ = writeln!(header, "property ushort segment");
    }
    let _ = writeln!(header, "element face {}", mesh.triangles.len());
    let _ = writeln!(header, "property list uchar int vertex_indices\nend_header");
    let mut bytes = header.into_bytes();
    for (index, position) in mesh.positions.iter().enumerate() {
        let normal = mesh.normals.get(index).copied().unwrap_or(Vec3::ZERO);
        for value in position.to_array().into_iter().chain(normal.to_array()) {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        if has_color {
            let linear = mesh.linear[index];
            bytes.extend(linear.map(crate::color::srgb8_from_linear));
            for value in linear {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
        }
        if has_segment {
            bytes.extend_from_slice(&mesh.segments[index].to_le_bytes());
        }
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        for index in triangle {
            bytes.extend_from_slice(&index.to_le_bytes());
        }
    }
    bytes
}

/// Reads a mesh that [`to_bytes`] wrote; other layouts are refused.
pub fn from_file(path: &Path) -> anyhow::Result<PlyMesh> {
    let bytes =
        std::fs::read(path).with_context(|| format!("cannot read the mesh {}", path.display()))?;
    from_bytes(&bytes).with_context(|| format!("{} is not a mesh of a run folder", path.display()))
}

fn from_bytes(bytes: &[u8]) -> anyhow::Result<PlyMesh> {
    const END: &[u8] = b"end_header\n";
    let header_end = bytes
        .windows(END.len())
        .take(4096)
        .position(|window| window == END)
        .context("the header has no end")?;
    let header = std::str::from_utf8(&bytes[..header_end])?;
    let mut mesh = PlyMesh::default();
    let (mut vertex_count, mut face_count, mut properties) = (0_usize, 0_usize, Vec::new());
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["comment", "origin", x, y, z] => {
                mesh.origin = DVec3::new(x.parse()?, y.parse()?, z.parse()?);
            }
            ["element", "vertex", count] => vertex_count = count.parse()?,
            ["element", "face", count] => face_count = count.parse()?,
            ["property", "list", ..] | ["comment", ..] | ["ply"] | ["format", ..] => {}
            ["property", kind, name] => properties.push((*kind, *name)),
            _ => bail!("unknown header line `{line}`"),
        }
    }
    let has_color = properties.iter().any(|(_, name)| *name == "linear_r");
    let has_segment = properties.iter().any(|(_, name)| *name == "segment");
    ensure!(
        properties.len() == 6 + 6 * usize::from(has_color) + usize::from(has_segment),
        "its vertex properties are not ours"
    );
    let stride = 24 + 15 * usize::from(has_color) + 2 * usize::from(has_segment);
    let body = &bytes[header_end + END.len()..];
    let vertex_bytes = vertex_count
        .checked_mul(stride)
        .context("the vertex count is absurd")?;
    let face_bytes = face_count
        .checked_mul(13)
        .context("the face count is absurd")?;
    ensure!(
        Some(body.len()) == vertex_bytes.checked_add(face_bytes),
        "it is cut short"
    );
    let float = |at: &[u8]| f32::from_le_bytes([at[0], at[1], at[2], at[3]]);
    for vertex in body[..vertex_bytes].chunks_exact(stride) {
        let at = |index: usize| float(&vertex[index * 4..]);
        mesh.positions.push(Vec3::new(at(0), at(1), at(2)));
        mesh.normals.push(Vec3::new(at(3), at(4), at(5)));
        if has_color {
            mesh.linear.push([
                float(&vertex[27..]),
                float(&vertex[31..]),
                float(&vertex[35..]),
            ]);
        }
        if has_segment {
            mesh.segments
                .push(u16::from_le_bytes([vertex[stride - 2], vertex[stride - 1]]));
        }
    }
    for face in body[vertex_bytes..].chunks_exact(13) {
        let index =
            |at: usize| u32::from_le_bytes([face[at], face[at + 1], face[at + 2], face[at + 3]]);
        let triangle = [index(1), index(5), index(9)];
        ensure!(
            face[0] == 3 && triangle.iter().all(|&i| (i as usize) < vertex_count),
            "a face names a vertex that does not exist"
        );
        mesh.triangles.push(triangle);
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> PlyMesh {
        PlyMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            linear: vec![[0.1, 0.2, 0.3]; 3],
            segments: vec![0, 1, 2],
            triangles: vec![[0, 1, 2]],
            origin: DVec3::new(1.5, -2.0, 0.25),
        }
    }

    #[test]
    fn a_mesh_comes_back_as_it_was_written() {
        for with_color in [false, true] {
            for with_segment in [false, true] {
                let mut mesh = sample();
                if !with_color {
                    mesh.linear.clear();
                }
                if !with_segment {
                    mesh.segments.clear();
                }
                assert_eq!(from_bytes(&to_bytes(&mesh)).unwrap(), mesh);
            }
        }
    }

    #[test]
    fn a_cut_or_lying_file_is_refused() {
        let bytes = to_bytes(&sample());
        for length in 0..bytes.len() {
            assert!(from_bytes(&bytes[..length]).is_err());
        }
        let mut lying = bytes.clone();
        let last = lying.len() - 1;
        lying[last] = 0x7f;
        assert!(from_bytes(&lying).is_err());
    }
}
