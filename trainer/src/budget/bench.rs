//! How fast this machine is now: fixed work of the kinds that training consists of.
//!
//! Half of it are rays through a bumpy surface, half are sparse rows that are gathered from a texture and scattered
//! back, as the solver does. One thread; the time of its processor counts.

use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use raytrace::{Ray, Scene};
use rustix::time::{ClockId, clock_gettime};

use geometry::robust;

/// Points along an edge of the surface that the rays meet.
const EDGE: u32 = 160;
/// Rays of a round.
const RAY_COUNT: usize = 60_000;
/// Rows of a round: with what they touch, more than a cache holds.
const ROW_COUNT: usize = 200_000;
/// Texels that the rows touch.
const TEXEL_COUNT: usize = 125_000;
/// Taps of a row.
const TAPS: usize = 7;
/// Times that the rows are gone through in a round.
const PASSES: usize = 4;
/// Rounds, of which the median counts: single rounds swing by half on a shared machine.
const ROUNDS: usize = 5;

/// Core-milliseconds that a round of the fixed work takes now. Takes about a second in all.
pub fn score_ms() -> f64 {
    let work = Work::new();
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = thread_seconds();
            std::hint::black_box(work.round());
            1e3 * (thread_seconds() - start)
        })
        .collect();
    robust::median(&mut times).unwrap_or(f64::NAN)
}

fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

struct Work {
    scene: Option<Scene>,
    rays: Vec<Ray>,
    taps: Vec<([u32; TAPS], f32)>,
}

impl Work {
    fn new() -> Self {
        let mut rng = Pcg64::seed_from_u64(1);
        let (positions, triangles) = bumps(&mut rng);
        let mut unit = |scale: f32| scale * rng.random::<f32>();
        let rays = (0..RAY_COUNT)
            .map(|_| {
                let origin = Vec3::new(unit(1.0), unit(1.0), 1.0);
                let aside = Vec3::new(unit(1.0) - 0.5, unit(1.0) - 0.5, -1.0);
                Ray::new(origin, aside.normalize())
            })
            .collect();
        let taps = (0..ROW_COUNT)
            .map(|_| {
                let texels = std::array::from_fn(|_| rng.random_range(0..TEXEL_COUNT as u32));
                (texels, rng.random::<f32>())
            })
            .collect();
        Self {
            // Its triangles are numbers within bounds: were it refused, the rows would be the score.
            scene: Scene::new(&positions, &triangles).ok(),
            rays,
            taps,
        }
    }

    fn round(&self) -> f64 {
        let hits = self.rays.iter();
        let hits = hits.filter_map(|ray| self.scene.as_ref()?.closest(ray));
        let depth: f64 = hits.map(|hit| f64::from(hit.t)).sum();
        let mut texels = vec![[1.0_f64; 3]; TEXEL_COUNT];
        for _ in 0..PASSES {
            for (taps, weight) in &self.taps {
                let mut value = [0.0; 3];
                for &tap in taps {
                    for (sum, texel) in value.iter_mut().zip(texels[tap as usize]) {
                        *sum += texel;
                    }
                }
                // Keeps near 1 whatever was drawn.
                let step = 0.01 * f64::from(*weight);
                for &tap in taps {
                    for (texel, sum) in texels[tap as usize].iter_mut().zip(value) {
                        *texel += step * (sum / TAPS as f64 - *texel);
                    }
                }
            }
        }
        depth + texels.iter().map(|texel| texel[0]).sum::<f64>()
    }
}

/// A square of hills in [0, 1]², seen from above.
fn bumps(rng: &mut Pcg64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let step = 1.0 / (EDGE - 1) as f32;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for y in 0..EDGE {
        for x in 0..EDGE {
            let height = 0.2 * rng.random::<f32>();
            positions.push(Vec3::new(x as f32 * step, y as f32 * step, height));
            if x + 1 < EDGE && y + 1 < EDGE {
                let corner = y * EDGE + x;
                triangles.push([corner, corner + 1, corner + EDGE]);
                triangles.push([corner + 1, corner + EDGE + 1, corner + EDGE]);
            }
        }
    }
    (positions, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_work_is_the_same_every_time_and_every_ray_meets_the_surface() {
        let work = Work::new();
        let first = work.round();
        assert_eq!(first.to_bits(), Work::new().round().to_bits());
        let scene = work.scene.as_ref().expect("the surface is one");
        let met = work.rays.iter().filter(|ray| scene.closest(ray).is_some());
        assert!(met.count() > RAY_COUNT / 2);
        assert!(score_ms() > 0.0);
    }
}
