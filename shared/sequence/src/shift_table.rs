//! From the shifts of a structured-light sensor to depth: the device's own table, checked, or one made of its
//! constants.

use crate::cameras::{DepthCamera, DepthSamples, ShiftConstants};
use crate::error::SequenceError;

/// Farthest depth of a table that is made of constants, mm: what OpenNI2 allows at 1 mm a unit. Nearer the pole of the
/// formula a step of shift is a quarter of a metre and more.
pub const FARTHEST_MM: f64 = 10_000.0;
/// Shifts of a table that is made: 11 bits.
pub const SHIFT_COUNT: usize = 2048;

impl ShiftConstants {
    /// The offset that OpenNI2 and libfreenect subtract, pixels: where a recording does not say another.
    pub const USUAL_OFFSET: f64 = 0.375;

    /// Depth of a shift by the constants, mm, or `None` at and beyond the pole of the formula, where the rays of
    /// emitter and camera no longer meet in front of them.
    ///
    /// z = Z₀ · b / (b − m) with m = p · f · ((s − C) / k − offset), C = ⌊k · constant shift / f⌋: Z₀ the zero plane, p
    /// its pixel size, b the distance of emitter and camera, k the parameter coefficient, f the pixel size factor.
    pub fn depth_mm(&self, shift: u16) -> Option<f64> {
        let constant =
            (self.param_coefficient * self.constant_shift / self.pixel_size_factor).floor();
        let pixels = (f64::from(shift) - constant) / self.param_coefficient - self.offset_pixels;
        let along = pixels * self.zero_plane_pixel_mm * self.pixel_size_factor;
        let emitter_mm = 10.0 * self.emitter_distance_cm;
        let ahead = emitter_mm - along;
        let depth = self.zero_plane_mm * emitter_mm / ahead;
        // False for what is not a number.
        (ahead > 0.0 && depth > 0.0 && depth.is_finite()).then_some(depth)
    }

    /// The table of the constants: depth of each of [`SHIFT_COUNT`] shifts in whole mm, cut off as the device does;
    /// 0 for the first and the last shift, which are no measurement, and where no depth below [`FARTHEST_MM`] is.
    pub fn computed_table_mm(&self) -> Vec<u16> {
        let last = SHIFT_COUNT as u16 - 1;
        (0..=last)
            .map(|shift| match self.depth_mm(shift) {
                // Below 10 000, so the cast only cuts off the fraction.
                Some(depth) if shift != 0 && shift != last && depth < FARTHEST_MM => depth as u16,
                _ => 0,
            })
            .collect()
    }
}

impl DepthCamera {
    /// Depth of each shift in mm, 0 for none, where the samples are shifts: the device's table or, if it sent none, that
    /// of its constants. `None` where samples are proportional to depth.
    ///
    /// # Errors
    /// [`SequenceError::NoShiftTable`] for shifts of which nothing is known, and [`SequenceError::ShiftTable`] for
    /// a table that falls: depth grows with shift, so such a table would swap near and far.
    pub fn shift_table_mm(&self) -> Result<Option<Vec<u16>>, SequenceError> {
        if self.samples == DepthSamples::Values {
            return Ok(None);
        }
        let shift = self.shift.as_ref().ok_or(SequenceError::NoShiftTable)?;
        let table = if shift.table_mm.is_empty() {
            shift.computed_table_mm()
        } else {
            shift.table_mm.clone()
        };
        let mut farthest = 0;
        for (shift, &depth) in table.iter().enumerate() {
            if depth == 0 {
                continue;
            }
            if depth < farthest {
                return Err(SequenceError::ShiftTable { shift });
            }
            farthest = depth;
        }
        if farthest == 0 {
            return Err(SequenceError::NoShiftTable);
        }
        Ok(Some(table))
    }
}

#[cfg(test)]
mod tests {
    use geometry::Intrinsics;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Constants of a real Xtion, whose firmware counts in centimetres (120, 0.1052, 7.5).
    fn xtion() -> ShiftConstants {
        ShiftConstants {
            zero_plane_mm: 1200.0,
            zero_plane_pixel_mm: 1.052,
            emitter_distance_cm: 7.5,
            param_coefficient: 4.0,
            constant_shift: 200.0,
            pixel_size_factor: 1.0,
            offset_pixels: ShiftConstants::USUAL_OFFSET,
            table_mm: Vec::new(),
        }
    }

