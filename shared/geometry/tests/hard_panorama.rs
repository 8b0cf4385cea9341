//! Hard cases F01 to F05 and F09: the seam, the poles and the convention of the panorama.
//!
//! F06 (the Jacobian of the mapping) has no code to test: nothing differentiates texels by directions.

mod rows;
mod sampling;

use geometry::{DVec2, DVec3, PanoramaSize, direction::angle_between, direction::reflect};
use rows::{bites, holds, worse};
use sampling::{generator, uniform, unit_vector};
use std::f64::consts::{PI, TAU};

/// The size of the paper's map: 0.72° a texel.
fn map_size() -> PanoramaSize {
    PanoramaSize::from_height(250).expect("a size")
}

/// A direction by longitude and latitude.
fn from_angles(lon: f64, lat: f64) -> DVec3 {
    DVec3::new(lat.cos() * lon.sin(), -lat.sin(), lat.cos() * lon.cos())
}

#[test]
fn hc_f01_the_seam_is_inside() {
    let size = map_size();
    let naive_column = |lon: f32| ((lon / std::f32::consts::TAU + 0.5) * 500.0) as usize;
    bites("f01", naive_column(0.0_f32.atan2(-1.0)) as f64, 499.0);
    let below = f32::from_bits(std::f32::consts::PI.to_bits() - 1);
    bites("f01 one ulp below", naive_column(below) as f64, 499.0);
    let fract = |v: f32| v - v.floor();
    bites("f01 fract", f64::from(fract(-1e-9)), 1.0 - 1e-9);

    let mut rng = generator(301);
    let pi_above = f64::from_bits(PI.to_bits() + 1);
    let pi_below = f64::from_bits(PI.to_bits() - 1);
    let listed = [PI, -PI, pi_below, -pi_below, pi_above, -pi_above, 0.0, -0.0];
    let random: Vec<f64> = (0..2000)
        .map(|_| PI + uniform(&mut rng, -1.0, 1.0) * 10.0_f64.powf(uniform(&mut rng, -17.0, 0.0)))
        .collect();
    let mut outside = 0.0;
    for lon in listed.into_iter().chain(random) {
        for direction in [
            from_angles(lon, 0.0),
            from_angles(-lon, 0.3),
            from_angles(lon, 0.0).as_vec3().as_dvec3(),
        ] {
            let texel = size.texel_from_direction(direction);
            let inside = (-0.5..499.5).contains(&texel.x) && (-0.5..=249.5).contains(&texel.y);
            outside += f64::from(u8::from(
                !inside || size.index_from_direction(direction) >= 125_000,
            ));
            outside += f64::from(u8::from(
                size.taps(direction).texels.iter().any(|&t| t >= 125_000),
            ));
        }
    }
    for z in [-1.0, -0.0, 0.0] {
        for x in [0.0, -0.0] {
            outside += f64::from(u8::from(
                size.index_from_direction(DVec3::new(x, 0.0, z)) >= 125_000,
            ));
        }
    }
    holds("f01 outside", outside, 0.0);
    let row = 125 * 500;
    let (plus, minus) = (DVec3::new(0.0, 0.0, -1.0), DVec3::new(-0.0, 0.0, -1.0));
    assert_eq!(size.index_from_direction(plus), row, "+pi is column 0");
    assert_eq!(size.index_from_direction(minus), row, "-pi is column 0");
    assert_eq!(
        size.index_from_direction(DVec3::new(1e-9, 0.0, -1.0)),
        row + 499
    );
    assert_eq!(size.index_from_direction(DVec3::new(-1e-9, 0.0, -1.0)), row);
    // φ and φ + 2π are one texel; half a texel of margin keeps rounding out of the claim.
    for _ in 0..2000 {
        let column = uniform(&mut rng, 0.0, 500.0).floor();
        let (lon, lat) = (
            TAU * (column + 0.5) / 500.0 - PI,
            uniform(&mut rng, -1.5, 1.5),
        );
        let turned = size.index_from_direction(from_angles(lon + TAU, lat));
        assert_eq!(size.index_from_direction(from_angles(lon, lat)), turned);
        assert_eq!(turned % 500, column as usize);
    }
}

