//! Streams through OpenNI2 as installed and writes what it decodes to a file.
//!
//! `openni2-stream FRAMES OUT STREAM...` with STREAM = `SENSOR:INPUT:PIXELS:WIDTH:HEIGHT:FPS`, numbers as OpenNI2 has
//! them (sensor 1 infrared, 2 colour, 3 depth; INPUT the format on the wire). Depth and colour together are asked to be
//! synchronous. Mirroring is off. First of all may stand `--register`: the camera is asked to register depth to colour; and
//! `--close`: streams are stopped and the device is closed, which takes that driver a second for each; and `--dark`: the
//! emitter is switched off once all streams run. Exit code 3: there is no OpenNI2.

mod api;

use std::fs::File;
use std::io::Write as _;
use std::process::ExitCode;

use api::{Device, Stream, StreamRequest};

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut is_asked = |option: &str| {
        let place = arguments.iter().position(|argument| argument == option);
        place.map(|place| arguments.remove(place)).is_some()
    };
    let (does_close, registers) = (is_asked("--close"), is_asked("--register"));
    let is_dark = is_asked("--dark");
    match run(&arguments, does_close, registers, is_dark) {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("openni2-stream: {error}");
            ExitCode::from(1)
        }
    }
}

fn run(
    arguments: &[String],
    does_close: bool,
    registers: bool,
    is_dark: bool,
) -> Result<u8, String> {
    let [count, out, streams @ ..] = arguments else {
        return Err("FRAMES OUT STREAM...".to_owned());
    };
    let count: usize = count.parse().map_err(|_| "FRAMES is no number")?;
    let requests: Vec<StreamRequest> = streams
        .iter()
        .map(|text| text.parse())
        .collect::<Result<_, _>>()?;
    let Some(api) = api::load() else {
        return Ok(3);
    };
    let mut out = File::create(out).map_err(|error| error.to_string())?;
    let device = Device::open(api)?;
    let mut streams = Vec::new();
    for request in &requests {
        streams.push(device.create(request)?);
    }
    if registers {
        device.register()?;
    }
    if streams.len() > 1 {
        device.synchronise()?;
    }
    for stream in &streams {
        stream.start()?;
    }
    if is_dark {
        device.darken()?;
    }
    read(&streams, &requests, count, &mut out)?;
    out.flush().map_err(|error| error.to_string())?;
    if does_close {
        drop(streams);
        device.close();
        return Ok(0);
    }
    api::leave_at_once()
}

/// For each frame: sensor, number, microseconds, bytes (each u64, little-endian), then the bytes.
fn read(
    streams: &[Stream<'_>],
    requests: &[StreamRequest],
    count: usize,
    out: &mut File,
) -> Result<(), String> {
    let mut left = vec![count; streams.len()];
    while left.iter().any(|&left| left > 0) {
        let ready = api::wait_for_any(streams)?;
        let frame = streams[ready].read()?;
        if left[ready] == 0 {
            continue;
        }
        left[ready] -= 1;
        let head = [
            u64::from(requests[ready].sensor.unsigned_abs()),
            frame.index,
            frame.micros,
            frame.data.len() as u64,
        ];
        let head: Vec<u8> = head
            .iter()
            .flat_map(|number| number.to_le_bytes())
            .collect();
        out.write_all(&head)
            .and_then(|()| out.write_all(&frame.data))
            .map_err(|error| error.to_string())?;
    }
    Ok(())
}
