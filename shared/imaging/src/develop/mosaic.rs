//! Rows of full colour from a Bayer mosaic, in linear radiance.

use std::ops::Range;

use crate::kernels::Level;
use crate::kernels::demosaic::{
    ColorRows, DIFFERENCE_PAD, RAW_PAD, color_row, fill_row, green_row,
};

/// Raw rows kept: the five of a row's green, and three more where rows are mirrored at the border.
const RAW_KEPT: usize = 8;
/// Rows of green and differences kept: a row and its neighbours.
const GREEN_KEPT: usize = 4;
/// What a slot holds that holds no row.
const NO_ROW: usize = usize::MAX;

/// A mosaic with what makes it linear.
#[derive(Clone, Copy)]
pub(super) struct Mosaic<'a> {
    pub(super) codes: &'a [u8],
    pub(super) width: usize,
    pub(super) height: usize,
    /// Radiance of each code of red, green, blue.
    pub(super) linear_of_code: &'a [[f32; 256]; 3],
    /// Factor of each pixel.
    pub(super) factor: &'a [f32],
}

/// Working memory for rows one after the other.
#[derive(Debug)]
pub(super) struct MosaicRows {
    width: usize,
    raw: [Vec<f32>; RAW_KEPT],
    raw_row: [usize; RAW_KEPT],
    green: [Vec<f32>; GREEN_KEPT],
    filled: [Vec<f32>; GREEN_KEPT],
    green_row: [usize; GREEN_KEPT],
    difference: Vec<f32>,
    second: Vec<f32>,
    third: Vec<f32>,
}

impl MosaicRows {
    pub(super) fn new(width: usize) -> Self {
        let row = |pad: usize| vec![0.0; width + 2 * pad];
        Self {
            width,
            raw: std::array::from_fn(|_| row(RAW_PAD)),
            raw_row: [NO_ROW; RAW_KEPT],
            green: std::array::from_fn(|_| row(0)),
            filled: std::array::from_fn(|_| row(0)),
            green_row: [NO_ROW; GREEN_KEPT],
            difference: row(DIFFERENCE_PAD),
            second: row(0),
            third: row(0),
        }
    }

    /// Calls `emit(y, [red, green, blue])` for each of `rows`, which lie in the mosaic.
    pub(super) fn for_each(
        &mut self,
        level: Level,
        mosaic: &Mosaic,
        rows: Range<usize>,
        mut emit: impl FnMut(usize, [&[f32]; 3]),
    ) {
        debug_assert!(self.width == mosaic.width && rows.end <= mosaic.height);
        self.raw_row = [NO_ROW; RAW_KEPT];
        self.green_row = [NO_ROW; GREEN_KEPT];
        for y in rows {
            let above = self.need_green(level, mosaic, mirrored(y, -1, mosaic.height));
            let below = self.need_green(level, mosaic, mirrored(y, 1, mosaic.height));
            let own = self.need_green(level, mosaic, y);
            let rows = ColorRows {
                green: &self.green[own],
                own: &self.filled[own],
                above: &self.filled[above],
                below: &self.filled[below],
            };
            color_row(level, rows, &mut self.second, &mut self.third);
            let green = self.green[own].as_slice();
            emit(
                y,
                if is_red_row(y) {
                    [&self.second, green, &self.third]
                } else {
                    [&self.third, green, &self.second]
                },
            );
        }
    }

    /// The slot that holds green and differences of row `y`.
    fn need_green(&mut self, level: Level, mosaic: &Mosaic, y: usize) -> usize {
        let slot = y % GREEN_KEPT;
        if self.green_row[slot] == y {
            return slot;
        }
        self.green_row[slot] = y;
        let slots = [-2, -1, 0, 1, 2].map(|step| {
            let row = mirrored(y, step, mosaic.height);
            self.need_raw(mosaic, row)
        });
        green_row(
            level,
            slots.map(|slot| self.raw[slot].as_slice()),
            usize::from(is_red_row(y)),
            &mut self.green[slot],
            &mut self.difference,
        );
        let last = self.width - 1;
        self.difference[0] = self.difference[1 + mirrored(0, -1, self.width)];
        self.difference[self.width + 1] = self.difference[1 + mirrored(last, 1, self.width)];
        fill_row(level, &self.difference, &mut self.filled[slot]);
        slot
    }

    /// The slot that holds row `y` in linear radiance, mirrored at both ends.
    fn need_raw(&mut self, mosaic: &Mosaic, y: usize) -> usize {
        let slot = y % RAW_KEPT;
        if self.raw_row[slot] == y {
            return slot;
        }
        self.raw_row[slot] = y;
        let width = self.width;
        let codes = &mosaic.codes[y * width..][..width];
        let factors = &mosaic.factor[y * width..][..width];
        let [red, green, blue] = mosaic.linear_of_code;
        // Even rows are green, red; odd rows are blue, green.
        let (even, odd) = if is_red_row(y) {
            (green, red)
        } else {
            (blue, green)
        };
        let row = &mut self.raw[slot];
        let (pairs, last) = row[RAW_PAD..RAW_PAD + width].as_chunks_mut::<2>();
        let (code_pairs, last_code) = codes.as_chunks::<2>();
        let (factor_pairs, last_factor) = factors.as_chunks::<2>();
        for ((pair, codes), factors) in pairs.iter_mut().zip(code_pairs).zip(factor_pairs) {
            *pair = [
                even[usize::from(codes[0])] * factors[0],
                odd[usize::from(codes[1])] * factors[1],
            ];
        }
        for ((value, &code), &factor) in last.iter_mut().zip(last_code).zip(last_factor) {
            *value = even[usize::from(code)] * factor;
        }
        for step in 1..=RAW_PAD {
            row[RAW_PAD - step] = row[RAW_PAD + mirrored(0, -(step as isize), width)];
            row[RAW_PAD + width - 1 + step] =
                row[RAW_PAD + mirrored(width - 1, step as isize, width)];
        }
        slot
    }
}

/// Rows of green and red in a GRBG mosaic; their red sites are the odd columns, the blue sites of the others the
/// even ones.
fn is_red_row(y: usize) -> bool {
    y.is_multiple_of(2)
}

/// Index `at + step` in a row `length` long, mirrored at its ends so that the parity of the mosaic is kept; in
/// rows shorter than the step the first index of the right parity, if there is one.
fn mirrored(at: usize, step: isize, length: usize) -> usize {
    let index = at as isize + step;
    let last = length as isize - 1;
    let index = if index < 0 {
        -index
    } else if index > last {
        2 * last - index
    } else {
        index
    };
    if (0..=last).contains(&index) {
        index as usize
    } else {
        (index.unsigned_abs() & 1).min(length - 1)
    }
}
