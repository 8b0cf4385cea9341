//! How good poses are, by what they were not fitted to: the frames that are judged are left out of the model that
//! judges them.

use fusion::{ModelView, Volume, VolumeConfig};
use geometry::robust;
use serde::{Deserialize, Serialize};

use super::flow::{FEWEST_PATCHES, displacements};
use super::frames::{FrameLoader, LoadedFrame};
use super::loops::half;
use super::{ActiveFrame, fuse};

/// Every how many frames are judged.
const EVERY: usize = 5;
/// Below so many frames all of them make the model, and all are judged by it.
const FEWEST_APART: usize = 15;
/// Depth farther from the model than this lies on something else, metres.
const LARGEST_RESIDUAL: f32 = 0.03;

/// Figures of one path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Median over frames of the median length of residual optical flow of the fused colour against the photograph,
    /// full-size pixels; `None` where no photograph has enough texture.
    pub flow_px: Option<f64>,
    /// Median distance of measured depth from the fused surface along its normal, millimetres.
    pub depth_residual_mm: Option<f64>,
    /// Frames that were judged.
    pub frame_count: usize,
    /// Patches whose flow was measured.
    pub patch_count: usize,
}

/// What one frame says.
struct FrameFigures {
    flow: Option<f64>,
    residual: Option<f64>,
    patch_count: usize,
}

/// Judges frames at their poses.
pub(super) fn judge(
    loader: &FrameLoader<'_>,
    frames: &[ActiveFrame],
    volume: &VolumeConfig,
    progress: &mut dyn FnMut(usize),
) -> anyhow::Result<Judgement> {
    let is_apart = frames.len() >= FEWEST_APART;
    let is_judged = |position: usize| position % EVERY == EVERY / 2;
    let (judged, makers): (Vec<ActiveFrame>, Vec<ActiveFrame>) = if is_apart {
        let (judged, makers): (Vec<_>, Vec<_>) =
            frames.iter().enumerate().partition(|(p, _)| is_judged(*p));
        let frames = |list: Vec<(usize, &ActiveFrame)>| list.into_iter().map(|(_, f)| *f).collect();
        (frames(judged), frames(makers))
    } else {
        (frames.to_vec(), frames.to_vec())
    };
    let model = fuse(loader, &makers, volume.clone(), progress)?;
    let indices: Vec<usize> = judged.iter().map(|frame| frame.index).collect();
    let figures = loader.map(&indices, |position, frame| {
        figures_of(loader, &model, &judged[position], frame)
    })?;
    let mut flows: Vec<f64> = figures.iter().filter_map(|figures| figures.flow).collect();
    let mut residuals: Vec<f64> = figures.iter().filter_map(|f| f.residual).collect();
    Ok(Judgement {
        flow_px: robust::median(&mut flows),
        depth_residual_mm: robust::median(&mut residuals).map(|metres| 1e3 * metres),
        frame_count: judged.len(),
        patch_count: figures.iter().map(|figures| figures.patch_count).sum(),
    })
}

fn figures_of(
    loader: &FrameLoader<'_>,
    model: &Volume,
    at: &ActiveFrame,
    frame: &LoadedFrame,
) -> anyhow::Result<FrameFigures> {
    let camera = half(loader)?;
    let mut view = ModelView::new(&camera, &at.world_from_camera);
    model.predict(&camera, &at.world_from_camera, &mut view);
    let residual = robust::median(&mut residuals(&view, frame));
    let lengths = match &frame.photograph {
        None => Vec::new(),
        Some(photograph) => {
            let camera = loader.half_color_camera;
            let pose = at.world_from_camera * loader.color_from_depth().inverse();
            model.predict(&camera, &pose, &mut view);
            let (_, image) = &photograph.grey.levels[0];
            displacements(&view, image)
        }
    };
    let patch_count = lengths.len();
    let mut lengths = lengths;
    Ok(FrameFigures {
        flow: robust::median(&mut lengths).filter(|_| patch_count >= FEWEST_PATCHES),
        residual,
        patch_count,
    })
}

/// Distances of points from the surfels of their pixels, along the normal, metres.
fn residuals(view: &ModelView, frame: &LoadedFrame) -> Vec<f64> {
    let Some(level) = frame.points.levels().first() else {
        return Vec::new();
    };
    let grid = &level.points;
    let mut found = Vec::new();
    let mut place = 0;
    for tile in (0..grid.tile_count()).map(|index| grid.tile(index)) {
        for ((&x, &y), &z) in tile.x.iter().zip(tile.y).zip(tile.z) {
            // A point lies in its own pixel: the view is that of the frame's own camera.
            let surfel = view.surfels.get(place);
            place += 1;
            let Some(surfel) = surfel.filter(|surfel| surfel.is_surface() && z.is_finite()) else {
                continue;
            };
            let [px, py, pz] = surfel.position;
            let [nx, ny, nz] = surfel.normal;
            let distance = nx * (x - px) + ny * (y - py) + nz * (z - pz);
            // NaN fails.
            if distance.abs() <= LARGEST_RESIDUAL {
                found.push(f64::from(distance.abs()));
            }
        }
    }
    found
}
