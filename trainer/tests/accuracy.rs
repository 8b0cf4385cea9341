//! Every figure of docs/accuracy.md is derived again from the tables beside it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Rows of a table by point, each a figure by key.
type Rows = BTreeMap<String, Vec<BTreeMap<String, String>>>;

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

/// Fields of a line; commas within quotes do not part them.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut is_quoted = false;
    for letter in line.chars() {
        match letter {
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(String::new()),
            other => fields.last_mut().expect("never empty").push(other),
        }
    }
    fields
}

fn rows(path: &Path) -> Rows {
    let text = std::fs::read_to_string(path).expect("the committed table is readable");
    let mut lines = text.lines().map(fields);
    let header = lines.next().expect("a header");
    let mut rows = Rows::new();
    for line in lines {
        let row: BTreeMap<String, String> = header.iter().cloned().zip(line).collect();
        rows.entry(row["point"].clone()).or_default().push(row);
    }
    rows
}

fn median(rows: &Rows, point: &str, key: &str) -> f64 {
    let runs = rows.get(point).unwrap_or_else(|| panic!("{point} was run"));
    let value = |row: &BTreeMap<String, String>| -> f64 {
        let text = row.get(key).unwrap_or_else(|| panic!("{key} is a column"));
        text.parse()
            .unwrap_or_else(|_| panic!("{key} of {point} is `{text}`"))
    };
    let mut values: Vec<f64> = runs.iter().map(value).collect();
    values.sort_by(f64::total_cmp);
    let (low, high) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
    f64::midpoint(low, high)
}

/// A quoted figure against its value, to as many decimals as are quoted.
fn assert_quoted(quoted: &str, value: f64, what: &str) {
    let decimals = quoted.split_once('.').map_or(0, |(_, after)| after.len());
    assert_eq!(quoted, format!("{value:.decimals$}"), "{what}");
}

/// Cells of a line of a table, without code marks.
fn cells(line: &str) -> Vec<String> {
    let inner = line.trim().trim_matches('|').split('|');
    inner
        .map(|cell| cell.trim().trim_matches('`').to_owned())
        .collect()
}

/// Tables that follow a line `From [name](path):`, with that path.
fn tables(text: &str) -> Vec<(String, Vec<Vec<String>>)> {
    let mut found = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let Some(rest) = line.strip_prefix("From [") else {
            continue;
        };
        let path = rest
            .split_once("](")
            .and_then(|(_, rest)| rest.split_once(')'));
        let (path, _) = path.expect("a link to the table");
        let table = lines
            .by_ref()
            .skip_while(|line| line.trim().is_empty())
            .take_while(|line| line.starts_with('|'))
            .filter(|line| !line.starts_with("|---"))
            .map(cells);
        found.push((path.to_owned(), table.collect()));
    }
    found
}

#[test]
fn every_figure_of_the_page_is_in_its_table() {
    let text = std::fs::read_to_string(docs().join("accuracy.md")).expect("the page is readable");
    let mut figure_count = 0;
    for (path, table) in tables(&text) {
        let rows = rows(&docs().join(&path));
        let (header, lines) = table.split_first().expect("a header");
        for line in lines {
            if header[0] == "ratio" {
                let [ratio, above, below, key] = &line[..] else {
                    panic!("a ratio has four cells: {line:?}");
                };
                let value = median(&rows, above, key) / median(&rows, below, key);
                assert_quoted(ratio, value, &format!("{path}: {line:?}"));
                figure_count += 1;
                continue;
            }
            for (key, quoted) in header.iter().zip(line).skip(1) {
                let what = format!("{path}: {key} of {}", line[0]);
                if key == "front" {
                    assert_eq!(rows[&line[0]][0]["front"], *quoted, "{what}");
                } else {
                    assert_quoted(quoted, median(&rows, &line[0], key), &what);
                }
                figure_count += 1;
            }
        }
        // Every point of the grid is shown, whatever became of it.
        if header[0] == "point" {
            let shown: Vec<&String> = lines.iter().map(|line| &line[0]).collect();
            assert!(rows.keys().all(|point| shown.contains(&point)), "{path}");
        }
    }
    println!("{figure_count} figures derived again");
    assert!(figure_count >= 100);
}

#[test]
fn the_runs_of_fusion_ended_well_and_believed_no_wrong_pose() {
    for scene in ["mitsuba-dev", "redkitchen"] {
        let rows = rows(&docs().join(format!("tradeoff/{scene}/fusion.csv")));
        let grid = glint::tradeoff::fusion::SUBJECT.points();
        assert!(grid.iter().all(|point| rows.contains_key(&point.name)));
        for (point, runs) in &rows {
            let what = format!("{point} of {scene}");
            for key in ["ate_mm", "fscore_5mm"] {
                let is_same = runs.iter().all(|run| run[key] == runs[0][key]);
                assert!(is_same, "{key} of {what} is the same at each repetition");
            }
            for run in runs {
                assert_eq!(run["status"], "ok", "{what}");
                assert_eq!(run["wrong_accepted"], "0", "{what}");
            }
        }
    }
}

#[test]
fn the_default_is_on_the_front_and_every_run_ended_well() {
    for table in [
        "redkitchen/codec",
        "mitsuba-dev/srm",
        "bowls/srm",
        "two-cans/render",
    ] {
        let rows = rows(&docs().join(format!("tradeoff/{table}.csv")));
        assert_ne!(rows["default"][0]["front"], "no", "{table}");
        for row in rows.values().flatten() {
            let ended = (row["status"].as_str(), row["reason"].as_str());
            assert_eq!(ended, ("ok", ""), "{table}");
        }
        assert!(rows.values().all(|runs| runs.len() == 3), "{table}");
    }
}
