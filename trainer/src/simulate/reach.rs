//! Which directions a capture can know: those that enough training frames mirror past everything.

use geometry::{DVec2, PanoramaSize};
use imaging::Image;
use rayon::prelude::*;
use scene::Film;

/// Rows of the grid (srm-feasibility section 1).
const ROWS: u32 = 64;
/// Every how many pixels are looked at.
const STEP: usize = 3;
/// Frames that a direction has to be seen in …
const LEAST_FRAMES: u32 = 3;
/// … and pixels in all.
const LEAST_PIXELS: u32 = 6;

/// 1 where at least three of `frames` and six of their pixels (every third in x and y) mirror the direction of a texel
/// without meeting anything; else 0.
pub(super) fn reach(film: &Film, frames: &[u32]) -> Image<f32> {
    let size = PanoramaSize::from_height(ROWS).expect("64 rows make a panorama");
    let seen: Vec<Vec<u32>> = frames
        .par_iter()
        .map(|&frame| pixels_of(film, frame, size))
        .collect();
    let mut frame_count = vec![0_u32; size.texel_count()];
    let mut pixel_count = vec![0_u32; size.texel_count()];
    for pixels in seen {
        for (texel, count) in pixels.into_iter().enumerate() {
            frame_count[texel] += u32::from(count > 0);
            pixel_count[texel] += count;
        }
    }
    Image::from_fn(size.width(), size.height(), |x, y| {
        let texel = (y * size.width() + x) as usize;
        let is_known = frame_count[texel] >= LEAST_FRAMES && pixel_count[texel] >= LEAST_PIXELS;
        f32::from(u8::from(is_known))
    })
}

/// Pixels of one frame that mirror each texel.
fn pixels_of(film: &Film, frame: u32, size: PanoramaSize) -> Vec<u32> {
    let mut counts = vec![0; size.texel_count()];
    let camera = film.color().intrinsics;
    for y in (0..camera.height()).step_by(STEP) {
        for x in (0..camera.width()).step_by(STEP) {
            let at = DVec2::new(f64::from(x), f64::from(y));
            if let Some(direction) = film.mirrored_to_the_sky(frame, at) {
                counts[size.index_from_direction(direction.as_dvec3())] += 1;
            }
        }
    }
    counts
}
