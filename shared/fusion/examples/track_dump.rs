//! Tracks and fuses a dump of RGB-D frames and compares the path with a reference, as one line of JSON.
//!
//! Frames that come again get fresh depth noise.
//!
//! `track_dump DUMP [--voxel-mm 5] [--threads 1] [--frames A..B,C..D,blank*N,…] [--no-grey] [--coarse-view] [--skip-finest]
//! [--poses OUT.txt] [--mesh OUT.ply] [--verbose]`
//!
//! DUMP, little-endian: u32 columns, rows, frames, 1; f64 fx, fy, cx, cy, metres per unit of the depth camera; u32
//! columns, rows, f64 fx, fy, cx, cy of the colour camera; 16 f64 color_from_depth; per frame i64 nanoseconds, 16 f64
//! world_from_camera (row-major, the reference), u16 depth (0 = none), RGB8 with gamma 2.2.

mod mesh_file;

use std::io::{BufReader, Read, Write as _};

use fusion::live::{Effort, LiveConfig, LiveFusion, LiveRig};
use fusion::tracking::TrackState;
use fusion::{MeshConfig, VolumeConfig, extract_mesh};
use geometry::{DMat3, DVec3, Intrinsics, Pose, trajectory_error};
use imaging::develop::{ColorLayout, Developer};
use imaging::{Corrector, DepthImage, LinearPixel, Response, Vignetting};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use rustix::time::{ClockId, clock_gettime};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// In place of a frame number: the last frame without depth.
const BLANK: usize = usize::MAX;

struct Arguments {
    dump: String,
    voxel_mm: f32,
    truncation_voxels: f32,
    threads: usize,
    frames: std::ops::Range<usize>,
    list: Vec<usize>,
    grey: bool,
    effort: Effort,
    poses: Option<String>,
    mesh: Option<String>,
    verbose: bool,
}

fn main() -> Result<(), Failure> {
    let arguments = parse(std::env::args().skip(1))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    pool.install(|| run(&arguments))
}

fn parse(mut words: impl Iterator<Item = String>) -> Result<Arguments, Failure> {
    let mut arguments = Arguments {
        dump: words.next().ok_or("give the dump")?,
        voxel_mm: 5.0,
        truncation_voxels: 6.0,
        threads: 1,
        frames: 0..usize::MAX,
        list: Vec::new(),
        grey: true,
        effort: Effort::default(),
        poses: None,
        mesh: None,
        verbose: false,
    };
    while let Some(flag) = words.next() {
        match flag.as_str() {
            "--no-grey" => arguments.grey = false,
            "--coarse-view" => arguments.effort.coarse_view = true,
            "--skip-finest" => arguments.effort.skip_finest = true,
            "--verbose" => arguments.verbose = true,
            _ => {
                let value = words.next().ok_or("a value is missing")?;
                match flag.as_str() {
                    "--voxel-mm" => arguments.voxel_mm = value.parse()?,
                    "--truncation-voxels" => arguments.truncation_voxels = value.parse()?,
                    "--threads" => arguments.threads = value.parse()?,
                    "--poses" => arguments.poses = Some(value),
                    "--mesh" => arguments.mesh = Some(value),
                    "--frames" => {
                        for part in value.split(',') {
                            if let Some(count) = part.strip_prefix("blank*") {
                                let blanks = std::iter::repeat_n(BLANK, count.parse()?);
                                arguments.list.extend(blanks);
                                continue;
                            }
                            let (from, to) = part.split_once("..").ok_or("frames are A..B")?;
                            let (from, to): (usize, usize) = (from.parse()?, to.parse()?);
                            arguments.frames = from..to;
                            if from <= to {
                                arguments.list.extend(from..to);
                            } else {
                                arguments.list.extend((to..from).rev());
                            }
                        }
                    }
                    _ => return Err(format!("unknown flag {flag}").into()),
                }
            }
        }
    }
    Ok(arguments)
}

struct Frame {
    time_nanos: i64,
    reference: Pose,
    depth: DepthImage,
    rgb: Vec<u8>,
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut file = BufReader::new(std::fs::File::open(&arguments.dump)?);
    let [width, height, count, _] = u32s::<4>(&mut file)?;
    let [fx, fy, cx, cy, scale] = f64s::<5>(&mut file)?;
    let depth_camera = Intrinsics::pinhole(width, height, fx, fy, cx, cy)?;
    let [color_width, color_height] = u32s::<2>(&mut file)?;
    let [fx, fy, cx, cy] = f64s::<4>(&mut file)?;
    let color_camera = Intrinsics::pinhole(color_width, color_height, fx, fy, cx, cy)?;
    let color_from_depth = pose(&f64s::<16>(&mut file)?)?;

