//! The command: what it writes, and what it refuses.

use std::path::Path;
use std::process::{Command, Output};

use imaging::{read_channel_exr, read_rgb_exr};
use sequence::{ColorEncoding, DepthSamples, Recording};

fn glint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glint"))
        .args(arguments)
        .output()
        .unwrap()
}

fn simulate(folder: &Path, extra: &[&str]) -> Output {
    let output = folder.join("x.glint");
    let mut arguments = vec!["simulate", "bowls", "--width", "96", "--frames", "12", "-o"];
    arguments.push(output.to_str().unwrap());
    arguments.extend(extra);
    glint(&arguments)
}

#[test]
fn a_simulation_is_a_raw_recording_with_its_truth_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let made = simulate(folder.path(), &["--truth-every", "5"]);
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
    let recording = Recording::open(&folder.path().join("x.glint")).unwrap();
    assert_eq!(recording.frame_count(), 12);
    assert_eq!(recording.color_camera().encoding, ColorEncoding::BayerGrbg);
    assert_eq!(recording.depth_camera().samples, DepthSamples::Codes);
    assert!(!recording.depth_camera().is_registered);
    let split = recording.split();
    assert_eq!(
        split.train.len() + split.unused.len() + split.test.len(),
        12
    );
    assert!(
        recording
            .poses("source")
            .unwrap()
            .iter()
            .all(Option::is_some)
    );
    let truth = folder.path().join("x.truth");
    let (environment, _) = read_rgb_exr(&truth.join("environment.exr")).unwrap();
    assert_eq!(environment.width(), 2 * environment.height());
    read_channel_exr(&truth.join("reach.exr"), None).unwrap();
    for name in ["mesh.ply", "poses.txt", "split.json", "manifest.json"] {
        assert!(truth.join(name).exists(), "{name}");
    }
    for number in [0, 5, 10] {
        let components = truth.join(format!("components/{number:06}.exr"));
        for channel in ["D.R", "S.G", "FBI.B", "N.R", "R.G", "V"] {
            read_channel_exr(&components, Some(channel)).unwrap();
        }
    }
    for number in &split.test {
        assert!(truth.join(format!("masks/{number:06}.png")).exists());
    }
    // The recording holds nothing that a camera would not know.
    let bytes = std::fs::read(folder.path().join("x.glint")).unwrap();
    assert!(!bytes.windows(11).any(|window| window == b"environment"));
}

#[test]
fn the_same_seed_makes_the_same_file_and_another_seed_another() {
    let folders = [0, 1, 2].map(|_| tempfile::tempdir().unwrap());
    for (folder, extra) in folders.iter().zip([
        &["--threads", "1"][..],
        &["--threads", "2"][..],
        &["--seed", "2"][..],
    ]) {
        assert!(simulate(folder.path(), extra).status.success());
    }
    let [a, b, c] = folders
        .each_ref()
        .map(|f| std::fs::read(f.path().join("x.glint")).unwrap());
    assert_eq!(a, b);
    assert_ne!(a, c);
}

#[test]
fn what_cannot_be_simulated_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("x.glint");
    let output = output.to_str().unwrap();
    for (arguments, word) in [
        (
            vec!["simulate", "nothing", "-o", output],
            "there is no scene",
        ),
        (
            vec!["simulate", "matte", "-o", output, "--width", "97"],
            "multiple of 4",
        ),
        (
            vec!["simulate", "matte", "-o", output, "--effects", "+fog"],
            "no effect",
        ),
        (
            vec![
                "simulate",
                "matte",
                "-o",
                output,
                "--effects",
                "+first-bounce,-visibility",
            ],
            "first-bounce",
        ),
        (
            vec!["simulate", "matte", "-o", output, "--pose-noise", "2"],
            "pose noise",
        ),
        (
            vec![
                "simulate",
                "matte",
                "-o",
                output,
                "--environment",
                "absent.exr",
            ],
            "absent.exr",
        ),
        (vec!["simulate", "matte"], "-o"),
    ] {
        let refused = glint(&arguments);
        let text = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains(word), "{arguments:?}: {text}");
        assert!(!Path::new(output).exists());
    }
    // A folder that is no truth of a simulation is never removed.
    let beside = folder.path().join("x.truth");
    std::fs::create_dir(&beside).unwrap();
    std::fs::write(beside.join("mine"), "keep").unwrap();
    let refused = simulate(folder.path(), &["--overwrite"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(beside.join("mine").exists());
}

#[test]
fn every_scene_is_listed() {
    let listed = glint(&["simulate", "list"]);
    let text = String::from_utf8_lossy(&listed.stdout).into_owned();
    for name in scene::catalogue::names() {
        assert!(text.contains(name), "{name}");
    }
}
