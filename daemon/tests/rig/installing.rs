//! `udev/install.sh` into a folder.

use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::machine::{all_words, text, udev_file, udev_folder};

fn install(root: &Path, arguments: &[&str]) -> Output {
    Command::new(udev_folder().join("install.sh"))
        .args(arguments)
        .args(["--binary", env!("CARGO_BIN_EXE_glintd")])
        .env("DESTDIR", root)
        .output()
        .unwrap()
}

/// Files under `root` with their bytes.
fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(root).unwrap().to_path_buf();
                found.insert(name, std::fs::read(path).unwrap());
            }
        }
    }
    found
}

#[test]
fn what_is_installed_is_taken_away_again() {
    let root = tempfile::tempdir().unwrap();
    let installed = install(root.path(), &["install"]);
    assert!(installed.status.success(), "{}", all_words(&installed));
    let found = files(root.path());
    let names: Vec<&str> = found.keys().map(|path| path.to_str().unwrap()).collect();
    assert_eq!(
        names,
        [
            "etc/glint/glintd.toml",
            "etc/systemd/system/glintd@.service",
            "etc/sysusers.d/glint.conf",
            "etc/tmpfiles.d/glint.conf",
            "etc/udev/rules.d/59-glint.rules",
            "usr/local/bin/glintd",
        ]
    );
    let mode = |name: &str| {
        let path = root.path().join(name);
        path.metadata().unwrap().permissions().mode() & 0o777
    };
    assert_eq!(mode("usr/local/bin/glintd"), 0o755);
    assert_eq!(mode("etc/glint/glintd.toml"), 0o644);
    for name in names {
        assert!(text(&installed.stdout).contains(&format!("installed: /{name}")));
    }
    // A second time changes nothing.
    let again = install(root.path(), &["install"]);
    assert!(!text(&again.stdout).contains("installed: "));
    assert_eq!(files(root.path()), found);

    let removed = install(root.path(), &["uninstall"]);
    assert!(removed.status.success(), "{}", all_words(&removed));
    assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0);
    // Also where there is nothing.
    assert!(install(root.path(), &["uninstall"]).status.success());
}

#[test]
fn a_dry_run_only_says_what_it_would_do() {
    let root = tempfile::tempdir().unwrap();
    let said = install(root.path(), &["--dry-run"]);
    assert!(text(&said.stdout).contains("would install: /etc/udev/rules.d/59-glint.rules"));
    assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0);
    install(root.path(), &[]);
    let before = files(root.path());
    let said = install(root.path(), &["uninstall", "--dry-run"]);
    assert!(text(&said.stdout).contains("would remove: /usr/local/bin/glintd"));
    assert_eq!(files(root.path()), before);
}

#[test]
fn settings_of_the_owner_are_left_alone() {
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &[]);
    let settings = root.path().join("etc/glint/glintd.toml");
    std::fs::write(&settings, "output = \"/mnt/big\"\n").unwrap();
    for verb in ["install", "uninstall"] {
        let said = install(root.path(), &[verb]);
        assert!(text(&said.stdout).contains("yours, left alone: /etc/glint/glintd.toml"));
        let kept = std::fs::read_to_string(&settings).unwrap();
        assert_eq!(kept, "output = \"/mnt/big\"\n");
    }
    assert_eq!(files(root.path()).len(), 1);
}

#[test]
fn another_prefix_stands_in_the_unit() {
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--prefix", "/opt/glint"]);
    assert!(root.path().join("opt/glint/bin/glintd").is_file());
    let unit = root.path().join("etc/systemd/system/glintd@.service");
    let unit = std::fs::read_to_string(unit).unwrap();
    assert!(unit.contains("ExecStart=/opt/glint/bin/glintd record "));
    assert_eq!(
        unit.lines().count(),
        udev_file("glintd@.service").lines().count()
    );
}

#[test]
fn mistakes_get_one_sentence_and_code_2() {
    let root = tempfile::tempdir().unwrap();
    let cases: [(&[&str], &str); 2] = [
        (&["remove"], "`remove` is unknown"),
        (&["--prefix", "a b"], "no absolute path"),
    ];
    for (arguments, expected) in cases {
        let said = install(root.path(), arguments);
        let sentence = text(&said.stderr);
        assert_eq!(said.status.code(), Some(2), "{sentence}");
        assert!(
            sentence.contains(expected) && sentence.lines().count() == 1,
            "{sentence}"
        );
    }
    let said = Command::new(udev_folder().join("install.sh"))
        .args(["--binary", "/nowhere/glintd"])
        .env("DESTDIR", root.path())
        .output()
        .unwrap();
    assert_eq!(said.status.code(), Some(2));
    assert!(text(&said.stderr).contains("cargo build --release -p glintd"));
    assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0);
}
