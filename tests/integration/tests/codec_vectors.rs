//! The codecs in another language: `tests/format/codecs.py`, written from `docs/codecs.md`, agrees on all vectors.

use std::path::Path;
use std::process::Command;

#[test]
fn the_python_decoder_agrees_on_every_vector() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let has_modules = Command::new("python3")
        .args(["-c", "import numpy, zstandard"])
        .output();
    if !has_modules.is_ok_and(|output| output.status.success()) {
        println!(
            "skipped the_python_decoder_agrees_on_every_vector: no python3 with numpy and zstandard"
        );
        return;
    }
    let output = Command::new("python3")
        .arg(root.join("tests/format/codecs.py"))
        .arg(root.join("recordings/vectors/codecs"))
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
