//! What OpenNI2 must make of a frame of the pattern: from the description of the protocol, not from our driver.

use virtual_carmine::TestPattern;

/// Constants of the virtual unit (those of a real Xtion), lengths in centimetres.
const ZERO_PLANE: f64 = 120.0;
/// As the camera holds it, in 32 bits.
const ZERO_PLANE_PIXEL: f32 = 0.1052;
const EMITTER: f64 = 7.5;
const CONSTANT_SHIFT: f64 = 200.0;
const COEFFICIENT: f64 = 4.0;
const MM_PER_CM: f64 = 10.0;
const MAX_DEPTH_MM: f64 = 10_000.0;
const MAX_SHIFT: u16 = 2047;

/// Section 8.2: millimetres of a shift, 0 where there is no depth; `factor` is the size of a pixel in those of the
/// reference pattern.
fn millimetres(shift: u16, factor: f64) -> u16 {
    if shift == 0 || shift >= MAX_SHIFT {
        return 0;
    }
    let x = (f64::from(shift) - COEFFICIENT * CONSTANT_SHIFT / factor) / COEFFICIENT - 0.375;
    let metric = x * f64::from(ZERO_PLANE_PIXEL) * factor;
    let z = MM_PER_CM * (metric * ZERO_PLANE / (EMITTER - metric) + ZERO_PLANE);
    if z > 0.0 && z < MAX_DEPTH_MM {
        z as u16
    } else {
        0
    }
}

fn words(width: u32, height: u32, word: impl Fn(u32, u32) -> u16) -> Vec<u8> {
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    places.flat_map(|(x, y)| word(x, y).to_le_bytes()).collect()
}

fn bytes(width: u32, height: u32, byte: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    places.map(|(x, y)| byte(x, y)).collect()
}

pub(crate) fn depth_mm(
    pattern: &TestPattern,
    index: u64,
    width: u32,
    height: u32,
    factor: f64,
) -> Vec<u8> {
    let table: Vec<u16> = (0..=MAX_SHIFT)
        .map(|shift| millimetres(shift, factor))
        .collect();
    words(width, height, |x, y| {
        table[usize::from(pattern.shift(index, x, y, false))]
    })
}

pub(crate) fn shifts(pattern: &TestPattern, index: u64, width: u32, height: u32) -> Vec<u8> {
    words(width, height, |x, y| pattern.shift(index, x, y, false))
}

pub(crate) fn registered_shifts(
    pattern: &TestPattern,
    index: u64,
    width: u32,
    height: u32,
) -> Vec<u8> {
    words(width, height, |x, y| pattern.shift(index, x, y, true))
}

/// The largest shift, which is no measurement, as 0.
pub(crate) fn measured_shifts(
    pattern: &TestPattern,
    index: u64,
    width: u32,
    height: u32,
) -> Vec<u8> {
    words(width, height, |x, y| {
        let shift = pattern.shift(index, x, y, false);
        if shift < MAX_SHIFT { shift } else { 0 }
    })
}

pub(crate) fn infrared(pattern: &TestPattern, index: u64, width: u32, height: u32) -> Vec<u8> {
    words(width, height, |x, y| pattern.infrared_sample(index, x, y))
}

pub(crate) fn unlit_infrared(
    pattern: &TestPattern,
    index: u64,
    width: u32,
    height: u32,
) -> Vec<u8> {
    words(width, height, |x, y| {
        pattern.unlit_infrared_sample(index, x, y)
    })
}

pub(crate) fn uyvy(pattern: &TestPattern, index: u64, width: u32, height: u32) -> Vec<u8> {
    bytes(2 * width, height, |column, y| {
        pattern.uyvy_byte(index, column, y)
    })
}

pub(crate) fn yuyv(pattern: &TestPattern, index: u64, width: u32, height: u32) -> Vec<u8> {
    bytes(2 * width, height, |column, y| {
        pattern.uyvy_byte(index, column ^ 1, y)
    })
}

pub(crate) fn mosaic(pattern: &TestPattern, index: u64, width: u32, height: u32) -> Vec<u8> {
    bytes(width, height, |x, y| pattern.bayer_byte(index, x, y))
}

/// Section 7.5, written anew here: both pixels of a pair have the same chroma.
pub(crate) fn rgb(pattern: &TestPattern, index: u64, width: u32, height: u32) -> Vec<u8> {
    let pairs = uyvy(pattern, index, width, height);
    let pixels = pairs.chunks_exact(4).flat_map(|pair| {
        let (u, v) = (i32::from(pair[0]) - 128, i32::from(pair[2]) - 128);
        [pair[1], pair[3]].map(|y| {
            let c = 298 * (i32::from(y) - 16) + 128;
            [c + 409 * v, c - 100 * u - 208 * v, c + 516 * u]
                .map(|channel| (channel >> 8).clamp(0, 255) as u8)
        })
    });
    pixels.flatten().collect()
}
