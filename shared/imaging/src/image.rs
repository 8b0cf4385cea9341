//! The image buffer: rows of pixels without padding.

use crate::error::ImagingError;

/// A row-major image without padding. Pixel (0, 0) is the first one, x runs right, y down.
#[derive(Debug, Clone, PartialEq)]
pub struct Image<T> {
    width: u32,
    height: u32,
    pixels: Vec<T>,
}

/// 8-bit codes, red, green, blue, as a sensor or a file gives them.
pub type Rgb8Image = Image<[u8; 3]>;
/// Linear radiance, red, green, blue; 1.0 = the sensor's white level.
pub type LinearImage = Image<[f32; 3]>;
/// Depth along the optical axis in metres; 0.0 = no measurement (ask [`crate::is_measured`]).
pub type DepthImage = Image<f32>;
/// A truth value per pixel.
pub type Mask = Image<bool>;

impl<T> Image<T> {
    /// A `width` x `height` image whose pixels all equal `fill`.
    pub fn new(width: u32, height: u32, fill: T) -> Self
    where
        T: Clone,
    {
        Self {
            width,
            height,
            pixels: vec![fill; width as usize * height as usize],
        }
    }

    /// Takes `pixels`, rows one after the other. Refuses a buffer that is not width · height long.
    pub fn from_vec(width: u32, height: u32, pixels: Vec<T>) -> Result<Self, ImagingError> {
        let expected = u64::from(width) * u64::from(height);
        if pixels.len() as u64 != expected {
            return Err(ImagingError::PixelCount {
                width,
                height,
                expected,
                got: pixels.len() as u64,
            });
        }
        Ok(Self {
            width,
            height,
            pixels,
        })
    }

    /// An image whose pixel (x, y) is `value(x, y)`, asked row by row.
    pub fn from_fn(width: u32, height: u32, mut value: impl FnMut(u32, u32) -> T) -> Self {
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            pixels.extend((0..width).map(|x| value(x, y)));
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Whether `other` has the same width and height.
    pub fn same_size<U>(&self, other: &Image<U>) -> bool {
        (self.width, self.height) == (other.width, other.height)
    }

    /// Refuses an image of another size.
    pub(crate) fn require_same_size<U>(&self, other: &Image<U>) -> Result<(), ImagingError> {
        if self.same_size(other) {
            return Ok(());
        }
        Err(ImagingError::SizeMismatch {
            width: self.width,
            height: self.height,
            other_width: other.width,
            other_height: other.height,
        })
    }

    /// The pixel at column `x`, row `y`.
    ///
    /// # Panics
    /// When (x, y) lies outside the image; [`Image::get`] is for coordinates that may.
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> T
    where
        T: Copy,
    {
        self.pixels[self.index(x, y)]
    }

    /// The pixel at column `x`, row `y`, to be changed.
    ///
    /// # Panics
    /// When (x, y) lies outside the image.
    #[inline]
    pub fn at_mut(&mut self, x: u32, y: u32) -> &mut T {
        let index = self.index(x, y);
        &mut self.pixels[index]
    }

    /// The pixel at column `x`, row `y`, or `None` outside the image.
    #[inline]
    pub fn get(&self, x: i64, y: i64) -> Option<T>
    where
        T: Copy,
    {
        let inside =
            (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y);
        inside.then(|| self.pixels[y as usize * self.width as usize + x as usize])
    }

    /// Row `y`, `width` pixels long.
    ///
    /// # Panics
    /// When `y` is not below the height.
    #[inline]
    pub fn row(&self, y: u32) -> &[T] {
        let width = self.width as usize;
        &self.pixels[y as usize * width..][..width]
    }

    /// Row `y`, to be changed.
    ///
    /// # Panics
    /// When `y` is not below the height.
    #[inline]
    pub fn row_mut(&mut self, y: u32) -> &mut [T] {
        let width = self.width as usize;
        &mut self.pixels[y as usize * width..][..width]
    }

    /// All pixels, rows one after the other.
    pub fn pixels(&self) -> &[T] {
        &self.pixels
    }

    /// All pixels, to be changed.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.pixels
    }

    /// The pixels without their image, rows one after the other.
    pub fn into_pixels(self) -> Vec<T> {
        self.pixels
    }

    /// The image of `convert(pixel)`.
    pub fn map<U>(&self, convert: impl FnMut(T) -> U) -> Image<U>
    where
        T: Copy,
    {
        Image {
            width: self.width,
            height: self.height,
            pixels: self.pixels.iter().copied().map(convert).collect(),
        }
    }

    #[inline]
    fn index(&self, x: u32, y: u32) -> usize {
        // Without this a column beyond the right edge would name a pixel of the next row.
        assert!(
            x < self.width && y < self.height,
            "pixel ({x}, {y}) of a {}x{} image",
            self.width,
            self.height
        );
        y as usize * self.width as usize + x as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_pixels_name_the_same_memory() {
        let mut image = Image::from_fn(3, 2, |x, y| 10 * y + x);
        assert_eq!(image.row(1), &[10, 11, 12]);
        assert_eq!(image.at(2, 1), 12);
        *image.at_mut(0, 1) = 7;
        image.row_mut(0)[1] = 5;
        assert_eq!(image.pixels(), &[0, 5, 2, 7, 11, 12]);
        assert_eq!(
            image.map(|v| v * 2).into_pixels(),
            vec![0, 10, 4, 14, 22, 24]
        );
    }

    #[test]
    fn get_outside_is_none_on_every_side() {
        let image = Image::new(3, 2, 1_u8);
        for (x, y) in [
            (-1, 0),
            (3, 0),
            (0, -1),
            (0, 2),
            (i64::MAX, 0),
            (0, i64::MIN),
        ] {
            assert_eq!(image.get(x, y), None);
        }
        assert_eq!(image.get(2, 1), Some(1));
    }

    #[test]
    fn a_buffer_of_the_wrong_length_is_refused() {
        assert!(Image::from_vec(3, 2, vec![0_u8; 5]).is_err());
        assert!(Image::from_vec(u32::MAX, u32::MAX, vec![0_u8; 1]).is_err());
        assert!(Image::from_vec(0, 2, Vec::<u8>::new()).is_ok());
    }

    #[test]
    #[should_panic(expected = "pixel (3, 0) of a 3x2 image")]
    fn a_column_beyond_the_edge_is_not_the_next_row() {
        Image::new(3, 2, 0_u8).at(3, 0);
    }
}
