//! Channels and attributes of one flat layer, to and from the `exr` crate.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::attribute::AttributeValue;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image as ExrImage,
    ImageAttributes, IntegerBounds, Layer, LayerAttributes, LineOrder, ReadChannels as _,
    ReadLayers as _, SmallVec, WritableImage as _,
};

use crate::error::ImagingError;
use crate::files::require_plausible_size;
use crate::image::Image;
use crate::whole_file::write_whole_file;

const FORMAT: &str = "exr";

/// Names and values; few, so a list beats a map and keeps its order.
type Attributes = Vec<(String, AttributeValue)>;

/// What an EXR file holds for us: channels of one size and the attributes that are not the format's own.
pub(super) struct Content {
    width: u32,
    height: u32,
    channels: Vec<(String, FlatSamples)>,
    attributes: Attributes,
}

impl Content {
    pub(super) fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            channels: Vec::new(),
            attributes: Vec::new(),
        }
    }

    pub(super) fn pixel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }

    pub(super) fn add_channel(&mut self, name: &str, samples: FlatSamples) {
        self.channels.push((name.to_owned(), samples));
    }

    pub(super) fn add_attribute(&mut self, name: &str, value: AttributeValue) {
        self.attributes.push((name.to_owned(), value));
    }

    pub(super) fn attribute(&self, name: &str) -> Option<&AttributeValue> {
        self.attributes
            .iter()
            .find(|(own, _)| own == name)
            .map(|(_, value)| value)
    }

    pub(super) fn channel(&self, name: &str, path: &Path) -> Result<&FlatSamples, ImagingError> {
        let found = self.channels.iter().find(|(own, _)| own == name);
        found
            .map(|(_, samples)| samples)
            .ok_or_else(|| self.missing(name, path))
    }

    pub(super) fn first_channel(&self, path: &Path) -> Result<String, ImagingError> {
        self.channels
            .first()
            .map(|(name, _)| name.clone())
            .ok_or_else(|| self.missing("", path))
    }

    pub(super) fn image<T>(&self, pixels: Vec<T>) -> Result<Image<T>, ImagingError> {
        Image::from_vec(self.width, self.height, pixels)
    }

    fn missing(&self, name: &str, path: &Path) -> ImagingError {
        let present: Vec<&str> = self
            .channels
            .iter()
            .map(|(name, _)| name.as_str())
            .collect();
        ImagingError::MissingChannel {
            path: path.to_path_buf(),
            channel: name.to_owned(),
            present: present.join(", "),
        }
    }
}

/// Writes beside and renames.
pub(super) fn write(path: &Path, content: Content) -> Result<(), ImagingError> {
    let exr = |source| ImagingError::Exr {
        path: path.to_path_buf(),
        source,
    };
    let size = (content.width as usize, content.height as usize);
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = content
        .channels
        .into_iter()
        .map(|(name, samples)| AnyChannel::new(name.as_str(), samples))
        .collect();
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let mut attributes = ImageAttributes::new(IntegerBounds::from_dimensions(size));
    attributes.other = content
        .attributes
        .into_iter()
        .map(|(name, value)| (name.as_str().into(), value))
        .collect();
    let layer = Layer::new(
        size,
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(channels),
    );
    let image = ExrImage {
        attributes,
        layer_data: layer,
    };
    let mut bytes = Vec::new();
    image
        .write()
        .non_parallel()
        .to_buffered(Cursor::new(&mut bytes))
        .map_err(exr)?;
    write_whole_file(path, &with_sorted_attributes(bytes))
}

/// Reads the first flat layer, largest level.
pub(super) fn read(path: &Path) -> Result<Content, ImagingError> {
    let bytes = fs::read(path).map_err(|source| ImagingError::Io {
        path: path.to_path_buf(),
        source,
    })?;
    let exr = |source| ImagingError::Exr {
        path: path.to_path_buf(),
        source,
    };
    let in_file = |source| ImagingError::InFile {
        path: path.to_path_buf(),
        source: Box::new(source),
    };
    require_plausible_headers(&bytes).map_err(|error| match error {
        HeaderError::Library(source) => exr(source),
        HeaderError::Own(error) => in_file(error),
    })?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(&bytes))
        .map_err(exr)?;
    let layer = image.layer_data;
    let attributes = image
        .attributes
        .other
        .into_iter()
        .chain(layer.attributes.other)
        .map(|(name, value)| (name.to_string(), value))
        .collect();
    Ok(Content {
        // Checked against the largest side with the headers.
        width: layer.size.width() as u32,
        height: layer.size.height() as u32,
        channels: layer
            .channel_data
            .list
            .into_iter()
            .map(|c| (c.name.to_string(), c.sample_data))
            .collect(),
        attributes,
    })
}

enum HeaderError {
    Library(exr::error::Error),
    Own(ImagingError),
}

/// Refuses declared sizes before `exr` allocates them.
fn require_plausible_headers(bytes: &[u8]) -> Result<(), HeaderError> {
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(HeaderError::Library)?;
    for header in &meta.headers {
        let size = header.layer_size;
        let bytes_per_pixel: u64 = header
            .channels
            .list
            .iter()
            .map(|c| c.sample_type.bytes_per_sample() as u64)
            .sum();
        require_plausible_size(
            FORMAT,
            size.width() as u64,
            size.height() as u64,
            bytes_per_pixel,
            bytes.len() as u64,
        )
        .map_err(HeaderError::Own)?;
    }
    Ok(())
}

/// Orders the header's attributes by name. `exr` keeps those of its users in a hash map, whose order differs
/// from run to run; their lengths stay, so nothing behind the header moves.
fn with_sorted_attributes(mut bytes: Vec<u8>) -> Vec<u8> {
    /// Magic number and version.
    const PREAMBLE_BYTES: usize = 8;
    let mut attributes: Vec<&[u8]> = Vec::new();
    let mut at = PREAMBLE_BYTES;
    while let Some(attribute) = attribute_at(&bytes, at) {
        at += attribute.len();
        attributes.push(attribute);
    }
    attributes.sort();
    let sorted = attributes.concat();
    bytes[PREAMBLE_BYTES..at].copy_from_slice(&sorted);
    bytes
}

/// All bytes of the attribute at `at` (name, type, length, value); `None` at the end of the header.
fn attribute_at(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let rest = bytes.get(at..)?;
    let name = rest
        .iter()
        .position(|&b| b == 0)
        .filter(|&length| length > 0)?;
    let kind = rest[name + 1..].iter().position(|&b| b == 0)?;
    let value = name + kind + 2;
    let length = rest
        .get(value..value + 4)?
        .try_into()
        .map(u32::from_le_bytes)
        .ok()?;
    rest.get(..value + 4 + length as usize)
}
