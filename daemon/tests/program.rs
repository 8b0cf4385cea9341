//! The program as a user runs it: exit codes, sentences, summaries, signals, kills.

#[path = "fuse/scene.rs"]
mod scene;
#[path = "record/source.rs"]
mod source;

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use sequence::copy::recover;
use sequence::follow::Follower;
use sequence::scan::Checking;
use sequence::source::PreadFile;
use sequence::verify::verify;
use sequence::{Contents, Recording};

fn glintd(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glintd"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn summary(output: &Output) -> serde_json::Value {
    let last = text(&output.stdout).lines().last().unwrap().to_owned();
    let summary: serde_json::Value = serde_json::from_str(&last).unwrap();
    assert_eq!(summary["event"], "summary");
    summary
}

#[test]
fn a_mistake_gets_one_sentence_and_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 3, &[]);
    let input = input.to_str().unwrap();
    let replay = format!("replay:{input}?speed=max");
    let foreign = folder.path().join("foreign.glint");
    std::fs::write(&foreign, b"no recording").unwrap();
    let draft = folder.path().join("draft.glint");
    std::fs::write(
        &draft,
        b"glint recording, version 0\n and more bytes than a header has in it",
    )
    .unwrap();
    let (foreign, draft) = (foreign.to_str().unwrap(), draft.to_str().unwrap());
    let new = folder.path().join("new.glint");
    let new = new.to_str().unwrap();
    let cases: [(&[&str], &str); 10] = [
        (&["info", foreign], "no glint recording"),
        (&["verify", draft], "version 1"),
        (&["info", "absent.glint"], "absent.glint"),
        (&["info", "."], "no file"),
        (
            &["record", &replay, "-o", new, "--voxel-mm", "0.01"],
            "voxel size",
        ),
        (&["record", &replay, "-o", input, "--no-fuse"], "exists"),
        (
            &["record", "camera:1", "-o", new, "--no-fuse"],
            "no kind `camera`",
        ),
        (
            &[
                "record",
                &replay,
                "-o",
                new,
                "--no-fuse",
                "--reserve-mb",
                "999999999",
            ],
            "in reserve",
        ),
        (&["recover", input, "-o", input], "exists"),
        (
            &["cut", input, "--range", "7..9", "-o", new],
            "they go from 0 to 2",
        ),
    ];
    for (arguments, expected) in cases {
        let output = glintd(arguments);
        let sentence = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?} {sentence}");
        assert!(sentence.contains(expected), "{arguments:?} {sentence}");
        assert!(!Path::new(new).exists());
    }
}

#[test]
fn every_help_ends_with_an_example_that_parses() {
    for command in ["", "record", "info", "verify", "recover", "cut"] {
        let arguments: Vec<&str> = [command, "--help"]
            .into_iter()
            .filter(|part| !part.is_empty())
            .collect();
        let help = text(&glintd(&arguments).stdout);
        let example = help.lines().last().unwrap().trim();
        assert!(example.starts_with("glintd "), "{help}");
        // With a flag that does not exist, the parser names that flag and nothing else.
        let mut words: Vec<&str> = example.split_whitespace().skip(1).collect();
        words.push("--no-such-flag");
        let words: Vec<String> = words
            .iter()
            .map(|word| word.trim_matches('\'').to_owned())
            .collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let error = text(&glintd(&words).stderr);
        assert!(error.contains("'--no-such-flag'"), "{error}");
    }
}

