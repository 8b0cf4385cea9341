//! Stage `diffuse`: the colour of every vertex, twice: the paper's robust minimum, and the median that
//! serves as the radiance of a first bounce.

use fusion::texture::{Sample, robust_minimum};
use rayon::prelude::*;

use super::observe::{FrameObservations, Surface};

/// Colours of vertices, linear radiance.
#[derive(Clone, Debug, Default)]
pub struct VertexColors {
    /// Robust minimum over views (Park 2020 section 3.3; hard-cases G).
    pub robust_minimum: Vec<[f32; 3]>,
    /// Median over views a channel.
    pub median: Vec<[f32; 3]>,
    /// Views that saw the vertex, 0 where the colour comes from neighbours.
    pub count: Vec<u32>,
}

/// Noise of a linear sample: shot and read noise of an 8-bit camera near mid grey, with resampling.
const SAMPLE_SIGMA: f32 = 0.01;
/// Rounds in which vertices without a sample take the mean of their neighbours.
const FILL_ROUNDS: usize = 24;

/// Gathers samples by vertex and reduces them; deterministic for any number of threads.
pub fn vertex_colors(surface: &Surface, observations: &[FrameObservations]) -> VertexColors {
    let vertex_count = surface.positions.len();
    // Counting sort by vertex, frames in order.
    let mut start = vec![0_u32; vertex_count + 1];
    for sample in observations.iter().flat_map(|frame| &frame.samples) {
        start[sample.vertex as usize + 1] += 1;
    }
    for vertex in 0..vertex_count {
        start[vertex + 1] += start[vertex];
    }
    let mut cursor = start.clone();
    let blank = Sample {
        linear: [0.0; 3],
        saturated: false,
        frame: 0,
    };
    let mut sorted = vec![blank; start[vertex_count] as usize];
    for sample in observations.iter().flat_map(|frame| &frame.samples) {
        let slot = &mut cursor[sample.vertex as usize];
        sorted[*slot as usize] = Sample {
            linear: sample.linear,
            saturated: sample.saturated,
            frame: sample.frame,
        };
        *slot += 1;
    }
    let reduced: Vec<([f32; 3], [f32; 3], u32)> = (0..vertex_count)
        .into_par_iter()
        .map(|vertex| {
            let samples = &sorted[start[vertex] as usize..start[vertex + 1] as usize];
            if samples.is_empty() {
                return ([0.0; 3], [0.0; 3], 0);
            }
            (
                robust_minimum(samples, SAMPLE_SIGMA).value,
                median(samples),
                samples.len() as u32,
            )
        })
        .collect();
    let mut colors = VertexColors::default();
    for (minimum, median, count) in reduced {
        colors.robust_minimum.push(minimum);
        colors.median.push(median);
        colors.count.push(count);
    }
    let known: Vec<bool> = colors.count.iter().map(|&count| count > 0).collect();
    fill(surface, &mut colors.robust_minimum, &known);
    fill(surface, &mut colors.median, &known);
    colors
}

fn median(samples: &[Sample]) -> [f32; 3] {
    let mut values: Vec<f32> = Vec::with_capacity(samples.len());
    [0, 1, 2].map(|channel| {
        values.clear();
        values.extend(samples.iter().map(|sample| sample.linear[channel]));
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    })
}

/// Gives vertices without a value the mean of their neighbours, round by round.
pub fn fill(surface: &Surface, values: &mut [[f32; 3]], known: &[bool]) {
    let mut known = known.to_vec();
    for _ in 0..FILL_ROUNDS {
        let mut sum = vec![[0.0_f32; 3]; values.len()];
        let mut count = vec![0.0_f32; values.len()];
        for triangle in &surface.triangles {
            for (at, from) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
                let (at, from) = (triangle[at] as usize, triangle[from] as usize);
                if !known[at] && known[from] {
                    for c in 0..3 {
                        sum[at][c] += values[from][c];
                    }
                    count[at] += 1.0;
                }
            }
        }
        let mut changed = false;
        for (index, &count) in count.iter().enumerate() {
            if count > 0.0 {
                values[index] = sum[index].map(|s| s / count);
                known[index] = true;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
}
