//! Feeds mutated vectors to the decoders: `codec_fuzz VECTORS COUNT [SEED [OUT]]`.
//!
//! Each execution takes a vector of `VECTORS` (recordings/vectors/codecs), flips, overwrites, cuts or appends up to four
//! times, half of the time inside the zstd frame, and decodes: a panic ends the program with its seed printed. With
//! OUT, mutants and what became of them are written as vectors, for `tests/format/codecs.py` to judge.

use std::error::Error;
use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{CodeTable, CodecError, ColorDecoder, ColorFormat, DepthDecoder};
use serde_json::{Value, json};

/// A vector with a decoder of its own, so that damage of one frame would show in the next.
struct Seed {
    entry: Value,
    payload: Vec<u8>,
    decoder: Decoder,
}

enum Decoder {
    Depth(DepthDecoder, Option<CodeTable>, Vec<u16>),
    Color(ColorDecoder, Vec<u8>),
}

impl Decoder {
    fn decode(&mut self, payload: &[u8]) -> Result<Vec<u8>, CodecError> {
        match self {
            Self::Depth(decoder, table, samples) => {
                decoder.decode(payload, table.as_ref(), samples)?;
                Ok(samples
                    .iter()
                    .flat_map(|sample| sample.to_le_bytes())
                    .collect())
            }
            Self::Color(decoder, frame) => {
                decoder.decode(payload, frame)?;
                Ok(frame.clone())
            }
        }
    }
}

fn seeds(folder: &Path) -> Result<Vec<Seed>, Box<dyn Error>> {
    let index: Vec<Value> = serde_json::from_slice(&std::fs::read(folder.join("index.json"))?)?;
    let mut seeds = Vec::new();
    for entry in index {
        let name = entry["name"].as_str().ok_or("a vector without a name")?;
        let side = |key: &str| {
            entry[key]
                .as_u64()
                .and_then(|side| u32::try_from(side).ok())
                .ok_or("a side")
        };
        let (width, height) = (side("width")?, side("height")?);
        let payload = std::fs::read(folder.join(format!("{name}.payload")))?;
        let format = match entry["format"].as_str() {
            Some("bayer-grbg") => Some(ColorFormat::BayerGrbg),
            Some("uyvy") => Some(ColorFormat::Uyvy),
            Some("yuyv") => Some(ColorFormat::Yuyv),
            Some("rgb8") => Some(ColorFormat::Rgb8),
            Some("infrared10") => Some(ColorFormat::Infrared10),
            _ => None,
        };
        let decoder = if let Some(format) = format {
            let frame = vec![0; format.frame_bytes(width, height)?];
            Decoder::Color(ColorDecoder::new(format, width, height)?, frame)
        } else {
            let table = match entry["table"].as_str() {
                Some(table) => Some(CodeTable::from_bytes(&std::fs::read(folder.join(table))?)?),
                None => None,
            };
            let samples = vec![0; width as usize * height as usize];
            Decoder::Depth(DepthDecoder::new(width, height)?, table, samples)
        };
        seeds.push(Seed {
            payload,
            decoder,
            entry,
        });
    }
    Ok(seeds)
}

fn mutate(bytes: &mut Vec<u8>, random: &mut Pcg64Mcg) {
    for _ in 0..random.random_range(1..5) {
        let place = random.random_range(0..=bytes.len());
        match (random.random_range(0..6), bytes.get_mut(place)) {
            (0, _) => bytes.truncate(place),
            (1, _) => bytes.insert(place, random.random()),
            (2, Some(byte)) => *byte = random.random(),
            (3, Some(byte)) => *byte = [0, 0x7f, 0x80, 0xff][random.random_range(0..4)],
            (_, Some(byte)) => *byte ^= 1 << random.random_range(0..8),
            (_, None) => {}
        }
    }
}

/// A mutant of `payload`; half of those with a zstd frame are mutated inside it and packed anew.
fn mutant(payload: &[u8], head_bytes: usize, random: &mut Pcg64Mcg) -> Vec<u8> {
    if let (true, Some((head, body))) = (random.random(), payload.split_at_checked(head_bytes))
        && let Ok(mut content) = zstd::bulk::decompress(body, 1 << 16)
    {
        mutate(&mut content, random);
        if let Ok(packed) = zstd::bulk::compress(&content, 1) {
            return [head, packed.as_slice()].concat();
        }
    }
    let mut bytes = payload.to_vec();
    mutate(&mut bytes, random);
    bytes
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, count, rest @ ..] = arguments.as_slice() else {
        return Err("codec_fuzz VECTORS COUNT [SEED [OUT]]".into());
    };
    let seed = rest.first().map_or(Ok(1), |seed| seed.parse())?;
    let out = rest.get(1).map(Path::new);
    println!("seed {seed}");
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut seeds = seeds(Path::new(folder))?;
    let mut written = Vec::new();
    let (count, mut refused_count): (u64, u64) = (count.parse()?, 0);
    for execution in 0..count {
        let chosen = random.random_range(0..seeds.len());
        let Seed {
            entry,
            payload,
            decoder,
        } = &mut seeds[chosen];
        let head_bytes = if matches!(decoder, Decoder::Depth(..)) {
            3
        } else {
            1
        };
        let mutant = mutant(payload, head_bytes, &mut random);
        let decoded = decoder.decode(&mutant);
        refused_count += u64::from(decoded.is_err());
        let Some(out) = out else { continue };
        let name = format!("mutant-{execution}");
        let mut entry = entry.clone();
        entry["name"] = json!(name);
        entry["refused"] = json!(decoded.is_err());
        entry["describes"] = json!(format!("{:?}", decoded.as_ref().err()));
        std::fs::write(out.join(format!("{name}.payload")), &mutant)?;
        if let Ok(raw) = decoded {
            std::fs::write(out.join(format!("{name}.raw")), raw)?;
        }
        written.push(entry);
    }
    if let Some(out) = out {
        std::fs::write(out.join("index.json"), serde_json::to_vec_pretty(&written)?)?;
    }
    println!("{count} executions, {refused_count} refused, no panic");
    Ok(())
}
