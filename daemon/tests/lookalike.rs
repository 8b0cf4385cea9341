//! The program itself against cameras in software, through a library that looks like libusb.
//!
//! Skipped by name where the program has libusb inside: nothing can stand in front of it then.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use sequence::verify::verify;
use sequence::{GapCause, Recording};
use serde_json::Value;
use virtual_carmine::TestPattern;

const SEED: u64 = 3;
const CYCLE: u64 = 8;

/// A folder with the library, the configuration and the camera's own log.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// `None` where nothing can stand in front of libusb.
    fn new(cameras: &str) -> Option<Self> {
        if !is_dynamic() {
            println!("skipped: glintd has libusb inside; install libusb-1.0-0-dev and build anew");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        usb_lookalike::library::put_into(folder.path()).unwrap();
        let log = folder.path().join("log.json");
        let config = format!("log = {log:?}\n{cameras}");
        std::fs::write(folder.path().join("cameras.toml"), config).unwrap();
        Some(Self { folder })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn glintd(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_glintd"))
            .args(arguments)
            .env("LD_LIBRARY_PATH", self.folder.path())
            .env("GLINT_VIRTUAL_CAMERAS", self.path("cameras.toml"))
            .output()
            .unwrap()
    }

    /// Records `source` without fusing into `file`, with `extra` arguments.
    fn record(&self, source: &str, file: &Path, extra: &[&str]) -> Output {
        let file = file.to_str().unwrap();
        let arguments = [
            "record",
            source,
            "-o",
            file,
            "--no-fuse",
            "--reserve-mb",
            "0",
            "--json",
        ];
        self.glintd(&[&arguments, extra].concat())
    }

    fn log(&self) -> Value {
        let text = std::fs::read_to_string(self.path("log.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }
}

fn camera(lines: &str, faults: &str) -> String {
    format!(
        "[[camera]]\npattern_seed = {SEED}\npattern_cycle = {CYCLE}\n{lines}\n[camera.faults]\n{faults}\n"
    )
}

/// Whether the program asks the system for libusb: its name stands among those of the libraries that are needed.
fn is_dynamic() -> bool {
    let program = std::fs::read(env!("CARGO_BIN_EXE_glintd")).unwrap();
    let name = b"\0libusb-1.0.so.0\0";
    program.windows(name.len()).any(|window| window == name)
}

fn summary(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    let last = text.lines().last();
    let last = last.unwrap_or_else(|| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    serde_json::from_str(last).unwrap()
}

/// Every depth sample is what was filmed.
fn assert_pixels(recording: &Recording, width: u32) {
    let pattern = TestPattern::with_cycle(SEED, CYCLE);
    for index in 0..recording.frame_count() {
        let image = recording.depth_raw(index).unwrap();
        let film_index = pattern.depth_index(image.pixels()).unwrap();
        for (place, got) in (0..).zip(image.pixels()) {
            let (x, y) = (place % width, place / width);
            assert_eq!(*got, pattern.shift(film_index, x, y, false), "{index}");
        }
    }
}

#[test]
fn an_unplugged_camera_leaves_a_whole_file_and_code_0_or_3() {
    let faults = "unplug_after_nanos = 2500000000";
    let Some(bench) = Bench::new(&camera("personality = \"carmine-1.08\"", faults)) else {
        return;
    };
    let file = bench.path("x.glint");
    let output = bench.record("ps1080?size=qvga", &file, &[]);
    let summary = summary(&output);
    assert_eq!(summary["reason"], "unplugged", "{summary}");
    let lost = summary["gaps"].as_u64().unwrap() - summary["unplugged"].as_u64().unwrap();
    assert_eq!(output.status.code(), Some(if lost > 0 { 3 } else { 0 }));
    let recording = Recording::open(&file).unwrap();
    assert_pixels(&recording, 320);
    assert!(recording.frame_count() > 20, "{summary}");
    assert!(verify(&file, true).unwrap().findings.is_empty());
    // What the camera says that it could not deliver is what the file says is missing.
    let counters = &bench.log()["cameras"][0]["counters"];
    let is_lossless =
        ["depth", "image"].map(|stream| counters[stream]["fifo_lost_packets"] == 0) == [true; 2];
    let mut causes = recording.contents().gaps.iter().map(|gap| gap.cause);
    assert!(
        !is_lossless || causes.all(|cause| cause == Some(GapCause::Unplug)),
        "{counters}"
    );
}

#[test]
fn a_recording_that_is_told_to_end_switches_the_camera_off() {
    let Some(bench) = Bench::new(&camera("", "")) else {
        return;
    };
    let file = bench.path("x.glint");
    let output = bench.record(
        "ps1080?size=qvga&exposure=auto",
        &file,
        &["--duration", "1.5"],
    );
    let summary = summary(&output);
    assert_eq!(summary["reason"], "duration", "{summary}");
    let log = bench.log();
    let parameters = &log["cameras"][0]["parameters"];
    assert_eq!(
        (&parameters["Stream0Mode"], &parameters["Stream1Mode"]),
        (&0.into(), &0.into()),
        "{log}"
    );
    assert_pixels(&Recording::open(&file).unwrap(), 320);
}

/// Every byte of colour is what was filmed.
fn assert_color(recording: &Recording, width: u32) {
    let pattern = TestPattern::with_cycle(SEED, CYCLE);
    let row_bytes = 2 * width;
    for place in recording.contents().stream(sequence::COLOR_STREAM) {
        let frame = recording.color_frame(place).unwrap();
        let is_first_row = |index: &u64| {
            (0..row_bytes).all(|x| frame[x as usize] == pattern.uyvy_byte(*index, x, 0))
        };
        let film_index = (0..CYCLE).find(is_first_row).unwrap();
        for (at, got) in (0..).zip(&frame) {
            let filmed = pattern.uyvy_byte(film_index, at % row_bytes, at / row_bytes);
            assert_eq!(*got, filmed, "frame {}, byte {at}", place.label.number);
        }
    }
}

#[test]
fn infrared_is_recorded_without_dots_and_the_emitter_is_on_again_afterwards() {
    let Some(bench) = Bench::new(&camera("", "")) else {
        return;
    };
    let file = bench.path("x.glint");
    let output = bench.glintd(&[
        "record",
        "ps1080?size=qvga&color=infrared&emitter=off",
        "-o",
        file.to_str().unwrap(),
        "--reserve-mb",
        "0",
        "--duration",
        "1.5",
        "--json",
    ]);
    let summary = summary(&output);
    assert_eq!(summary["reason"], "duration", "{summary}");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains("the emitter is off"), "{words}");
    assert_eq!(bench.log()["cameras"][0]["is_lit"], true);
    let recording = Recording::open(&file).unwrap();
    let pattern = TestPattern::with_cycle(SEED, CYCLE);
    let frames = recording.contents().stream(sequence::COLOR_STREAM);
    let mut dark_count = 0;
    for place in frames {
        let frame = recording.color_frame(place).unwrap();
        let image = sequence::infrared_samples(&frame, 320, 240).unwrap();
        let index = u64::from(image.pixels()[0]);
        dark_count += usize::from((0..).zip(image.pixels()).all(|(place, got)| {
            *got == pattern.unlit_infrared_sample(index, place % 320, place / 320)
        }));
    }
    // The emitter may have been on for the first ones.
    assert!(
        frames.len() > 20 && dark_count + 2 >= frames.len(),
        "{dark_count}"
    );
    assert!(verify(&file, true).unwrap().findings.is_empty());
}

/// `cargo test --release -p glintd --test lookalike -- --ignored --nocapture minute`, on a machine that is idle: the
/// camera loses what nobody reads in time.
#[test]
#[ignore = "takes a minute and an idle machine"]
fn a_minute_of_both_streams_comes_whole() {
    let Some(bench) = Bench::new(&camera("personality = \"carmine-1.08\"", "")) else {
        return;
    };
    let file = bench.path("x.glint");
    let output = bench.record("ps1080", &file, &["--duration", "60"]);
    let summary = summary(&output);
    println!("{summary:#}\n{:#}", bench.log());
    println!("{}", String::from_utf8_lossy(&output.stderr));
    let counters = &bench.log()["cameras"][0]["counters"];
    for stream in ["depth", "image"] {
        assert_eq!(counters[stream]["fifo_lost_packets"], 0, "{counters}");
    }
    assert_eq!(
        (output.status.code(), &summary["gaps"]),
        (Some(0), &0.into())
    );
    let recording = Recording::open(&file).unwrap();
    assert!(recording.frame_count() > 1700, "{summary}");
    assert_pixels(&recording, 640);
    assert_color(&recording, 640);
    assert!(verify(&file, true).unwrap().findings.is_empty());
}

#[test]
fn list_shows_every_camera_and_why_one_does_not_answer() {
    let cameras = [
        camera("personality = \"carmine-1.08\"", ""),
        camera("ports = [3]\nis_busy = true", ""),
        camera("ports = [4]\nis_forbidden = true", ""),
    ];
    let Some(bench) = Bench::new(&cameras.concat()) else {
        return;
    };
    let output = bench.glintd(&["list", "--json"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let events: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(events.len(), 4, "{text}");
    assert_eq!(events[0]["serial"], "1206090000");
    assert!(
        events[0]["firmware"]
            .as_str()
            .unwrap()
            .starts_with("5.8.22")
    );
    assert_eq!(
        (&events[0]["bus"], &events[0]["speed"]),
        (&1.into(), &"high".into())
    );
    let problem = |index: usize| events[index]["problem"].as_str().unwrap_or_default();
    assert!(problem(1).contains("another program"), "{text}");
    assert!(problem(2).contains("udev rule"), "{text}");
    assert_eq!(events[3]["cameras"], 3);
    let which = bench.glintd(&["record", "ps1080", "-o", "/absent/x.glint"]);
    let words = String::from_utf8_lossy(&which.stderr).into_owned();
    assert!(
        which.status.code() == Some(2) && words.contains("name one"),
        "{words}"
    );
}

#[test]
fn a_camera_that_cannot_be_used_is_one_sentence_and_code_2() {
    let cases = [
        (camera("is_safe_mode = true", ""), "ps1080", "safe mode"),
        (camera("is_busy = true", ""), "ps1080", "another program"),
        (camera("is_forbidden = true", ""), "ps1080", "no right"),
        (camera("", ""), "ps1080:0815", "0815"),
        (camera("", ""), "ps1080:/sys/absent", "/sys/absent"),
        (
            camera("personality = \"carmine-1.08\"", ""),
            "ps1080?color=bayer",
            "does not offer",
        ),
        (String::new(), "ps1080", "no PrimeSense camera"),
        (
            camera("personality = \"firmware-5.4\"", ""),
            "ps1080?color=infrared&emitter=off",
            "5.8.15",
        ),
        (
            camera("", ""),
            "ps1080?color=infrared&registration=on",
            "do not go together",
        ),
        (
            camera("", ""),
            "ps1080?color=infrared&fps=60",
            "qvga at 30 or 60",
        ),
        (
            camera("", ""),
            "ps1080?color=infrared&exposure=auto",
            "no exposure",
        ),
    ];
    for (cameras, source, expected) in cases {
        let Some(bench) = Bench::new(&cameras) else {
            return;
        };
        let file = bench.path("x.glint");
        let output = bench.glintd(&["record", source, "-o", file.to_str().unwrap()]);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert!(words.contains(expected), "{expected}: {words}");
        assert!(!Path::new(&file).exists(), "{expected}");
    }
}
