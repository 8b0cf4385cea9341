//! The colour path of a live frame, the vector level against its scalar twin, taking turns, one thread;
//! `cargo bench -p imaging` prints core-milliseconds a VGA frame.
//!
//! `develop/<layout>`: into fixed-point radiance and grey. `register/<camera>`: the colour of every depth pixel of a
//! box before a wall, 96 % measured.

use geometry::{DQuat, DVec3, Distortion, Intrinsics, Pose};
use imaging::{
    ColorLayout, Corrector, Developer, Level, LinearPixel, Registration, Response, Vignetting,
    YuvCoding,
};
use rustix::time::{ClockId, clock_gettime};

const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;
const ROUNDS: usize = 15;
const FRAMES: usize = 10;

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.expect("a pool of one thread").install(|| {
        for (name, layout, chroma_subsampled) in [
            ("rgb8", ColorLayout::Rgb8, false),
            ("rgb8 of a JPEG", ColorLayout::Rgb8, true),
            ("bayer-grbg", ColorLayout::BayerGrbg, false),
            ("yuyv", ColorLayout::Yuyv(YuvCoding::default()), false),
        ] {
            develop(name, layout, chroma_subsampled);
        }
        register("pinhole", Distortion::NONE);
        register(
            "distorted",
            Distortion {
                k1: 0.2,
                k2: -0.6,
                p1: 0.001,
                p2: -0.001,
                k3: 0.6,
            },
        );
    });
}

fn develop(name: &str, layout: ColorLayout, chroma_subsampled: bool) {
    let center = geometry::DVec2::new(319.5, 239.5);
    let lens = Vignetting::even_polynomial(center, 400.0, [-0.3, 0.05, 0.0])
        .expect("a lens with fall-off");
    let response = Response::gamma(2.2).expect("a usable gamma");
    let corrector = Corrector::new(&response, &lens, WIDTH, HEIGHT, 1.0);
    let frame = frame_of(layout);
    let mut pixels = vec![LinearPixel::INVALID; (WIDTH * HEIGHT) as usize];
    let mut grey = vec![0.0; (WIDTH / 2 * (HEIGHT / 2)) as usize];
    let levels = [Level::Scalar, Level::detect()];
    let mut developers = levels.map(|level| {
        Developer::with_level(&corrector, layout, level).expect("the layout fits the size")
    });
    compare(&format!("develop/{name}"), |slot| {
        developers[slot]
            .develop(&frame, chroma_subsampled, &mut pixels, &mut grey)
            .expect("buffers of the frame's size");
    });
}

fn register(name: &str, distortion: Distortion) {
    let depth_camera =
        Intrinsics::pinhole(WIDTH, HEIGHT, 575.0, 575.0, 319.5, 239.5).expect("a camera");
    let color_camera = Intrinsics::new(WIDTH, HEIGHT, 525.0, 525.0, 317.0, 241.0, distortion)
        .expect("a camera with little distortion");
    let rotation = DQuat::from_scaled_axis(DVec3::new(0.004, -0.006, 0.002));
    let color_from_depth =
        Pose::new(rotation, DVec3::new(0.025, 0.0, 0.001)).expect("a rigid transform");
    let depth: Vec<f32> = (0..WIDTH * HEIGHT)
        .map(|at| {
            let (u, v) = (at % WIDTH, at / WIDTH);
            let is_box = (200..440).contains(&u) && (150..350).contains(&v);
            match at % 25 {
                0 => 0.0,
                _ if is_box => 0.7,
                _ => 1.2 + 0.001 * u as f32,
            }
        })
        .collect();
    let color: Vec<LinearPixel> = (0..WIDTH * HEIGHT)
        .map(|at| {
            LinearPixel([
                (at % 9001) as u16,
                (at % 7001) as u16,
                (at % 5001) as u16,
                1,
            ])
        })
        .collect();
    let mut registered = vec![LinearPixel::INVALID; depth.len()];
    let mut registrations = [Level::Scalar, Level::detect()].map(|level| {
        Registration::with_level(&depth_camera, &color_camera, &color_from_depth, level)
            .expect("a depth camera without distortion")
    });
    compare(&format!("register/{name}"), |slot| {
        registrations[slot]
            .register(&depth, &color, &mut registered)
            .expect("buffers of the cameras' sizes");
    });
}

/// Runs `frame(0)` at the scalar and `frame(1)` at the vector level by turns and prints their CPU times.
fn compare(name: &str, mut frame: impl FnMut(usize)) {
    let mut millis = [Vec::new(), Vec::new()];
    for round in 0..=ROUNDS {
        for (slot, millis) in millis.iter_mut().enumerate() {
            let start = process_millis();
            for _ in 0..FRAMES {
                frame(slot);
            }
            // The first round warms the caches.
            if round > 0 {
                millis.push((process_millis() - start) / FRAMES as f64);
            }
        }
    }
    let [scalar, vector] = millis.map(|mut millis| {
        millis.sort_by(f64::total_cmp);
        (millis[ROUNDS / 2], millis[0])
    });
    println!(
        "{name}: scalar {:.2} ({:.2}) core-ms a frame, {:?} {:.2} ({:.2}), ratio {:.2}; median (min)",
        scalar.0,
        scalar.1,
        Level::detect(),
        vector.0,
        vector.1,
        scalar.0 / vector.0
    );
}

/// Waves of brightness with little colour, and a clipped part of 2 %.
fn frame_of(layout: ColorLayout) -> Vec<u8> {
    (0..layout.frame_bytes(WIDTH, HEIGHT))
        .map(|at| {
            let is_chroma = matches!(layout, ColorLayout::Yuyv(_)) && at % 2 == 1;
            let wave = (at % 1543) as f64 / 245.0;
            let height = if is_chroma { 10.0 } else { 60.0 };
            let code = 128.0 + height * wave.sin() + (at % 7) as f64;
            if !is_chroma && at % 50_000 < 1000 {
                255
            } else {
                code as u8
            }
        })
        .collect()
}

/// CPU time of this process.
fn process_millis() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