#[test]
fn damage_is_listed_with_code_3_and_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 120, &[]);
    let whole = glintd(&["verify", input.to_str().unwrap(), "--decode", "--json"]);
    assert_eq!(
        (whole.status.code(), summary(&whole)["is_whole"].as_bool()),
        (Some(0), Some(true))
    );

    // One byte in the image of depth frame 60.
    let place = *Recording::open(&input).unwrap().depth_place(60).unwrap();
    let mut bytes = std::fs::read(&input).unwrap();
    bytes[place.offset as usize + 100] ^= 4;
    let broken = folder.path().join("broken.glint");
    std::fs::write(&broken, &bytes).unwrap();
    let output = glintd(&["verify", broken.to_str().unwrap()]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(
        said.contains("missing: stream 1: frame 60 (damaged)") && said.contains("NOT whole"),
        "{said}"
    );

    let mended = folder.path().join("mended.glint");
    let output = glintd(&[
        "recover",
        broken.to_str().unwrap(),
        "-o",
        mended.to_str().unwrap(),
        "--json",
    ]);
    assert_eq!(output.status.code(), Some(3));
    let copied = summary(&output);
    assert_eq!(copied["frames"], serde_json::json!([[1, 119], [2, 120]]));
    let found = verify(&mended, true).unwrap();
    assert!(found.findings.is_empty(), "{found:?}");
    assert_eq!(found.missing.len(), 1);

    // A clean file without a first page is whole after repair, so nothing is missing: code 0.
    let mut bytes = std::fs::read(&input).unwrap();
    bytes[..64].fill(0);
    let headless = folder.path().join("headless.glint");
    std::fs::write(&headless, &bytes).unwrap();
    assert_eq!(
        glintd(&["info", headless.to_str().unwrap()]).status.code(),
        Some(2)
    );
    let mended = folder.path().join("mended-too.glint");
    let output = glintd(&[
        "recover",
        headless.to_str().unwrap(),
        "-o",
        mended.to_str().unwrap(),
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(verify(&mended, true).unwrap().is_whole());
}

#[test]
fn a_range_is_cut_with_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 60, &[33]);
    let part = folder.path().join("part.glint");
    let arguments = [
        "cut",
        input.to_str().unwrap(),
        "--range",
        "30..40",
        "-o",
        part.to_str().unwrap(),
    ];
    // The number 33 has no gap in this source: it is one in the part.
    assert_eq!(glintd(&arguments).status.code(), Some(3));
    let recording = Recording::open(&part).unwrap();
    assert_eq!(recording.frame_count(), 9);
    for (index, number) in (30..40).filter(|number| *number != 33).enumerate() {
        assert_eq!(recording.depth_times(index).unwrap().number, number);
        assert_eq!(
            recording.depth_raw(index).unwrap().pixels(),
            source::depth(number)
        );
        assert_eq!(recording.color_raw(index).unwrap(), source::color(number));
    }
    let gaps = &recording.contents().gaps;
    assert!(
        gaps.len() == 2
            && gaps
                .iter()
                .all(|gap| (gap.first_number, gap.count) == (33, 1))
    );
}

#[test]
fn info_shows_what_the_recorder_counted() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 20, &[]);
    let replay = format!("replay:{}?speed=max", input.display());
    let copy = folder.path().join("copy.glint");
    let copy = copy.to_str().unwrap();
    let arguments = ["record", &replay, "-o", copy, "--no-fuse"];
    assert_eq!(glintd(&arguments).status.code(), Some(0));
    let shown = summary(&glintd(&["info", copy, "--json"]));
    let counts = shown["histograms"][0]["counts"].as_array().unwrap();
    let count: u64 = counts.iter().filter_map(serde_json::Value::as_u64).sum();
    assert!(count > 0, "{shown}");
    assert!(shown["events"].is_array(), "{shown}");
    let words = text(&glintd(&["info", copy]).stdout);
    assert!(
        words.contains(&format!(", {count} values, p50 from ")),
        "{words}"
    );
}

