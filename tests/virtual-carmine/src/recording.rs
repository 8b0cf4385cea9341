//! A recording as film, played in a loop.

use std::path::Path;

use ps1080::mode::Resolution;
use sequence::cameras::{ColorEncoding, DepthSamples};
use sequence::{MAX_INFRARED, Recording, SequenceError, infrared_samples};

use crate::film::{ColorLayout, Film};

/// Why a recording is no film.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// It cannot be read.
    #[error(transparent)]
    Recording(#[from] SequenceError),
    /// Its depth is not in shifts, which alone a camera sends.
    #[error("depth of the recording is not in shifts")]
    NoShifts,
    /// It has no pairs of frames.
    #[error("the recording has no pair of depth and colour")]
    Empty,
}

/// Pairs of a recording, codes as they are in it, at its own resolution and in its own layout of colour alone.
pub struct RecordingFilm {
    recording: Recording,
}

impl RecordingFilm {
    /// Opens a `.glint` file.
    ///
    /// # Errors
    /// What cannot be read, or holds nothing that a camera could send.
    pub fn open(path: &Path) -> Result<Self, FilmError> {
        let recording = Recording::open(path)?;
        if recording.depth_camera().samples != DepthSamples::Codes {
            return Err(FilmError::NoShifts);
        }
        if recording.frame_count() == 0 {
            return Err(FilmError::Empty);
        }
        Ok(Self { recording })
    }

    fn pair(&self, index: u64) -> usize {
        // Below the count of pairs, which is a usize.
        (index % self.cycle()) as usize
    }
}

impl Film for RecordingFilm {
    fn depth(
        &mut self,
        index: u64,
        resolution: Resolution,
        _registered: bool,
        codes: &mut [u16],
    ) -> bool {
        let (width, height) = resolution.size();
        let Ok(image) = self.recording.depth_raw(self.pair(index)) else {
            return false;
        };
        let has_size = (image.width(), image.height()) == (width.into(), height.into());
        if has_size {
            codes.copy_from_slice(image.pixels());
        }
        has_size
    }

    fn infrared(
        &mut self,
        index: u64,
        resolution: Resolution,
        _is_lit: bool,
        samples: &mut [u16],
    ) -> bool {
        let (width, height) = resolution.size();
        let (width, height) = (width.into(), height.into());
        let camera = self.recording.color_camera();
        let size = (camera.intrinsics.width(), camera.intrinsics.height());
        if camera.encoding != ColorEncoding::Infrared10 || size != (width, height) {
            return false;
        }
        let frame = self.recording.color_raw(self.pair(index));
        let image = frame
            .ok()
            .and_then(|frame| infrared_samples(&frame, width, height).ok());
        let Some(image) = image else {
            return false;
        };
        samples
            .iter_mut()
            .zip(image.pixels())
            .for_each(|(place, sample)| *place = (*sample).min(MAX_INFRARED));
        true
    }

    fn color(
        &mut self,
        index: u64,
        resolution: Resolution,
        layout: ColorLayout,
        frame: &mut Vec<u8>,
    ) -> bool {
        let camera = self.recording.color_camera();
        let (width, height) = resolution.size();
        let size = (camera.intrinsics.width(), camera.intrinsics.height());
        let encoding = camera.encoding;
        let is_offered = matches!(
            (layout, encoding),
            (ColorLayout::Bayer, ColorEncoding::BayerGrbg)
                | (ColorLayout::Uyvy, ColorEncoding::Uyvy | ColorEncoding::Yuyv)
                | (ColorLayout::Jpeg, ColorEncoding::Jpeg)
        );
        if !is_offered || size != (width.into(), height.into()) {
            return false;
        }
        let pair = self.pair(index);
        let bytes = if encoding == ColorEncoding::Jpeg {
            self.recording.color_bytes(pair).map(<[u8]>::to_vec)
        } else {
            self.recording.color_raw(pair)
        };
        let Ok(bytes) = bytes else {
            return false;
        };
        frame.extend_from_slice(&bytes);
        if encoding == ColorEncoding::Yuyv {
            frame.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
        }
        true
    }

    fn cycle(&self) -> u64 {
        self.recording.frame_count() as u64
    }
}
