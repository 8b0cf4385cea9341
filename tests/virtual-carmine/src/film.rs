//! What the camera sees.

use ps1080::mode::Resolution;

/// How colour is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColorLayout {
    /// U Y V Y for two pixels, row by row.
    Uyvy,
    /// A byte a pixel: G R in even rows, B G in odd ones.
    Bayer,
    /// One JPEG stream.
    Jpeg,
}

/// A scene that lasts for ever. Frames are numbered by the time they are taken at: depth, infrared and colour of one
/// number belong together, and a number says how many frame periods have passed since the camera was plugged in.
///
/// The number that a function is given is the rest after division by [`Film::cycle`].
///
/// A function that returns false has no such picture; the camera then refuses to switch the stream on.
pub trait Film: Send {
    /// Shifts (0 to 2047, 2047 and 0 are no measurement), row by row; `registered`: as the image sensor sees them.
    fn depth(
        &mut self,
        index: u64,
        resolution: Resolution,
        registered: bool,
        codes: &mut [u16],
    ) -> bool;

    /// Brightness, 0 to 1023, row by row; `is_lit`: with the dots of the emitter.
    fn infrared(
        &mut self,
        index: u64,
        resolution: Resolution,
        is_lit: bool,
        samples: &mut [u16],
    ) -> bool;

    /// Colour; `frame` is empty and gets the bytes.
    fn color(
        &mut self,
        index: u64,
        resolution: Resolution,
        layout: ColorLayout,
        frame: &mut Vec<u8>,
    ) -> bool;

    /// After so many frames the film repeats, so that what has been packed can be kept; at least 1.
    fn cycle(&self) -> u64;
}
