//! The worked examples of the protocol document, as bytes that go in and come out.

use ps1080::mode::Resolution;
use ps1080::parameter::Parameter;
use virtual_carmine::{
    Bus, ColorLayout, Control, Faults, Film, Personality, Setup, VirtualCarmine,
};

use crate::host::{Host, MILLISECOND, SECOND};

/// Sends bytes, fetches bytes.
fn exchange(bus: &mut Bus, request: &[u8]) -> Vec<u8> {
    let mut packet = request.to_vec();
    let out = Setup::vendor_out(request.len() as u16);
    assert_eq!(
        bus.control(0, out, &mut packet),
        Control::Done(request.len())
    );
    let mut reply = vec![0; 512];
    let Control::Done(length) = bus.control(MILLISECOND, Setup::vendor_in(512), &mut reply) else {
        panic!("no reply");
    };
    reply.truncate(length);
    reply
}

#[test]
fn get_param_19_of_section_2() {
    let film = Box::new(virtual_carmine::TestPattern::new(0));
    let camera = VirtualCarmine::new(Personality::carmine_1_09(), film, Faults::default());
    let mut bus = Bus::new(camera);
    let reply = exchange(&mut bus, &[0x47, 0x4D, 1, 0, 2, 0, 0x20, 0, 0x13, 0]);
    assert_eq!(reply, [0x52, 0x42, 2, 0, 2, 0, 0x20, 0, 0, 0, 0, 0]);
}

#[test]
fn get_version_of_section_3() {
    let film = Box::new(virtual_carmine::TestPattern::new(0));
    let camera = VirtualCarmine::new(Personality::carmine_1_09(), film, Faults::default());
    let mut bus = Bus::new(camera);
    let reply = exchange(&mut bus, &[0x47, 0x4D, 0, 0, 0, 0, 1, 0]);
    assert_eq!(reply[..10], [0x52, 0x42, 7, 0, 0, 0, 1, 0, 0, 0]);
    // 5.8.22: minor, major, 0x0022; PS1080; RD109.
    assert_eq!(
        reply[10..],
        [8, 5, 0x22, 0, 0x20, 0x20, 0x20, 0, 6, 0, 1, 0]
    );
}

#[test]
fn an_unknown_opcode_gets_error_2() {
    let film = Box::new(virtual_carmine::TestPattern::new(0));
    let camera = VirtualCarmine::new(Personality::carmine_1_09(), film, Faults::default());
    let mut bus = Bus::new(camera);
    let reply = exchange(&mut bus, &[0x47, 0x4D, 0, 0, 0xE7, 3, 9, 0]);
    assert_eq!(reply, [0x52, 0x42, 1, 0, 0xE7, 3, 9, 0, 2, 0]);
}

/// The rows of section 7, repeated over the picture.
struct Example;

impl Film for Example {
    fn depth(&mut self, _: u64, _: Resolution, _: bool, codes: &mut [u16]) -> bool {
        let row = [100, 200, 300, 400, 500, 600, 2047, 0];
        codes
            .iter_mut()
            .zip(row.iter().cycle())
            .for_each(|(code, &shift)| *code = shift);
        true
    }

    fn infrared(&mut self, _: u64, _: Resolution, _: bool, samples: &mut [u16]) -> bool {
        let row = [1, 2, 512, 1023];
        samples
            .iter_mut()
            .zip(row.iter().cycle())
            .for_each(|(sample, &value)| *sample = value);
        true
    }

    fn color(
        &mut self,
        _: u64,
        resolution: Resolution,
        layout: ColorLayout,
        frame: &mut Vec<u8>,
    ) -> bool {
        let (width, height) = resolution.size();
        let pixels = usize::from(width) * usize::from(height);
        let bytes: &[u8] = match layout {
            ColorLayout::Uyvy => &[120, 80, 130, 82, 121, 84, 129, 200],
            _ => &[50, 90, 52, 92],
        };
        let count = if layout == ColorLayout::Uyvy {
            2 * pixels
        } else {
            pixels
        };
        frame.extend(bytes.iter().cycle().take(count));
        true
    }

    fn cycle(&self) -> u64 {
        1
    }
}

/// The first packets of depth and of the other stream in these modes.
fn first_bytes(settings: &[(Parameter, u16)], endpoint: u8) -> Vec<u8> {
    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    let camera = VirtualCarmine::new(
        Personality::carmine_1_09(),
        Box::new(Example),
        Faults::default(),
    );
    host.bus = Bus::new(camera);
    host.set(Parameter::DepthMirror, 0);
    host.set(Parameter::ImageMirror, 0);
    for &(parameter, value) in settings {
        host.set(parameter, value);
    }
    host.bus.submit(host.now_nanos, endpoint, 1, 512);
    host.bus.advance(host.now_nanos + SECOND);
    host.bus.completed().expect("a transfer is full").data
}

#[test]
fn first_vga_packet_of_section_6_and_packed_11_of_section_7() {
    let bytes = first_bytes(
        &[(Parameter::DepthResolution, 1), (Parameter::Stream1Mode, 2)],
        0x81,
    );
    assert_eq!(
        bytes[..12],
        [0x52, 0x42, 0x00, 0x71, 0, 0, 0x0C, 0x00, 0, 0, 0, 0]
    );
    let samples = [
        0x0C, 0x83, 0x20, 0x96, 0x19, 0x03, 0xE8, 0x96, 0x3F, 0xF8, 0x00,
    ];
    assert_eq!(bytes[12..23], samples);
    assert_eq!(bytes[23..34], samples);
}

#[test]
fn compressed_yuv_of_section_7() {
    let bytes = first_bytes(&[(Parameter::Stream0Mode, 1)], 0x82);
    assert_eq!(bytes[..4], [0x52, 0x42, 0x00, 0x81]);
    assert_eq!(
        bytes[12..20],
        [0xF7, 0x8F, 0x50, 0xF8, 0x28, 0x78, 0x5F, 0xC8]
    );
}

#[test]
fn infrared_of_section_7() {
    let bytes = first_bytes(&[(Parameter::Stream0Mode, 3)], 0x82);
    assert_eq!(bytes[12..17], [0x00, 0x40, 0x28, 0x03, 0xFF]);
}
