//! Verdicts of recordings without training them: `verdicts VOXEL_MM RECORDING…` prints a line for each, with what every
//! compared effect gains in codes.

use std::path::Path;

use effects::{EffectsFile, Habit, Verdict};
use glint::effects::{Request, decide};
use glint::stages::geometry::build;
use glint::stages::object::find_object;
use glint::stages::observe::Surface;
use glint::stages::poses::training_frames;
use sequence::Recording;

fn verdicts(path: &Path, voxel_size: f32) -> anyhow::Result<EffectsFile> {
    let recording = Recording::open(path)?;
    let frames = training_frames(&recording, "source")?;
    let geometry = build(&recording, &frames, voxel_size, &mut |_, _| {})?;
    let parts = find_object(&geometry.mesh, None, 1);
    let surface = Surface::fused(geometry.mesh, parts.vertex_segment, voxel_size)?;
    let request = Request {
        requests: &"".parse()?,
        habit: Habit::Cheap,
        previous: None,
        refinement: None,
        compares: true,
        stride: 2,
        seed: 1,
    };
    Ok(decide(&recording, &surface, &frames, &request)?.file)
}

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let voxel_mm: f32 = arguments.next().unwrap_or_default().parse()?;
    for path in arguments {
        let file = verdicts(path.as_ref(), 1e-3 * voxel_mm)?;
        print!("{path}: blocks {}", file.survey.blocks);
        for record in &file.effects {
            let verdict = match record.verdict {
                Verdict::On => "ON",
                Verdict::Off => "off",
            };
            print!(" | {} {verdict} {:?}", record.id, record.by);
            if let Some(probe) = &record.probe {
                print!(" {:.2} -> {:.2}", probe.l1_off, probe.l1_on);
            }
        }
        println!();
    }
    Ok(())
}
