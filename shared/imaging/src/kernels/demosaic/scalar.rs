//! The specification, written so that a compiler can widen it.

use super::ColorRows;
use crate::linear_pixel::{LinearPixel, RADIANCE_ONE};

/// See [`super::green_row`].
#[inline(always)]
pub(super) fn green_row(
    raw: [&[f32]; 5],
    parity: usize,
    green: &mut [f32],
    difference: &mut [f32],
) {
    let width = green.len();
    let [far_up, up, row, down, far_down] = raw.map(|row| &row[..width + 4]);
    let difference = &mut difference[1..=width];
    let green = &mut green[..width];
    let parity = (parity & 1) as u32;
    for x in 0..width {
        let center = row[x + 2];
        let (left, right) = (row[x + 1], row[x + 3]);
        let (above, below) = (up[x + 2], down[x + 2]);
        let bend_h = 2.0 * center - row[x] - row[x + 4];
        let bend_v = 2.0 * center - far_up[x + 2] - far_down[x + 2];
        let change_h = (left - right).abs() + bend_h.abs();
        let change_v = (above - below).abs() + bend_v.abs();
        let along_h = 0.5 * (left + right) + 0.25 * bend_h;
        let along_v = 0.5 * (above + below) + 0.25 * bend_v;
        let mean = 0.5 * (along_h + along_v);
        let flatter = if change_h < change_v {
            along_h
        } else {
            along_v
        };
        let guess = if change_h == change_v { mean } else { flatter };
        let is_site = (x as u32 & 1) == parity;
        green[x] = if is_site { guess } else { center };
        difference[x] = if is_site { center - guess } else { 0.0 };
    }
}

/// See [`super::fill_row`].
#[inline(always)]
pub(super) fn fill_row(difference: &[f32], filled: &mut [f32]) {
    let difference = &difference[..filled.len() + 2];
    for (x, filled) in filled.iter_mut().enumerate() {
        // Either the middle is 0 or both sides are.
        *filled = difference[x + 1] + 0.5 * (difference[x] + difference[x + 2]);
    }
}

/// See [`super::color_row`].
#[inline(always)]
pub(super) fn color_row(rows: ColorRows<'_>, second: &mut [f32], third: &mut [f32]) {
    let width = second.len();
    let (green, own) = (&rows.green[..width], &rows.own[..width]);
    let (above, below) = (&rows.above[..width], &rows.below[..width]);
    let third = &mut third[..width];
    for x in 0..width {
        second[x] = (green[x] + own[x]).max(0.0);
        third[x] = (green[x] + 0.5 * (above[x] + below[x])).max(0.0);
    }
}

/// See [`super::pack_row`].
#[inline(always)]
pub(super) fn pack_row(rgb: [&[f32]; 3], flags: &[u8], pixels: &mut [LinearPixel]) {
    let width = pixels.len();
    let [red, green, blue] = rgb.map(|row| &row[..width]);
    let flags = &flags[..width];
    let code = |radiance: f32| {
        let value = radiance * f32::from(RADIANCE_ONE) + 0.5;
        value.clamp(0.0, 65_535.0) as u16
    };
    for x in 0..width {
        let kept = if flags[x] == 0 { 0 } else { u16::MAX };
        pixels[x] = LinearPixel([
            code(red[x]) & kept,
            code(green[x]) & kept,
            code(blue[x]) & kept,
            u16::from(flags[x]),
        ]);
    }
}