#[test]
fn hc_f02_components_beyond_one() {
    let size = map_size();
    let mut rng = generator(302);
    let (mut naive_nan_count, mut nan_count) = (0.0, 0.0);
    let (mut naive_worst, mut worst) = (0.0, 0.0);
    for _ in 0..1_000_000 {
        let outgoing = unit_vector(&mut rng);
        let Some(normal) = (outgoing + DVec3::NEG_Y).try_normalize() else {
            continue;
        };
        let (outgoing, normal) = (outgoing.as_vec3(), normal.as_vec3());
        let unnormalised = normal * (2.0 * normal.dot(outgoing)) - outgoing;
        let naive_colatitude = (-unnormalised.y).acos();
        if naive_colatitude.is_nan() {
            naive_nan_count += 1.0;
        } else {
            let truth = angle_between(unnormalised.as_dvec3(), DVec3::NEG_Y);
            naive_worst = worse(naive_worst, (f64::from(naive_colatitude) - truth).abs());
        }
        let reflected = reflect(outgoing, normal).as_dvec3();
        let texel = size.texel_from_direction(reflected);
        nan_count += f64::from(u8::from(!texel.is_finite()));
        let colatitude = (texel.y + 0.5) / 250.0 * PI;
        worst = worse(
            worst,
            (colatitude - angle_between(reflected, DVec3::NEG_Y)).abs(),
        );
    }
    bites("f02 NaN", naive_nan_count, 0.0);
    bites("f02 acos", naive_worst, 1e-6);
    holds("f02 NaN", nan_count, 0.0);
    holds("f02", worst, 1e-6);
    // Near a pole the sine is flat: asin resolves 1e-8 rad even in f64, the colatitude is exact.
    let mut worst_near = 0.0;
    let mut asin_worst = 0.0;
    for _ in 0..2000 {
        let colatitude = 10.0_f64.powf(uniform(&mut rng, -9.0, -3.0));
        let direction = from_angles(uniform(&mut rng, -PI, PI), PI / 2.0).with_y(-colatitude.cos())
            + from_angles(uniform(&mut rng, -PI, PI), 0.0) * colatitude.sin();
        let asin = PI / 2.0 - (-direction.y / direction.length()).asin();
        asin_worst = worse(asin_worst, (asin / colatitude - 1.0).abs());
        let found = (size.texel_from_direction(direction).y + 0.5) / 250.0 * PI;
        worst_near = worse(worst_near, (found / colatitude - 1.0).abs());
    }
    bites("f02 asin near a pole", asin_worst, 1e-3);
    holds("f02 near a pole", worst_near, 1e-3);
    assert!(
        size.taps(DVec3::NAN).weights.iter().all(|w| w.is_nan()),
        "no direction, no value"
    );
}

/// The value of a map at a direction, by the shipped taps.
fn look_up(size: PanoramaSize, map: &[f32], direction: DVec3) -> f64 {
    let taps = size.taps(direction);
    taps.texels
        .iter()
        .zip(taps.weights)
        .map(|(&t, w)| f64::from(map[t as usize]) * f64::from(w))
        .sum()
}

/// The value where rows and columns clamp at the edges of the image.
fn naive_look_up(size: PanoramaSize, map: &[f32], direction: DVec3) -> f64 {
    let texel = size.texel_from_direction(direction);
    let (width, height) = (f64::from(size.width()), f64::from(size.height()));
    let (x0, y0) = (texel.x.floor(), texel.y.floor());
    let (fx, fy) = (texel.x - x0, texel.y - y0);
    let at = |x: f64, y: f64| {
        f64::from(map[(y.clamp(0.0, height - 1.0) * width + x.clamp(0.0, width - 1.0)) as usize])
    };
    (at(x0, y0) * (1.0 - fx) + at(x0 + 1.0, y0) * fx) * (1.0 - fy)
        + (at(x0, y0 + 1.0) * (1.0 - fx) + at(x0 + 1.0, y0 + 1.0) * fx) * fy
}

