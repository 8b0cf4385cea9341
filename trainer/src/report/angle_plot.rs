//! LPIPS against the angle to the nearest training view, as a picture.

use std::fmt::Write as _;

use super::views::METHOD_NAMES;
use crate::eval::views::{AngleBin, AngleMetrics, CompositionMetrics, FrameError};

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;
/// Medians of the methods stand beside each other.
const SIDE_STEP: f64 = 7.0;
/// Colours of the methods.
const COLORS: [&str; 3] = ["#8a4b12", "#5b666f", "#1f6f8b"];

/// From angles and distances to pixels.
struct Axes {
    most_deg: f64,
    most_lpips: f64,
}

impl Axes {
    /// Axes from zero to just beyond all values.
    fn of(frames: &[FrameError], angles: &AngleMetrics) -> Self {
        let values = frames
            .iter()
            .flat_map(|f| [f.lpips, f.lpips_diffuse, f.lpips_nearest])
            .flatten();
        let medians = angles
            .methods
            .iter()
            .flat_map(|m| &m.bins)
            .map(|b| b.median);
        let most = values.chain(medians).fold(0.0, f64::max);
        let most_deg = frames.iter().map(|f| f.angle_deg).fold(0.0, f64::max);
        Self {
            most_deg: f64::max(1.05 * most_deg, 1.0),
            most_lpips: f64::max(1.1 * most, 0.01),
        }
    }

    fn x(&self, angle_deg: f64) -> f64 {
        LEFT + angle_deg / self.most_deg * (WIDTH - LEFT - RIGHT)
    }

    /// Values beyond the axis end at its edge.
    fn y(&self, lpips: f64) -> f64 {
        let share = (lpips / self.most_lpips).clamp(0.0, 1.0);
        HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)
    }
}

/// About five round values from 0 to `most`.
fn ticks(most: f64) -> Vec<f64> {
    let rough = most / 5.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * power)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(rough);
    (0..10)
        .map(|k| f64::from(k) * step)
        .filter(|v| *v <= most)
        .collect()
}

/// The picture, to stand in the page.
pub(super) fn svg(composition: &CompositionMetrics, angles: &AngleMetrics) -> String {
    let axes = Axes::of(&composition.frames, angles);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" role=\"img\" aria-label=\"LPIPS against angle\" font-size=\"12\" fill=\"#5b666f\">"
    );
    grid(&mut svg, &axes);
    for frame in &composition.frames {
        let values = [frame.lpips, frame.lpips_diffuse, frame.lpips_nearest];
        for (value, color) in values.into_iter().zip(COLORS) {
            if let Some(value) = value {
                let (x, y) = (axes.x(frame.angle_deg), axes.y(value));
                let _ = write!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2\" fill=\"{color}\" fill-opacity=\"0.45\"/>"
                );
            }
        }
    }
    for (k, method) in angles.methods.iter().enumerate().take(COLORS.len()) {
        for bin in &method.bins {
            median(&mut svg, &axes, composition, bin, k);
        }
    }
    for (k, name) in METHOD_NAMES.iter().enumerate() {
        let x = LEFT + 190.0 * k as f64;
        let _ = write!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"16\" r=\"5\" fill=\"{}\"/><text x=\"{:.1}\" y=\"20\">{name}</text>",
            x + 5.0,
            COLORS[k],
            x + 16.0
        );
    }
    svg.push_str("</svg>");
    svg
}

fn grid(svg: &mut String, axes: &Axes) {
    let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
    for tick in ticks(axes.most_deg) {
        let x = axes.x(tick);
        let _ = write!(
            svg,
            "<path stroke=\"#e4e6e8\" d=\"M{x:.1} {TOP}V{bottom}\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{tick}</text>",
            bottom + 16.0
        );
    }
    for tick in ticks(axes.most_lpips) {
        let y = axes.y(tick);
        let label = (tick * 1e4).round() / 1e4;
        let _ = write!(
            svg,
            "<path stroke=\"#e4e6e8\" d=\"M{LEFT} {y:.1}H{right}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            LEFT - 8.0,
            y + 4.0
        );
    }
    let middle = f64::midpoint(TOP, bottom);
    let _ = write!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">angle to the nearest training view, degrees</text><text transform=\"translate(14 {middle}) rotate(-90)\" text-anchor=\"middle\">LPIPS</text>",
        f64::midpoint(LEFT, right),
        HEIGHT - 8.0
    );
}

/// A bin's median at the mean angle of its frames, with its interval.
fn median(
    svg: &mut String,
    axes: &Axes,
    composition: &CompositionMetrics,
    bin: &AngleBin,
    method: usize,
) {
    let inside = |f: &&FrameError| {
        f.lpips.is_some()
            && f.angle_deg >= bin.from_deg
            && bin.to_deg.is_none_or(|end| f.angle_deg < end)
    };
    let frames = composition.frames.iter().filter(inside);
    let (sum, count) = frames.fold((0.0, 0.0), |(sum, count), f| {
        (sum + f.angle_deg, count + 1.0)
    });
    let x = axes.x(sum / f64::max(count, 1.0)) + SIDE_STEP * (method as f64 - 1.0);
    let (y, color) = (axes.y(bin.median), COLORS[method]);
    if let Some([low, high]) = bin.interval {
        let (low, high) = (axes.y(low), axes.y(high));
        let _ = write!(
            svg,
            "<path stroke=\"{color}\" stroke-width=\"1.5\" d=\"M{x:.1} {low:.1}V{high:.1}\"/>"
        );
    }
    let fill = if bin.is_hollow { "#fbfaf7" } else { color };
    let _ = write!(
        svg,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"1.5\"/>"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_values_stay_on_the_picture() {
        assert_eq!(ticks(24.0), [0.0, 5.0, 10.0, 15.0, 20.0]);
        assert_eq!(ticks(1.0), [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]);
        let axes = Axes {
            most_deg: 10.0,
            most_lpips: 0.2,
        };
        assert_eq!((axes.x(0.0), axes.x(10.0)), (LEFT, WIDTH - RIGHT));
        assert_eq!((axes.y(0.0), axes.y(0.2)), (HEIGHT - BOTTOM, TOP));
        assert_eq!((axes.y(-1.0), axes.y(9.0)), (HEIGHT - BOTTOM, TOP));
    }
}
