//! Undistortion of depth: which real pixel sees what an ideal pinhole would see.

use geometry::{DVec2, Intrinsics};

/// For each pixel of the ideal pinhole with the focal lengths and centre of a camera, the pixel of the camera that
/// sees the same ray. Nearest, never a mean: averaging depths would invent surfaces across edges (hard-cases B04).
/// Made once, 4 bytes a pixel; nothing where the lens has no distortion.
#[derive(Clone, Debug)]
pub struct Undistortion {
    camera: Intrinsics,
    /// Empty without distortion.
    sources: Vec<u32>,
}

/// Source of an ideal pixel that the lens does not see.
const NO_SOURCE: u32 = u32::MAX;

impl Undistortion {
    /// For images of `camera`.
    pub fn new(camera: &Intrinsics) -> Self {
        let (width, height) = (camera.width(), camera.height());
        let (focal, center) = (camera.focal(), camera.center());
        let source = |x: u32, y: u32| {
            let ideal = (DVec2::new(f64::from(x), f64::from(y)) - center) / focal;
            let pixel = camera.pixel_from_camera(ideal.extend(1.0))?;
            let (column, line) = camera.contains(pixel)?;
            Some(line * width + column)
        };
        let sources = if camera.distortion().is_none() {
            Vec::new()
        } else {
            (0..height)
                .flat_map(|y| (0..width).map(move |x| source(x, y).unwrap_or(NO_SOURCE)))
                .collect()
        };
        Self {
            camera: *camera,
            sources,
        }
    }

    /// The camera with its distortion.
    pub fn camera(&self) -> &Intrinsics {
        &self.camera
    }

    /// Whether every pixel is its own source.
    pub fn is_identity(&self) -> bool {
        self.sources.is_empty()
    }

    /// For each ideal pixel, row by row, the index of the real one; `u32::MAX`, which is no index, where the lens
    /// sees nothing. Empty where [`Undistortion::is_identity`].
    pub fn sources(&self) -> &[u32] {
        &self.sources
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.sources.capacity() * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use geometry::Distortion;

    use super::*;

    #[test]
    fn an_ideal_pixel_takes_what_the_real_one_on_its_ray_saw() {
        let distortion = Distortion {
            k1: -0.2,
            k2: 0.05,
            p1: 0.001,
            p2: -0.002,
            k3: 0.0,
        };
        let camera = Intrinsics::new(64, 48, 60.0, 58.0, 31.0, 23.5, distortion).unwrap();
        let undistortion = Undistortion::new(&camera);
        let mut seen_count = 0;
        for (index, &source) in undistortion.sources().iter().enumerate() {
            if source == NO_SOURCE {
                continue;
            }
            seen_count += 1;
            let (x, y) = (source % 64, source / 64);
            let ray = camera.camera_from_pixel(DVec2::new(f64::from(x), f64::from(y)));
            let ray = ray.unwrap();
            let ideal = DVec2::new(ray.x / ray.z * 60.0 + 31.0, ray.y / ray.z * 58.0 + 23.5);
            let expected = DVec2::new((index % 64) as f64, (index / 64) as f64);
            // Half a real pixel, which the lens stretches by a fifth at most.
            assert!((ideal - expected).abs().max_element() < 0.65, "{index}");
        }
        assert!(seen_count > 2500, "{seen_count}");
    }

    #[test]
    fn a_pinhole_needs_no_table() {
        let camera = Intrinsics::pinhole(64, 48, 60.0, 60.0, 31.5, 23.5).unwrap();
        assert!(Undistortion::new(&camera).is_identity());
    }
}
