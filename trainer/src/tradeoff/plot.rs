//! `<subject>.svg`: every point, the front as steps, failures at the top edge.

use std::fmt::Write as _;

use super::child::PointStatus;
use super::front::OnFront;
use super::result::{Measurement, PointResult, digits};
use super::subject::DEFAULT_POINT;

const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 660.0;
const LEFT: f64 = 90.0;
const RIGHT: f64 = 170.0;
const TOP: f64 = 84.0;
const BOTTOM: f64 = 120.0;
/// Errors that span less than this factor are drawn on a linear axis.
const LEAST_LOG_SPAN: f64 = 5.0;

const STYLE: &str = "text{font:12px system-ui,sans-serif;fill:#1d2328}.soft{fill:#5b666f}.grid{stroke:#e4e6e8}.front{fill:none;stroke:#8a4b12;stroke-width:1.5}.run{fill:#b9c0c6}.on{fill:#8a4b12}.off{fill:#5b666f}.hollow{fill:#fbfaf7;stroke:#5b666f;stroke-width:1.5}.cross{stroke:#a3262a;stroke-width:2}.ring{fill:none;stroke:#8a4b12;stroke-width:1.5}.title{font-size:17px;font-weight:600}";

/// One axis from values to pixels.
struct Scale {
    low: f64,
    high: f64,
    is_log: bool,
    from: f64,
    to: f64,
}

impl Scale {
    /// A scale over `values`, which are finite, with room at both ends.
    fn of(values: &[f64], wants_log: bool, from: f64, to: f64) -> Self {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (low, high) = if low <= high {
            (low, high)
        } else {
            (1.0, 10.0)
        };
        let is_log = low > 0.0 && wants_log;
        let (low, high) = if is_log {
            (low / 1.25, high * 1.25)
        } else {
            let room = 0.08 * (high - low).max(1e-3 * high.abs()).max(1e-12);
            (low - room, high + room)
        };
        Self {
            low,
            high,
            is_log,
            from,
            to,
        }
    }

    fn at(&self, value: f64) -> f64 {
        let share = if self.is_log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.from + share * (self.to - self.from)
    }

    /// Round values within the scale: 1, 2, 5 of each decade where that gives three, else equal steps.
    fn ticks(&self) -> Vec<f64> {
        let decade = |value: f64| value.log10().floor() as i32;
        if self.is_log {
            let decades = decade(self.low)..=decade(self.high);
            let values = decades.flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * 10_f64.powi(d)));
            let ticks: Vec<f64> = values
                .filter(|v| *v >= self.low && *v <= self.high)
                .collect();
            if ticks.len() >= 3 {
                return ticks;
            }
        }
        let rough = (self.high - self.low) / 6.0;
        let power = 10_f64.powi(decade(rough));
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|m| m * power)
            .into_iter()
            .find(|step| *step >= rough)
            .unwrap_or(rough);
        let first = (self.low / step).ceil();
        (0..8)
            .map(|k| (first + f64::from(k)) * step)
            .filter(|v| *v <= self.high)
            .collect()
    }
}

/// A point with its place among the pixels.
struct Drawn<'a> {
    point: &'a PointResult,
    x: f64,
    y: f64,
    cost: f64,
    error: f64,
}

/// The picture, self-contained.
pub(super) fn svg(measurement: &Measurement) -> String {
    let subject = &measurement.subject;
    let (costs, errors) = run_values(measurement);
    let x = Scale::of(&costs, true, LEFT, WIDTH - RIGHT);
    let span = errors.iter().copied().fold(0.0, f64::max)
        / errors.iter().copied().fold(f64::INFINITY, f64::min);
    let y = Scale::of(&errors, span > LEAST_LOG_SPAN, HEIGHT - BOTTOM, TOP);
    let mut drawn: Vec<Drawn<'_>> = measurement
        .points
        .iter()
        .filter_map(|point| {
            let (cost, error) = measurement.place(point)?;
            Some(Drawn {
                point,
                x: x.at(cost),
                y: y.at(error),
                cost,
                error,
            })
        })
        .collect();
    drawn.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\"><style>{STYLE}</style><rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fbfaf7\"/>"
    );
    let title = format!("{}: {}", subject.name, measurement.beginning.scene);
    text(&mut svg, LEFT, 28.0, "title", &title);
    for (line, words) in measurement.sentence().split("; ").enumerate() {
        text(&mut svg, LEFT, 46.0 + 16.0 * line as f64, "soft", words);
    }
    axes(&mut svg, &x, &y, measurement);
    front_line(&mut svg, &drawn);
    for point in &measurement.points {
        for run in point.runs.iter().filter(|r| r.status == PointStatus::Ok) {
            let value = |key: &str| run.figures.metrics.get(key).copied();
            if let (Some(cost), Some(error)) = (value(subject.cost.key), value(subject.error.key)) {
                let (cx, cy) = (x.at(cost), y.at(error));
                let _ = write!(
                    svg,
                    "<circle class=\"run\" cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"2\"/>"
                );
            }
        }
    }
    markers(&mut svg, measurement, &drawn);
    failures(&mut svg, measurement);
    svg.push_str("</svg>\n");
    svg
}

