//! What a service manager hears: its socket is made here.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::source;

/// A test that would hang ends after this.
const PATIENCE: Duration = Duration::from_secs(120);

/// A recorder, and what it says.
struct Service {
    child: Child,
    socket: UnixDatagram,
}

impl Service {
    /// Records frames `0..count` but those in `holes`, at the speed of the camera.
    fn start(folder: &Path, count: u64, holes: &[u64]) -> Self {
        let input = source::write(folder, count, holes);
        let path = folder.join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_glintd"))
            .arg("record")
            .arg(format!("replay:{}?speed=1", input.display()))
            .args(["--no-fuse", "--reserve-mb", "0", "-o"])
            .arg(folder.join("out.glint"))
            .env("NOTIFY_SOCKET", &path)
            // Ten seconds, as in the unit.
            .env("WATCHDOG_USEC", "10000000")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self { child, socket }
    }

    fn word(&self) -> String {
        let mut bytes = [0; 4096];
        let length = self.socket.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..length].to_vec())
            .unwrap()
            .trim_end()
            .to_owned()
    }

    /// All words up to the first of which `is_last` holds, that one included.
    fn until(&self, is_last: impl Fn(&str) -> bool) -> Vec<String> {
        let mut words = Vec::new();
        loop {
            words.push(self.word());
            if words.last().is_some_and(|word| is_last(word)) {
                return words;
            }
        }
    }

    fn terminate(&mut self) -> (Vec<String>, Option<i32>) {
        let id = self.child.id().to_string();
        let killed = Command::new("kill").args(["-TERM", &id]).status();
        assert!(killed.unwrap().success());
        let words = self.until(|word| word == "STOPPING=1");
        (words, self.child.wait().unwrap().code())
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Frames recorded, as a line of status says it.
fn recorded(word: &str) -> Option<u64> {
    let line = word.strip_prefix("STATUS=")?;
    line.split(" frames recorded").next()?.parse().ok()
}

#[test]
fn the_watchdog_hears_frames_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    // Frames for 3 seconds, then none for an hour.
    let holes: Vec<u64> = (150..180_000).collect();
    let mut service = Service::start(folder.path(), 180_001, &holes);
    let before = service.until(|word| word == "READY=1");
    assert_eq!(before, ["STATUS=waiting for the first frames", "READY=1"]);
    // While frames come, it is said that they come; the line goes on when they do not.
    let last = service.until(|word| recorded(word) == Some(300));
    let alive = last.iter().filter(|word| *word == "WATCHDOG=1").count();
    assert!((1..=4).contains(&alive), "{last:?}");
    // A frame that was on its way when the line was made.
    let silent = (0..3).flat_map(|_| service.until(|word| recorded(word).is_some()));
    let silent: Vec<String> = silent.collect();
    let beats = silent.iter().skip(1).filter(|word| *word == "WATCHDOG=1");
    assert_eq!(beats.count(), 0, "{silent:?}");
    let line = silent.last().unwrap();
    for part in ["300 frames recorded, 0 missing", "tracking off", " MB"] {
        assert!(line.contains(part), "{line}");
    }
    assert!(!line.contains('\n'));
    let (words, code) = service.terminate();
    assert!(!words.contains(&"WATCHDOG=1".to_owned()), "{words:?}");
    assert_eq!(code, Some(0));
}

#[test]
fn ready_waits_for_data() {
    let folder = tempfile::tempdir().unwrap();
    // The file does not exist: there is nothing to be ready for.
    let path = folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_nonblocking(true).unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_glintd"))
        .args(["record", "replay:absent.glint", "-o"])
        .arg(folder.path().join("out.glint"))
        .env("NOTIFY_SOCKET", &path)
        .stderr(Stdio::null())
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(2));
    let mut bytes = [0; 4096];
    let mut words = String::new();
    while let Ok(length) = socket.recv(&mut bytes) {
        words += std::str::from_utf8(&bytes[..length]).unwrap();
    }
    assert!(!words.contains("READY=1"), "{words}");
}
