//! Triangle meshes of any PLY file: text or binary, either byte order, whatever properties.

use std::path::Path;

use anyhow::{Context as _, bail, ensure};
use glam::{DVec3, Vec3};

/// A triangle mesh as other programs and `glint` write it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceMesh {
    /// World positions minus `origin`, metres.
    pub positions: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// World position that `positions` count from.
    pub origin: DVec3,
}

/// Longest header, bytes.
const LONGEST_HEADER: usize = 64 << 10;
/// Longest element that has a name we know: a polygon of a hundred corners is no mesh of a surface.
const MOST_CORNERS: usize = 100;

/// Reads a mesh; polygons become fans of triangles.
///
/// # Errors
/// When the file cannot be read, is no PLY file, is cut short, or names vertices that do not exist.
pub fn read_mesh(path: &Path) -> anyhow::Result<SurfaceMesh> {
    let bytes =
        std::fs::read(path).with_context(|| format!("cannot read the mesh {}", path.display()))?;
    let mesh =
        from_bytes(&bytes).with_context(|| format!("{} is no usable PLY mesh", path.display()))?;
    ensure!(
        !mesh.triangles.is_empty(),
        "{} has no triangles: give a mesh, not points",
        path.display()
    );
    Ok(mesh)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Text,
    LittleEndian,
    BigEndian,
}

/// A number type of the format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Int8,
    Uint8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Float32,
    Float64,
}

impl Kind {
    fn of(name: &str) -> anyhow::Result<Self> {
        Ok(match name {
            "char" | "int8" => Self::Int8,
            "uchar" | "uint8" => Self::Uint8,
            "short" | "int16" => Self::Int16,
            "ushort" | "uint16" => Self::Uint16,
            "int" | "int32" => Self::Int32,
            "uint" | "uint32" => Self::Uint32,
            "float" | "float32" => Self::Float32,
            "double" | "float64" => Self::Float64,
            other => bail!("`{other}` is no number type"),
        })
    }
}

struct Property {
    name: String,
    /// Type of the length of a list.
    length: Option<Kind>,
    kind: Kind,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Header {
    format: Format,
    elements: Vec<Element>,
    origin: DVec3,
}

fn header(text: &str) -> anyhow::Result<Header> {
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut origin = DVec3::ZERO;
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["format", "ascii", _] => format = Some(Format::Text),
            ["format", "binary_little_endian", _] => format = Some(Format::LittleEndian),
            ["format", "binary_big_endian", _] => format = Some(Format::BigEndian),
            ["comment", "origin", x, y, z] => {
                if let (Ok(x), Ok(y), Ok(z)) = (x.parse(), y.parse(), z.parse()) {
                    origin = DVec3::new(x, y, z);
                }
            }
            ["element", name, count] => elements.push(Element {
                name: (*name).to_owned(),
                count: count.parse().context("an element has no count")?,
                properties: Vec::new(),
            }),
            ["property", "list", length, kind, name] => push_property(
                &mut elements,
                Property {
                    name: (*name).to_owned(),
                    length: Some(Kind::of(length)?),
                    kind: Kind::of(kind)?,
                },
            )?,
            ["property", kind, name] => push_property(
                &mut elements,
                Property {
                    name: (*name).to_owned(),
                    length: None,
                    kind: Kind::of(kind)?,
                },
            )?,
            _ => {}
        }
    }
    ensure!(origin.is_finite(), "its origin is not a number");
    Ok(Header {
        format: format.context("the header names no format")?,
        elements,
        origin,
    })
}

fn push_property(elements: &mut [Element], property: Property) -> anyhow::Result<()> {
    let element = elements
        .last_mut()
        .context("a property stands before its element")?;
    element.properties.push(property);
    Ok(())
}

