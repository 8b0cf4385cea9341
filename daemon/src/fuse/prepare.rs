//! From frames as the camera sent them to what tracking and fusion take: metres and linear radiance.

use anyhow::ensure;
use geometry::Intrinsics;
use imaging::{
    Corrector, DepthImage, DepthTable, Developer, Image, ImagingError, LinearPixel, Rgb8Image,
    Undistortion, decode_jpeg, jpeg_is_subsampled,
};
use sequence::{ColorEncoding, Streams};

/// Turns the depth of one recording into metres. Memory is taken when it is made.
pub struct DepthPreparer {
    table: DepthTable,
    undistortion: Undistortion,
    pinhole: Intrinsics,
    image: DepthImage,
}

impl DepthPreparer {
    /// For the depth of `streams`.
    ///
    /// # Errors
    /// Shifts of which nothing is known.
    pub fn new(streams: &Streams) -> anyhow::Result<Self> {
        let depth = &streams.depth;
        let range = depth.depth_range.clone();
        let table = match depth.shift_table_mm()? {
            None => DepthTable::of_values(depth.depth_scale, range),
            Some(table_mm) => DepthTable::of_codes(&table_mm, range),
        };
        let camera = &depth.intrinsics;
        let (focal, center) = (camera.focal(), camera.center());
        let (width, height) = (camera.width(), camera.height());
        Ok(Self {
            table,
            undistortion: Undistortion::new(camera),
            pinhole: Intrinsics::pinhole(width, height, focal.x, focal.y, center.x, center.y)?,
            image: DepthImage::new(width, height, 0.0),
        })
    }

    /// The camera of the prepared depth.
    pub fn pinhole(&self) -> &Intrinsics {
        &self.pinhole
    }

    /// Metres of the depth `samples`.
    ///
    /// # Errors
    /// When their count is not that of the camera's pixels.
    pub fn prepare(&mut self, samples: &[u16]) -> Result<&DepthImage, ImagingError> {
        let metres = self.image.pixels_mut();
        self.table
            .metres_into(samples, &self.undistortion, metres)?;
        Ok(&self.image)
    }

    /// Depth of the last frame.
    pub fn image(&self) -> &DepthImage {
        &self.image
    }
}

/// Turns the photographs of one recording into linear radiance. Memory is taken when it is made, but for what a JPEG
/// decoder takes.
pub struct PhotographPreparer {
    developer: Developer,
    is_jpeg: bool,
    /// The photograph, decoded.
    codes: Option<Rgb8Image>,
    is_subsampled: bool,
    pixels: Vec<LinearPixel>,
}

impl PhotographPreparer {
    /// For the photographs of `streams`.
    ///
    /// # Errors
    /// YUV that this version does not know.
    pub fn new(streams: &Streams) -> anyhow::Result<Self> {
        let color = &streams.color;
        let (columns, rows) = (color.intrinsics.width(), color.intrinsics.height());
        let corrector = Corrector::new(
            &color.response(),
            &color.vignetting(),
            columns,
            rows,
            color.relative_exposure,
        );
        Ok(Self {
            developer: Developer::new(&corrector, color.layout()?)?,
            is_jpeg: color.encoding == ColorEncoding::Jpeg,
            codes: None,
            is_subsampled: false,
            pixels: vec![LinearPixel::INVALID; columns as usize * rows as usize],
        })
    }

    /// Decodes the photograph where it is a JPEG.
    ///
    /// # Errors
    /// A JPEG that cannot be read, or has another size than its stream.
    pub fn decode(&mut self, photograph: &[u8]) -> anyhow::Result<()> {
        self.codes = None;
        if self.is_jpeg {
            let codes = decode_jpeg(photograph)?;
            let (width, height) = (self.developer.width(), self.developer.height());
            ensure!(
                (codes.width(), codes.height()) == (width, height),
                "a JPEG of {}x{} pixels in a stream of {width}x{height}",
                codes.width(),
                codes.height()
            );
            self.is_subsampled = jpeg_is_subsampled(photograph)?;
            self.codes = Some(codes);
        }
        Ok(())
    }

    /// Linear radiance of the photograph that was decoded, or is raw; its half-size luminance goes into `grey`.
    ///
    /// # Errors
    /// When an image has not the size of its camera.
    pub fn develop(
        &mut self,
        photograph: &[u8],
        grey: &mut Image<f32>,
    ) -> Result<(), ImagingError> {
        let (bytes, is_subsampled) = match &self.codes {
            Some(codes) => (codes.pixels().as_flattened(), self.is_subsampled),
            None => (photograph, false),
        };
        let (developer, pixels) = (&mut self.developer, &mut self.pixels);
        developer.develop(bytes, is_subsampled, pixels, grey.pixels_mut())
    }

    /// Photograph of the last frame.
    pub fn pixels(&self) -> &[LinearPixel] {
        &self.pixels
    }
}
