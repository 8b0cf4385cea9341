//! The format in another language: programs written from the pages in `docs/` agree with all vectors.

use std::path::Path;
use std::process::Command;

/// Runs `script` on `vectors`, or says that `test` was skipped.
fn agree(test: &str, script: &str, vectors: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let has_modules = Command::new("python3")
        .args(["-c", "import numpy, zstandard"])
        .output();
    if !has_modules.is_ok_and(|output| output.status.success()) {
        println!("skipped {test}: no python3 with numpy and zstandard");
        return;
    }
    let output = Command::new("python3")
        .arg(root.join("tests/format").join(script))
        .arg(root.join("recordings/vectors").join(vectors))
        .output()
        .expect("python3 ran a moment ago");
    let report = String::from_utf8_lossy(&output.stdout);
    print!("{report}");
    assert!(
        output.status.success(),
        "{report}{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn the_python_decoder_agrees_on_every_vector() {
    let test = "the_python_decoder_agrees_on_every_vector";
    agree(test, "codecs.py", "codecs");
}

#[test]
fn the_python_reader_agrees_on_every_recording() {
    let test = "the_python_reader_agrees_on_every_recording";
    agree(test, "glint_reader.py", "recordings");
}
