//! ARCHITECTURE.md says which room uses which; the manifests must say the same.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

type Arrows = BTreeMap<String, BTreeSet<String>>;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The block of ARCHITECTURE.md fenced as `arrows`: `room -> room, room` or `room -> nothing`.
fn documented() -> Arrows {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md"))
        .expect("ARCHITECTURE.md is readable");
    let block = text
        .split("```arrows\n")
        .nth(1)
        .expect("ARCHITECTURE.md has a block fenced as `arrows`");
    let block = block.split("```").next().expect("the block has an end");
    block
        .lines()
        .map(|line| {
            let (room, used) = line
                .split_once("->")
                .expect("a line of the block reads `room -> rooms`");
            let used = used
                .split(',')
                .map(|name| name.trim().to_owned())
                .filter(|name| name != "nothing");
            (room.trim().to_owned(), used.collect())
        })
        .collect()
}

/// The same from `cargo metadata`: normal dependencies between packages of the workspace.
fn manifests() -> Arrows {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--no-deps",
            "--offline",
            "--format-version",
            "1",
        ])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let value: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
    let packages = value["packages"].as_array().expect("a list of packages");
    let name =
        |package: &serde_json::Value| package["name"].as_str().unwrap_or_default().to_owned();
    let own: BTreeSet<String> = packages.iter().map(name).collect();
    packages
        .iter()
        .filter(|package| name(package) != "glint-integration")
        .map(|package| {
            let dependencies = package["dependencies"]
                .as_array()
                .expect("a list of dependencies");
            let used = dependencies
                .iter()
                .filter(|dependency| dependency["kind"].is_null())
                .map(name)
                .filter(|used| own.contains(used));
            (name(package), used.collect())
        })
        .collect()
}

#[test]
fn the_documented_arrows_are_those_of_the_manifests() {
    assert_eq!(
        documented(),
        manifests(),
        "left: ARCHITECTURE.md, right: the manifests"
    );
}

#[test]
fn only_the_trainer_sees_its_heavy_rooms() {
    let manifests = manifests();
    for (room, used) in &manifests {
        // The simulator follows rays too, for the trainer alone.
        for (heavy, users) in [
            ("raytrace", &["glint", "scene"][..]),
            ("srm", &["glint"]),
            ("scene", &["glint"]),
        ] {
            assert!(
                users.contains(&room.as_str()) || !used.contains(heavy),
                "{room} must not use {heavy}"
            );
        }
    }
    // Those who estimate share nothing with those who simulate but shapes of data.
    assert!(!manifests["srm"].contains("scene") && !manifests["fusion"].contains("scene"));
}