/// Costs and errors of all runs that ended well.
fn run_values(measurement: &Measurement) -> (Vec<f64>, Vec<f64>) {
    let runs = measurement.points.iter().flat_map(|point| &point.runs);
    let runs: Vec<_> = runs.filter(|run| run.status == PointStatus::Ok).collect();
    let values = |key: &str| -> Vec<f64> {
        let found = runs.iter().filter_map(|run| run.figures.metrics.get(key));
        found.copied().filter(|value| value.is_finite()).collect()
    };
    (
        values(measurement.subject.cost.key),
        values(measurement.subject.error.key),
    )
}

fn axes(svg: &mut String, x: &Scale, y: &Scale, measurement: &Measurement) {
    let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
    for tick in x.ticks() {
        let at = x.at(tick);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/><text class=\"soft\" x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            bottom + 18.0,
            short(tick)
        );
    }
    for tick in y.ticks() {
        let at = y.at(tick);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 8.0,
            at + 4.0,
            short(tick)
        );
    }
    let subject = &measurement.subject;
    text(svg, LEFT, bottom + 40.0, "", subject.cost.label);
    let label = escaped(subject.error.label);
    let middle = f64::midpoint(TOP, bottom);
    let _ = write!(
        svg,
        "<text transform=\"translate(20 {middle}) rotate(-90)\" text-anchor=\"middle\">{label}</text>"
    );
    let machine = measurement.beginning.machine.to_string();
    text(svg, LEFT, bottom + 62.0, "soft", &machine);
    let run = format!(
        "{} repetitions, seed {}; dots: runs; large: medians; brown: on the front, ring: the default; crosses at the top: failed; hollow: no candidate",
        measurement.beginning.repetitions, measurement.beginning.seed
    );
    text(svg, LEFT, bottom + 80.0, "soft", &run);
    let missing = measurement.missing();
    if !missing.is_empty() {
        let missing = format!("not yet run: {}", missing.join(", "));
        text(svg, LEFT, bottom + 98.0, "soft", &missing);
    }
}

