use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::super::Level;
use super::{ColorRows, color_row, fill_row, green_row, pack_row};
use crate::linear_pixel::LinearPixel;

/// Everything the kernels make of random rows `width` pixels wide, as bits.
fn made(level: Level, width: usize, seed: u64) -> (Vec<u32>, Vec<LinearPixel>) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut row = |length: usize| -> Vec<f32> {
        (0..length)
            .map(|_| match rng.random_range(0..16) {
                0 => 0.0,
                1 => 1e-40,
                2 => 1e9,
                _ => rng.random(),
            })
            .collect()
    };
    let raw: [Vec<f32>; 5] = std::array::from_fn(|_| row(width + 4));
    let (above, below) = (row(width), row(width));
    let [mut green, mut own, mut second, mut third] = [0; 4].map(|_| vec![0.0; width]);
    let mut difference = vec![0.0; width + 2];
    let raw: [&[f32]; 5] = std::array::from_fn(|y| raw[y].as_slice());
    green_row(level, raw, (seed & 1) as usize, &mut green, &mut difference);
    fill_row(level, &difference, &mut own);
    let rows = ColorRows {
        green: &green,
        own: &own,
        above: &above,
        below: &below,
    };
    color_row(level, rows, &mut second, &mut third);
    let flags: Vec<u8> = (0..width).map(|x| [1, 3, 0][x % 3]).collect();
    let mut pixels = vec![LinearPixel::INVALID; width];
    pack_row(level, [&second, &green, &third], &flags, &mut pixels);
    let floats = [green, difference, own, second, third].concat();
    (floats.into_iter().map(f32::to_bits).collect(), pixels)
}

#[test]
fn widened_rows_equal_their_scalar_twins() {
    if !Level::Avx2.is_usable() {
        println!("skipped: this machine has no AVX2");
        return;
    }
    for width in 0..=4 * 8 + 1 {
        for seed in 0..8 {
            assert!(
                made(Level::Scalar, width, seed) == made(Level::Avx2, width, seed),
                "{width} pixels, seed {seed}"
            );
        }
    }
}
