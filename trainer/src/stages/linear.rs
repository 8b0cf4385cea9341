//! Stage `linear`: D and the SRM solved jointly from all pixels that reflect.

use std::collections::BTreeMap;

use anyhow::Context as _;
use clap::ValueEnum;
use effects::{Counters, Effect};
use geometry::PanoramaSize;
use serde::{Deserialize, Serialize};
use srm::selection::{self, SegmentVerdict, WeightTrial};
use srm::{Confidence, DiffuseTreatment, JointSettings, Problem, Rows, Solution};

use super::diffuse::VertexColors;
use super::observe::{FrameObservations, Surface};
use super::rows::{CompactVertices, RowMaker};
use crate::effects::{EffectPlan, FresnelFit};

/// Reflectance that the map assumes for every shiny surface. One map cannot tell it: its value only
/// scales S (srm-feasibility section 5).
pub const GAIN: f32 = 0.3;

/// Rows of the SRM unless others are asked for: texels of 1.43 degrees. The paper's 250 (Park 2020 section 3.2) cost up
/// to twice as much, err no less, and resolve no finer bar even on a mirror filmed in VGA (docs/accuracy.md).
pub const SRM_HEIGHT: u32 = 126;

/// What is done with D.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DiffuseOrder {
    /// D and S together, D pulled to zero.
    #[default]
    Joint,
    /// D and S together, D pulled to the robust minimum.
    MinimumPrior,
    /// The paper's order: D is the robust minimum and stays, then S.
    MinimumFixed,
}

/// What the stage found out, `linear/summary.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LinearSummary {
    /// Whether anything shiny was found.
    pub found_specular: bool,
    /// A sentence for people.
    pub sentence: String,
    /// Treatment of D.
    pub diffuse: DiffuseOrder,
    /// The assumed reflectance.
    pub gain: f32,
    /// Rows solved from.
    pub row_count: usize,
    /// Of these, with a clipped channel.
    pub clipped_fraction: f64,
    /// Of these, with the mirrored ray blocked.
    pub occluded_fraction: f64,
    /// Pixels of the object lost to silhouettes, slant or unsure normals.
    pub dropped_fraction: f64,
    /// Vertices of D.
    pub vertex_count: usize,
    /// Weight of D's prior, equivalent rows a vertex at ten rows a vertex.
    pub diffuse_weight: f64,
    /// All tried weights with their held-out errors.
    pub weight_trials: Vec<TrialSummary>,
    /// Every segment with its held-out errors.
    pub segments: Vec<SegmentSummary>,
    /// Robust residual of the solved rows, linear luminance.
    pub residual_sigma: f64,
    /// Robust residual on held-out frames.
    pub held_out_sigma: f64,
    /// Standard deviation of the offset of S.
    pub offset_sigma: f64,
    /// Share of the offset's curvature that comes from data.
    pub offset_data_fraction: f64,
    /// Whether the data fix the offset.
    pub offset_observed: bool,
    /// Parts of the scene that share no texel.
    pub component_count: usize,
    /// Mean confidence over the panorama.
    pub mean_confidence: f64,
    /// Share of texels with confidence of 0.5 or more.
    pub claimed_fraction: f64,
    /// Largest violation of the optimality conditions, linear radiance.
    pub kkt_violation: f64,
    /// Relative residual of the normal equations, recomputed.
    pub relative_residual: f64,
}

/// One tried weight.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct TrialSummary {
    /// Weight at ten rows a vertex.
    pub weight: f64,
    /// Held-out error.
    pub error: f64,
}

/// One judged segment.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct SegmentSummary {
    /// Number, as in the mesh.
    pub id: u16,
    /// Held-out error of D alone.
    pub diffuse_error: f64,
    /// Held-out error of D and S.
    pub joint_error: f64,
    /// Whether it keeps S.
    pub is_specular: bool,
    /// What it reflects of the map over the common gain; 1 where it was not measured.
    pub relative_gain: f32,
    /// How its reflectance rises towards grazing angles; absent where that is not modelled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fresnel: Option<FresnelFit>,
}

