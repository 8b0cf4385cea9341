//! Core-seconds of filming: `cargo run --release -p scene --example film_speed -- laptop bag`.

use rustix::time::{ClockId, clock_gettime};
use scene::{Film, FilmOptions};

/// CPU time of this process, seconds.
fn core_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = core_seconds();
    let result = work();
    (result, core_seconds() - start)
}

fn main() -> Result<(), scene::SceneError> {
    println!("scene            set-up     light     frame     truth   (core-seconds, 640 x 480)");
    for name in std::env::args().skip(1) {
        let (film, setup) = timed(|| Film::new(&name, FilmOptions::default()));
        let film = film?;
        let (_, light) = timed(|| film.light(film.frame_count() / 2));
        let (_, frame) = timed(|| film.frame(film.frame_count() / 2));
        let (_, truth) = timed(|| film.truth(film.frame_count() / 2, 16));
        println!("{name:15} {setup:8.2}  {light:8.2}  {frame:8.2}  {truth:8.2}");
    }
    Ok(())
}
