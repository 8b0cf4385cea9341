//! Maps on the grid that scores are taken on, and in other axes.

use geometry::{DQuat, DVec2, PanoramaSize};
use imaging::{Image, LinearImage};

/// Rows of the grid that scores are taken on (128 x 64).
pub(super) const GRID_HEIGHT: u32 = 64;

/// A map on the grid.
pub(super) type Grid = Vec<[f64; 3]>;

/// The size of the grid.
pub(super) fn grid_size() -> PanoramaSize {
    PanoramaSize::from_height(GRID_HEIGHT).expect("64 rows make a panorama")
}

/// Source texels and counts of every grid block; sizes that do not divide are sampled bilinearly at four
/// times the grid first.
fn blocks(width: u32, height: u32, size: PanoramaSize) -> Option<u32> {
    let factor = height / size.height();
    (factor >= 1 && factor * size.height() == height && width == 2 * height).then_some(factor)
}

fn resampled(image: &LinearImage, size: PanoramaSize) -> LinearImage {
    let fine = PanoramaSize::from_height(4 * size.height()).expect("a multiple of the grid");
    turned_to(image, fine, DQuat::IDENTITY)
}

/// The map in other axes, at its own size; `turn` takes its directions to the new ones.
pub(super) fn turned(image: &LinearImage, turn: DQuat) -> LinearImage {
    match PanoramaSize::from_height(image.height()) {
        Some(size) => turned_to(image, size, turn),
        None => image.clone(),
    }
}

/// The map at another size and in other axes, bilinear.
fn turned_to(image: &LinearImage, fine: PanoramaSize, turn: DQuat) -> LinearImage {
    let source = PanoramaSize::from_height(image.height());
    let back = turn.conjugate();
    let pixels = (0..fine.texel_count())
        .map(|index| {
            let texel = DVec2::new(
                (index % fine.width() as usize) as f64,
                (index / fine.width() as usize) as f64,
            );
            let Some(source) = source else {
                return [0.0; 3];
            };
            let taps = source.taps(back * fine.direction_from_texel(texel));
            let mut value = [0.0_f32; 3];
            for (&texel, weight) in taps.texels.iter().zip(taps.weights) {
                let color = image.pixels()[texel as usize];
                for c in 0..3 {
                    value[c] += weight * color[c];
                }
            }
            value
        })
        .collect();
    Image::from_vec(fine.width(), fine.height(), pixels).expect("one value a texel")
}

/// The plain mean of each block.
pub(super) fn block_mean(image: &LinearImage, size: PanoramaSize) -> Grid {
    let ones = Image::new(image.width(), image.height(), 1.0_f32);
    grid_map(image, &ones, size).0
}

/// The plain mean of each block of one channel.
pub(super) fn grid_scalar(image: &Image<f32>, size: PanoramaSize) -> Vec<f64> {
    let wide = image.map(|v| [v; 3]);
    block_mean(&wide, size).into_iter().map(|v| v[0]).collect()
}

/// Item 1: the map by the confidence-weighted block mean, the confidence by the plain one.
pub(super) fn grid_map(
    map: &LinearImage,
    confidence: &Image<f32>,
    size: PanoramaSize,
) -> (Grid, Vec<f64>) {
    let (map, confidence) = match blocks(map.width(), map.height(), size) {
        Some(_) => (map.clone(), confidence.clone()),
        None => (
            resampled(map, size),
            resampled(&confidence.map(|c| [c; 3]), size).map(|v| v[0]),
        ),
    };
    let factor = map.height() / size.height();
    let mut values = Vec::with_capacity(size.texel_count());
    let mut confidences = Vec::with_capacity(size.texel_count());
    for row in 0..size.height() {
        for column in 0..size.width() {
            let (mut sum, mut weight, mut plain) = ([0.0; 3], 0.0, 0.0);
            for y in row * factor..(row + 1) * factor {
                for x in column * factor..(column + 1) * factor {
                    let color = map.at(x, y).map(f64::from);
                    let finite = color.iter().all(|v| v.is_finite());
                    let c = if finite {
                        f64::from(confidence.at(x, y))
                    } else {
                        0.0
                    };
                    plain += c;
                    if finite {
                        weight += c + 1e-6;
                        for channel in 0..3 {
                            sum[channel] += color[channel] * (c + 1e-6);
                        }
                    }
                }
            }
            values.push(if weight > 0.0 {
                sum.map(|s| s / weight)
            } else {
                [0.0; 3]
            });
            confidences.push(plain / f64::from(factor * factor));
        }
    }
    (values, confidences)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::rotation;

    #[test]
    fn a_turned_map_turns_back() {
        let size = PanoramaSize::from_height(64).unwrap();
        let toward = |index: usize| {
            let (column, row) = (index % 128, index / 128);
            size.direction_from_texel(DVec2::new(column as f64, row as f64))
        };
        // Smooth, so that bilinear taps cost little.
        let value = |d: geometry::DVec3| [(0.5 + 0.3 * d.x + 0.2 * d.y * d.z) as f32; 3];
        let turn = rotation::exp(geometry::DVec3::new(0.3, -0.8, 0.2));
        let in_map = (0..size.texel_count()).map(|i| value(toward(i))).collect();
        let map = Image::from_vec(128, 64, in_map).unwrap();
        let found = turned(&map, turn);
        for (index, pixel) in found.pixels().iter().enumerate() {
            let expected = value(turn.conjugate() * toward(index));
            assert!((pixel[0] - expected[0]).abs() < 2e-3);
        }
        assert_eq!(
            turned(&map, DQuat::IDENTITY).pixels().len(),
            map.pixels().len()
        );
    }
}
