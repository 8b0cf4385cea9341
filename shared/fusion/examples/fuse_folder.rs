//! Fuses a dump of depth frames and prints what it cost, as one line of JSON.
//!
//! `fuse_folder DUMP [--voxel-mm 5] [--truncation-voxels 8] [--min-weight 3] [--threads 1] [--mesh OUT.ply]
//! [--color yes] [--predict 320]`
//!
//! DUMP, little-endian: u32 width, height, frame count; f64 fx, fy, cx, cy; per frame 16 f64 (4x4
//! `world_from_camera`, row-major, metres), width·height u16 (depth in millimetres; 0 and 65535 = none) and
//! width·height · 3 u8 (red, green, blue, taken as sRGB and as registered).
//! `tests/peers/fusion_open3d.py` writes such a file.
//!
//! `--color yes` fuses colour too. `--predict WIDTH` predicts the model from each pose when its frame is fused, at
//! that width, once by the depth of the frame and once (`march_…`) without it; the times stand apart.

mod mesh_file;

use std::io::Read as _;

use fusion::{MeshConfig, ModelView, Volume, VolumeConfig, extract_mesh};
use geometry::{DMat3, DVec3, Intrinsics, Pose};
use imaging::{LinearPixel, Srgb8};
use rustix::time::{ClockId, clock_gettime};

type Failure = Box<dyn std::error::Error + Send + Sync>;

struct Arguments {
    dump: String,
    voxel_mm: f32,
    truncation_voxels: f32,
    min_weight: f32,
    threads: usize,
    mesh: Option<String>,
    has_color: bool,
    predict_width: Option<u32>,
}

fn main() -> Result<(), Failure> {
    let arguments = parse(std::env::args().skip(1))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    pool.install(|| run(&arguments))
}

fn parse(mut words: impl Iterator<Item = String>) -> Result<Arguments, Failure> {
    let dump = words.next().ok_or("give the dump to fuse")?;
    let mut arguments = Arguments {
        dump,
        voxel_mm: 5.0,
        truncation_voxels: 8.0,
        min_weight: 3.0,
        threads: 1,
        mesh: None,
        has_color: false,
        predict_width: None,
    };
    while let Some(flag) = words.next() {
        let value = words
            .next()
            .ok_or_else(|| format!("{flag} needs a value"))?;
        match flag.as_str() {
            "--voxel-mm" => arguments.voxel_mm = value.parse()?,
            "--truncation-voxels" => arguments.truncation_voxels = value.parse()?,
            "--min-weight" => arguments.min_weight = value.parse()?,
            "--threads" => arguments.threads = value.parse()?,
            "--mesh" => arguments.mesh = Some(value),
            "--color" => arguments.has_color = value == "yes",
            "--predict" => arguments.predict_width = Some(value.parse()?),
            _ => return Err(format!("unknown flag {flag}").into()),
        }
    }
    Ok(arguments)
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut file = std::fs::File::open(&arguments.dump)?;
    let [width, height, frame_count] = [
        read_u32(&mut file)?,
        read_u32(&mut file)?,
        read_u32(&mut file)?,
    ];
    let [fx, fy, cx, cy] = read_f64s::<4>(&mut file)?;
    let camera = Intrinsics::pinhole(width, height, fx, fy, cx, cy)?;
    let mut volume = Volume::new(VolumeConfig {
        voxel_size: arguments.voxel_mm / 1000.0,
        truncation_voxels: arguments.truncation_voxels,
        ..VolumeConfig::default()
    })?;

    let pixel_count = width as usize * height as usize;
    let mut raw_depth = vec![0u8; 2 * pixel_count];
    let mut raw_color = vec![0u8; 3 * pixel_count];
    let linear = linear_codes();
    let mut frame_ms = Vec::new();
    let seen = arguments.predict_width.map(|to| scaled(&camera, to));
    let mut prediction = seen.transpose()?.map(|seen| Prediction {
        view: ModelView::new(&seen, &Pose::IDENTITY),
        depth: Vec::new(),
        frame_ms: Vec::new(),
        march_ms: 0.0,
        surface_count: 0,
    });
    for _ in 0..frame_count {
        let m = read_f64s::<16>(&mut file)?;
        let rotation =
            DMat3::from_cols_array(&[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]]);
        let world_from_camera = Pose::from_matrix(rotation, DVec3::new(m[3], m[7], m[11]))?;
        file.read_exact(&mut raw_depth)?;
        file.read_exact(&mut raw_color)?;
        let depth: Vec<f32> = raw_depth
            .chunks_exact(2)
            .map(|b| metres(u16::from_le_bytes([b[0], b[1]])))
            .collect();
        let color: Vec<LinearPixel> = raw_color
            .chunks_exact(3)
            .map(|c| {
                LinearPixel::from_radiance([0, 1, 2].map(|n| linear[usize::from(c[n])]), false)
            })
            .collect();
        let start = process_ms();
        if arguments.has_color {
            volume.integrate_colored(&depth, &color, &camera, &world_from_camera)?;
        } else {
            volume.integrate(&depth, &camera, &world_from_camera)?;
        }
        frame_ms.push(process_ms() - start);
        if let Some(prediction) = &mut prediction {
            prediction.measure(&volume, &depth, &camera, &world_from_camera);
        }
    }
    let start = process_ms();
    let mesh = extract_mesh(
        &volume,
        &MeshConfig {
            min_weight: arguments.min_weight,
        },
    );
    let mesh_ms = process_ms() - start;
    if let Some(path) = &arguments.mesh {
        mesh_file::write_ply(&mesh, path)?;
    }
    let (total, median) = total_and_median(&mut frame_ms);
    let (predict_total, predict_median, march_total, surface_count) = match &mut prediction {
        Some(prediction) => {
            let (total, median) = total_and_median(&mut prediction.frame_ms);
            (total, median, prediction.march_ms, prediction.surface_count)
        }
        None => (0.0, 0.0, 0.0, 0),
    };
    println!(
        "{{\"frames\": {}, \"core_ms_total\": {total:.1}, \"core_ms_median\": {median:.2}, \"blocks\": {}, \
         \"refused\": {}, \"memory_bytes\": {}, \"predict_core_ms_total\": {predict_total:.1}, \
         \"predict_core_ms_median\": {predict_median:.2}, \"march_core_ms_total\": {march_total:.1}, \
         \"predicted_surfels\": {surface_count}, \
         \"mesh_core_ms\": {mesh_ms:.1}, \"vertices\": {}, \"triangles\": {}}}",
        frame_ms.len(),
        volume.block_count(),
        volume.refused_count(),
        volume.memory_bytes(),
        mesh.positions.len(),
        mesh.triangles.len()
    );
    Ok(())
}

