//! How far a view is from those that were trained on: the angle at the object (hard-cases L10).

use geometry::direction::angle_between;
use glam::DVec3;

use crate::eval::model::Model;

/// Centre of the shiny segments, surface axes; of everything where nothing is shiny.
pub(super) fn object_center(model: &Model) -> DVec3 {
    let surface = &model.surface;
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for (position, segment) in surface.positions.iter().zip(&surface.vertex_segment) {
        if model.specular_segments.is_empty() || model.specular_segments.contains(segment) {
            sum += position.as_dvec3();
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// The entry of `cameras` (centres) that is nearest in angle to `camera` as seen from `object`, and that angle in
/// radians; the first of several, `None` of none.
pub(super) fn nearest_camera(
    object: DVec3,
    camera: DVec3,
    cameras: impl Iterator<Item = DVec3>,
) -> Option<(usize, f64)> {
    cameras
        .map(|other| angle_between(camera - object, other - object))
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{DQuat, rotation};
    use rand::{RngExt as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    const NEIGHBOURS: usize = 1000;
    /// Rotating a vector in f64 errs by a few units of the last place.
    const TOLERANCE: f64 = 1e-14;

    fn naive_angle(object: DVec3, a: DVec3, b: DVec3) -> f64 {
        (a - object)
            .normalize()
            .dot((b - object).normalize())
            .acos()
    }

    fn vector(rng: &mut Pcg64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| 2.0 * rng.random::<f64>() - 1.0))
    }

    #[test]
    fn hc_l10_the_angle_to_the_nearest_view_is_zero_for_the_same_view() {
        let mut rng = Pcg64::seed_from_u64(10);
        let (mut worst_same, mut worst, mut naive_same, mut naive_small) = (0.0, 0.0, 0, 0.0);
        for _ in 0..NEIGHBOURS {
            let object = vector(&mut rng);
            let camera = object + (0.3 + rng.random::<f64>()) * vector(&mut rng).normalize();
            let (index, angle) =
                nearest_camera(object, camera, [camera].into_iter()).expect("there is one");
            assert_eq!(index, 0);
            worst_same = f64::max(worst_same, angle);
            // NaN, where the product exceeds 1, counts as wrong.
            naive_same += usize::from(naive_angle(object, camera, camera) != 0.0);
            // A known turn about the object, at another distance: distance and where a camera looks do not matter.
            let expected = 10_f64.powf(-9.0 * rng.random::<f64>());
            let axis = (camera - object).cross(vector(&mut rng)).normalize();
            let turn: DQuat = rotation::exp(axis * expected);
            let other = turn * (camera - object) * (0.5 + rng.random::<f64>());
            let (_, found) = nearest_camera(DVec3::ZERO, camera - object, [other].into_iter())
                .expect("there is one");
            worst = f64::max(worst, (found - expected).abs());
            let naive = naive_angle(DVec3::ZERO, camera - object, other);
            naive_small = f64::max(naive_small, (naive - expected).abs());
        }
        println!(
            "L10: acos errs in {naive_same} of {NEIGHBOURS} identical views, by {naive_small:.1e} in others"
        );
        assert!(naive_same > 0 && naive_small > 1e-9);
        println!("L10 identical views: worst error {worst_same:.1e}, tolerance 0");
        assert_eq!(worst_same, 0.0);
        println!("L10 known turns: worst error {worst:.1e}, tolerance {TOLERANCE:.1e}");
        assert!(worst <= TOLERANCE, "{worst}");
    }

    #[test]
    fn hc_l10_the_angle_is_that_at_the_object_not_at_the_camera() {
        // Two cameras side by side that look the same way see the object from 2 atan(1/2) apart.
        let object = DVec3::ZERO;
        let (a, b) = (DVec3::new(-0.5, 0.0, -1.0), DVec3::new(0.5, 0.0, -1.0));
        let naive_between_axes = geometry::direction::angle_between(DVec3::Z, DVec3::Z);
        let expected = 2.0 * 0.5_f64.atan();
        assert!((naive_between_axes - expected).abs() > 0.9);
        let (_, found) = nearest_camera(object, a, [b].into_iter()).expect("there is one");
        println!(
            "L10 at the object: worst error {:.1e}, tolerance {TOLERANCE:.1e}",
            (found - expected).abs()
        );
        assert!((found - expected).abs() <= TOLERANCE);
    }

    #[test]
    fn the_nearest_of_several_is_the_first_of_the_least() {
        let cameras = [DVec3::X, DVec3::Z * 2.0, DVec3::Z, DVec3::Y];
        let (index, angle) = nearest_camera(DVec3::ZERO, DVec3::Z * 5.0, cameras.into_iter())
            .expect("there are four");
        assert_eq!((index, angle), (1, 0.0));
        assert_eq!(
            nearest_camera(DVec3::ZERO, DVec3::Z, std::iter::empty()),
            None
        );
    }
}
