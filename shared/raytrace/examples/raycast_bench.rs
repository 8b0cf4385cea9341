//! Rays a second on one core, for `tests/peers/raycast_embree.py`.
//!
//!     raycast_bench FILE [scalar]
//!
//! FILE (little-endian): u32 vertex count, u32 triangle count, u32 ray count; vertices as 3 f32; triangles as 3
//! u32; rays as origin and direction, 6 f32. For each line on standard input (`closest` or `any`) answers all
//! rays once and prints a line of JSON with the CPU seconds; `hits PATH` writes the last answer as u32 triangle,
//! f32 t per ray. `scalar` answers without AVX2.

use std::io::{BufRead as _, Write as _};
use std::time::Duration;

use glam::Vec3;
use raytrace::{Hit, Level, Ray, Scene};
use rustix::time::{ClockId, clock_gettime};

fn cpu_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

struct Input {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    rays: Vec<Ray>,
}

fn read(path: &str) -> std::io::Result<Input> {
    let bytes = std::fs::read(path)?;
    let words: Vec<u32> = bytes
        .chunks_exact(4)
        .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    let [vertices, triangles, rays] = [0, 1, 2].map(|k| words.get(k).map_or(0, |w| *w as usize));
    if words.len() != 3 + 3 * vertices + 3 * triangles + 6 * rays {
        return Err(std::io::Error::other(format!(
            "{path} is not as long as its counts say"
        )));
    }
    let (positions, rest) = words[3..].split_at(3 * vertices);
    let (corners, rest) = rest.split_at(3 * triangles);
    let point = |w: &[u32]| {
        Vec3::new(
            f32::from_bits(w[0]),
            f32::from_bits(w[1]),
            f32::from_bits(w[2]),
        )
    };
    Ok(Input {
        positions: positions.chunks_exact(3).map(point).collect(),
        triangles: corners
            .chunks_exact(3)
            .map(|w| [w[0], w[1], w[2]])
            .collect(),
        rays: rest
            .chunks_exact(6)
            .map(|w| Ray::new(point(w), point(&w[3..])))
            .collect(),
    })
}

fn write_hits(path: &str, hits: &[Hit]) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    for hit in hits {
        out.write_all(&hit.triangle.to_le_bytes())?;
        out.write_all(&hit.t.to_le_bytes())?;
    }
    out.flush()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().ok_or("which file?")?;
    let level = match arguments.get(1).map(String::as_str) {
        Some("scalar") => Level::Scalar,
        _ => Level::detect(),
    };
    let input = read(path)?;
    let before = cpu_time();
    let scene = Scene::new(&input.positions, &input.triangles)?.with_level(level);
    println!(
        "{{\"build_core_s\": {}, \"level\": \"{level:?}\"}}",
        (cpu_time() - before).as_secs_f64()
    );
    let mut hits = vec![Hit::MISS; input.rays.len()];
    let mut blocked = vec![false; input.rays.len()];
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let before = cpu_time();
        match line.split_once(' ') {
            Some(("hits", path)) => write_hits(path, &hits)?,
            _ if line == "closest" => scene.closest_batch(&input.rays, &mut hits),
            _ if line == "any" => scene.blocked_batch(&input.rays, &mut blocked),
            _ => return Err(format!("unknown request {line}").into()),
        }
        let seconds = (cpu_time() - before).as_secs_f64();
        let rate = input.rays.len() as f64 / seconds;
        println!("{{\"core_s\": {seconds}, \"rays_per_s\": {rate}}}");
    }
    Ok(())
}
