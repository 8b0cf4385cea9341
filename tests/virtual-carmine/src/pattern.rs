//! A film of which every pixel is a known function of frame, column and row.

use ps1080::mode::Resolution;
use ps1080::samples::NO_SHIFT;

use crate::film::{ColorLayout, Film};

const DEFAULT_CYCLE: u64 = 32;
/// Shift of the pattern's nearest place.
const NEAR_SHIFT: u32 = 300;

/// Slopes, edges, holes and noise, other ones in each frame. The first pixel carries the number of the frame.
#[derive(Clone, Copy, Debug)]
pub struct TestPattern {
    seed: u64,
    cycle: u64,
}

impl TestPattern {
    /// A pattern that repeats after 32 frames.
    pub fn new(seed: u64) -> Self {
        Self::with_cycle(seed, DEFAULT_CYCLE)
    }

    /// A pattern that repeats after `cycle` frames: 1 to 256, so that the first byte of colour tells them apart.
    pub fn with_cycle(seed: u64, cycle: u64) -> Self {
        Self {
            seed,
            cycle: cycle.clamp(1, 256),
        }
    }

    /// Number of the frame, within a cycle, of which these are all shifts, the mirrored ones not.
    pub fn depth_index(&self, codes: &[u16]) -> Option<u64> {
        codes
            .first()
            .and_then(|&code| u64::from(code).checked_sub(1))
    }

    /// The shift at column `x` and row `y`.
    pub fn shift(&self, index: u64, x: u32, y: u32, registered: bool) -> u16 {
        let frame = index % self.cycle;
        if (x, y) == (0, 0) {
            // At most 256: never 2047.
            return 1 + frame as u16;
        }
        let noise = self.noise(frame, x, y, 0);
        if noise.is_multiple_of(61) {
            return if noise & 64 == 0 { NO_SHIFT } else { 0 };
        }
        let step = if (x / 40 + y / 30 + frame as u32).is_multiple_of(3) {
            450
        } else {
            0
        };
        let slope = (x + 2 * y + 3 * frame as u32) % 900 / 2;
        let jump = if noise & 0x700 == 0 { 77 } else { 0 };
        (NEAR_SHIFT + slope + step + jump + noise % 7 + 5 * u32::from(registered)) as u16
    }

    /// The brightness at column `x` and row `y`, 0 to 1023, with the dots of the emitter.
    pub fn infrared_sample(&self, index: u64, x: u32, y: u32) -> u16 {
        self.brightness(index, x, y, true)
    }

    /// The same while the emitter is off.
    pub fn unlit_infrared_sample(&self, index: u64, x: u32, y: u32) -> u16 {
        self.brightness(index, x, y, false)
    }

    fn brightness(&self, index: u64, x: u32, y: u32, is_lit: bool) -> u16 {
        let frame = index % self.cycle;
        if (x, y) == (0, 0) {
            return frame as u16;
        }
        let noise = self.noise(frame, x, y, 1);
        let dot = if is_lit && noise.is_multiple_of(9) {
            700
        } else {
            40
        };
        ((dot + x / 4 + y / 8 + frame as u32 + noise % 16) % 1024) as u16
    }

    /// The byte of U Y V Y at byte `column` (two a pixel) and row `y`.
    pub fn uyvy_byte(&self, index: u64, column: u32, y: u32) -> u8 {
        let frame = index % self.cycle;
        if (column, y) == (0, 0) {
            return frame as u8;
        }
        let noise = self.noise(frame, column, y, 2);
        // Colours that differ between rows and between U and V, so that mixing them up shows.
        let base = match column % 4 {
            0 => 90 + wave(column) / 8 + y % 7,
            2 => 160 - wave(column) / 8 + y % 5,
            _ => 40 + (wave(column) + 3 * y + frame as u32) / 8 % 160,
        };
        let jump = if noise & 0x1F00 == 0 { 50 } else { 0 };
        (base + jump + noise % 5) as u8
    }