/// A file system in memory, as long as it lives.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    /// `None` where this user may not mount.
    fn mount(size: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"])
            .arg(folder.path())
            .output();
        mounted
            .is_ok_and(|output| output.status.success())
            .then_some(Self(folder))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn a_small_disk_that_fills_up_holds_a_valid_file_and_code_3_lists_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 3000, &[]);
    let Some(disk) = SmallDisk::mount("1m") else {
        println!("skipped a_small_disk_that_fills_up…: no right to mount a tmpfs");
        return;
    };
    for write_path in ["mapped", "pwrite"] {
        let output = disk.0.path().join("out.glint");
        let replay = format!("replay:{}?speed=max", input.display());
        let recorded = glintd(&[
            "record",
            &replay,
            "-o",
            output.to_str().unwrap(),
            "--no-fuse",
            "--json",
            "--reserve-mb",
            "0",
            "--write-path",
            write_path,
        ]);
        let said = summary(&recorded);
        assert_eq!(
            (recorded.status.code(), said["reason"].as_str()),
            (Some(3), Some("disk-full"))
        );
        let count = |key: &str| said[key].as_u64().unwrap();
        assert_eq!(count("frames_in"), count("frames_recorded") + count("gaps"));
        let found = verify(&output, true).unwrap();
        assert!(found.findings.is_empty(), "{found:?}");
        assert_eq!(
            found.missing.len(),
            said["missing"].as_array().unwrap().len()
        );
        assert_eq!(
            sealed(&output).iter().sum::<usize>() as u64,
            count("frames_recorded")
        );
        std::fs::remove_file(&output).unwrap();
    }
}

