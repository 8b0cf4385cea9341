//! Colours as OpenNI2 shows them (protocol section 7.5), to compare pictures with that driver. glint itself develops
//! what was recorded, see crate imaging.

/// Red, green, blue of one pixel: both pixels of a pair have the same chroma.
pub fn openni2_rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    let luma = 298 * (i32::from(y) - 16) + 128;
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    // Within i32 by far, within a byte after clamping.
    [luma + 409 * v, luma - 100 * u - 208 * v, luma + 516 * u]
        .map(|channel| (channel >> 8).clamp(0, 255) as u8)
}

/// Both pixels of the bytes U Y V Y.
pub fn openni2_rgb_pair([u, y0, v, y1]: [u8; 4]) -> [[u8; 3]; 2] {
    [openni2_rgb(y0, u, v), openni2_rgb(y1, u, v)]
}