/// The steps of the points that are not off the front.
fn front_line(svg: &mut String, drawn: &[Drawn<'_>]) {
    let mut path = String::new();
    let mut least = f64::INFINITY;
    for place in drawn.iter().filter(|d| d.point.front != OnFront::No) {
        // What may be on the front but is beaten by the medians does not lead the steps.
        if place.error >= least {
            continue;
        }
        least = place.error;
        if path.is_empty() {
            let _ = write!(path, "M{:.1} {:.1}", place.x, place.y);
        } else {
            let _ = write!(path, "H{:.1}V{:.1}", place.x, place.y);
        }
    }
    if !path.is_empty() {
        let _ = write!(svg, "<path class=\"front\" d=\"{path}\"/>");
    }
}

fn markers(svg: &mut String, measurement: &Measurement, drawn: &[Drawn<'_>]) {
    let mut taken: Vec<Area> = drawn.iter().map(|place| Area::of_marker(place)).collect();
    for place in drawn {
        let point = place.point;
        let tracked = measurement
            .subject
            .tracked
            .and_then(|key| point.median(key));
        let label = match tracked {
            Some(fraction) => format!("{} ({:.0} %)", point.name, 100.0 * fraction),
            None => point.name.clone(),
        };
        let x = place.x + 14.0;
        let y = free_height(&taken, x, place.y + 4.0, &label);
        taken.push(Area::of_label(x, y, &label));
        if (y - place.y - 4.0).abs() > 1.0 {
            let (x, y) = (x - 3.0, y - 4.0);
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{:.1} {:.1}L{x:.1} {y:.1}\"/>",
                place.x, place.y
            );
        }
        text(svg, x, y, "", &label);
    }
    for place in drawn {
        marker(svg, measurement, place);
    }
}

fn marker(svg: &mut String, measurement: &Measurement, place: &Drawn<'_>) {
    let point = place.point;
    let reason = measurement.no_candidate(point);
    let class = match (reason, point.front) {
        (Some(_), _) => "hollow",
        (None, OnFront::No) => "off",
        (None, OnFront::Sure | OnFront::Maybe) => "on",
    };
    let (cx, cy) = (place.x, place.y);
    let title = format!(
        "{}: {} {}, {} {}, on the front: {}{}",
        point.name,
        digits(place.cost),
        measurement.subject.cost.label,
        digits(place.error),
        measurement.subject.error.label,
        point.front,
        reason.map_or_else(String::new, |reason| format!(" ({reason})"))
    );
    let title = escaped(&title);
    let _ = write!(
        svg,
        "<circle class=\"{class}\" cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"5\"><title>{title}</title></circle>"
    );
    if point.name == DEFAULT_POINT {
        let _ = write!(
            svg,
            "<circle class=\"ring\" cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"9\"/>"
        );
    }
}

/// A rectangle of the picture that is taken.
struct Area {
    x: [f64; 2],
    y: [f64; 2],
}

impl Area {
    fn of_marker(place: &Drawn<'_>) -> Self {
        Self {
            x: [place.x - 6.0, place.x + 6.0],
            y: [place.y - 6.0, place.y + 6.0],
        }
    }

    /// The font's letters are about 6.5 pixels wide.
    fn of_label(x: f64, y: f64, label: &str) -> Self {
        Self {
            x: [x, x + 6.5 * label.chars().count() as f64],
            y: [y - 10.0, y + 3.0],
        }
    }

    fn meets(&self, other: &Self) -> bool {
        let meets = |a: [f64; 2], b: [f64; 2]| a[0] < b[1] && b[0] < a[1];
        meets(self.x, other.x) && meets(self.y, other.y)
    }
}

/// The height nearest to `wanted` at which a label lies on nothing.
fn free_height(taken: &[Area], x: f64, wanted: f64, label: &str) -> f64 {
    (0..120_u32)
        .map(|k| {
            let step = f64::from(k.div_ceil(2)) * 4.0;
            wanted + if k % 2 == 0 { step } else { -step }
        })
        .find(|y| {
            let area = Area::of_label(x, *y, label);
            !taken.iter().any(|other| other.meets(&area))
        })
        .unwrap_or(wanted)
}

/// Points that did not end well, side by side at the top edge.
fn failures(svg: &mut String, measurement: &Measurement) {
    let failed = measurement.points.iter().filter_map(|point| {
        let status = point.status.filter(|status| *status != PointStatus::Ok)?;
        Some((point, status))
    });
    for (index, (point, status)) in failed.enumerate() {
        let x = LEFT + 20.0 + 150.0 * (index % 5) as f64;
        let y = TOP + 16.0 * (index / 5) as f64;
        let _ = write!(
            svg,
            "<path class=\"cross\" d=\"M{:.1} {:.1}l8 8m0 -8l-8 8\"><title>{}</title></path>",
            x - 4.0,
            y - 4.0,
            escaped(point.reason())
        );
        text(
            svg,
            x + 10.0,
            y + 4.0,
            "",
            &format!("{}: {status}", point.name),
        );
    }
}

fn text(svg: &mut String, x: f64, y: f64, class: &str, words: &str) {
    let words = escaped(words);
    let _ = write!(
        svg,
        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{words}</text>"
    );
}

fn escaped(words: &str) -> String {
    words
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A tick in few characters.
fn short(value: f64) -> String {
    if value.abs() >= 1e4 {
        format!("{:.0}k", value / 1e3)
    } else {
        let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
        rounded.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_keep_values_inside_and_ticks_are_round() {
        let log = Scale::of(&[1.3, 80.0], true, 0.0, 100.0);
        assert_eq!(log.ticks(), [2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert!(log.at(1.3) > 0.0 && log.at(80.0) < 100.0);
        let linear = Scale::of(&[0.21, 0.29], false, 100.0, 0.0);
        assert!(linear.ticks().len() >= 4 && linear.at(0.29) < linear.at(0.21));
        // Nothing, one value, and zero on a logarithm still make a scale.
        for values in [&[][..], &[3.0], &[0.0, 1.0]] {
            let scale = Scale::of(values, true, 0.0, 1.0);
            assert!(scale.low < scale.high && !scale.ticks().is_empty());
        }
    }

    #[test]
    fn labels_make_way_for_each_other() {
        let taken = [
            Area::of_label(100.0, 50.0, "first"),
            Area::of_label(110.0, 64.0, "second"),
        ];
        let y = free_height(&taken, 105.0, 52.0, "third");
        let area = Area::of_label(105.0, y, "third");
        assert!(!taken.iter().any(|other| other.meets(&area)));
        assert_eq!(free_height(&taken, 400.0, 52.0, "far"), 52.0);
    }
}
