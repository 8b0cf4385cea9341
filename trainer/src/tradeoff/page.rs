//! `<subject>.html`: the picture and a table that sorts, in one file.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::child::PointStatus;
use super::result::{Measurement, PointResult, digits};
use super::subject::Axis;

const STYLE: &str = "
body{margin:0;background:#fbfaf7;color:#1d2328;font:15px/1.5 system-ui,sans-serif}
main{max-width:1160px;margin:0 auto;padding:28px 20px 60px}h1{font-size:24px;margin:0 0 4px}p{margin:6px 0;max-width:90ch}
.soft{color:#5b666f}svg{max-width:100%;height:auto}table{display:block;overflow-x:auto;border-collapse:collapse;margin:12px 0;font-size:13px;font-variant-numeric:tabular-nums}
th,td{text-align:right;padding:3px 12px 3px 0;border-bottom:1px solid #dcdfe1}th{cursor:pointer;color:#5b666f;vertical-align:bottom}
th:first-child,td:first-child{text-align:left;white-space:nowrap}.sure,.maybe{color:#8a4b12;font-weight:600}.bad{color:#a3262a}
";

/// Sorts by the column whose head is clicked: numbers by value, the rest as text, the other way at the second click.
const SORT: &str = "
document.querySelectorAll('th').forEach((head,column)=>head.addEventListener('click',()=>{
const body=document.querySelector('tbody'),rows=[...body.rows],down=head.dataset.down!=='1';head.dataset.down=down?'1':'0';
const key=row=>row.cells[column].dataset.v??row.cells[column].textContent;
rows.sort((a,b)=>{const x=key(a),y=key(b),n=parseFloat(x)-parseFloat(y);return(isNaN(n)?x.localeCompare(y):n)*(down?1:-1)});
rows.forEach(row=>body.append(row))}));
";

/// The page.
pub(super) fn html(measurement: &Measurement, svg: &str) -> String {
    let beginning = &measurement.beginning;
    let subject = &measurement.subject;
    let columns: Vec<&Axis> = [&subject.cost, &subject.error]
        .into_iter()
        .chain(subject.beside)
        .collect();
    let missing = measurement.missing();
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { "glint tradeoff " (subject.name) }
                style { (PreEscaped(STYLE)) }
            }
            body { main {
                h1 { "What accuracy costs: " (subject.name) ", " (beginning.scene) }
                p { (measurement.sentence()) "." }
                p.soft {
                    (beginning.machine) ". glint " (beginning.version) ", commit " (beginning.commit) "; "
                    (beginning.repetitions) " repetitions in random order, seed " (beginning.seed)
                    "; medians; recording " (short(&beginning.scene_blake3)) "."
                }
                @if !missing.is_empty() { p.bad { "Not yet run: " (missing.join(", ")) "." } }
                @if measurement.rejected_count > 0 {
                    p.bad { (measurement.rejected_count) " runs are left out: their figures are not those of their log." }
                }
                @if let Some(audit) = measurement.audits.last() {
                    p.bad[!audit.disagreements().is_empty()] { (audit.sentence()) "." }
                }
                (PreEscaped(svg))
                table {
                    thead { tr {
                        th { "point" } th { "status" } th { "front" }
                        @for column in &columns { th { (column.label) } }
                        th { "core-seconds of a run" } th { "steal, %" } th { "load" }
                    } }
                    tbody { @for point in &measurement.points { (row(measurement, point, &columns)) } }
                }
                p.soft { "A click on a head sorts. The command of a point is shown where the pointer rests on its name." }
            } script { (PreEscaped(SORT)) } }
        }
    };
    page.into_string()
}

fn row(measurement: &Measurement, point: &PointResult, columns: &[&Axis]) -> Markup {
    let is_ok = point.status == Some(PointStatus::Ok);
    let status = point.status.map_or("not run".to_owned(), |s| s.to_string());
    let command = point.runs.first().map(|run| run.command.join(" "));
    let mean = |of: &dyn Fn(&super::PointRecord) -> f64| {
        let sum: f64 = point.runs.iter().map(of).sum();
        sum / point.runs.len() as f64
    };
    html! {
        tr {
            td title=(command.unwrap_or_default()) { (point.name) }
            td.bad[!is_ok] title=(point.reason()) { (status) }
            td class=(point.front) title=(measurement.no_candidate(point).unwrap_or_default()) {
                @if measurement.no_candidate(point).is_some() { "no candidate" } @else { (point.front) }
            }
            @for column in columns { (cell(point.median(column.key))) }
            (cell(Some(mean(&|run| run.cost.core_s()))))
            (cell(Some(mean(&|run| 100.0 * run.cost.steal_fraction))))
            (cell(Some(mean(&|run| run.cost.load_average))))
        }
    }
}

/// A number; what is missing sorts as the worst.
fn cell(value: Option<f64>) -> Markup {
    let value = value.filter(|value| value.is_finite());
    html! {
        @match value {
            Some(value) => td data-v=(value) { (digits(value)) },
            None => td data-v="1e308" { "" },
        }
    }
}

fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}
