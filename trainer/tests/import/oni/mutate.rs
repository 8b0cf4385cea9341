//! Mutants of `.oni` files and of their frames.

use glint::import::oni::{
    OniCodec, OniContents, OniPixels, OniSamples, OniShape, decode_frame, read_frame,
};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use super::made::{OniFile, encode_8z, encode_16z, encode_16z_with_table};

/// What became of mutants.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) executions: u64,
    /// Files of which frames were found.
    pub(crate) files: u64,
    /// Frames that decoded.
    pub(crate) frames: u64,
    /// Frames and files that were refused.
    pub(crate) refused: u64,
}

const SIZE: [u32; 2] = [8, 6];
const AREA: usize = 48;

/// A file with a stream of each codec but JPEG.
fn seed_file(random: &mut Pcg64Mcg) -> Vec<u8> {
    let mut file = if random.random() {
        OniFile::new()
    } else {
        OniFile::old()
    };
    let words: Vec<u16> = (0..AREA)
        .map(|_| 500 + random.random_range(0..9) * 40)
        .collect();
    let bytes: Vec<u8> = (0..3 * AREA)
        .map(|_| random.random_range(0..4) * 7)
        .collect();
    file.node(1, 2, if random.random() { b"16zT" } else { b"16zP" }, SIZE);
    file.node(2, 3, if random.random() { b"NONE" } else { b"Im8z" }, SIZE);
    file.int(2, "oniPixelFormat", 200);
    for number in 1..3 {
        file.frame(1, 0, number, &encode_16z_with_table(&words));
        file.frame(2, 0, number, &bytes);
        file.frame(2, 0, number, &encode_8z(&bytes));
        file.frame(1, 0, number, &encode_16z(&words));
    }
    file.end()
}

fn damage(random: &mut Pcg64Mcg, bytes: &mut Vec<u8>) {
    for _ in 0..random.random_range(1..5) {
        if bytes.is_empty() {
            return;
        }
        let at = random.random_range(0..bytes.len());
        match random.random_range(0..5) {
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = [0, 0xFF, 0x7F, 0x80][random.random_range(0..4)],
            2 => bytes.truncate(at),
            3 => bytes.insert(at, random.random()),
            _ => {
                let word: u32 = random.random();
                let end = bytes.len().min(at + 4);
                bytes[at..end].copy_from_slice(&word.to_le_bytes()[..end - at]);
            }
        }
    }
}

/// Makes a mutant and reads it: nothing panics, and what decodes has the size that was announced.
pub(crate) fn execute(random: &mut Pcg64Mcg, counts: &mut Counts) {
    counts.executions += 1;
    if random.random_range(0..4) == 0 {
        file(random, counts);
    } else {
        frame(random, counts);
    }
}

fn file(random: &mut Pcg64Mcg, counts: &mut Counts) {
    let mut bytes = seed_file(random);
    damage(random, &mut bytes);
    let source = bytes.as_slice();
    let Ok(contents) = OniContents::read(&source) else {
        counts.refused += 1;
        return;
    };
    counts.files += 1;
    for node in &contents.nodes {
        for frame in &node.frames {
            assert!(frame.payload.end <= bytes.len() as u64);
            judge(read_frame(&source, node, frame).ok(), frame.shape, counts);
        }
    }
}

fn frame(random: &mut Pcg64Mcg, counts: &mut Counts) {
    let words: Vec<u16> = (0..AREA)
        .map(|_| 500 + random.random_range(0..60))
        .collect();
    let narrow: Vec<u8> = words.iter().map(|&word| word as u8).collect();
    let (codec, pixels, mut payload) = match random.random_range(0..3) {
        0 => (
            OniCodec::Z16,
            OniPixels::DepthMillimetres,
            encode_16z(&words),
        ),
        1 => (
            OniCodec::Z16Table,
            OniPixels::DepthMillimetres,
            encode_16z_with_table(&words),
        ),
        _ => (OniCodec::Z8, OniPixels::Gray8, encode_8z(&narrow)),
    };
    damage(random, &mut payload);
    let shape = OniShape {
        width: SIZE[0],
        height: SIZE[1],
        offset: [0, 0],
        pixels,
    };
    judge(
        decode_frame(codec, shape, payload).ok(),
        Some(shape),
        counts,
    );
}

fn judge(samples: Option<OniSamples>, shape: Option<OniShape>, counts: &mut Counts) {
    let Some(samples) = samples else {
        counts.refused += 1;
        return;
    };
    counts.frames += 1;
    let shape = shape.expect("decoded");
    match samples {
        OniSamples::Words(words) => assert_eq!(words.len(), shape.area()),
        OniSamples::Bytes(bytes) => {
            assert_eq!(bytes.len(), shape.area() * shape.pixels.byte_count());
        }
        OniSamples::Jpeg(_) => {}
    }
}
