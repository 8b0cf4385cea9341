//! A matte sheet has no reflections to find, and its glossy twin has.

use std::path::{Path, PathBuf};
use std::process::Command;

use imaging::read_rgb_exr;
use serde_json::Value;

/// Films a scene small and trains it: the run folder and the summary.
fn trained(scene: &str, folder: &Path) -> (PathBuf, Value) {
    let (recording, run) = (folder.join("x.glint"), folder.join("run"));
    let glint = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_glint"))
            .args(arguments)
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{scene}: {errors}");
        String::from_utf8(output.stdout).unwrap()
    };
    let name = recording.to_str().unwrap();
    glint(&[
        "simulate", scene, "--width", "160", "--frames", "48", "-o", name,
    ]);
    let run_name = run.to_str().unwrap();
    let said = glint(&["train", name, "-o", run_name, "--voxel-mm", "4", "--json"]);
    let summary = serde_json::from_str(said.lines().last().unwrap()).unwrap();
    (run, summary)
}

#[test]
fn matte_sheets_give_a_black_map_and_the_sentence_and_the_glossy_twin_does_not() {
    const BLACK: f32 = 0.02;
    for (scene, is_shiny) in [
        ("matte", false),
        ("matte-clean", false),
        ("shiny-plane", true),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (run, summary) = trained(scene, folder.path());
        let (map, _) = read_rgb_exr(&run.join("linear/srm0.exr")).unwrap();
        let brightest = map.pixels().iter().flatten().copied().fold(0.0, f32::max);
        let sentence = summary["sentence"].as_str().unwrap();
        println!("{scene}: brightest {brightest:.3}; {sentence}");
        assert_eq!(summary["found_specular"], is_shiny, "{scene}: {sentence}");
        assert_eq!(
            sentence.contains("nothing specular"),
            !is_shiny,
            "{scene}: {sentence}"
        );
        assert_eq!(brightest < BLACK, !is_shiny, "{scene}: {brightest}");
    }
}