/// The solved stage.
pub struct Linear {
    /// S, row-major, filled where no row reaches.
    pub specular_map: Vec<[f32; 3]>,
    /// Its confidence.
    pub confidence: Confidence,
    /// D of every vertex of the surface: solved on shiny segments, the median colour elsewhere.
    pub diffuse: Vec<[f32; 3]>,
    /// Which segments are shiny.
    pub specular_segments: Vec<u16>,
    /// Size of the map.
    pub panorama: PanoramaSize,
    /// What was computed.
    pub counters: Counters,
    /// Figures.
    pub summary: LinearSummary,
}

/// Weights of D's prior that may be tried, at ten rows a vertex: those of srm-feasibility section 4 and one beyond each
/// end, which weak reflectors (0.05) and polished balls (1.6) take.
const WEIGHTS: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.8, 1.6];
/// Rows a vertex for which the weights are stated.
const STATED_ROWS_PER_VERTEX: f64 = 10.0;
/// One row in this many takes part in the choices.
const CHOICE_STEP: usize = 3;
/// Most rows of the map that choices are made with: few pixels leave a fine map so free that it paints what is matte.
const CHOICE_HEIGHT: u32 = 62;

/// Solver settings of the choices: they rank, and need fewer steps than the result.
fn choice_settings() -> JointSettings {
    let mut settings = JointSettings {
        rounds: 2,
        ..JointSettings::default()
    };
    settings.solver.steps = 40;
    settings.solver.passes = 1;
    settings
}

/// Heights that a map may have.
pub const MAP_HEIGHTS: std::ops::RangeInclusive<u32> = 16..=1000;

/// How the stage is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinearSettings {
    /// Treatment of D.
    pub diffuse: DiffuseOrder,
    /// Rows of the map.
    pub map_height: u32,
    /// One in this many of the pixels gives a row; 1 for all.
    pub row_step: usize,
    /// Rounds of robust reweighting; the solver's own number when absent.
    pub rounds: Option<usize>,
}

fn panorama_of(height: u32) -> anyhow::Result<PanoramaSize> {
    PanoramaSize::from_height(height)
        .filter(|_| MAP_HEIGHTS.contains(&height))
        .with_context(|| {
            let (least, most) = (MAP_HEIGHTS.start(), MAP_HEIGHTS.end());
            format!("a map of {height} rows cannot be solved: give {least} to {most}")
        })
}