    /// The formula as it stands in drivers, in mm and without a look at its pole.
    fn naive_depth_mm(constants: &ShiftConstants, shift: u16) -> f64 {
        let pixels = (f64::from(shift) - 800.0) / 4.0 - 0.375;
        let m = 0.1 * constants.zero_plane_pixel_mm * pixels;
        let zero = 0.1 * constants.zero_plane_mm;
        10.0 * (m * zero / (constants.emitter_distance_cm - m) + zero)
    }

    /// Entries that are neither 0 nor above all before them, in f64, and entries behind the farthest depth.
    fn wrong_count(depths: impl Iterator<Item = f64>) -> usize {
        let mut farthest = 0.0;
        let mut count = 0;
        for depth in depths {
            if depth == 0.0 {
                continue;
            }
            count += usize::from(depth <= farthest || depth >= FARTHEST_MM);
            farthest = f64::max(farthest, depth);
        }
        count
    }

    fn shifts() -> impl Iterator<Item = u16> {
        0..SHIFT_COUNT as u16
    }

    #[test]
    fn hc_b01_no_shift_beyond_the_pole_becomes_a_depth() {
        let constants = xtion();
        let naive = wrong_count(shifts().map(|shift| naive_depth_mm(&constants, shift)));
        assert!(naive > 900, "{naive}");
        assert!(naive_depth_mm(&constants, 1086) > 500_000.0);
        assert!(naive_depth_mm(&constants, 1087) < -1e6);

        // Entries of the table that the real camera stored.
        let table = constants.computed_table_mm();
        for (shift, depth) in [
            (0, 0),
            (1, 315),
            (100, 346),
            (400, 498),
            (800, 1193),
            (1000, 3948),
            (1050, 9331),
            (1052, 9870),
        ] {
            assert_eq!(table[shift], depth, "shift {shift}");
        }
        assert!(table[1053..].iter().all(|&depth| depth == 0));

        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut wrong = 0;
        for round in 0..=1000 {
            let mut constants = xtion();
            if round > 0 {
                let mut about = |value: &mut f64| *value *= random.random_range(0.7..1.4);
                about(&mut constants.zero_plane_mm);
                about(&mut constants.zero_plane_pixel_mm);
                about(&mut constants.emitter_distance_cm);
                about(&mut constants.constant_shift);
                about(&mut constants.offset_pixels);
                constants.pixel_size_factor = f64::from(random.random_range(1..=2));
            }
            let table = constants.computed_table_mm();
            wrong += wrong_count(shifts().map(|shift| {
                let is_kept = table[usize::from(shift)] != 0;
                constants.depth_mm(shift).filter(|_| is_kept).unwrap_or(0.0)
            }));
            // In whole millimetres neighbours may be equal, never smaller.
            let kept: Vec<u16> = table.into_iter().filter(|&depth| depth != 0).collect();
            wrong += usize::from(!kept.is_sorted());
        }
        println!("B01: worst error {wrong} entries out of order or range, tolerance 0");
        assert_eq!(wrong, 0);
    }

    #[test]
    fn constants_that_are_no_numbers_give_no_depth() {
        for value in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            for field in 0..4 {
                let mut constants = xtion();
                *[
                    &mut constants.zero_plane_mm,
                    &mut constants.zero_plane_pixel_mm,
                    &mut constants.emitter_distance_cm,
                    &mut constants.param_coefficient,
                ][field] = value;
                let table = constants.computed_table_mm();
                assert_eq!(table.len(), SHIFT_COUNT);
                assert!(table.iter().all(|&depth| f64::from(depth) < FARTHEST_MM));
            }
        }
    }

    #[test]
    fn tables_are_checked_and_values_need_none() {
        let intrinsics = Intrinsics::pinhole(64, 48, 58.0, 58.0, 31.5, 23.5).unwrap();
        let mut camera = DepthCamera::new(intrinsics, 0.001, 0.4..=8.0).unwrap();
        assert_eq!(camera.shift_table_mm().unwrap(), None);
        camera.samples = DepthSamples::Codes;
        assert!(matches!(
            camera.shift_table_mm(),
            Err(SequenceError::NoShiftTable)
        ));
        camera.shift = Some(xtion());
        let computed = camera.shift_table_mm().unwrap().unwrap();
        assert_eq!(computed[800], 1193);
        let mut device = xtion();
        device.table_mm = vec![0, 400, 401, 0, 401, 500];
        camera.shift = Some(device.clone());
        assert_eq!(camera.shift_table_mm().unwrap().unwrap(), device.table_mm);
        device.table_mm[4] = 399;
        camera.shift = Some(device);
        assert!(matches!(
            camera.shift_table_mm(),
            Err(SequenceError::ShiftTable { shift: 4 })
        ));
    }
}
