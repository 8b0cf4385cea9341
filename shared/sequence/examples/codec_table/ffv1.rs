//! FFV1 through an installed ffmpeg.

use std::io::Write as _;
use std::process::{Command, Stdio};

use super::measure::Failure;

/// Bytes of a sample in a raw video.
pub(crate) trait Sample: Copy {
    fn append_to(self, bytes: &mut Vec<u8>);
}

impl Sample for u8 {
    fn append_to(self, bytes: &mut Vec<u8>) {
        bytes.push(self);
    }
}

impl Sample for u16 {
    fn append_to(self, bytes: &mut Vec<u8>) {
        bytes.extend_from_slice(&self.to_le_bytes());
    }
}

/// Codes `frames` of `pixel_format`, intra, on one thread, and prints the row; says so where there is no ffmpeg.
pub(crate) fn print_row<T: Sample>(
    pixel_format: &str,
    frames: &[Vec<T>],
    width: u32,
    height: u32,
) -> Result<(), Failure> {
    let mut raw = Vec::new();
    for &sample in frames.iter().flatten() {
        sample.append_to(&mut raw);
    }
    let size = format!("{width}x{height}");
    let raw_format = ["-f", "rawvideo", "-pix_fmt", pixel_format, "-s", &size];
    let encode = [
        raw_format.as_slice(),
        &[
            "-i", "-", "-c:v", "ffv1", "-level", "3", "-g", "1", "-coder", "1",
        ],
        &[
            "-slices",
            "4",
            "-slicecrc",
            "0",
            "-threads",
            "1",
            "-f",
            "nut",
            "-",
        ],
    ]
    .concat();
    let Ok((coded, encode_s)) = ffmpeg(&encode, &raw) else {
        println!(
            "| FFV1 (intra, range coder, {pixel_format}) | skipped: no working ffmpeg on the PATH | | | | |"
        );
        return Ok(());
    };
    let decode = [
        "-threads",
        "1",
        "-i",
        "-",
        "-f",
        "rawvideo",
        "-pix_fmt",
        pixel_format,
        "-",
    ];
    let (decoded, decode_s) = ffmpeg(&decode, &coded)?;
    if decoded != raw {
        return Err("FFV1 is not lossless".into());
    }
    let count = frames.len() as f64;
    println!(
        "| FFV1 (intra, range coder, {pixel_format}) | {:.2} | {:.2} | {:.3} | {:.2} (mean) | {:.2} (mean) |",
        raw.len() as f64 / coded.len() as f64,
        100.0 * coded.len() as f64 / raw.len() as f64,
        8.0 * coded.len() as f64 / (count * f64::from(width) * f64::from(height)),
        1e3 * encode_s / count,
        1e3 * decode_s / count,
    );
    Ok(())
}

/// What ffmpeg writes for `input`, and its user time in seconds.
fn ffmpeg(arguments: &[&str], input: &[u8]) -> Result<(Vec<u8>, f64), Failure> {
    let mut child = Command::new("ffmpeg")
        .args(["-hide_banner", "-nostdin", "-benchmark"])
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let mut stdin = child.stdin.take().ok_or("ffmpeg has no input")?;
    let output = std::thread::scope(|scope| {
        // An early end of ffmpeg breaks the pipe; its status says why.
        scope.spawn(move || stdin.write_all(input));
        child.wait_with_output()
    })?;
    let report = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        return Err(format!("ffmpeg fails: {report}").into());
    }
    let utime = report
        .split("utime=")
        .nth(1)
        .and_then(|rest| rest.split('s').next());
    Ok((output.stdout, utime.ok_or("ffmpeg says no utime")?.parse()?))
}