/// Solves the stage.
///
/// # Errors
/// When the rows make no problem, or the map would have a height out of [`MAP_HEIGHTS`].
pub fn solve(
    surface: &Surface,
    observations: &[FrameObservations],
    colors: &VertexColors,
    settings: &LinearSettings,
    plan: &EffectPlan,
) -> anyhow::Result<Linear> {
    let LinearSettings {
        diffuse: order,
        map_height,
        row_step,
        rounds,
    } = *settings;
    let panorama = panorama_of(map_height)?;
    let vertices = CompactVertices::new(surface);
    let maker = RowMaker {
        surface,
        colors,
        vertices: &vertices,
        panorama,
        plan,
    };
    let coarse = RowMaker {
        panorama: panorama_of(map_height.min(CHOICE_HEIGHT))?,
        ..maker
    };
    let mut counters = Counters::default();
    let mut rows = maker.rows(observations, None, row_step, &mut counters);
    let object_count: usize = observations.iter().map(|frame| frame.object_count).sum();
    let dropped: usize = observations.iter().map(|frame| frame.dropped_count).sum();
    let dropped_fraction = dropped as f64 / object_count.max(1) as f64;
    if rows.is_empty() {
        let sentence = if plan.is_specular {
            "nothing specular was found: no part of the surface stands out from its planes"
        } else {
            "nothing specular was found: no part of the object changes its look with the view"
        };
        return Ok(black(
            surface,
            colors,
            panorama,
            sentence,
            order,
            dropped_fraction,
            &[],
            &[],
        ));
    }
    let per_vertex = |rows: &Rows| rows.len() as f64 / vertices.full.len().max(1) as f64;
    let sparse = coarse.rows(observations, None, CHOICE_STEP * row_step, &mut counters);
    let scale = per_vertex(&sparse) / STATED_ROWS_PER_VERTEX;
    let weights = WEIGHTS.map(|weight| weight * scale);
    let choice = selection::choose(
        &sparse,
        vertices.full.len(),
        coarse.panorama,
        &choice_settings(),
        &weights,
    )?;
    let trials: Vec<TrialSummary> = choice
        .trials
        .iter()
        .map(|WeightTrial { weight, error, .. }| TrialSummary {
            weight: weight / scale,
            error: *error,
        })
        .collect();
    let mut segments: Vec<SegmentSummary> = choice.segments.iter().map(segment_summary).collect();
    let specular_segments: Vec<u16> = segments
        .iter()
        .filter(|s| s.is_specular)
        .map(|s| s.id)
        .collect();
    if specular_segments.is_empty() {
        let sentence =
            "nothing specular was found: a matte texture explains every part of the object as well";
        return Ok(black(
            surface,
            colors,
            panorama,
            sentence,
            order,
            dropped_fraction,
            &trials,
            &segments,
        ));
    }
    if plan.computed.contains(Effect::FirstBounceSpecular) {
        // Only now is it known which first bounces mirror.
        let counters = &mut Counters::default();
        rows = maker.rows(observations, Some(&specular_segments), row_step, counters);
    }
    let shiny = rows.filtered(|row| specular_segments.contains(&row.segment));
    let diffuse_weight = choice.weight / scale;
    let solved_weight = diffuse_weight * per_vertex(&shiny) / STATED_ROWS_PER_VERTEX;
    let minimum = || {
        vertices
            .full
            .iter()
            .map(|&v| colors.robust_minimum[v as usize])
            .collect()
    };
    let settings = JointSettings {
        diffuse: match order {
            DiffuseOrder::Joint => DiffuseTreatment::PulledToZero {
                weight: solved_weight,
            },
            DiffuseOrder::MinimumPrior => DiffuseTreatment::PulledTo {
                values: minimum(),
                weight: solved_weight,
            },
            DiffuseOrder::MinimumFixed => DiffuseTreatment::Fixed { values: minimum() },
        },
        rounds: rounds.unwrap_or(JointSettings::default().rounds),
        ..JointSettings::default()
    };
    let problem = Problem::new(shiny, vertices.full.len(), panorama)?;
    let split = problem.solve(&settings);
    let offset = problem.offset_condition(&split, &settings, choice.held_out_sigma);
    let confidence = problem.confidence(
        &split,
        settings.smoothness,
        choice.held_out_sigma,
        offset.is_observed(),
    );
    let (solution, gains) = match order {
        DiffuseOrder::Joint | DiffuseOrder::MinimumPrior => {
            let gains = problem.segment_gains(&split);
            (
                problem
                    .with_segment_gains(&gains)
                    .refit_diffuse(&split, &settings),
                gains,
            )
        }
        DiffuseOrder::MinimumFixed => (split, BTreeMap::new()),
    };
    for segment in &mut segments {
        segment.relative_gain = gains.get(&segment.id).map_or(1.0, |&gain| gain as f32);
        segment.fresnel = plan.fresnel_of(segment.id).copied();
    }
    let share = |count: usize| count as f64 / problem.rows().len() as f64;
    let clipped = problem.rows().iter().filter(|row| row.clipped != 0).count();
    let occluded = problem
        .rows()
        .iter()
        .filter(|row| row.taps == [0.0; 4])
        .count();
    let claimed = confidence.confidence.iter().filter(|&&c| c >= 0.5).count();
    let texel_count = panorama.texel_count() as f64;
    let summary = LinearSummary {
        found_specular: true,
        sentence: sentence(&offset, specular_segments.len()),
        diffuse: order,
        gain: GAIN,
        row_count: problem.rows().len(),
        clipped_fraction: share(clipped),
        occluded_fraction: share(occluded),
        dropped_fraction,
        vertex_count: vertices.full.len(),
        diffuse_weight,
        weight_trials: trials,
        segments,
        residual_sigma: solution.residual_sigma,
        held_out_sigma: choice.held_out_sigma,
        offset_sigma: offset.sigma,
        offset_data_fraction: offset.data_fraction,
        offset_observed: offset.is_observed(),
        component_count: offset.component_count,
        mean_confidence: confidence
            .confidence
            .iter()
            .map(|&c| f64::from(c))
            .sum::<f64>()
            / texel_count,
        claimed_fraction: claimed as f64 / texel_count,
        kkt_violation: solution.report.kkt_violation,
        relative_residual: solution.report.relative_residual,
    };
    Ok(Linear {
        specular_map: problem.filled(&solution.specular),
        confidence,
        diffuse: full_diffuse(
            surface,
            colors,
            &vertices,
            &solution,
            &problem,
            &specular_segments,
        ),
        specular_segments,
        panorama,
        counters,
        summary,
    })
}

