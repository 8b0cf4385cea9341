//! Depth and colour in one grid, in software: the colour of every depth pixel.

use geometry::{Intrinsics, Pose};
use rayon::prelude::*;

use crate::error::ImagingError;
use crate::kernels::Level;
use crate::kernels::register::{
    NearestCells, ProjectedRow, Projection, Seen, project_row, sample_row,
};
use crate::linear_pixel::LinearPixel;

/// Rows of a band of work: a VGA image gives two threads four each.
const BAND_ROWS: usize = 60;
/// Something nearer by less parallax than this, pixels of the colour image, hides less than a sample's own blur.
const HIDING_PARALLAX: f64 = 1.0;
/// Share of inverse depth by which a surface's own samples differ inside a cell: 2 pixels of a surface 80 degrees
/// aslant at a focal length of 575 pixels.
const HIDING_SHARE: f32 = 0.02;
/// Side of a cell in which nearer hides farther, in distances of neighbouring depth pixels in the colour image. At 2
/// every cell inside a silhouette holds a depth pixel at any angle, so no background shows through cracks.
const CELL_SPACINGS: f64 = 2.0;

/// Gives every pixel of a depth camera its colour from a colour camera beside it. All memory is taken when it is
/// made; same bits for any number of threads.
///
/// A depth pixel is projected by its depth and sampled bilinearly among the valid colour pixels about that place; a
/// saturated one among them makes the sample saturated. Invalid are pixels without a measurement, those outside the
/// colour image, and those that the colour camera cannot see because something nearer lies before them (hard-cases
/// B14): in each cell of the colour image the nearest depth wins. What no depth pixel saw hides nothing.
#[derive(Debug)]
pub struct Registration {
    depth_size: [usize; 2],
    color_size: [usize; 2],
    level: Level,
    work: Work,
}

#[derive(Debug)]
enum Work {
    /// The cameras coincide.
    Copy,
    Project(Box<Projecting>),
}

#[derive(Debug)]
struct Projecting {
    projection: Projection,
    /// Nearest in the upper and in the lower half of the depth image, merged into the first; two whatever the number
    /// of threads. Absent where both cameras have one centre, so that nothing hides anything.
    nearest: Option<[NearestCells; 2]>,
    half_rows: [ProjectedRow; 2],
    band_rows: Vec<ProjectedRow>,
    /// How much nearer in inverse depth hides, 1/metres.
    hiding: f32,
}

impl Registration {
    /// From pixels of `depth`, a camera without distortion, to those of `color`, which may have some.
    ///
    /// # Errors
    /// [`ImagingError::DistortedDepth`]: undistort depth first.
    pub fn new(
        depth: &Intrinsics,
        color: &Intrinsics,
        color_from_depth: &Pose,
    ) -> Result<Self, ImagingError> {
        Self::with_level(depth, color, color_from_depth, Level::detect())
    }

    /// The same with chosen instructions; those that the machine lacks become scalar.
    ///
    /// # Errors
    /// As [`Registration::new`].
    pub fn with_level(
        depth: &Intrinsics,
        color: &Intrinsics,
        color_from_depth: &Pose,
        level: Level,
    ) -> Result<Self, ImagingError> {
        if !depth.distortion().is_none() {
            return Err(ImagingError::DistortedDepth);
        }
        let size = |camera: &Intrinsics| [camera.width() as usize, camera.height() as usize];
        let coincide = depth == color && *color_from_depth == Pose::IDENTITY;
        let work = if coincide {
            Work::Copy
        } else {
            Work::Project(Box::new(Projecting::new(depth, color, color_from_depth)))
        };
        Ok(Self {
            depth_size: size(depth),
            color_size: size(color),
            level: if level.is_usable() {
                level
            } else {
                Level::Scalar
            },
            work,
        })
    }

    /// Whether the cameras coincide: then colours are copied, also where depth was not measured.
    pub fn is_copy(&self) -> bool {
        matches!(self.work, Work::Copy)
    }

