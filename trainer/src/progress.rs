//! Progress on standard error: a bar on a terminal, plain lines elsewhere.

use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Progress of a long command.
pub struct Progress {
    bar: ProgressBar,
    stage: Mutex<String>,
}

impl Progress {
    /// A bar on standard error, hidden where that is no terminal.
    pub fn new() -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{prefix:>9} {wide_bar} {pos}/{len} {eta}")
            .expect("the template is a constant");
        bar.set_style(style);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self {
            bar,
            stage: Mutex::new(String::new()),
        }
    }

    /// No output at all, for tests.
    pub fn silent() -> Self {
        Self {
            bar: ProgressBar::hidden(),
            stage: Mutex::new(String::new()),
        }
    }

    /// Begins a stage.
    pub fn stage(&self, name: &str) {
        if let Ok(mut stage) = self.stage.lock() {
            name.clone_into(&mut stage);
        }
        self.bar.reset();
        self.bar.set_prefix(name.to_owned());
    }

    /// `done` of `of` steps of the stage are done.
    pub fn step(&self, done: usize, of: usize) {
        self.bar.set_length(of as u64);
        self.bar.set_position(done as u64);
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Default for Progress {
    fn default() -> Self {
        Self::new()
    }
}