/// A map of the values of `value` at the centres of the texels.
fn paint(size: PanoramaSize, value: impl Fn(DVec3) -> f64) -> Vec<f32> {
    let width = size.width();
    (0..size.height())
        .flat_map(|row| (0..width).map(move |column| DVec2::new(f64::from(column), f64::from(row))))
        .map(|texel| value(size.direction_from_texel(texel)) as f32)
        .collect()
}

/// A smooth map: spherical harmonics up to the second order.
fn smooth(d: DVec3) -> f64 {
    0.5 + 0.3 * d.x + 0.2 * d.y - 0.1 * d.z + 0.15 * d.x * d.z + 0.1 * (d.x * d.x - d.z * d.z)
}

#[test]
fn hc_f03_continuous_at_the_poles() {
    let size = map_size();
    let map = paint(size, smooth);
    // The map moves by 4e-5 over 1e-4 rad; its second harmonic differs by 2e-5 across row 0.
    let tolerance = 1e-4;
    let spread = |value: &dyn Fn(DVec3) -> f64, pole: DVec3, azimuths: u32| {
        let at_pole = value(pole);
        (0..azimuths)
            .map(|k| {
                let azimuth = TAU * f64::from(k) / f64::from(azimuths);
                (value(pole + DVec3::new(azimuth.sin(), 0.0, azimuth.cos()) * 1e-4) - at_pole).abs()
            })
            .fold(0.0, worse)
    };
    for pole in [DVec3::Y, DVec3::NEG_Y] {
        bites(
            "f03 clamped",
            spread(&|d| naive_look_up(size, &map, d), pole, 360),
            tolerance,
        );
        holds(
            "f03",
            spread(&|d| look_up(size, &map, d), pole, 3600),
            tolerance,
        );
        for zero in [
            DVec3::new(-0.0, 0.0, 0.0),
            DVec3::new(0.0, 0.0, -0.0),
            DVec3::new(-0.0, 0.0, -0.0),
        ] {
            holds(
                "f03 signed zero",
                (look_up(size, &map, pole + zero) - smooth(pole)).abs(),
                tolerance,
            );
        }
    }
}

#[test]
fn hc_f03_a_constant_map_is_constant_everywhere() {
    // Four f32 weights, each rounded to 6e-8.
    let tolerance = 2.5e-7;
    let mut rng = generator(303);
    // Without the tap beyond the pole, as where a row outside contributes nothing.
    let black_outside = |size: PanoramaSize, direction: DVec3| {
        let y = size.texel_from_direction(direction).y;
        let fy = y - y.floor();
        let inside = |row: f64| f64::from(u8::from(row >= 0.0 && row < f64::from(size.height())));
        inside(y.floor()) * (1.0 - fy) + inside(y.floor() + 1.0) * fy
    };
    bites(
        "f03 black outside",
        (black_outside(map_size(), DVec3::Y) - 1.0).abs(),
        tolerance,
    );

    let mut worst = 0.0;
    for height in [1, 2, 3, 250] {
        let size = PanoramaSize::from_height(height).expect("a size");
        let map = vec![1.0_f32; size.texel_count()];
        let axes = [DVec3::X, DVec3::Y, DVec3::Z]
            .into_iter()
            .flat_map(|a| [a, -a]);
        let random: Vec<DVec3> = (0..20_000).map(|_| unit_vector(&mut rng)).collect();
        let near: Vec<DVec3> = (0..2000)
            .map(|_| {
                DVec3::NEG_Y + unit_vector(&mut rng) * 10.0_f64.powf(uniform(&mut rng, -18.0, -1.0))
            })
            .collect();
        for direction in axes.chain(random).chain(near) {
            let taps = size.taps(direction);
            assert!(
                taps.weights.iter().all(|w| (0.0..=1.0).contains(w)),
                "weights are shares"
            );
            worst = worse(worst, (look_up(size, &map, direction) - 1.0).abs());
        }
    }
    holds("f03 constant", worst, tolerance);
}