/// The numbers of the body, one after the other.
enum Body<'a> {
    Text(std::str::SplitAsciiWhitespace<'a>),
    Binary { rest: &'a [u8], is_big: bool },
}

impl Body<'_> {
    fn next(&mut self, kind: Kind) -> anyhow::Result<f64> {
        match self {
            Self::Text(words) => {
                let word = words.next().context("it is cut short")?;
                word.parse()
                    .with_context(|| format!("`{word}` is no number"))
            }
            Self::Binary { rest, is_big } => match kind {
                Kind::Int8 => take::<1>(rest, *is_big).map(|b| f64::from(i8::from_le_bytes(b))),
                Kind::Uint8 => take::<1>(rest, *is_big).map(|b| f64::from(b[0])),
                Kind::Int16 => take(rest, *is_big).map(|b| f64::from(i16::from_le_bytes(b))),
                Kind::Uint16 => take(rest, *is_big).map(|b| f64::from(u16::from_le_bytes(b))),
                Kind::Int32 => take(rest, *is_big).map(|b| f64::from(i32::from_le_bytes(b))),
                Kind::Uint32 => take(rest, *is_big).map(|b| f64::from(u32::from_le_bytes(b))),
                Kind::Float32 => take(rest, *is_big).map(|b| f64::from(f32::from_le_bytes(b))),
                Kind::Float64 => take(rest, *is_big).map(f64::from_le_bytes),
            },
        }
    }

    /// A length or index: a whole number that is not negative.
    fn next_index(&mut self, kind: Kind) -> anyhow::Result<usize> {
        let value = self.next(kind)?;
        ensure!(
            value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0,
            "{value} is no index"
        );
        // Exact: checked above.
        Ok(value as usize)
    }
}

/// The next bytes as little-endian ones.
fn take<const N: usize>(rest: &mut &[u8], is_big: bool) -> anyhow::Result<[u8; N]> {
    let (head, tail) = rest.split_first_chunk::<N>().context("it is cut short")?;
    *rest = tail;
    let mut bytes = *head;
    if is_big {
        bytes.reverse();
    }
    Ok(bytes)
}

fn from_bytes(bytes: &[u8]) -> anyhow::Result<SurfaceMesh> {
    ensure!(bytes.starts_with(b"ply"), "it does not begin with `ply`");
    const END: &[u8] = b"end_header";
    let end = bytes
        .windows(END.len())
        .take(LONGEST_HEADER)
        .position(|window| window == END)
        .context("the header has no end")?;
    let header = header(std::str::from_utf8(&bytes[..end]).context("the header is no text")?)?;
    // One line break, of one byte or two.
    let body = match &bytes[end + END.len()..] {
        [b'\r', b'\n', body @ ..] | [b'\n', body @ ..] => body,
        _ => bail!("the header has no end"),
    };
    let mut body = match header.format {
        Format::Text => {
            let text = std::str::from_utf8(body).context("the numbers are no text")?;
            Body::Text(text.split_ascii_whitespace())
        }
        Format::LittleEndian | Format::BigEndian => Body::Binary {
            rest: body,
            is_big: header.format == Format::BigEndian,
        },
    };
    let mut points: Vec<DVec3> = Vec::new();
    let mut triangles = Vec::new();
    // An element without properties takes no bytes: its count could be anything.
    for element in header.elements.iter().filter(|e| !e.properties.is_empty()) {
        for _ in 0..element.count {
            match element.name.as_str() {
                "vertex" => points.push(vertex(&mut body, element)?),
                "face" => face(&mut body, element, &mut triangles)?,
                _ => skip(&mut body, element)?,
            }
        }
    }
    let is_known = |index: &u32| (*index as usize) < points.len();
    ensure!(
        triangles.iter().flatten().all(is_known),
        "a face names a vertex that does not exist"
    );
    // Near the mesh, so that f32 keeps its digits.
    let near = points.iter().copied().find(|point| point.is_finite());
    let near = near.unwrap_or(DVec3::ZERO).round();
    Ok(SurfaceMesh {
        positions: points.iter().map(|p| (*p - near).as_vec3()).collect(),
        triangles,
        origin: header.origin + near,
    })
}

fn vertex(body: &mut Body<'_>, element: &Element) -> anyhow::Result<DVec3> {
    let mut point = [f64::NAN; 3];
    for property in &element.properties {
        ensure!(property.length.is_none(), "a vertex holds a list");
        let value = body.next(property.kind)?;
        if let Some(axis) = ["x", "y", "z"].iter().position(|n| *n == property.name) {
            point[axis] = value;
        }
    }
    Ok(DVec3::from_array(point))
}

