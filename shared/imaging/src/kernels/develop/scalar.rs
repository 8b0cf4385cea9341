//! The specification of both kernels.

use super::{CodeLanes, LARGEST, LUMINANCE};
use crate::linear_pixel::{LinearPixel, RADIANCE_ONE};

/// See [`super::linear_row`].
pub(super) fn linear_row(
    [red, green, blue]: &CodeLanes,
    codes: &[[u8; 3]],
    scale: &[f32],
    pixels: &mut [LinearPixel],
) {
    for ((pixel, &[r, g, b]), &scale) in pixels.iter_mut().zip(codes).zip(scale) {
        let (red, green, blue) = (
            &red[usize::from(r)],
            &green[usize::from(g)],
            &blue[usize::from(b)],
        );
        let is_valid = if scale != 0.0 { 1.0 } else { 0.0 };
        let scale = [scale, scale, scale, is_valid];
        *pixel = LinearPixel(std::array::from_fn(|lane| {
            let value = (red[lane] + green[lane] + blue[lane]) * scale[lane] + 0.5;
            // Truncation is rounding half up here: no lane is negative.
            value.min(LARGEST[lane]) as u16
        }));
    }
}

/// See [`super::grey_row`].
pub(super) fn grey_row(above: &[LinearPixel], below: &[LinearPixel], grey: &mut [f32]) {
    let pairs = above
        .as_chunks::<2>()
        .0
        .iter()
        .zip(below.as_chunks::<2>().0);
    for (grey, (above, below)) in grey.iter_mut().zip(pairs) {
        *grey = grey_of([above[0], above[1], below[0], below[1]]);
    }
}

/// Mean luminance of the valid, unsaturated ones of four pixels; 0 where there is none.
#[inline(always)]
pub(super) fn grey_of(pixels: [LinearPixel; 4]) -> f32 {
    // Sums of four codes are exact in f32.
    let mut sum = [0_u32; 3];
    let mut count = 0_u32;
    for LinearPixel([red, green, blue, flags]) in pixels {
        if flags == LinearPixel::VALID {
            sum[0] += u32::from(red);
            sum[1] += u32::from(green);
            sum[2] += u32::from(blue);
            count += 1;
        }
    }
    if count == 0 {
        return 0.0;
    }
    let [red, green, blue] = sum.map(|sum| sum as f32);
    let weighted = (LUMINANCE[0] * red + LUMINANCE[1] * green) + LUMINANCE[2] * blue;
    weighted / (count as f32 * f32::from(RADIANCE_ONE))
}