/// A recorder that goes on for ever.
fn endless(input: &Path, output: &Path) -> Child {
    Command::new(env!("CARGO_BIN_EXE_glintd"))
        .arg("record")
        .arg(format!("replay:{}?speed=max&loop", input.display()))
        .args(["--no-fuse", "--json", "--reserve-mb", "0", "-o"])
        .arg(output)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits for so many status events.
fn await_events(child: &mut Child, count: usize) {
    let stdout = child.stdout.take().unwrap();
    let mut lines = BufReader::new(stdout).lines();
    for _ in 0..count {
        let line = lines.next().unwrap().unwrap();
        assert!(line.contains("status"), "{line}");
    }
    // The rest is read on, so that the recorder never waits for this pipe.
    std::thread::spawn(move || lines.for_each(drop));
}

#[test]
fn sigterm_closes_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 50, &[]);
    let output = folder.path().join("out.glint");
    let mut child = endless(&input, &output);
    await_events(&mut child, 1);
    let status = Command::new("kill")
        .args(["-TERM", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(status.success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let found = verify(&output, true).unwrap();
    assert!(found.is_whole(), "{found:?}");
    assert_eq!(found.summary.end_reason.as_deref(), Some("stopped"));
}

#[test]
fn the_surface_is_written_and_the_summary_has_its_keys() {
    let folder = tempfile::tempdir().unwrap();
    let shots: Vec<scene::Shot> = (0..11).map(scene::Shot::From).collect();
    let shots = [&shots[..], &[scene::Shot::Blank(3)]].concat();
    let input = scene::write(folder.path(), &shots);
    let (output, mesh) = (
        folder.path().join("out.glint"),
        folder.path().join("out.ply"),
    );
    let recorded = glintd(&[
        "record",
        &format!("replay:{}?speed=max", input.display()),
        "-o",
        output.to_str().unwrap(),
        "--mesh",
        mesh.to_str().unwrap(),
        "--voxel-mm",
        "10",
        "--reserve-mb",
        "0",
        "--json",
    ]);
    assert_eq!(
        recorded.status.code(),
        Some(0),
        "{}",
        text(&recorded.stderr)
    );
    let said = summary(&recorded);
    // The keys of the design, which other tools rely on.
    for key in [
        "frames_in",
        "frames_recorded",
        "gaps",
        "tracked",
        "lost",
        "realtime_factor",
        "fuse_ms_p50",
        "fuse_ms_p99",
        "record_ms_p99",
        "bytes",
        "raw_bytes",
        "rss_peak_mb",
    ] {
        assert!(said[key].is_number(), "{key} in {said}");
    }
    let count = |key: &str| said[key].as_u64().unwrap();
    assert_eq!(
        (count("tracked"), count("lost"), count("fused")),
        (11, 1, 11)
    );
    let triangles = said["mesh"]["triangles"].as_u64().unwrap();
    assert!(triangles > 1000, "{said}");
    let bytes = std::fs::read(&mesh).unwrap();
    let end = b"end_header\n";
    let header = bytes
        .windows(end.len())
        .position(|window| window == end)
        .unwrap();
    let words = text(&bytes[..header]);
    assert!(
        words.starts_with("ply\n") && words.contains("property uchar red"),
        "{words}"
    );
    // Position and normal, sRGB and linear colour; a triangle.
    let vertices = said["mesh"]["vertices"].as_u64().unwrap();
    let body = (bytes.len() - header - end.len()) as u64;
    assert_eq!(body, 39 * vertices + 13 * triangles);
    // Beside it nothing is left.
    let names = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    assert_eq!(names.count(), 3);
}

/// Kills of a short run; `GLINT_KILLS` sets another number, `GLINT_KILL_SOURCE` another recording.
const KILLS: usize = 3;

/// Frames of stream 1 and 2 in sealed chunks.
fn sealed(path: &Path) -> [usize; 2] {
    let file = PreadFile::open(path).unwrap();
    let contents = Contents::read(&file, Checking::Marks).unwrap();
    [1, 2].map(|stream| contents.stream(stream).len())
}

#[test]
fn a_kill_at_any_moment_costs_at_most_the_unsealed_chunk() {
    let count = std::env::var("GLINT_KILLS").map_or(KILLS, |count| count.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let input = match std::env::var("GLINT_KILL_SOURCE") {
        Ok(path) => path.into(),
        Err(_) => source::write(folder.path(), 50, &[]),
    };
    let source = Recording::open(&input).unwrap();
    let period = source.contents().stream(1).len() as u64;
    let (mut tail_frames, mut sealed_frames) = (0, 0);
    let mut seed = 0x2545_f491_4f6c_dd1d_u64;
    for round in 0..count {
        let output = folder.path().join(format!("out-{round}.glint"));
        let mut child = endless(&input, &output);
        // A moment that the seed chooses: so many events, then so many turns.
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        await_events(&mut child, 1 + (seed >> 60) as usize % 3);
        for _ in 0..(seed >> 32) % 100_000 {
            std::thread::yield_now();
        }
        let mut follower = Follower::open(&output).unwrap();
        follower.poll().unwrap();
        let followed = [1, 2].map(|stream| {
            follower
                .contents()
                .map_or(0, |contents| contents.stream(stream).len())
        });
        child.kill().unwrap();
        child.wait().unwrap();

        let kept = sealed(&output);
        assert!(
            kept[0] >= followed[0] && kept[1] >= followed[1],
            "{kept:?} {followed:?}"
        );
        let mended = folder.path().join(format!("mended-{round}.glint"));
        let Ok(copied) = recover(&output, &mended) else {
            // Killed before the first record.
            assert_eq!(kept, [0, 0]);
            continue;
        };
        assert!(copied.missing.is_empty(), "{copied:?}");
        tail_frames += copied.from_tail;
        sealed_frames += (kept[0] + kept[1]) as u64;
        let recording = Recording::open(&mended).unwrap();
        let places = recording.contents().stream(1);
        assert!(places.len() >= kept[0]);
        for (number, place) in (0..).zip(places) {
            assert_eq!(place.label.number, number);
            // All of the last ones, which the kill could have hurt; of the others one in sixteen.
            if number % 16 > 0 && number as usize + 500 < places.len() {
                continue;
            }
            let original = &source.contents().stream(1)[(number % period) as usize];
            let (mended, original) = (recording.depth_frame(place), source.depth_frame(original));
            assert_eq!(mended.unwrap(), original.unwrap(), "frame {number}");
        }
        std::fs::remove_file(&output).unwrap();
        std::fs::remove_file(&mended).unwrap();
    }
    println!(
        "{count} kills: {sealed_frames} sealed frames, all kept; {tail_frames} more from behind them"
    );
}
