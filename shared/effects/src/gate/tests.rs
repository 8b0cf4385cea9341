use super::*;
use crate::random::Normal;

const SIZE: usize = 64;
const VIEWS: usize = 40;

/// Linear luminance of a printed texture at a point, pixels: waves, stripes or blots.
fn texture(kind: usize, x: f64, y: f64) -> f64 {
    match kind {
        0 => 0.3 + 0.15 * (0.35 * x).sin() * (0.27 * y).cos(),
        // Print: edges a pixel wide, on half of the surface.
        1 => {
            let edge = ((0.4 * x + 0.1 * y).sin() * 6.0).clamp(-1.0, 1.0);
            if y < 32.0 { 0.35 + 0.2 * edge } else { 0.35 }
        }
        _ => {
            let blot = (-((x % 16.0 - 8.0).powi(2) + (y % 16.0 - 8.0).powi(2)) / 18.0).exp();
            0.2 + 0.2 * blot
        }
    }
}

/// How the surface reflects.
#[derive(Clone, Copy)]
enum Gloss {
    Matte,
    /// Three percent of the samples are highlights of 0.2.
    Highlights,
    /// A smooth lobe of amplitude 0.02 that moves with the view.
    Broad,
}

struct Case {
    gate: Gate,
    /// ⟨|G − D_med|⟩ in codes.
    spread: f64,
    /// ⟨‖∇D‖⟩·δ in codes.
    faked: f64,
    sigma: f64,
}

fn view(
    kind: usize,
    sigma: f64,
    shift: f64,
    gloss: Gloss,
    number: usize,
    normal: &mut Normal,
) -> Vec<f64> {
    let turn = 2.4 * number as f64;
    let (dx, dy) = (shift * turn.cos(), shift * turn.sin());
    (0..SIZE * SIZE)
        .map(|i| {
            let (x, y) = ((i % SIZE) as f64, (i / SIZE) as f64);
            let light = match gloss {
                Gloss::Matte => 0.0,
                Gloss::Highlights => {
                    // Bands of light that sweep over the surface: each sample is inside in 3 % of the views.
                    let place =
                        (x / SIZE as f64 + 0.31 * y / SIZE as f64 + number as f64 / VIEWS as f64)
                            .fract();
                    if place < 0.03 { 0.2 } else { 0.0 }
                }
                Gloss::Broad => {
                    let phase = x / SIZE as f64 + number as f64 / VIEWS as f64;
                    0.01 + 0.01 * (std::f64::consts::TAU * phase).sin()
                }
            };
            texture(kind, x + dx, y + dy) + light + sigma * normal.next()
        })
        .collect()
}

fn measure(kind: usize, sigma_codes: f64, shift: f64, gloss: Gloss) -> Case {
    let sigma = sigma_codes / CODES;
    let mut normal = Normal::new(kind as u64 + 17);
    let views: Vec<Vec<f64>> = (0..VIEWS)
        .map(|number| view(kind, sigma, shift, gloss, number, &mut normal))
        .collect();
    let median: Vec<f64> = (0..SIZE * SIZE)
        .map(|i| {
            let mut values: Vec<f64> = views.iter().map(|view| view[i]).collect();
            values.sort_by(f64::total_cmp);
            0.5 * (values[VIEWS / 2 - 1] + values[VIEWS / 2])
        })
        .collect();
    let gradient: Vec<f32> = (0..SIZE * SIZE)
        .map(|i| {
            let right = if i % SIZE + 1 < SIZE { i + 1 } else { i };
            let below = if i / SIZE + 1 < SIZE { i + SIZE } else { i };
            (median[right] - median[i]).hypot(median[below] - median[i]) as f32
        })
        .collect();
    let mut dependence = ViewDependence::default();
    let mut spread = 0.0;
    for view in &views {
        let residual: Vec<f32> = view
            .iter()
            .zip(&median)
            .map(|(g, d)| (g - d) as f32)
            .collect();
        spread += residual.iter().map(|&r| f64::from(r.abs())).sum::<f64>();
        dependence.add(&ViewResidual {
            width: SIZE,
            residual: &residual,
            gradient: &gradient,
        });
    }
    let mean_gradient = gradient.iter().map(|&g| f64::from(g)).sum::<f64>() / gradient.len() as f64;
    Case {
        gate: dependence.gate(sigma, shift),
        spread: CODES * spread / (VIEWS * SIZE * SIZE) as f64,
        faked: CODES * mean_gradient * shift,
        sigma: sigma_codes,
    }
}

#[test]
fn matte_surfaces_stay_shut_and_shiny_ones_open() {
    for kind in 0..3 {
        for sigma in [1.0, 2.5] {
            for shift in [0.0, 0.5] {
                let matte = measure(kind, sigma, shift, Gloss::Matte).gate;
                assert!(!matte.is_specular(), "{kind} {sigma} {shift}: {matte:?}");
                // A broad lobe hides behind a gradient everywhere that is half a pixel off.
                let broad_shift = shift.min(0.25);
                for (gloss, shift) in [(Gloss::Highlights, shift), (Gloss::Broad, broad_shift)] {
                    let shiny = measure(kind, sigma, shift, gloss).gate;
                    assert!(shiny.is_specular(), "{kind} {sigma} {shift}: {shiny:?}");
                }
            }
        }
    }
}

#[test]
fn highlights_show_in_the_skew_and_broad_lobes_in_the_tiles() {
    let highlights = measure(0, 1.0, 0.0, Gloss::Highlights).gate;
    assert!(
        (1.0..1.8).contains(&highlights.eskew_codes),
        "{highlights:?}"
    );
    let broad = measure(0, 1.0, 0.0, Gloss::Broad).gate;
    assert!(broad.eskew_codes < 0.5, "{broad:?}");
    assert!((0.7..2.0).contains(&broad.etile_codes), "{broad:?}");
}

#[test]
fn the_obvious_test_is_wrong_on_both_sides() {
    // The bite: mean |G − D_med| beyond noise, with and without the allowance for misregistration.
    let naive = |case: &Case, allowance: f64| {
        case.spread - L1_OF_SIGMA * case.sigma - allowance > MATTE_SKEW.max(MATTE_TILE)
    };
    let shiny = measure(0, 1.0, 0.5, Gloss::Highlights);
    assert!(
        !naive(&shiny, shiny.faked),
        "{} {}",
        shiny.spread,
        shiny.faked
    );
    assert!(shiny.gate.is_specular());
    let matte = measure(1, 1.0, 0.5, Gloss::Matte);
    assert!(naive(&matte, 0.0), "{}", matte.spread);
    assert!(!matte.gate.is_specular(), "{:?}", matte.gate);
}

#[test]
fn nothing_seen_is_matte_and_nonsense_is_not() {
    let nothing = ViewDependence::default().gate(0.01, 0.5);
    assert!(!nothing.is_specular());
    let nonsense = Gate {
        eskew_codes: f64::NAN,
        etile_codes: 0.0,
    };
    assert!(nonsense.is_specular());
}