    /// Fills `registered`, one pixel per depth pixel, from `depth` (metres along the optical axis, see
    /// [`crate::is_measured`]) and `color` (one pixel per pixel of the colour camera).
    ///
    /// # Errors
    /// [`ImagingError::PixelCount`] for slices of another length than their camera has pixels.
    pub fn register(
        &mut self,
        depth: &[f32],
        color: &[LinearPixel],
        registered: &mut [LinearPixel],
    ) -> Result<(), ImagingError> {
        require_count(depth.len(), self.depth_size)?;
        require_count(color.len(), self.color_size)?;
        require_count(registered.len(), self.depth_size)?;
        match &mut self.work {
            Work::Copy => registered.copy_from_slice(color),
            Work::Project(work) => {
                let [width, _] = self.depth_size;
                work.find_nearest(self.level, depth, width);
                work.sample(self.level, depth, color, self.color_size, width, registered);
            }
        }
        Ok(())
    }
}

impl Projecting {
    fn new(depth: &Intrinsics, color: &Intrinsics, color_from_depth: &Pose) -> Self {
        let width = depth.width() as usize;
        let focal = color.focal().max_element();
        let spacing = (color.focal() / depth.focal()).max_element();
        // At least one pixel; focal lengths are within 0.2 to 10 widths, so this fits.
        let side = (CELL_SPACINGS * spacing).ceil().max(1.0) as u32;
        let baseline = color_from_depth.translation().length();
        let cells = || NearestCells::new(color.width(), color.height(), side);
        Self {
            projection: Projection::new(depth, color, color_from_depth),
            nearest: (baseline > 0.0).then(|| [cells(), cells()]),
            half_rows: std::array::from_fn(|_| ProjectedRow::new(width)),
            band_rows: vec![
                ProjectedRow::new(width);
                (depth.height() as usize).div_ceil(BAND_ROWS)
            ],
            hiding: (HIDING_PARALLAX / (baseline * focal)) as f32,
        }
    }

    fn find_nearest(&mut self, level: Level, depth: &[f32], width: usize) {
        let Some([first, second]) = &mut self.nearest else {
            return;
        };
        let row_count = depth.len() / width;
        let middle = row_count / 2;
        let (upper, lower) = depth.split_at(middle * width);
        let [upper_row, lower_row] = &mut self.half_rows;
        let projection = &self.projection;
        let enter =
            |start: usize, depth: &[f32], row: &mut ProjectedRow, cells: &mut NearestCells| {
                cells.clear();
                for (v, depth) in (start..).zip(depth.chunks_exact(width)) {
                    project_row(level, projection, v, depth, row);
                    cells.enter(level, row);
                }
            };
        rayon::join(
            || enter(0, upper, upper_row, first),
            || enter(middle, lower, lower_row, second),
        );
        first.merge(second);
    }

    fn sample(
        &mut self,
        level: Level,
        depth: &[f32],
        color: &[LinearPixel],
        [color_width, color_height]: [usize; 2],
        width: usize,
        registered: &mut [LinearPixel],
    ) {
        let seen = Seen {
            color,
            width: color_width,
            height: color_height,
            hiding: self
                .nearest
                .as_ref()
                .map(|[nearest, _]| (nearest, [self.hiding, HIDING_SHARE])),
        };
        let projection = &self.projection;
        registered
            .par_chunks_mut(BAND_ROWS * width)
            .zip(depth.par_chunks(BAND_ROWS * width))
            .zip(&mut self.band_rows)
            .enumerate()
            .for_each(|(band, ((registered, depth), row))| {
                let rows = registered
                    .chunks_exact_mut(width)
                    .zip(depth.chunks_exact(width));
                for (v, (registered, depth)) in (band * BAND_ROWS..).zip(rows) {
                    project_row(level, projection, v, depth, row);
                    sample_row(level, &seen, row, registered);
                }
            });
    }
}

fn require_count(count: usize, [width, height]: [usize; 2]) -> Result<(), ImagingError> {
    if count == width * height {
        return Ok(());
    }
    Err(ImagingError::PixelCount {
        width: width as u32,
        height: height as u32,
        expected: (width * height) as u64,
        got: count as u64,
    })
}