/// The model seen from each frame, and what that cost.
struct Prediction {
    view: ModelView,
    /// Depth of the frame at the view's pixels.
    depth: Vec<f32>,
    frame_ms: Vec<f64>,
    march_ms: f64,
    /// Over all frames.
    surface_count: usize,
}

impl Prediction {
    fn measure(&mut self, volume: &Volume, depth: &[f32], full: &Intrinsics, pose: &Pose) {
        let camera = self.view.camera;
        let start = process_ms();
        // The nearest pixel.
        let step = full.width() as usize / camera.width() as usize;
        self.depth.clear();
        for row in depth.chunks(full.width() as usize).step_by(step) {
            self.depth.extend(row.iter().step_by(step));
        }
        volume.predict_near(&camera, pose, &self.depth, &mut self.view);
        self.frame_ms.push(process_ms() - start);
        self.surface_count += self.view.surface_count();
        let start = process_ms();
        volume.predict(&camera, pose, &mut self.view);
        self.march_ms += process_ms() - start;
    }
}

/// The camera at another width; pixel centres keep their rays' spread.
fn scaled(camera: &Intrinsics, width: u32) -> Result<Intrinsics, geometry::camera::CameraError> {
    let scale = f64::from(width) / f64::from(camera.width());
    let height = (f64::from(camera.height()) * scale).round() as u32;
    let (focal, center) = (
        camera.focal() * scale,
        (camera.center() + 0.5) * scale - 0.5,
    );
    Intrinsics::pinhole(width, height, focal.x, focal.y, center.x, center.y)
}

/// Linear radiance of every 8-bit code.
fn linear_codes() -> [f32; 256] {
    std::array::from_fn(|code| Srgb8([code as u8; 3]).to_linear()[0])
}

fn total_and_median(values: &mut [f64]) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let median = values.get(values.len() / 2).copied().unwrap_or(0.0);
    (values.iter().sum(), median)
}

fn metres(millimetres: u16) -> f32 {
    if millimetres == u16::MAX {
        0.0
    } else {
        f32::from(millimetres) * 1e-3
    }
}

/// CPU time of this process, milliseconds.
fn process_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

fn read_u32(file: &mut std::fs::File) -> std::io::Result<u32> {
    let mut bytes = [0; 4];
    file.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

fn read_f64s<const N: usize>(file: &mut std::fs::File) -> std::io::Result<[f64; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        let mut bytes = [0; 8];
        file.read_exact(&mut bytes)?;
        *value = f64::from_le_bytes(bytes);
    }
    Ok(values)
}
