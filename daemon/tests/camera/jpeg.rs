//! Colour as JPEG: the bytes of each picture, and not one more.

use std::sync::{Arc, Mutex};

use glintd::ps1080::modes::{ColorChoice, Wanted};
use imaging::{Image, encode_jpeg};
use ps1080::blocks::CmosPreset;
use ps1080::color::ColorFormat;
use ps1080::mode::Resolution;
use sequence::ColorEncoding;
use virtual_carmine::{Bus, ColorLayout, Film, Personality, VirtualCarmine};

use crate::transport::{film_with, open, pattern, small};
use crate::whole::unplugged_after;

const CYCLE: u64 = 5;
/// Bytes that the camera sends behind a picture.
const FILLER: [u8; 37] = [0xFF; 37];

/// Pictures of several lengths, some with a filler behind them.
struct Jpegs;

fn picture(index: u64) -> Vec<u8> {
    let shade = |x: u32, y: u32| [(x + 9 * index as u32) as u8, (3 * y) as u8, (x * y) as u8];
    encode_jpeg(&Image::from_fn(320, 240, shade), 40 + 10 * index as u8).unwrap()
}

impl Film for Jpegs {
    fn depth(
        &mut self,
        index: u64,
        resolution: Resolution,
        registered: bool,
        codes: &mut [u16],
    ) -> bool {
        pattern().depth(index, resolution, registered, codes)
    }

    fn infrared(&mut self, _: u64, _: Resolution, _: bool, _: &mut [u16]) -> bool {
        false
    }

    fn color(
        &mut self,
        index: u64,
        resolution: Resolution,
        layout: ColorLayout,
        frame: &mut Vec<u8>,
    ) -> bool {
        frame.extend(picture(index));
        if !index.is_multiple_of(2) {
            frame.extend(FILLER);
        }
        resolution == Resolution::Qvga && layout == ColorLayout::Jpeg
    }

    fn cycle(&self) -> u64 {
        CYCLE
    }
}

#[test]
fn jpeg_is_kept_byte_for_byte_up_to_its_end() {
    let mut personality = Personality::carmine_1_09();
    personality.color_presets.push(CmosPreset {
        format: ColorFormat::Jpeg.code(),
        resolution: Resolution::Qvga.code(),
        fps: 30,
    });
    let faults = unplugged_after(2_000_000_000);
    let camera = VirtualCarmine::new(personality, Box::new(Jpegs), faults);
    let bus = Arc::new(Mutex::new(Bus::new(camera)));
    let wanted = Wanted {
        color: ColorChoice::Format(ColorFormat::Jpeg),
        ..small()
    };
    let filmed = film_with(open(&bus, wanted).unwrap(), &bus);
    let recording = &filmed.recording;
    assert_eq!(recording.color_camera().encoding, ColorEncoding::Jpeg);
    let pictures: Vec<Vec<u8>> = (0..CYCLE).map(picture).collect();
    let frames = recording.contents().stream(sequence::COLOR_STREAM);
    assert!(frames.len() >= 30, "{}", frames.len());
    let mut expected: Option<usize> = None;
    for place in frames {
        let bytes = recording.color_frame(place).unwrap();
        let found = pictures.iter().position(|picture| *picture == bytes);
        let found = found.unwrap_or_else(|| panic!("frame {} was not filmed", place.label.number));
        assert!(expected.is_none_or(|expected| expected == found));
        expected = Some((found + 1) % CYCLE as usize);
    }
    assert!(filmed.outcome.is_whole(), "{:?}", filmed.outcome.missing);
    assert!(filmed.verified.findings.is_empty(), "{:?}", filmed.verified);
}
