//! Which frames an `.oni` file holds, and where.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt as _;

use super::OniDamage;
use super::properties::{OniShape, Properties};
use super::record::{FILE_HEADER_LEN, Fields, Positions, RecordHeader, RecordKind};

/// Bytes that can be read at any place.
pub trait ReadAt {
    /// How many there are.
    ///
    /// # Errors
    /// What the system says.
    fn byte_count(&self) -> io::Result<u64>;

    /// Fills `bytes` from `offset` on.
    ///
    /// # Errors
    /// What the system says, and when the bytes end before.
    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()>;
}

impl ReadAt for File {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        self.read_exact_at(bytes, offset)
    }
}

impl ReadAt for &[u8] {
    fn byte_count(&self) -> io::Result<u64> {
        Ok((**self).len() as u64)
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        let start = usize::try_from(offset).unwrap_or(usize::MAX);
        let end = start.checked_add(bytes.len());
        let part = end.and_then(|end| self.get(start..end));
        bytes.copy_from_slice(part.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}

/// What a node films.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// Depth.
    Depth,
    /// Colour, or grey.
    Image,
    /// Infrared.
    Infrared,
    /// Anything else: the device, sound.
    Other,
}

/// How the frames of a node are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OniCodec {
    /// Raw samples.
    Raw,
    /// JPEG.
    Jpeg,
    /// 16z.
    Z16,
    /// 16z with a table.
    Z16Table,
    /// 8z.
    Z8,
    /// One that is not known, by its four characters.
    Unknown([u8; 4]),
}

impl OniCodec {
    fn of(name: [u8; 4]) -> Self {
        match &name {
            b"NONE" | b"NULL" | [0, 0, 0, 0] => Self::Raw,
            b"JPEG" => Self::Jpeg,
            b"16zP" => Self::Z16,
            b"16zT" => Self::Z16Table,
            b"Im8z" => Self::Z8,
            _ => Self::Unknown(name),
        }
    }
}

/// A frame of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct OniFrame {
    /// Microseconds.
    pub timestamp_us: u64,
    /// Counted by the writer, from 1.
    pub number: u32,
    /// Size and samples; `None` where the properties before it say nothing that can be believed.
    pub shape: Option<OniShape>,
    /// Where its bytes lie.
    pub payload: Range<u64>,
}

/// A stream of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct OniNode {
    /// What it films.
    pub kind: NodeKind,
    /// Its name, given by the writer.
    pub name: String,
    /// How its frames are coded.
    pub codec: OniCodec,
    /// The properties as they were before its first frame.
    pub properties: Properties,
    /// The frames in the order of the file.
    pub frames: Vec<OniFrame>,
    current: Properties,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct OniContents {
    /// The nodes in the order in which they were added.
    pub nodes: Vec<OniNode>,
    /// Where the file stops without an END record, if it does: the writer was cut off, or the bytes are damaged.
    pub cut_at: Option<u64>,
}

impl OniContents {
    /// Reads all records up to END or to where none can be read.
    ///
    /// # Errors
    /// When the bytes are no `.oni` file of a known version, or cannot be read at all.
    pub fn read(source: &impl ReadAt) -> Result<Self, OniDamage> {
        let mut header = [0; FILE_HEADER_LEN as usize];
        let len = source.byte_count().map_err(|error| OniDamage::io(&error))?;
        if len < FILE_HEADER_LEN {
            return Err(OniDamage::NoOni);
        }
        source
            .read_at(&mut header, 0)
            .map_err(|error| OniDamage::io(&error))?;
        let positions = Positions::of_file(&header)?;
        let mut reader = Reader {
            nodes: Vec::new(),
            by_id: BTreeMap::new(),
        };
        let mut at = FILE_HEADER_LEN;
        loop {
            match reader.record(source, positions, at, len)? {
                Step::Next(next) => at = next,
                Step::End => break,
                Step::Cut => {
                    return Ok(Self {
                        nodes: reader.nodes,
                        cut_at: Some(at),
                    });
                }
            }
        }
        Ok(Self {
            nodes: reader.nodes,
            cut_at: None,
        })
    }

    /// The first node of a kind that has frames, or else the first.
    pub fn node(&self, kind: NodeKind) -> Option<&OniNode> {
        let mut nodes = self.nodes.iter().filter(|node| node.kind == kind);
        let first = nodes.clone().next();
        nodes.find(|node| !node.frames.is_empty()).or(first)
    }
}

enum Step {
    Next(u64),
    End,
    Cut,
}

struct Reader {
    nodes: Vec<OniNode>,
    /// Place in `nodes` of the node that has a number now.
    by_id: BTreeMap<u32, usize>,
}

impl Reader {
    fn record(
        &mut self,
        source: &impl ReadAt,
        positions: Positions,
        at: u64,
        len: u64,
    ) -> Result<Step, OniDamage> {
        let header_len = positions.header_len();
        let left = len - at;
        if left < header_len as u64 {
            return Ok(Step::Cut);
        }
        let mut bytes = [0; 28];
        let bytes = &mut bytes[..header_len];
        read(source, bytes, at)?;
        let Some(header) = RecordHeader::read(bytes, positions) else {
            return Ok(Step::Cut);
        };
        // Sums of a few 32-bit sizes.
        let payload_at = at + (header_len + header.fields_len) as u64;
        let next = payload_at + u64::from(header.payload_len);
        if header.kind == RecordKind::End {
            return Ok(Step::End);
        }
        if next > len {
            return Ok(Step::Cut);
        }
        if header.kind != RecordKind::Other {
            let mut fields = vec![0; header.fields_len];
            read(source, &mut fields, at + header_len as u64)?;
            if self.take(&header, &fields, payload_at..next).is_none() {
                return Ok(Step::Cut);
            }
        }
        Ok(Step::Next(next))
    }

    /// Takes a record; `None` when its fields are not what its kind has.
    fn take(&mut self, header: &RecordHeader, fields: &[u8], payload: Range<u64>) -> Option<()> {
        let mut words = Fields(fields);
        match header.kind {
            RecordKind::NodeAdded => {
                let name = words.text()?;
                let kind = match words.u32()? {
                    2 => NodeKind::Depth,
                    3 => NodeKind::Image,
                    5 => NodeKind::Infrared,
                    _ => NodeKind::Other,
                };
                let codec = OniCodec::of(words.u32()?.to_le_bytes());
                self.by_id.insert(header.node, self.nodes.len());
                self.nodes.push(OniNode {
                    kind,
                    name,
                    codec,
                    properties: Properties::default(),
                    frames: Vec::new(),
                    current: Properties::default(),
                });
            }
            RecordKind::NewData => {
                let (timestamp_us, number) = (words.u64()?, words.u32()?);
                let node = self.node(header.node)?;
                if (timestamp_us, number) == (0, 0) {
                    // OpenNI's player skips it too.
                    return Some(());
                }
                if node.frames.is_empty() {
                    node.properties = node.current.clone();
                }
                node.frames.push(OniFrame {
                    timestamp_us,
                    number,
                    shape: node.current.shape(node.kind == NodeKind::Depth),
                    payload,
                });
            }
            RecordKind::End | RecordKind::Other => {}
            kind => self.node(header.node)?.current.take(kind, fields)?,
        }
        Some(())
    }

    fn node(&mut self, id: u32) -> Option<&mut OniNode> {
        self.nodes.get_mut(*self.by_id.get(&id)?)
    }
}

fn read(source: &impl ReadAt, bytes: &mut [u8], at: u64) -> Result<(), OniDamage> {
    source
        .read_at(bytes, at)
        .map_err(|error| OniDamage::io(&error))
}
