//! What can go wrong with images and image files.

use std::path::PathBuf;

/// Why an image, a curve or an image file is refused.
#[derive(Debug, thiserror::Error)]
pub enum ImagingError {
    /// A pixel buffer does not hold width · height pixels.
    #[error("a {width}x{height} image needs {expected} pixels, got {got}")]
    PixelCount {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// width · height.
        expected: u64,
        /// Length of the buffer.
        got: u64,
    },
    /// A raw frame of another length than its layout has.
    #[error("a raw colour frame of {width}x{height} pixels has {expected} bytes, got {got}")]
    FrameBytes {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// What the layout needs.
        expected: u64,
        /// Length of the frame.
        got: u64,
    },
    /// A size that no frame of its layout has.
    #[error(
        "a frame of {width}x{height} pixels cannot be developed; YUV 4:2:2 needs an even width"
    )]
    FrameSize {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// A depth camera with distortion where one without is needed.
    #[error("the depth camera has distortion; registration needs depth that was undistorted")]
    DistortedDepth,
    /// Two images that belong together differ in size.
    #[error("images of one size are needed, got {width}x{height} and {other_width}x{other_height}")]
    SizeMismatch {
        /// Width of the first image.
        width: u32,
        /// Height of the first image.
        height: u32,
        /// Width of the other image.
        other_width: u32,
        /// Height of the other image.
        other_height: u32,
    },
    /// An image measure met a value that no image of its kind has.
    #[error("pixel ({x}, {y}) holds {value}, outside [{low}, {high}]")]
    ValueOutOfRange {
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// The value found.
        value: f32,
        /// Smallest value allowed.
        low: f32,
        /// Largest value allowed.
        high: f32,
    },
    /// A response curve that cannot be inverted.
    #[error("response curve of channel {channel} is unusable: {reason}")]
    Response {
        /// 0 red, 1 green, 2 blue.
        channel: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// A parameter outside its range.
    #[error("{name} is {value}, it must be {expected}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// The value given.
        value: f64,
        /// The range in words.
        expected: &'static str,
    },
    /// A file declares more pixels than its bytes can hold or than is allowed.
    #[error("{format} declares {width}x{height} pixels in {file_bytes} bytes: more than the limit")]
    TooLarge {
        /// "jpeg", "png" or "exr".
        format: &'static str,
        /// Declared width.
        width: u64,
        /// Declared height.
        height: u64,
        /// Size of the file.
        file_bytes: u64,
    },
    /// A file ends early or breaks the rules of its format.
    #[error("{format} is damaged at byte {offset}: {reason}")]
    Damaged {
        /// "jpeg", "png" or "exr".
        format: &'static str,
        /// Where it was noticed.
        offset: u64,
        /// What is wrong.
        reason: &'static str,
    },
    /// A file of another pixel type than the caller can use.
    #[error("{format} holds {got}, expected {expected}")]
    PixelType {
        /// "jpeg", "png" or "exr".
        format: &'static str,
        /// What the file holds.
        got: String,
        /// What the caller needs.
        expected: &'static str,
    },
    /// The JPEG or PNG library refuses the file or the image.
    #[error("{format}: {source}")]
    Codec {
        /// "jpeg" or "png".
        format: &'static str,
        /// The library's own error.
        source: image::ImageError,
    },
    /// The EXR library refuses the file or the image.
    #[error("{}: {source}", path.display())]
    Exr {
        /// The file.
        path: PathBuf,
        /// The library's own error.
        source: exr::error::Error,
    },
    /// An EXR file lacks a channel.
    #[error("{} has no channel {channel:?}; it has {present}", path.display())]
    MissingChannel {
        /// The file.
        path: PathBuf,
        /// The name looked for; empty when any would do.
        channel: String,
        /// The names in the file, separated by commas.
        present: String,
    },
    /// An EXR attribute that is not what its name promises.
    #[error("attribute {name} is unusable: {reason}")]
    Attribute {
        /// The attribute's name.
        name: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// Another error, of a named file.
    #[error("{}: {source}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: Box<ImagingError>,
    },
    /// The operating system refuses a file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}
