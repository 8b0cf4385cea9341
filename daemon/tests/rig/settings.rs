//! The file of settings, as the program reads it.

use std::path::Path;
use std::process::{Command, Output};

use crate::machine::{all_words, text};
use crate::source;

fn record(folder: &Path, settings: &str, arguments: &[&str]) -> Output {
    let config = folder.join("glintd.toml");
    std::fs::write(&config, settings).unwrap();
    let replay = format!("replay:{}?speed=max", folder.join("source.glint").display());
    Command::new(env!("CARGO_BIN_EXE_glintd"))
        .args(["record", &replay, "--json", "--config"])
        .arg(&config)
        .args(arguments)
        .output()
        .unwrap()
}

fn files(output: &Output) -> Vec<String> {
    let last = text(&output.stdout).lines().last().unwrap().to_owned();
    let summary: serde_json::Value = serde_json::from_str(&last).unwrap();
    let files = summary["files"].as_array().unwrap();
    let name = |file: &serde_json::Value| file.as_str().unwrap().to_owned();
    files.iter().map(name).collect()
}

#[test]
fn a_mistake_in_the_file_gets_one_sentence_and_code_2() {
    let folder = tempfile::tempdir().unwrap();
    source::write(folder.path(), 3, &[]);
    let cases = [
        ("", "no output is named"),
        ("output = 3", "line 1"),
        (
            "output = \".\"\nspilt_mb = 4",
            "line 2: unknown field `spilt_mb`, expected one of `output`, `camera`",
        ),
        ("output = \".\"\nsplit_mb = 0", "split_mb goes from 1"),
        ("split_seconds = -1.0", "split_seconds"),
        ("camera = \"size=xga\"", "`size=xga` is not one of"),
        ("depth_codec = \"slow\"", "expected `fast` or `dense`"),
        ("output = \"", "line 1"),
        ("fuse_threads = 65", "fuse_threads goes from 1 to 64"),
        ("output = \"x.glint\"\nkeep_mb = 1", "from a folder only"),
    ];
    for (settings, expected) in cases {
        let said = record(folder.path(), settings, &[]);
        let sentence = text(&said.stderr);
        assert_eq!(said.status.code(), Some(2), "{settings}: {sentence}");
        assert!(sentence.contains(expected), "{settings}: {sentence}");
        assert_eq!(sentence.lines().count(), 1, "{sentence}");
    }
    let absent = Command::new(env!("CARGO_BIN_EXE_glintd"))
        .args(["record", "ps1080", "--config", "absent.toml"])
        .output()
        .unwrap();
    assert_eq!(absent.status.code(), Some(2));
    assert!(text(&absent.stderr).contains("absent.toml: the configuration cannot be read"));
}

#[test]
fn the_command_line_wins() {
    let folder = tempfile::tempdir().unwrap();
    source::write(folder.path(), 200, &[]);
    let shelf = folder.path().join("shelf");
    std::fs::create_dir(&shelf).unwrap();
    // The camera's options concern cameras, fusion is off, files are split.
    let settings = format!(
        "output = {shelf:?}\ncamera = \"size=qvga\"\nfuse = false\nreserve_mb = 0\nsplit_mb = 999"
    );
    let by_file = record(folder.path(), &settings, &[]);
    assert!(by_file.status.success(), "{}", all_words(&by_file));
    let made = files(&by_file);
    assert!(
        made.len() == 1 && made[0].starts_with(shelf.to_str().unwrap()),
        "{made:?}"
    );

    let other = folder.path().join("other.glint");
    let by_line = record(folder.path(), &settings, &["-o", other.to_str().unwrap()]);
    assert_eq!(files(&by_line), [other.to_str().unwrap()]);
}

#[test]
fn old_recordings_of_this_camera_make_room() {
    let folder = tempfile::tempdir().unwrap();
    source::write(folder.path(), 60, &[]);
    let shelf = folder.path().join("shelf");
    std::fs::create_dir(&shelf).unwrap();
    let settings = format!("output = {shelf:?}\nfuse = false\nreserve_mb = 0\nkeep_mb = 1");
    let first = record(folder.path(), &settings, &[]);
    let made = files(&first).remove(0);
    // Two years ago it was 2 MB.
    let name = made.rsplit_once('-').unwrap().0;
    let old = format!("{name}-20241126T104530Z.glint");
    std::fs::write(&old, vec![0x5a; 2_000_000]).unwrap();
    std::fs::File::open(&old).unwrap().sync_all().unwrap();
    let foreign = shelf.join("kitchen.glint");
    std::fs::write(&foreign, vec![0x5a; 2_000_000]).unwrap();
    std::fs::remove_file(&made).unwrap();

    let second = record(folder.path(), &settings, &[]);
    assert!(second.status.success(), "{}", all_words(&second));
    assert!(
        text(&second.stderr).contains("removed, 2.0 MB"),
        "{}",
        all_words(&second)
    );
    assert!(!Path::new(&old).exists() && foreign.exists());
    assert!(Path::new(&files(&second)[0]).exists());
}