fn sentence(offset: &srm::offset::OffsetCondition, segment_count: usize) -> String {
    let parts = if segment_count == 1 {
        "1 shiny part".to_owned()
    } else {
        format!("{segment_count} shiny parts")
    };
    if offset.is_observed() {
        format!(
            "{parts}; the offset of the map is fixed by the data (sigma {:.3})",
            offset.sigma
        )
    } else {
        format!(
            "{parts}; the offset of the map is not observed (sigma {:.3}, {:.0} % from data): it is the largest \
             that the dark parts of the texture allow",
            offset.sigma,
            100.0 * offset.data_fraction
        )
    }
}

fn segment_summary(verdict: &SegmentVerdict) -> SegmentSummary {
    SegmentSummary {
        id: verdict.segment,
        diffuse_error: verdict.diffuse_error,
        joint_error: verdict.joint_error,
        is_specular: verdict.is_specular,
        relative_gain: 1.0,
        fresnel: None,
    }
}

/// D on the whole surface: the solution where rows touch it, its neighbours' mean on the rest of a shiny
/// segment, the median colour elsewhere.
fn full_diffuse(
    surface: &Surface,
    colors: &VertexColors,
    vertices: &CompactVertices,
    solution: &Solution,
    problem: &Problem,
    specular_segments: &[u16],
) -> Vec<[f32; 3]> {
    let touched = selection::known_vertices(problem);
    let mut diffuse = colors.median.clone();
    let mut known = vec![true; diffuse.len()];
    for (compact, &vertex) in vertices.full.iter().enumerate() {
        let vertex = vertex as usize;
        if !specular_segments.contains(&surface.vertex_segment[vertex]) {
            continue;
        }
        diffuse[vertex] = solution.diffuse[compact];
        known[vertex] = touched[compact];
    }
    super::diffuse::fill(surface, &mut diffuse, &known);
    diffuse
}

fn black(
    surface: &Surface,
    colors: &VertexColors,
    panorama: PanoramaSize,
    sentence: &str,
    order: DiffuseOrder,
    dropped_fraction: f64,
    trials: &[TrialSummary],
    segments: &[SegmentSummary],
) -> Linear {
    let count = panorama.texel_count();
    debug_assert_eq!(colors.median.len(), surface.positions.len());
    Linear {
        specular_map: vec![[0.0; 3]; count],
        confidence: Confidence::nothing(count),
        diffuse: colors.median.clone(),
        specular_segments: Vec::new(),
        panorama,
        counters: Counters::default(),
        summary: LinearSummary {
            found_specular: false,
            sentence: sentence.to_owned(),
            diffuse: order,
            gain: GAIN,
            row_count: 0,
            clipped_fraction: 0.0,
            occluded_fraction: 0.0,
            dropped_fraction,
            vertex_count: 0,
            diffuse_weight: 0.0,
            weight_trials: trials.to_vec(),
            segments: segments.to_vec(),
            residual_sigma: 0.0,
            held_out_sigma: 0.0,
            offset_sigma: 0.0,
            offset_data_fraction: 0.0,
            offset_observed: false,
            component_count: 0,
            mean_confidence: 0.0,
            claimed_fraction: 0.0,
            kkt_violation: 0.0,
            relative_residual: 0.0,
        },
    }
}
