//! Measurements with children that are shell scripts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use super::front::OnFront;
use super::journal::journal_path;
use super::subject::{Axis, Knob, PointFigures, PointRunner, Setting, Subject};
use super::*;

const SUBJECT: Subject = Subject {
    name: "script",
    knobs: &[Knob {
        name: "script",
        default: "good",
        others: &[
            "better", "worse", "breaks", "loses", "killed", "sleeps", "babbles",
        ],
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
    exact: &["tracked_fraction"],
    no_candidates: &[],
    tracked: Some("tracked_fraction"),
};

/// Counts its runs in a file, then does what the level says.
struct Scripts {
    log: PathBuf,
}

impl PointRunner for Scripts {
    fn subject(&self) -> &Subject {
        &SUBJECT
    }

    fn command(&self, setting: &Setting, _desk: &Path) -> anyhow::Result<Command> {
        let script = match setting["script"].as_str() {
            "good" => "echo 2.0 3.0 1.0",
            "better" => "echo 4.0 1.0 1.0",
            "worse" => "echo 5.0 0.5 0.4",
            "breaks" => "echo sorry >&2; exit 2",
            "loses" => "exit 3",
            "killed" => "kill -9 $$",
            "sleeps" => "exec sleep 60",
            _ => "echo no numbers here",
        };
        let mut command = Command::new("sh");
        let script = format!(
            "echo {} >> {}; {script}",
            setting["script"],
            self.log.display()
        );
        command.args(["-c", &script]);
        Ok(command)
    }

    fn figures(&self, last_line: &str, _desk: &Path, core_s: f64) -> anyhow::Result<PointFigures> {
        assert!((0.0..10.0).contains(&core_s));
        let words = last_line.split_whitespace();
        let numbers: Vec<f64> = words.map(str::parse).collect::<Result<_, _>>()?;
        let [cost, error, tracked] = numbers[..] else {
            anyhow::bail!("three numbers are wanted");
        };
        Ok(PointFigures {
            metrics: BTreeMap::from([
                ("cost".to_owned(), cost),
                ("error".to_owned(), error),
                ("tracked_fraction".to_owned(), tracked),
            ]),
            blocks: vec![error; 10],
        })
    }
}

fn options(desk: &Path) -> TradeoffOptions {
    TradeoffOptions {
        output: desk.join("out"),
        scene: "a <scene> & \"more\"".to_owned(),
        scene_blake3: "00".repeat(32),
        program: PathBuf::from("/bin/sh"),
        repetitions: 2,
        seed: 1,
        timeout: Duration::from_millis(400),
    }
}

fn runs(log: &Path) -> usize {
    std::fs::read_to_string(log).map_or(0, |text| text.lines().count())
}

#[test]
fn every_end_of_a_point_is_kept_and_nothing_is_run_twice() {
    let desk = tempfile::tempdir().unwrap();
    let scripts = Scripts {
        log: desk.path().join("log"),
    };
    let options = options(desk.path());
    let measured = measure(&scripts, &options, &Progress::silent()).unwrap();
    let found: Vec<(String, PointStatus, OnFront)> = measured
        .points
        .iter()
        .map(|point| (point.name.clone(), point.status.unwrap(), point.front))
        .collect();
    let expected = [
        ("default", PointStatus::Ok, OnFront::Sure),
        ("script=better", PointStatus::Ok, OnFront::Sure),
        // Least error, but most frames were lost.
        ("script=worse", PointStatus::Ok, OnFront::No),
        ("script=breaks", PointStatus::Failed, OnFront::No),
        ("script=loses", PointStatus::Lost, OnFront::No),
        ("script=killed", PointStatus::OutOfMemory, OnFront::No),
        ("script=sleeps", PointStatus::Timeout, OnFront::No),
        ("script=babbles", PointStatus::Failed, OnFront::No),
    ];
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!((found.0.as_str(), found.1, found.2), expected);
    }
    assert_eq!(measured.points[3].reason(), "sorry");
    assert!(
        measured
            .sentence()
            .contains("going to script=better costs +100 % for -66.7 %")
    );
    let count = runs(&scripts.log);
    // Disturbed runs are repeated once.
    assert!((16..=32).contains(&count));
    measure(&scripts, &options, &Progress::silent()).unwrap();
    assert_eq!(runs(&scripts.log), count);
    // A torn last line was a run that did not finish: it is run again, with the ones whose lines are gone.
    let journal = journal_path(&options.output, "script");
    let text = std::fs::read_to_string(&journal).unwrap();
    let last = text.trim_end().rfind('\n').unwrap();
    std::fs::write(&journal, &text[..last + 40]).unwrap();
    let again = measure(&scripts, &options, &Progress::silent()).unwrap();
    assert!(runs(&scripts.log) > count && again.missing().is_empty());
}

#[test]
fn the_files_hold_every_run_and_open_without_a_network() {
    let desk = tempfile::tempdir().unwrap();
    let scripts = Scripts {
        log: desk.path().join("log"),
    };
    let options = options(desk.path());
    measure(&scripts, &options, &Progress::silent()).unwrap();
    let read = |name: &str| std::fs::read_to_string(options.output.join(name)).unwrap();
    let csv = read("script.csv");
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 17);
    assert!(lines[0].starts_with("run_id,") && lines[0].ends_with(",started_utc,front"));
    assert_eq!(
        lines
            .iter()
            .filter(|line| line.contains(",timeout,"))
            .count(),
        2
    );
    let svg = read("script.svg");
    assert!(svg.len() < 200_000 && svg.matches("class=\"cross\"").count() == 5);
    assert!(svg.contains("a &lt;scene&gt; &amp; &quot;more&quot;"));
    assert_eq!(svg.matches("class=\"ring\"").count(), 1);
    assert_eq!(svg.matches("class=\"hollow\"").count(), 1);
    let html = read("script.html");
    // Beside the name of the picture's format, no address.
    let addresses = html.matches("http").count();
    assert_eq!(
        addresses,
        html.matches("http://www.w3.org/2000/svg").count()
    );
    assert!(std::fs::read_dir(&options.output).unwrap().count() == 4);
}

#[test]
fn runs_that_do_not_compare_are_refused() {
    let desk = tempfile::tempdir().unwrap();
    let scripts = Scripts {
        log: desk.path().join("log"),
    };
    let first = TradeoffOptions {
        repetitions: 1,
        ..options(desk.path())
    };
    measure(&scripts, &first, &Progress::silent()).unwrap();
    let refused = |options: &TradeoffOptions| {
        let error = measure(&scripts, options, &Progress::silent()).unwrap_err();
        error.to_string()
    };
    let other = TradeoffOptions {
        scene_blake3: "11".repeat(32),
        ..first.clone()
    };
    assert!(refused(&other).contains("another recording"));
    let other = TradeoffOptions {
        program: PathBuf::from("/bin/ls"),
        ..first.clone()
    };
    assert!(refused(&other).contains("another program"));
    // A figure that was edited is not drawn.
    let journal = journal_path(&first.output, "script");
    let text = std::fs::read_to_string(&journal).unwrap();
    let edited = text.replace("\"log\":\"2.0 3.0 1.0\"", "\"log\":\"1.0 3.0 1.0\"");
    assert_ne!(text, edited);
    std::fs::write(&journal, edited).unwrap();
    let measured = measure(&scripts, &first, &Progress::silent()).unwrap();
    assert_eq!((measured.rejected_count, measured.missing().len()), (1, 1));
}
