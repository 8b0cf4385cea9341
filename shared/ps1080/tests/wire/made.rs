//! Made frames and random cuts.

use ps1080::color::ColorFormat;
use ps1080::samples::SampleFormat;
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

/// A frame of samples with all that occurs: runs, small and large steps, no measurement, the greatest code.
pub(crate) fn samples(format: SampleFormat, count: usize, random: &mut Pcg64Mcg) -> Vec<u16> {
    let most = i32::from(format.max_code());
    let mut code = 700.min(most);
    let mut codes = Vec::with_capacity(count);
    while codes.len() < count {
        let step = match random.random_range(0..10) {
            0..6 => random.random_range(-6..=6),
            6..8 => random.random_range(-70..=70),
            8 => 2047 - code,
            _ => random.random_range(0..=most) - code,
        };
        code = (code + step).clamp(0, most);
        let run = if random.random_bool(0.2) {
            random.random_range(1..40)
        } else {
            1
        };
        codes.extend(std::iter::repeat_n(
            code as u16,
            run.min(count - codes.len()),
        ));
    }
    codes
}

/// A frame of colour bytes: mostly small differences two and four bytes back, noise between.
pub(crate) fn color(count: usize, random: &mut Pcg64Mcg) -> Vec<u8> {
    let noise = if random.random() { 0.05 } else { 0.4 };
    let mut bytes = Vec::<u8>::with_capacity(count);
    for at in 0..count {
        let before = at.checked_sub(4).map_or(100, |at| bytes[at]);
        bytes.push(if random.random_bool(noise) {
            random.random()
        } else {
            before.saturating_add_signed(random.random_range(-7..=7))
        });
    }
    bytes
}

/// `bytes` cut anywhere: into single bytes, about packets, or seldom.
pub(crate) fn pieces<'a>(bytes: &'a [u8], random: &mut Pcg64Mcg) -> Vec<&'a [u8]> {
    let longest = [1, 3, 16, 100, 1000, 20_480][random.random_range(0..6)];
    let mut rest = bytes;
    let mut pieces = Vec::new();
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(random.random_range(0..=longest).min(rest.len()));
        pieces.push(piece);
        rest = after;
    }
    pieces
}

/// Formats of colour of a fixed size.
pub(crate) const SIZED_COLOR: [ColorFormat; 5] = [
    ColorFormat::CompressedBayer,
    ColorFormat::CompressedYuv422,
    ColorFormat::Uyvy,
    ColorFormat::Bayer,
    ColorFormat::Yuyv,
];
