//! Median edge detection (the predictor of JPEG-LS) on rows of bytes, wrapping in 8 bits.
//!
//! From left a, up b and up-left c the prediction is a + b − c, held between a and b. It is written as
//! a + b − clamp(c, min(a, b), max(a, b)): the same number, without branches and without leaving 8 bits.
//! Left of the first column stands the sample above it, above the first row stand zeros.

#[inline(always)]
fn predicted(left: u8, up: u8, up_left: u8) -> u8 {
    let (low, high) = (left.min(up), left.max(up));
    left.wrapping_add(up)
        .wrapping_sub(up_left.max(low).min(high))
}

/// Fills `residuals` with what `row` differs from its prediction; `above` is the row before. All of one length.
pub(super) fn residuals_of(row: &[u8], above: &[u8], residuals: &mut [u8]) {
    let (Some((&first, _)), Some((&first_above, _))) = (row.split_first(), above.split_first())
    else {
        return;
    };
    residuals[0] = first.wrapping_sub(first_above);
    let lefts = row;
    let pixels = row[1..].iter().zip(&above[1..]);
    for (residual, ((&sample, &up), (&left, &up_left))) in residuals[1..]
        .iter_mut()
        .zip(pixels.zip(lefts.iter().zip(above)))
    {
        *residual = sample.wrapping_sub(predicted(left, up, up_left));
    }
}

/// The inverse of [`residuals_of`]: fills `row` from `residuals` and the row before.
pub(super) fn row_from_residuals(residuals: &[u8], above: &[u8], row: &mut [u8]) {
    let Some(&first_above) = above.first() else {
        return;
    };
    let mut left = first_above;
    let mut up_left = first_above;
    for ((sample, &residual), &up) in row.iter_mut().zip(residuals).zip(above) {
        left = residual.wrapping_add(predicted(left, up, up_left));
        up_left = up;
        *sample = left;
    }
}