#[test]
fn hc_f04_one_texel_of_rotation() {
    let size = map_size();
    let mut rng = generator(304);
    let tolerance = 1e-6;
    // Values with no smoothness at all; f64 sums of f32 taps.
    let map: Vec<f32> = (0..size.texel_count())
        .map(|_| uniform(&mut rng, 0.0, 1.0) as f32)
        .collect();
    let (width, height) = (size.width() as usize, size.height() as usize);
    // The content moves to the right by one column, that is to a longitude one texel larger.
    let rotated: Vec<f32> = (0..height)
        .flat_map(|row| (0..width).map(move |column| row * width + (column + width - 1) % width))
        .map(|index| map[index])
        .collect();
    let step = TAU / f64::from(size.width());
    let turn = |d: DVec3| {
        DVec3::new(
            d.x * step.cos() + d.z * step.sin(),
            d.y,
            d.z * step.cos() - d.x * step.sin(),
        )
    };
    let seam = from_angles(PI - 0.2 * step, 0.4);
    let naive = naive_look_up(size, &rotated, turn(seam)) - naive_look_up(size, &map, seam);
    bites("f04 clamped", naive.abs(), tolerance);

    let mut worst = 0.0;
    let seams: Vec<DVec3> = (0..2000)
        .map(|_| {
            from_angles(
                PI + uniform(&mut rng, -2.0, 2.0) * step,
                uniform(&mut rng, -1.57, 1.57),
            )
        })
        .collect();
    let random: Vec<DVec3> = (0..20_000).map(|_| unit_vector(&mut rng)).collect();
    for direction in seams
        .into_iter()
        .chain(random)
        .chain([seam, DVec3::X, DVec3::NEG_Z])
    {
        let difference = look_up(size, &rotated, turn(direction)) - look_up(size, &map, direction);
        worst = worse(worst, difference.abs());
    }
    holds("f04", worst, tolerance);
}

#[test]
fn hc_f04_directions_are_interpolated_as_vectors() {
    let size = map_size();
    // 179° and −179°: the mean of the angles points ahead, the mean of the vectors at the seam.
    let [left, right] = [179.0_f64, -179.0].map(f64::to_radians);
    let mean_of_angles = from_angles((left + right) * 0.5, 0.0);
    bites(
        "f04 angles",
        angle_between(mean_of_angles, DVec3::NEG_Z),
        1e-6,
    );
    let mut rng = generator(404);
    let mut worst = 0.0;
    for _ in 0..2000 {
        let (half, at) = (uniform(&mut rng, 0.0, 0.1), uniform(&mut rng, 0.0, 1.0));
        let mean = from_angles(PI - half, 0.0).lerp(from_angles(-PI + half, 0.0), at);
        let expected = ((1.0 - 2.0 * at) * half.tan()).atan();
        let texel = size.texel_from_direction(mean);
        // Left of the seam are the last columns.
        let from_seam = if texel.x > 249.5 {
            499.5 - texel.x
        } else {
            -0.5 - texel.x
        };
        worst = worse(worst, (from_seam * TAU / 500.0 - expected).abs());
    }
    holds("f04 vectors", worst, 1e-6);
}

#[test]
fn hc_f05_solid_angles() {
    let size = map_size();
    let step = PI / 250.0;
    let naive_row = |row: u16| {
        let edge = |r: u16| (f32::from(r) * std::f32::consts::PI / 250.0).cos();
        f64::from(edge(row) - edge(row + 1))
    };
    let truth_row = |row: u16| {
        // cos a − cos b = 2 sin((a+b)/2) sin((b−a)/2)
        2.0 * (step * (f64::from(row) + 0.5)).sin() * (step * 0.5).sin()
    };
    let tolerance = 1e-6;
    bites(
        "f05 difference of cosines",
        (naive_row(0) / truth_row(0) - 1.0).abs(),
        tolerance,
    );

    let mut worst = 0.0;
    for height in [1, 2, 3, 16, 250, 4096, 32_768] {
        let size = PanoramaSize::from_height(height).expect("a size");
        let sum: f64 = (0..height).map(|row| size.solid_angle(row)).sum();
        worst = worse(
            worst,
            (sum * f64::from(size.width()) / (4.0 * PI) - 1.0).abs(),
        );
    }
    for row in 0..250 {
        let area = size.solid_angle(u32::from(row));
        worst = worse(worst, (area / (truth_row(row) * TAU / 500.0) - 1.0).abs());
        assert_eq!(area, size.solid_angle(u32::from(row)), "pure");
        let mirrored = size.solid_angle(249 - u32::from(row));
        worst = worse(worst, (area / mirrored - 1.0).abs());
    }
    holds("f05", worst, tolerance);
    holds(
        "f05 row 0 is 1/159 of the equator",
        (size.solid_angle(125) / size.solid_angle(0) - 159.0).abs(),
        0.5,
    );
}

