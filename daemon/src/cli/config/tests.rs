use clap::Parser;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::*;

#[test]
fn options_on_the_command_line_win() {
    let options = "size=qvga&exposure=30&gain=100";
    assert_eq!(
        with_options("ps1080:/sys/x", options),
        format!("ps1080:/sys/x?{options}&")
    );
    assert_eq!(
        with_options("ps1080?exposure=lock", options),
        "ps1080?size=qvga&exposure=lock"
    );
    assert_eq!(
        with_options("ps1080?size=vga", "size=qvga"),
        "ps1080?size=vga"
    );
    assert_eq!(with_options("replay:x?loop", options), "replay:x?loop");
}

#[test]
fn the_file_that_is_installed_is_all_of_the_keys() {
    let text = include_str!("../../../../udev/glintd.toml");
    let shown: RecordConfig = toml::from_str(text).unwrap();
    assert_eq!(shown.output.as_deref(), Some(Path::new("/var/lib/glint")));
    // With what is shown switched on it still parses.
    let on: String = text
        .lines()
        .map(|line| match line.strip_prefix("# ") {
            Some(setting) if setting.contains(" = ") && !setting.contains(", ") => setting,
            _ => line,
        })
        .flat_map(|line| [line, "\n"])
        .collect();
    let on: RecordConfig = toml::from_str(&on).unwrap();
    on.require_ranges().unwrap();
    assert_eq!((on.keep_mb, on.fuse), (Some(200_000), Some(true)));
    assert_eq!((on.voxel_mm, on.fuse_threads), (Some(5.0), Some(2)));
}

/// The command line of `glintd record`, alone.
#[derive(Parser)]
struct Line {
    #[command(flatten)]
    record: RecordArgs,
}

/// A file that says something of every key.
const WHOLE: &str = r#"# A rig.
output = "/var/lib/glint"
camera = "size=vga&fps=30&color=best&exposure=30&gain=100"
split_mb = 4000
split_seconds = 600.0
reserve_mb = 2147
keep_mb = 200000
depth_codec = "fast"
fuse = true
voxel_mm = 5.0
truncation_voxels = 6.0
fuse_threads = 2
fuse_stride = 3
fuse_memory_mb = 2048
"#;

/// What is put into files.
const PIECES: [&str; 22] = [
    "-1",
    "0",
    "1e400",
    "nan",
    "inf",
    "-0.0",
    "99999999999999999999",
    "true",
    "\"",
    "\"\"\"",
    "'",
    "\n",
    "\r\n",
    "[",
    "[[x]]",
    "{a = 1}",
    "= ",
    "&&=",
    "\\u0000",
    "\u{85}",
    "\u{1f980}",
    "fps=",
];

/// A file with one to four changes.
fn changed(random: &mut Pcg64Mcg) -> Vec<u8> {
    let mut bytes = WHOLE.as_bytes().to_vec();
    for _ in 0..random.random_range(1..5) {
        let at = random.random_range(0..bytes.len());
        let end = (at + random.random_range(0..9)).min(bytes.len());
        match random.random_range(0..5) {
            0 => bytes[at] = random.random(),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let piece = PIECES[random.random_range(0..PIECES.len())];
                drop(bytes.splice(at..end, piece.bytes()));
            }
            3 => {
                // A value in place of another.
                let equals = bytes[at..].iter().position(|byte| *byte == b'=');
                let from = equals.map_or(at, |equals| at + equals + 1);
                let line = bytes[from..].iter().position(|byte| *byte == b'\n');
                let to = line.map_or(bytes.len(), |line| from + line);
                let piece = PIECES[random.random_range(0..PIECES.len())];
                drop(bytes.splice(from..to, piece.bytes()));
            }
            _ => {
                let copy = bytes[at..end].to_vec();
                let to = random.random_range(0..=bytes.len());
                drop(bytes.splice(to..to, copy));
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

#[test]
fn whatever_stands_in_the_file_it_holds_or_one_sentence_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    let name = path.to_str().unwrap();
    let line = Line::parse_from(["glintd", "ps1080", "--config", name]);
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let (mut taken, mut refused) = (0, 0);
    for _ in 0..4000 {
        let bytes = changed(&mut random);
        std::fs::write(&path, &bytes).unwrap();
        let shown = String::from_utf8_lossy(&bytes);
        match resolved(&line.record) {
            Ok(args) => {
                taken += 1;
                assert!(args.source.parse::<SourceSpec>().is_ok(), "{shown}");
            }
            Err(error) => {
                refused += 1;
                let words = format!("{error:#}");
                assert!(words.starts_with(name), "{words} of {shown}");
                assert!(!words.contains(['\n', '\r']), "{words:?} of {shown}");
            }
        }
    }
    assert!(taken > 100 && refused > 1000, "{taken} {refused}");
}

#[test]
fn a_value_that_no_volume_can_have_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    let name = path.to_str().unwrap();
    let line = Line::parse_from(["glintd", "ps1080", "--config", name]);
    for text in [
        "voxel_mm = 0.01",
        "voxel_mm = nan",
        "truncation_voxels = 1.0",
    ] {
        std::fs::write(&path, text).unwrap();
        let words = format!("{:#}", resolved(&line.record).unwrap_err());
        assert!(words.starts_with(name), "{words}");
    }
}
