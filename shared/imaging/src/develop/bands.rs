//! A frame in fixed bands of rows, worked on in parallel: the same bits for any number of threads.

use std::ops::Range;

use crate::linear_pixel::LinearPixel;

/// Rows of a band: even, so that the half-size grey image splits with it; few enough for two busy threads to
/// share a VGA frame evenly, many enough that the rows a mosaic needs beyond its band cost a tenth.
pub(super) const BAND_ROWS: usize = 60;

/// The outputs of some rows of a frame.
pub(super) struct Band<'a> {
    pub(super) rows: Range<usize>,
    pub(super) width: usize,
    pub(super) pixels: &'a mut [LinearPixel],
    /// Half size: the rows that have both rows above them in this band.
    pub(super) grey: &'a mut [f32],
}

impl Band<'_> {
    /// Runs `work` on each band of [`BAND_ROWS`] rows with its own scratch, in parallel, without allocating.
    pub(super) fn for_each<S: Send>(
        self,
        scratch: &mut [S],
        work: &(impl Fn(Band, &mut S) + Sync),
    ) {
        if scratch.len() <= 1 {
            if let Some(scratch) = scratch.first_mut() {
                work(self, scratch);
            }
            return;
        }
        let (first_scratch, second_scratch) = scratch.split_at_mut(scratch.len() / 2);
        let split = BAND_ROWS * first_scratch.len();
        let (first, second) = self.split_at(split);
        rayon::join(
            || first.for_each(first_scratch, work),
            || second.for_each(second_scratch, work),
        );
    }

    fn split_at(self, row_count: usize) -> (Self, Self) {
        let (pixels, more_pixels) = self.pixels.split_at_mut(row_count * self.width);
        let grey_count = (row_count / 2) * (self.width / 2);
        let (grey, more_grey) = self.grey.split_at_mut(grey_count);
        let middle = self.rows.start + row_count;
        let first = Self {
            rows: self.rows.start..middle,
            width: self.width,
            pixels,
            grey,
        };
        let second = Self {
            rows: middle..self.rows.end,
            width: self.width,
            pixels: more_pixels,
            grey: more_grey,
        };
        (first, second)
    }
}
