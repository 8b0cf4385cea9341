//! The depth coders that are compared, behind one face.

use std::collections::BTreeMap;

use anyhow::{Context as _, bail, ensure};
use imaging::{Image, decode_png_gray16, encode_png_gray16};
use sequence::codecs::{CodeTable, DepthCodec, DepthDecoder, DepthEncoder, depth_table_id};

use super::super::subject::Setting;
use super::rvl;

/// Codes and decodes the depth of one stream.
pub(super) enum DepthCoder {
    /// Those of recordings.
    Ours(Box<Ours>),
    /// RVL as published.
    Rvl,
    /// PNG of 16 bits.
    Png { width: u32, height: u32 },
}

/// A coder of recordings with the tables it has found.
pub(super) struct Ours {
    encoder: DepthEncoder,
    decoder: DepthDecoder,
    codec: DepthCodec,
    tables: BTreeMap<u16, CodeTable>,
}

impl DepthCoder {
    /// The coder of a setting for images of a size. `table` is that of a stream of values, where its values are
    /// coded by a table that the coder has to find.
    pub(super) fn new(
        setting: &Setting,
        width: u32,
        height: u32,
        finds_table: bool,
    ) -> anyhow::Result<Self> {
        let level = |name: &str| setting.get(name).map_or("", String::as_str);
        let codec = match level("depth-coder") {
            "fast" => DepthCodec::Fast,
            "dense" => DepthCodec::Dense,
            "rvl" => return Ok(Self::Rvl),
            "png16" => return Ok(Self::Png { width, height }),
            other => bail!("there is no depth coder `{other}`"),
        };
        let mut encoder = if finds_table {
            DepthEncoder::of_values(width, height, None)?
        } else {
            DepthEncoder::of_codes(width, height)?
        };
        encoder.set_zstd_level(level("zstd-level").parse()?)?;
        Ok(Self::Ours(Box::new(Ours {
            encoder,
            decoder: DepthDecoder::new(width, height)?,
            codec,
            tables: BTreeMap::new(),
        })))
    }

    /// Replaces `payload`; a table that must be stored before it is returned.
    pub(super) fn encode(
        &mut self,
        samples: &[u16],
        payload: &mut Vec<u8>,
    ) -> anyhow::Result<Option<CodeTable>> {
        match self {
            Self::Ours(ours) => {
                payload.resize(ours.encoder.max_payload_bytes(), 0);
                let encoded = ours.encoder.encode(samples, ours.codec, payload)?;
                payload.truncate(encoded.byte_count);
                if !encoded.has_new_table {
                    return Ok(None);
                }
                let table = ours.encoder.table().cloned();
                ours.tables
                    .extend(table.clone().map(|table| (table.id(), table)));
                Ok(table)
            }
            Self::Rvl => {
                rvl::encode(samples, payload);
                Ok(None)
            }
            Self::Png { width, height } => {
                let image = Image::from_vec(*width, *height, samples.to_vec())?;
                *payload = encode_png_gray16(&image)?;
                Ok(None)
            }
        }
    }

    /// Fills `samples` from a payload.
    pub(super) fn decode(&mut self, payload: &[u8], samples: &mut [u16]) -> anyhow::Result<()> {
        match self {
            Self::Ours(ours) => {
                let table = depth_table_id(payload)?.and_then(|id| ours.tables.get(&id));
                Ok(ours.decoder.decode(payload, table, samples)?)
            }
            Self::Rvl => rvl::decode(payload, samples).context("RVL does not decode"),
            Self::Png { .. } => {
                let image = decode_png_gray16(payload)?;
                ensure!(
                    image.pixels().len() == samples.len(),
                    "PNG has another size"
                );
                samples.copy_from_slice(image.pixels());
                Ok(())
            }
        }
    }
}

/// The samples as codes of the table that their values are of, as a sensor would have sent them.
pub(super) fn as_codes(
    frames: &[Vec<u16>],
    width: u32,
    height: u32,
) -> anyhow::Result<Vec<Vec<u16>>> {
    let mut encoder = DepthEncoder::of_values(width, height, None)?;
    let mut payload = vec![0; encoder.max_payload_bytes()];
    for frame in frames {
        encoder.encode(frame, DepthCodec::Fast, &mut payload)?;
    }
    let table = encoder
        .table()
        .context("the depths of this recording are not those of a table of codes")?;
    let code_of = |sample: &u16| -> anyhow::Result<u16> {
        match *sample {
            0 | u16::MAX => Ok(*sample),
            value => {
                let found = table.values().binary_search(&value);
                Ok(found.ok().context("a depth is not in the table")? as u16 + 1)
            }
        }
    };
    frames
        .iter()
        .map(|frame| frame.iter().map(code_of).collect())
        .collect()
}