#[test]
fn hc_f05_a_map_wrong_only_at_the_poles() {
    let size = map_size();
    let wrong = |row: u32| f64::from(u8::from(size.latitude(row).abs() > PI / 3.0));
    let rows = f64::from(size.height());
    let unweighted: f64 = (0..size.height()).map(|row| wrong(row) / rows).sum();
    let weighted: f64 = (0..size.height())
        .map(|row| wrong(row) * size.solid_angle(row) * f64::from(size.width()) / (4.0 * PI))
        .sum();
    // The caps beyond 60° are 1 − sin 60° of the sphere; a row of texels more or less is 0.0063.
    let truth = 1.0 - (PI / 3.0).sin();
    bites("f05 unweighted", (unweighted - truth).abs(), 0.0063);
    holds("f05 weighted", (weighted - truth).abs(), 0.0063);
}

/// Design.md section 2: continuous texel addresses of the six axes at 500 x 250.
const AXES: [(&str, DVec3, f64, f64); 6] = [
    ("ahead +z", DVec3::Z, 249.5, 124.5),
    ("right +x", DVec3::X, 374.5, 124.5),
    ("left -x", DVec3::NEG_X, 124.5, 124.5),
    ("behind -z", DVec3::NEG_Z, -0.5, 124.5),
    ("up -y", DVec3::NEG_Y, 249.5, -0.5),
    ("down +y", DVec3::Y, 249.5, 249.5),
];

fn axis_error(
    texel_of: impl Fn(DVec3) -> DVec2,
    (_, direction, x, y): (&str, DVec3, f64, f64),
) -> f64 {
    let texel = texel_of(direction);
    // At a pole every column is the same place.
    let across = if direction.y == 0.0 {
        (texel.x - x).abs()
    } else {
        0.0
    };
    across.max((texel.y - y).abs())
}

fn shipped_axis(index: usize) {
    let (name, direction, x, y) = AXES[index];
    let error = axis_error(|d| map_size().texel_from_direction(d), AXES[index]);
    holds(&format!("f09 {name}"), error, 1e-12);
    let back = map_size().direction_from_texel(DVec2::new(x, y));
    holds(
        &format!("f09 {name} back"),
        (back - direction).length(),
        1e-12,
    );
}

#[test]
fn hc_f09_ahead_is_the_middle() {
    shipped_axis(0);
}

#[test]
fn hc_f09_right_is_right_of_the_middle() {
    shipped_axis(1);
}

#[test]
fn hc_f09_left_is_left_of_the_middle() {
    shipped_axis(2);
}

#[test]
fn hc_f09_behind_is_the_seam() {
    shipped_axis(3);
}

#[test]
fn hc_f09_up_is_the_top() {
    shipped_axis(4);
}

#[test]
fn hc_f09_down_is_the_bottom() {
    shipped_axis(5);
}

#[test]
fn hc_f09_other_conventions_fail_an_axis() {
    let size = map_size();
    let y_up = |d: DVec3| size.texel_from_direction(DVec3::new(d.x, -d.y, d.z));
    let mirrored = |d: DVec3| size.texel_from_direction(DVec3::new(-d.x, d.y, d.z));
    let z_up = |d: DVec3| size.texel_from_direction(DVec3::new(d.x, -d.z, d.y));
    let x_ahead = |d: DVec3| size.texel_from_direction(DVec3::new(-d.z, d.y, d.x));
    let worst = |texel_of: &dyn Fn(DVec3) -> DVec2| {
        AXES.into_iter()
            .map(|axis| axis_error(texel_of, axis))
            .fold(0.0, worse)
    };
    bites("f09 y up", worst(&y_up), 1e-12);
    bites("f09 mirrored", worst(&mirrored), 1e-12);
    bites("f09 z up", worst(&z_up), 1e-12);
    bites("f09 x ahead", worst(&x_ahead), 1e-12);
}
