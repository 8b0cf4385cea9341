//! What a service manager is told (systemd's `Type=notify`): ready, alive, and one line of status.
//!
//! Nothing here runs by a clock of its own: it is the disk thread that says "ready", with the first complete pair in the
//! file, and "alive", with a frame that reached the file. A recorder that hangs anywhere before the disk falls silent.

use std::time::Duration;

use sd_notify::NotifyState;
use sequence::{COLOR_STREAM, DEPTH_STREAM};

use crate::status::StatusNow;

/// Longest time between two signs of life while frames come.
const LONGEST_SILENCE: Duration = Duration::from_secs(1);
/// Signs of life in the time that the service manager grants.
const SIGNS_IN_GRANT: u32 = 4;

/// Something that a service manager understands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Word {
    /// The service does what it is for.
    Ready,
    /// It is alive.
    Alive,
    /// It is ending.
    Stopping,
    /// One line for whoever asks.
    Status(String),
}

/// The way to the service manager.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Service {
    /// Longest time between two signs of life; `None` where nobody listens.
    interval: Option<Duration>,
}

impl Service {
    /// The one that started this process, which it says by the variables `NOTIFY_SOCKET` and `WATCHDOG_USEC`; where there
    /// is none, words go nowhere.
    pub fn of_this_process() -> Self {
        let is_listening = std::env::var_os("NOTIFY_SOCKET").is_some();
        Self {
            interval: is_listening.then(|| interval_of(sd_notify::watchdog_enabled())),
        }
    }

    /// Whether somebody listens.
    pub fn is_listening(self) -> bool {
        self.interval.is_some()
    }

    /// Says something. What cannot be said is in the log: a recording does not end for it.
    pub fn say(self, word: &Word) {
        if self.interval.is_none() {
            return;
        }
        let state = match word {
            Word::Ready => NotifyState::Ready,
            Word::Alive => NotifyState::Watchdog,
            Word::Stopping => NotifyState::Stopping,
            Word::Status(line) => NotifyState::Status(line),
        };
        if let Err(error) = sd_notify::notify(&[state]) {
            tracing::debug!("the service manager does not listen: {error}");
        }
    }
}

fn interval_of(granted: Option<Duration>) -> Duration {
    granted.map_or(LONGEST_SILENCE, |granted| {
        LONGEST_SILENCE.min(granted / SIGNS_IN_GRANT)
    })
}

/// The frames that reach the file, as the service manager hears of them.
#[derive(Debug, Default)]
pub struct Pulse {
    service: Service,
    has_depth: bool,
    has_color: bool,
    /// When the last sign of life was given, nanoseconds of the host's clock; set from "ready" on.
    said_nanos: Option<i64>,
}

impl Pulse {
    /// Before the first frame.
    pub fn new(service: Service) -> Self {
        Self {
            service,
            ..Self::default()
        }
    }

    /// A frame of `stream` is in the file, at `now_nanos` of the host's clock.
    pub fn beat(&mut self, stream: u16, now_nanos: i64) {
        if let Some(word) = self.word(stream, now_nanos) {
            self.service.say(&word);
        }
    }

    /// The recording is being closed.
    pub fn stopping(&self) {
        self.service.say(&Word::Stopping);
    }

    fn word(&mut self, stream: u16, now_nanos: i64) -> Option<Word> {
        let interval = self.service.interval?;
        self.has_depth |= stream == DEPTH_STREAM;
        self.has_color |= stream == COLOR_STREAM;
        let word = match self.said_nanos {
            None if self.has_depth && self.has_color => Word::Ready,
            Some(said) if now_nanos.saturating_sub(said) >= interval.as_nanos() as i64 => {
                Word::Alive
            }
            _ => return None,
        };
        self.said_nanos = Some(now_nanos);
        Some(word)
    }
}

/// The line that `systemctl status` shows. `room` says how long the disk lasts, where that is known.
pub fn status_line(status: &StatusNow, room: &str) -> String {
    let seen = status.tracked + status.lost;
    let tracked = if seen == 0 {
        "tracking off".to_owned()
    } else {
        format!(
            "{:.0} % tracked",
            100.0 * status.tracked as f64 / seen as f64
        )
    };
    format!(
        "{} frames recorded, {} missing, {tracked}, {:.1} MB{room}",
        status.frames_recorded,
        status.frames_missing,
        status.file_bytes.max(status.payload_bytes) as f64 / 1e6,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn listened_to() -> Pulse {
        Pulse::new(Service {
            interval: Some(interval_of(Some(Duration::from_secs(10)))),
        })
    }

    #[test]
    fn ready_is_said_with_the_first_complete_pair() {
        let mut pulse = listened_to();
        assert_eq!(pulse.word(DEPTH_STREAM, 0), None);
        assert_eq!(pulse.word(DEPTH_STREAM, 5 * SECOND), None);
        assert_eq!(pulse.word(COLOR_STREAM, 5 * SECOND), Some(Word::Ready));
    }

    #[test]
    fn signs_of_life_come_from_frames_and_not_more_than_one_a_second() {
        let mut pulse = listened_to();
        pulse.word(DEPTH_STREAM, 0);
        pulse.word(COLOR_STREAM, 0);
        let words: Vec<_> = (1..=90)
            .filter_map(|frame| pulse.word(DEPTH_STREAM, frame * SECOND / 30))
            .collect();
        assert_eq!(words, [Word::Alive, Word::Alive, Word::Alive]);
        // After a silence it is the next frame that speaks.
        assert_eq!(pulse.word(COLOR_STREAM, 100 * SECOND), Some(Word::Alive));
    }

    #[test]
    fn nothing_is_said_where_nobody_listens() {
        let mut pulse = Pulse::default();
        assert_eq!(pulse.word(DEPTH_STREAM, 0), None);
        assert_eq!(pulse.word(COLOR_STREAM, 0), None);
    }

    #[test]
    fn four_signs_fit_what_is_granted() {
        let second = Duration::from_secs(1);
        assert_eq!(interval_of(None), second);
        assert_eq!(interval_of(Some(10 * second)), second);
        assert_eq!(interval_of(Some(2 * second)), second / 2);
    }

    #[test]
    fn the_line_has_frames_drops_tracked_fraction_and_size() {
        let status = StatusNow {
            frames_recorded: 90,
            frames_missing: 2,
            file_bytes: 12_340_000,
            tracked: 39,
            lost: 1,
            ..StatusNow::default()
        };
        assert_eq!(
            status_line(&status, ", 83 minutes left"),
            "90 frames recorded, 2 missing, 98 % tracked, 12.3 MB, 83 minutes left"
        );
        let status = StatusNow::default();
        assert!(status_line(&status, "").contains("tracking off"));
    }
}
