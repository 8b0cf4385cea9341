//! Prints what each codec makes of real frames, all from one run on one thread: Markdown tables.
//!
//! `codec_table DATA [--every N]`
//!
//! DATA holds `redkitchen/frame-*.depth.png` (16 bit, millimetres) and `colour-png/*.color.png` (RGB that never was
//! JPEG). Every N-th depth frame is taken (15); a frame is coded and decoded five times, compared, and its
//! fastest time kept; a row gives the median and the minimum over the frames, process CPU time. FFV1 is
//! measured where an `ffmpeg` is on the PATH: its own user time over all frames, raw input and output included.

mod codec_table {
    pub(crate) mod color;
    pub(crate) mod depth;
    pub(crate) mod ffv1;
    pub(crate) mod measure;
}

use std::path::Path;

use codec_table::measure::Failure;

fn main() -> Result<(), Failure> {
    let mut words = std::env::args().skip(1);
    let data = words
        .next()
        .ok_or("give the folder with redkitchen and colour-png")?;
    let mut every = 15;
    while let Some(word) = words.next() {
        match word.as_str() {
            "--every" => every = words.next().ok_or("--every needs a number")?.parse()?,
            other => return Err(format!("unknown argument {other}").into()),
        }
    }
    codec_table::depth::print(Path::new(&data), every)?;
    codec_table::color::print(Path::new(&data))
}