#[cfg(test)]
mod tests {
    use geometry::{DQuat, DVec3, Distortion};
    use rand::{RngExt as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    use super::*;

    fn camera(f: f64, distortion: Distortion) -> Intrinsics {
        Intrinsics::new(64, 130, f, f, 31.5, 64.5, distortion).unwrap()
    }

    fn registered(
        registration: &mut Registration,
        depth: &[f32],
        color: &[LinearPixel],
    ) -> Vec<LinearPixel> {
        let mut pixels = vec![LinearPixel([9; 4]); depth.len()];
        registration.register(depth, color, &mut pixels).unwrap();
        pixels
    }

    fn noise(seed: u64) -> (Vec<f32>, Vec<LinearPixel>) {
        let mut rng = Pcg64::seed_from_u64(seed);
        let count = 64 * 130;
        let depth = (0..count).map(|_| rng.random_range(0.0_f32..3.0) - 0.3);
        let depth = depth.map(|z| z.max(0.0)).collect();
        let color = (0..count)
            .map(|_| {
                let [r, g, b]: [u16; 3] = rng.random();
                LinearPixel([r, g, b, [1, 1, 1, 3, 0][rng.random_range(0..5)]])
            })
            .collect();
        (depth, color)
    }

    #[test]
    fn cameras_that_coincide_copy_and_a_distorted_depth_camera_is_refused() {
        let plain = camera(60.0, Distortion::NONE);
        let mut registration = Registration::new(&plain, &plain, &Pose::IDENTITY).unwrap();
        assert!(registration.is_copy());
        let (depth, color) = noise(1);
        assert_eq!(registered(&mut registration, &depth, &color), color);
        assert!(
            registration
                .register(&depth[1..], &color, &mut color.clone())
                .is_err()
        );
        let bent = camera(
            60.0,
            Distortion {
                k1: 0.1,
                ..Distortion::NONE
            },
        );
        assert!(Registration::new(&bent, &plain, &Pose::IDENTITY).is_err());
        assert!(
            !Registration::new(&plain, &bent, &Pose::IDENTITY)
                .unwrap()
                .is_copy()
        );
    }

    #[test]
    fn threads_and_levels_do_not_change_a_bit() {
        let beside = Pose::new(
            DQuat::from_scaled_axis(DVec3::new(0.02, 0.01, -0.03)),
            DVec3::new(0.05, 0.01, 0.002),
        )
        .unwrap();
        let (depth, color) = noise(2);
        let run = |threads: usize, level: Level| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let (from, to) = (
                camera(60.0, Distortion::NONE),
                camera(55.0, Distortion::NONE),
            );
            let mut registration = Registration::with_level(&from, &to, &beside, level).unwrap();
            pool.install(|| registered(&mut registration, &depth, &color))
        };
        let reference = run(1, Level::Scalar);
        assert!(reference.iter().any(|pixel| pixel.is_valid()));
        assert_eq!(reference, run(2, Level::Scalar));
        assert_eq!(reference, run(3, Level::Avx2));
    }

    #[test]
    fn a_tap_that_is_saturated_marks_and_one_that_is_invalid_counts_not() {
        // A quarter of a pixel to the right of each depth pixel lies its colour.
        let depth_camera = camera(60.0, Distortion::NONE);
        let color_camera = Intrinsics::pinhole(64, 130, 60.0, 60.0, 31.75, 64.5).unwrap();
        let mut registration =
            Registration::new(&depth_camera, &color_camera, &Pose::IDENTITY).unwrap();
        let mut color = vec![LinearPixel([1000, 2000, 3000, 1]); 64 * 130];
        color[64 * 10 + 5] = LinearPixel([4000, 2000, 3000, 3]);
        color[64 * 20 + 5] = LinearPixel([50_000, 0, 0, 0]);
        let mut depth = vec![1.0; 64 * 130];
        depth[64 * 30 + 5] = 0.0;
        let pixels = registered(&mut registration, &depth, &color);
        for (x, red) in [(4, 1750), (5, 3250)] {
            let LinearPixel([got, green, blue, flags]) = pixels[64 * 10 + x];
            assert!(got.abs_diff(red) <= 1, "{got}");
            assert_eq!([green, blue, flags], [2000, 3000, 3]);
        }
        assert_eq!(pixels[64 * 20 + 4], LinearPixel([1000, 2000, 3000, 1]));
        assert_eq!(pixels[64 * 20 + 5], LinearPixel::INVALID);
        assert_eq!(pixels[64 * 10 + 6], LinearPixel([1000, 2000, 3000, 1]));
        assert_eq!(pixels[64 * 30 + 5], LinearPixel::INVALID);
    }
}
