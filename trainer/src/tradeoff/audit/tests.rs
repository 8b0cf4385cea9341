//! Audits of tables whose children are shell scripts that read their figures from a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use super::*;
use crate::progress::Progress;
use crate::tradeoff::measure;
use crate::tradeoff::subject::{Axis, Knob, Setting};

const SUBJECT: Subject = Subject {
    name: "script",
    knobs: &[Knob {
        name: "level",
        default: "1",
        others: &["2", "3", "bad"],
    }],
    cost: Axis {
        key: "cost",
        label: "cost",
    },
    error: Axis {
        key: "error",
        label: "error",
    },
    beside: &[],
    exact: &["rows"],
    no_candidates: &[],
    tracked: None,
};

/// Prints the file: cost, error, rows; the level is added to the error.
struct Scripts {
    file: PathBuf,
}

impl PointRunner for Scripts {
    fn subject(&self) -> &Subject {
        &SUBJECT
    }

    fn command(&self, setting: &Setting, _desk: &Path) -> anyhow::Result<Command> {
        let mut command = Command::new("sh");
        let script = match setting["level"].as_str() {
            "bad" => "exit 2".to_owned(),
            level => format!("echo $(cat {}) {level}", self.file.display()),
        };
        command.args(["-c", &script]);
        Ok(command)
    }

    fn figures(&self, last_line: &str, _desk: &Path, _core_s: f64) -> anyhow::Result<PointFigures> {
        let words = last_line.split_whitespace().map(str::parse);
        let numbers: Vec<f64> = words.collect::<Result<_, _>>()?;
        let [cost, error, rows, level] = numbers[..] else {
            anyhow::bail!("four numbers are wanted");
        };
        Ok(PointFigures {
            metrics: BTreeMap::from([
                ("cost".to_owned(), cost),
                ("error".to_owned(), error + level),
                ("rows".to_owned(), rows),
            ]),
            blocks: vec![error; 3],
        })
    }
}

fn measured(desk: &Path) -> (Scripts, TradeoffOptions) {
    let scripts = Scripts {
        file: desk.join("figures"),
    };
    std::fs::write(&scripts.file, "2.0 0.1 7").unwrap();
    let options = TradeoffOptions {
        output: desk.join("out"),
        scene: "a scene".to_owned(),
        scene_blake3: "00".repeat(32),
        program: PathBuf::from("/bin/sh"),
        repetitions: 2,
        seed: 5,
        timeout: Duration::from_secs(60),
    };
    measure(&scripts, &options, &Progress::silent()).unwrap();
    (scripts, options)
}

fn page(options: &TradeoffOptions) -> String {
    std::fs::read_to_string(options.output.join("script.html")).unwrap()
}

#[test]
fn rows_that_repeat_are_stamped_and_the_table_stays() {
    let desk = tempfile::tempdir().unwrap();
    let (scripts, options) = measured(desk.path());
    let table = || std::fs::read_to_string(options.output.join("script.csv")).unwrap();
    let before = table();
    assert!(!page(&options).contains("audited"));
    let audited = audit(&scripts, &options, 3).unwrap();
    assert_eq!(audited.rows.len(), 3);
    assert!(audited.disagreements().is_empty() && audited.is_same_program);
    // Rows that failed are not drawn, and the same seed draws the same.
    assert!(audited.rows.iter().all(|row| row.point != "level=bad"));
    let again = audit(&scripts, &options, 3).unwrap();
    assert_eq!(audited.rows, again.rows);
    let whole = audit(&scripts, &options, 100).unwrap();
    assert_eq!(whole.rows.len(), 6);
    assert!(page(&options).contains("6 rows run again, all agree"));
    assert_eq!(before, table());
    // A measurement goes on with audits in its journal.
    measure(&scripts, &options, &Progress::silent()).unwrap();
    assert!(page(&options).contains("6 rows run again, all agree"));
}

#[test]
fn what_changed_is_named() {
    let desk = tempfile::tempdir().unwrap();
    let (scripts, options) = measured(desk.path());
    let found = |figures: &str| {
        std::fs::write(&scripts.file, figures).unwrap();
        audit(&scripts, &options, 1).unwrap().disagreements()
    };
    assert!(found("2.4 0.1 7").is_empty(), "a fifth more time is noise");
    let [slow] = &found("2.6 0.1 7")[..] else {
        panic!("one row");
    };
    assert!(slow.contains("cost is 1.30 of it"), "{slow}");
    // The last bit counts.
    let [other] = &found("2.0 0.10000000000000002 7")[..] else {
        panic!("one row");
    };
    assert!(
        other.contains("parts of the input err differently"),
        "{other}"
    );
    let [rows] = &found("2.0 0.1 8")[..] else {
        panic!("one row");
    };
    assert!(rows.contains("rows was 7, is 8"), "{rows}");
    let [failed] = &found("nothing")[..] else {
        panic!("one row");
    };
    assert!(failed.contains("failed"), "{failed}");
    assert!(page(&options).contains("1 do not agree"));
}

#[test]
fn a_table_of_another_input_or_none_is_refused() {
    let desk = tempfile::tempdir().unwrap();
    let (scripts, options) = measured(desk.path());
    let other = TradeoffOptions {
        scene_blake3: "11".repeat(32),
        ..options.clone()
    };
    let error = audit(&scripts, &other, 1).unwrap_err().to_string();
    assert!(error.contains("another input"), "{error}");
    let nowhere = TradeoffOptions {
        output: desk.path().join("nowhere"),
        ..options
    };
    let error = audit(&scripts, &nowhere, 1).unwrap_err().to_string();
    assert!(error.contains("is not there"), "{error}");
}