    let mut frames = Vec::new();
    let mut raw = vec![0u8; 2 * (width * height) as usize];
    for index in 0..count as usize {
        let mut nanos = [0; 8];
        file.read_exact(&mut nanos)?;
        let reference = pose(&f64s::<16>(&mut file)?)?;
        file.read_exact(&mut raw)?;
        let mut rgb = vec![0u8; 3 * (color_width * color_height) as usize];
        file.read_exact(&mut rgb)?;
        let wanted = arguments.list.is_empty() || arguments.list.contains(&index);
        let depth = raw
            .chunks_exact(2)
            .map(|b| (f64::from(u16::from_le_bytes([b[0], b[1]])) * scale) as f32)
            .collect();
        frames.push(wanted.then_some(Frame {
            time_nanos: i64::from_le_bytes(nanos),
            reference,
            depth: DepthImage::from_vec(width, height, depth)?,
            rgb,
        }));
    }
    let order: Vec<usize> = if arguments.list.is_empty() {
        (0..frames.len()).collect()
    } else {
        arguments.list.clone()
    };
    let corrector = Corrector::new(
        &Response::gamma(2.2)?,
        &Vignetting::none(),
        color_width,
        color_height,
        1.0,
    );
    let mut developer = Developer::new(&corrector, ColorLayout::Rgb8)?;
    let mut pixels = vec![LinearPixel::INVALID; (color_width * color_height) as usize];
    let rig = LiveRig {
        depth_camera,
        color_camera: arguments.grey.then_some(color_camera),
        color_from_depth,
    };
    let config = LiveConfig {
        volume: VolumeConfig {
            voxel_size: arguments.voxel_mm / 1000.0,
            truncation_voxels: arguments.truncation_voxels,
            ..LiveConfig::default().volume
        },
        ..LiveConfig::default()
    };
    let first = frames[order[0]].as_ref().ok_or("no such frame")?.reference;
    let mut live = LiveFusion::new(config, rig, first)?;
    let (mut references, mut estimates) = (Vec::new(), Vec::new());
    let mut ms = [0.0; 3];
    let mut counts = [0; 3];
    let mut worst = (0.0_f64, 0.0_f64);
    let mut wrong = 0;
    let mut end_mm = 0.0;
    let mut out = String::new();
    let interval = frames[order[0].max(1)]
        .as_ref()
        .map_or(0, |f| f.time_nanos / order[0].max(1) as i64)
        .max(1);
    let mut last = frames[order[0]].as_ref().map_or(0, |f| f.time_nanos);
    for (place, &index) in order.iter().enumerate() {
        let blank;
        let is_again = index != BLANK && order[..place].contains(&index);
        let frame = if index != BLANK && is_again {
            let frame = frames[index].as_ref().ok_or("no such frame")?;
            blank = Frame {
                time_nanos: frame.time_nanos,
                reference: frame.reference,
                depth: with_fresh_noise(&frame.depth, place as u64),
                rgb: frame.rgb.clone(),
            };
            &blank
        } else if index == BLANK {
            let frame = frames[order[place - 1].min(order[0])]
                .as_ref()
                .ok_or("no such frame")?;
            blank = Frame {
                time_nanos: frame.time_nanos,
                reference: frame.reference,
                depth: DepthImage::new(width, height, 0.0),
                rgb: frame.rgb.clone(),
            };
            &blank
        } else {
            frames[index].as_ref().ok_or("no such frame")?
        };
        // A list of frames plays at the rate of the recording.
        let time = if arguments.list.is_empty() {
            frame.time_nanos
        } else {
            last + interval
        };
        last = time;
        let start = process_ms();
        if let Some(grey) = live.grey_mut() {
            developer.develop(&frame.rgb, true, &mut pixels, grey.pixels_mut())?;
        }
        live.load(&frame.depth, arguments.grey);
        let loaded = process_ms();
        let tracked = live.track(time, arguments.effort);
        let found = process_ms();
        let fusing = process_ms();
        live.fuse(&frame.depth, arguments.grey.then_some(&pixels))?;
        let fused = process_ms();
        let parts = [loaded - start, found - loaded, fused - fusing];
        for (sum, part) in ms.iter_mut().zip(parts) {
            *sum += part;
        }
        let error = frame.reference.inverse() * tracked.world_from_camera;
        let (shift, turn) = (
            error.translation().length(),
            geometry::rotation::log(error.rotation())
                .length()
                .to_degrees(),
        );
        match tracked.state {
            TrackState::Ok => counts[0] += 1,
            TrackState::Weak(_) => counts[1] += 1,
            TrackState::Lost => counts[2] += 1,
        }
        let known = tracked.state != TrackState::Lost;
        end_mm = 1000.0 * shift;
        if known {
            worst = (worst.0.max(shift), worst.1.max(turn));
            wrong += u32::from(shift > 0.05 || turn > 5.0);
        }
        references.push(frame.reference.translation());
        estimates.push(known.then_some(tracked.world_from_camera.translation()));
        if arguments.verbose {
            println!(
                "{place:4} {index:4} {:?} map {} shift {:6.1} mm turn {turn:5.2} overlap {:.2} agreement {:.2} load {:.1} track {:.1} fuse {:.1} {:?}",
                tracked.state,
                tracked.map,
                shift * 1000.0,
                tracked.overlap,
                tracked.agreement,
                loaded - start,
                found - loaded,
                fused - fusing,
                live.last_alignment()
                    .map(|found| (found.cost, found.solution.rank))
            );
        }
        let (q, t) = (
            tracked.world_from_camera.rotation(),
            tracked.world_from_camera.translation(),
        );
        out += &format!(
            "{place} {} {} {} {} {} {} {}\n",
            t.x, t.y, t.z, q.x, q.y, q.z, q.w
        );
    }
    if let Some(path) = &arguments.poses {
        std::fs::File::create(path)?.write_all(out.as_bytes())?;
    }
    if let Some(path) = &arguments.mesh {
        let mesh = extract_mesh(live.volume(), &MeshConfig::default());
        mesh_file::write_ply(&mesh, path)?;
    }
    let error = trajectory_error(&references, &estimates)?;
    let n = order.len() as f64;
    println!(
        "{{\"frames\": {}, \"ok\": {}, \"weak\": {}, \"lost\": {}, \"ate_mm\": {:.2}, \"worst_mm\": {:.1}, \"worst_deg\": {:.2}, \"wrong\": {wrong}, \"end_mm\": {end_mm:.1}, \"load_ms\": {:.2}, \"track_ms\": {:.2}, \"fuse_ms\": {:.2}, \"blocks\": {}}}",
        order.len(),
        counts[0],
        counts[1],
        counts[2],
        error.ate_rmse * 1000.0,
        worst.0 * 1000.0,
        worst.1,
        ms[0] / n,
        ms[1] / n,
        ms[2] / n,
        live.volume().block_count()
    );
    Ok(())
}

