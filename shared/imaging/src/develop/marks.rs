//! Marks of saturation on raw samples, grown where neighbours share colour.

use rayon::prelude::*;

use super::bands::BAND_ROWS;
use super::layout::ColorLayout;
use super::yuv::{PairOrder, YuvConverter};
use crate::image::{Image, Mask};
use crate::kernels::Level;
use crate::radiance::{CHROMA_REACH, SATURATION_CODE, dilated};

/// Raw marks of a frame, already grown along rows; [`Marks::for_each_near`] grows them across rows.
#[derive(Debug)]
pub(super) struct Marks {
    width: usize,
    grown: Vec<bool>,
    has_any: Vec<bool>,
}

/// How raw samples say that they are clipped.
#[derive(Clone, Copy, Debug)]
pub(super) enum MarkRule {
    Rgb8,
    Bayer,
    Yuv(YuvConverter, PairOrder),
}

impl MarkRule {
    pub(super) fn of(layout: ColorLayout) -> Self {
        match layout {
            ColorLayout::Rgb8 => Self::Rgb8,
            ColorLayout::BayerGrbg => Self::Bayer,
            ColorLayout::Uyvy(coding) => Self::Yuv(YuvConverter::new(coding), PairOrder::Uyvy),
            ColorLayout::Yuyv(coding) => Self::Yuv(YuvConverter::new(coding), PairOrder::Yuyv),
        }
    }

    /// Marks the clipped pixels of a row; says whether there is any.
    fn mark(self, level: Level, samples: &[u8], marks: &mut [bool]) -> bool {
        match self {
            Self::Yuv(converter, order) => {
                converter.saturated_row(level, order, samples, marks);
                return marks.contains(&true);
            }
            Self::Rgb8 | Self::Bayer => {}
        }
        // Most rows have no clipped sample, which is quickly seen.
        if samples.iter().fold(0, |most, &code| most.max(code)) < SATURATION_CODE {
            marks.fill(false);
            return false;
        }
        let is_clipped = |code: &u8| *code >= SATURATION_CODE;
        if matches!(self, Self::Bayer) {
            for (mark, code) in marks.iter_mut().zip(samples) {
                *mark = is_clipped(code);
            }
        } else {
            for (mark, codes) in marks.iter_mut().zip(samples.as_chunks::<3>().0) {
                *mark = codes.iter().any(is_clipped);
            }
        }
        true
    }
}

impl Marks {
    pub(super) fn new(width: u32, height: u32) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self {
            width,
            grown: vec![false; width * height],
            has_any: vec![false; height],
        }
    }

    /// Marks a frame.
    pub(super) fn set(&mut self, level: Level, rule: MarkRule, frame: &[u8]) {
        let row_bytes = frame.len() / self.has_any.len();
        let width = self.width;
        self.grown
            .par_chunks_mut(BAND_ROWS * width)
            .zip(self.has_any.par_chunks_mut(BAND_ROWS))
            .zip(frame.par_chunks(BAND_ROWS * row_bytes))
            .for_each(|((grown, has_any), samples)| {
                let rows = grown.chunks_mut(width).zip(has_any);
                for ((row, has_any), samples) in rows.zip(samples.chunks(row_bytes)) {
                    *has_any = rule.mark(level, samples, row);
                    if *has_any {
                        grow_along(row, CHROMA_REACH as usize);
                    }
                }
            });
    }

    /// Calls `mark` with every row of grown marks that reaches row `y`.
    pub(super) fn for_each_near(&self, y: usize, mut mark: impl FnMut(&[bool])) {
        let reach = CHROMA_REACH as usize;
        let end = self.has_any.len().min(y + reach + 1);
        for near in y.saturating_sub(reach)..end {
            if self.has_any[near] {
                mark(&self.grown[near * self.width..][..self.width]);
            }
        }
    }
}

/// Grows the marks of a row by `reach` in place.
fn grow_along(row: &mut [bool], reach: usize) {
    // Pixels since the last mark of the frame's own; behind x the row holds grown marks, before it own ones.
    let mut since = reach;
    for x in 0..row.len() {
        if row[x] {
            row[x.saturating_sub(reach)..x].fill(true);
            since = 0;
        } else if since < reach {
            since += 1;
            row[x] = true;
        }
    }
}

/// Marks of a whole frame, grown in both directions.
pub(super) fn marks_of(layout: ColorLayout, frame: &[u8], width: u32, height: u32) -> Mask {
    let rule = MarkRule::of(layout);
    let row_bytes = frame.len() / height as usize;
    let mut mask = Image::new(width, height, false);
    for (y, samples) in (0..height).zip(frame.chunks(row_bytes)) {
        rule.mark(Level::detect(), samples, mask.row_mut(y));
    }
    dilated(&mask, CHROMA_REACH)
}
