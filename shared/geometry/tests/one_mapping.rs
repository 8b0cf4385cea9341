//! The panorama mapping exists once (house-style sections 2 and 11).

use std::fs;
use std::path::{Path, PathBuf};

/// Every file that may call `atan2(`, how often, and why. A new entry is an angle that is no longitude or
/// latitude of a direction; a direction goes through `PanoramaSize`.
const ALLOWED: &[(&str, usize, &str)] = &[
    (
        "shared/geometry/src/panorama.rs",
        2,
        "the mapping: longitude and latitude",
    ),
    (
        "shared/geometry/src/direction.rs",
        1,
        "the angle between two vectors, from lengths",
    ),
    (
        "shared/geometry/src/rotation.rs",
        2,
        "half a rotation's angle and the angle of slerp, from lengths",
    ),
    (
        "shared/geometry/tests/hard_panorama.rs",
        1,
        "the naive twin of F01",
    ),
    (
        "shared/fusion/tests/hard/minimum.rs",
        1,
        "the hue angle of a colour",
    ),
    (
        "trainer/tests/studio/mod.rs",
        1,
        "the truth of a test, apart from the mapping that it judges",
    ),
    (
        "shared/geometry/tests/one_mapping.rs",
        4,
        "this test, in text",
    ),
];

/// The lines of a source that call `atan2(`, comments left out.
fn calls(source: &str) -> Vec<usize> {
    let mut lines = Vec::new();
    for (index, line) in source.lines().enumerate() {
        let code = line.split("//").next().unwrap_or_default();
        lines.extend(std::iter::repeat_n(
            index + 1,
            code.matches("atan2(").count(),
        ));
    }
    lines
}

/// What is wrong with the calls of one file.
fn complaint(path: &str, source: &str) -> Option<String> {
    let lines = calls(source);
    let allowed = ALLOWED
        .iter()
        .find(|(file, ..)| *file == path)
        .map_or(0, |(_, count, _)| *count);
    (lines.len() != allowed).then(|| {
        format!(
            "{path} calls `atan2(` {} times, at lines {lines:?}; {allowed} are allowed",
            lines.len()
        )
    })
}

/// All Rust sources below `folder`, without build output and hidden folders, in order.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).expect("a folder of the workspace is readable");
    let mut paths: Vec<PathBuf> = entries
        .map(|e| e.expect("an entry of the workspace").path())
        .collect();
    paths.sort();
    for path in paths {
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn the_house_has_one_panorama_mapping() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut found = Vec::new();
    sources(&root, &mut found);
    let mut complaints = Vec::new();
    let mut seen = Vec::new();
    for path in &found {
        let name = path
            .strip_prefix(&root)
            .expect("below the root")
            .to_string_lossy()
            .replace('\\', "/");
        let bytes = fs::read(path).expect("a source is readable");
        complaints.extend(complaint(&name, &String::from_utf8_lossy(&bytes)));
        seen.push(name);
    }
    for (file, ..) in ALLOWED {
        assert!(
            seen.iter().any(|name| name == file),
            "{file} is allowed but does not exist"
        );
    }
    assert!(
        complaints.is_empty(),
        "use geometry::PanoramaSize for directions, or state the reason in ALLOWED:\n{}",
        complaints.join("\n")
    );
}

#[test]
fn a_second_mapping_is_found() {
    let second = "fn uv(d: Vec3) -> (f32, f32) {\n    (d.x.atan2(d.z), f32::atan2(d.y, d.z))\n}\n";
    assert_eq!(calls(second), [2, 2]);
    assert!(complaint("shared/srm/src/joint.rs", second).is_some());
    assert!(
        complaint("shared/geometry/src/panorama.rs", "").is_some(),
        "a stale entry is one too"
    );
    assert_eq!(
        calls("// d.x.atan2(d.z)\n/// lon = atan2(x, z)\n"),
        [] as [usize; 0]
    );
}