    /// The mosaic's byte at column `x` and row `y`.
    pub fn bayer_byte(&self, index: u64, x: u32, y: u32) -> u8 {
        let frame = index % self.cycle;
        if (x, y) == (0, 0) {
            return frame as u8;
        }
        let noise = self.noise(frame, x, y, 3);
        let base = 50 + 60 * (x % 2) + 30 * (y % 2) + (wave(x) + y + frame as u32) / 10 % 60;
        let jump = if noise & 0x1F00 == 0 { 50 } else { 0 };
        (base + jump + noise % 5) as u8
    }

    /// 32 bits that look like chance (the finaliser of SplitMix64).
    fn noise(&self, frame: u64, x: u32, y: u32, plane: u64) -> u32 {
        let place = u64::from(x) | u64::from(y) << 16 | frame << 32 | plane << 48;
        let mut bits = (place ^ self.seed.rotate_left(7)).wrapping_add(0x9E37_79B9_7F4A_7C15);
        bits = (bits ^ bits >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (bits >> 32) as u32
    }
}

impl Film for TestPattern {
    fn depth(
        &mut self,
        index: u64,
        resolution: Resolution,
        registered: bool,
        codes: &mut [u16],
    ) -> bool {
        for_each_place(resolution, codes, |x, y| {
            self.shift(index, x, y, registered)
        });
        true
    }

    fn infrared(
        &mut self,
        index: u64,
        resolution: Resolution,
        is_lit: bool,
        samples: &mut [u16],
    ) -> bool {
        for_each_place(resolution, samples, |x, y| {
            self.brightness(index, x, y, is_lit)
        });
        true
    }

    fn color(
        &mut self,
        index: u64,
        resolution: Resolution,
        layout: ColorLayout,
        frame: &mut Vec<u8>,
    ) -> bool {
        let (width, height) = resolution.size();
        let (width, height) = (u32::from(width), u32::from(height));
        for y in 0..height {
            match layout {
                ColorLayout::Uyvy => {
                    frame.extend((0..2 * width).map(|column| self.uyvy_byte(index, column, y)));
                }
                ColorLayout::Bayer => {
                    frame.extend((0..width).map(|x| self.bayer_byte(index, x, y)));
                }
                ColorLayout::Jpeg => return false,
            }
        }
        true
    }

    fn cycle(&self) -> u64 {
        self.cycle
    }
}

/// Up and down again, so that a line ends about where the next one begins: a packer that does not begin each line anew
/// is then found out.
fn wave(column: u32) -> u32 {
    let place = column % 640;
    place.min(640 - place)
}

fn for_each_place(resolution: Resolution, out: &mut [u16], value: impl Fn(u32, u32) -> u16) {
    let width = usize::from(resolution.size().0);
    for (y, row) in out.chunks_mut(width).enumerate() {
        for (x, place) in row.iter_mut().enumerate() {
            // Sides of a picture: at most 1600.
            *place = value(x as u32, y as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifts_stay_in_range_and_are_mostly_measured() {
        let mut codes = vec![0; 320 * 240];
        let mut pattern = TestPattern::new(3);
        assert!(pattern.depth(40, Resolution::Qvga, false, &mut codes));
        assert!(codes.iter().all(|&code| code <= NO_SHIFT));
        let measured = codes.iter().filter(|&&code| code != 0 && code != NO_SHIFT);
        assert!(measured.count() > 70_000);
        assert_eq!(pattern.depth_index(&codes), Some(8));
    }

    #[test]
    fn frames_of_a_cycle_differ_and_the_next_cycle_is_the_same() {
        let pattern = TestPattern::new(3);
        let row = |index| -> Vec<u16> {
            (0..320)
                .map(|x| pattern.shift(index, x, 9, false))
                .collect()
        };
        assert_ne!(row(0), row(1));
        assert_eq!(row(5), row(37));
    }
}