fn face(
    body: &mut Body<'_>,
    element: &Element,
    triangles: &mut Vec<[u32; 3]>,
) -> anyhow::Result<()> {
    for property in &element.properties {
        let Some(length) = property.length else {
            body.next(property.kind)?;
            continue;
        };
        let count = body.next_index(length)?;
        ensure!(count <= MOST_CORNERS, "a face has {count} corners");
        if !matches!(property.name.as_str(), "vertex_indices" | "vertex_index") {
            for _ in 0..count {
                body.next(property.kind)?;
            }
            continue;
        }
        let mut corners = [0_u32; MOST_CORNERS];
        for corner in &mut corners[..count] {
            *corner = body.next_index(property.kind)? as u32;
        }
        for pair in corners[..count].windows(2).skip(1) {
            triangles.push([corners[0], pair[0], pair[1]]);
        }
    }
    Ok(())
}

fn skip(body: &mut Body<'_>, element: &Element) -> anyhow::Result<()> {
    for property in &element.properties {
        let count = match property.length {
            Some(length) => body.next_index(length)?,
            None => 1,
        };
        for _ in 0..count {
            body.next(property.kind)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "ply\nformat ascii 1.0\ncomment origin 1 2 3\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nelement edge 1\nproperty list uchar int v\nend_header\n100000 0 0 7\n100001 0 0 7\n100001 1 0 7\n100000 1 0 7\n4 0 1 2 3\n2 0 1\n";

    #[test]
    fn polygons_become_fans_and_far_origins_keep_their_digits() {
        let mesh = from_bytes(TEXT.as_bytes()).unwrap();
        assert_eq!(mesh.origin, DVec3::new(100_001.0, 2.0, 3.0));
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions[2], Vec3::new(1.0, 1.0, 0.0));
    }

    fn binary(order: &str, bytes: impl Fn(f64, usize) -> Vec<u8>) -> Vec<u8> {
        let mut file = format!(
            "ply\r\nformat {order} 1.0\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\nelement face 1\r\nproperty list uchar uint vertex_index\r\nend_header\r\n"
        )
        .into_bytes();
        for value in [0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 2.5, 0.0] {
            file.extend(bytes(value, 4));
        }
        file.push(3);
        for index in [0.0, 1.0, 2.0] {
            file.extend(bytes(index, 0));
        }
        file
    }

    #[test]
    fn both_byte_orders_are_read() {
        let little = binary("binary_little_endian", |v, float| match float {
            0 => (v as u32).to_le_bytes().to_vec(),
            _ => (v as f32).to_le_bytes().to_vec(),
        });
        let big = binary("binary_big_endian", |v, float| match float {
            0 => (v as u32).to_be_bytes().to_vec(),
            _ => (v as f32).to_be_bytes().to_vec(),
        });
        let mesh = from_bytes(&little).unwrap();
        assert_eq!(mesh.positions[1], Vec3::new(1.5, 0.0, 0.0));
        assert_eq!(mesh, from_bytes(&big).unwrap());
        for length in 0..little.len() {
            assert!(from_bytes(&little[..length]).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn lies_are_refused_without_their_size() {
        for (from, to) in [
            ("vertex 4", "vertex 400000000000"),
            ("vertex 4", "vertex -4"),
            ("4 0 1 2 3", "4 0 1 2 4"),
            ("4 0 1 2 3", "4000000000 0 1 2 3"),
            ("4 0 1 2 3", "4 0 1 -2 3"),
            ("4 0 1 2 3", "4 0 1 nan 3"),
            ("double x", "quaternion x"),
            ("ascii", "gzip"),
            ("origin 1 2 3", "origin inf 2 3"),
            ("end_header", "end"),
        ] {
            assert!(
                from_bytes(TEXT.replacen(from, to, 1).as_bytes()).is_err(),
                "{to}"
            );
        }
        let idle = TEXT.replacen(
            "element vertex",
            "element void 99999999999999\nelement vertex",
            1,
        );
        assert!(from_bytes(idle.as_bytes()).is_ok());
    }
}