/// The same surface measured again: noise of a PrimeSense sensor, 1.2e-3 z² metres.
fn with_fresh_noise(depth: &DepthImage, seed: u64) -> DepthImage {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    depth.map(|z| {
        // The sum of four uniform numbers, variance 1/3, is near enough to normal.
        let sum: f32 = (0..4).map(|_| random.random_range(-0.5..0.5)).sum();
        z + 1.2e-3 * z * z * sum * 3.0_f32.sqrt()
    })
}

fn pose(m: &[f64; 16]) -> Result<Pose, Failure> {
    let rotation = DMat3::from_cols_array(&[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]]);
    Ok(Pose::from_matrix(rotation, DVec3::new(m[3], m[7], m[11]))?)
}

fn u32s<const N: usize>(from: &mut impl Read) -> Result<[u32; N], Failure> {
    let mut values = [0; N];
    for value in &mut values {
        let mut bytes = [0; 4];
        from.read_exact(&mut bytes)?;
        *value = u32::from_le_bytes(bytes);
    }
    Ok(values)
}

fn f64s<const N: usize>(from: &mut impl Read) -> Result<[f64; N], Failure> {
    let mut values = [0.0; N];
    for value in &mut values {
        let mut bytes = [0; 8];
        from.read_exact(&mut bytes)?;
        *value = f64::from_le_bytes(bytes);
    }
    Ok(values)
}

fn process_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}
