//! Hard cases A10, A11, A15, A16: angles, bases, mirror reflection, normals.

mod rows;
mod sampling;

use geometry::direction::{angle_between, basis, look_along, reflect, transform_normal};
use geometry::{DMat3, DVec3, Vec3};
use rows::{bites, holds, worse};
use sampling::{generator, uniform, unit_vector};
use std::f64::consts::PI;

/// A unit vector at `angle` from unit `a`, towards any side.
fn turned(a: DVec3, angle: f64) -> DVec3 {
    let side = a.any_orthonormal_vector();
    a * angle.cos() + side * angle.sin()
}

#[test]
fn hc_a10_angle_between_directions() {
    let tolerance = 1e-5;
    let naive = |a: DVec3, b: DVec3| f64::from(a.as_vec3().dot(b.as_vec3()).acos());
    let listed = DVec3::new(1.0, 2.0, 3.0).normalize();
    for angle in [1e-6, 2e-4, 1e-3] {
        bites(
            "a10",
            (naive(listed, turned(listed, angle)) / angle - 1.0).abs(),
            tolerance,
        );
    }

    let mut rng = generator(110);
    let mut worst = 0.0;
    for round in 0..4000 {
        let angle = match round {
            0..4 => [1e-6, 1e-4, 1e-3, 1e-2][round],
            _ => 10.0_f64.powf(uniform(&mut rng, -6.0, 0.0)),
        };
        let a = unit_vector(&mut rng);
        let b = turned(a, angle);
        worst = worse(worst, (angle_between(a, b) / angle - 1.0).abs());
        // From the antipode the deficit to π is the angle; π is known to 4e-16.
        worst = worse(worst, ((PI - angle_between(a, -b)) / angle - 1.0).abs());
        // The length of either side is free, however large or small.
        for scale in [1e-300, 1e-160, 3.0, 1e200] {
            worst = worse(
                worst,
                (angle_between(a * scale, b * 7.0) / angle - 1.0).abs(),
            );
        }
        assert_eq!(angle_between(a, a), 0.0);
        assert_eq!(angle_between(a, -a), PI);
    }
    holds("a10", worst, tolerance);
    for bad in [DVec3::NAN, DVec3::INFINITY, DVec3::X.with_z(f64::NAN)] {
        assert!(
            angle_between(bad, DVec3::X).is_nan(),
            "no direction, no angle"
        );
        assert!(angle_between(DVec3::X, bad).is_nan());
    }
    assert_eq!(angle_between(DVec3::ZERO, DVec3::X), PI / 2.0);
}

#[test]
fn hc_a10_reflection_onto_a_pole_never_gives_nan() {
    let mut rng = generator(210);
    let (mut naive_nan_count, mut nan_count) = (0, 0);
    let mut worst = 0.0;
    for _ in 0..1_000_000 {
        let outgoing = unit_vector(&mut rng);
        let Some(normal) = (outgoing + DVec3::Y).try_normalize() else {
            continue;
        };
        let (outgoing, normal) = (outgoing.as_vec3(), normal.as_vec3());
        let naive = normal * (2.0 * normal.dot(outgoing)) - outgoing;
        naive_nan_count += u32::from(naive.y.acos().is_nan());
        let angle = angle_between(reflect(outgoing, normal).as_dvec3(), DVec3::Y);
        nan_count += u32::from(angle.is_nan());
        worst = worse(worst, angle);
    }
    bites("a10 NaN by acos", f64::from(naive_nan_count), 0.0);
    holds("a10 NaN", f64::from(nan_count), 0.0);
    // Three f32 vectors of unit length, each rounded to 6e-8 per component; grazing ones amplify it.
    holds("a10 off the pole", worst, 1e-6);
}

/// The basis of one formula (Frisvad 2012), singular at −z.
fn naive_basis(n: Vec3) -> (Vec3, Vec3) {
    let a = 1.0 / (1.0 + n.z);
    let b = -n.x * n.y * a;
    (
        Vec3::new(1.0 - n.x * n.x * a, b, -n.x),
        Vec3::new(b, 1.0 - n.y * n.y * a, -n.y),
    )
}

/// How far `(u, v, n)` is from a right-handed orthonormal basis.
fn basis_error(n: Vec3, (u, v): (Vec3, Vec3)) -> f64 {
    let (n, u, v) = (n.as_dvec3(), u.as_dvec3(), v.as_dvec3());
    [
        u.length() - 1.0,
        v.length() - 1.0,
        u.dot(n),
        v.dot(n),
        u.dot(v),
        (u.cross(v) - n).length(),
    ]
    .into_iter()
    .map(f64::abs)
    .fold(0.0, worse)
}

#[test]
fn hc_a11_basis_near_minus_z() {
    // Three products of components that are rounded to 6e-8 each.
    let tolerance = 3e-7;
    for below in [1e-7, 1e-6] {
        let z: f64 = -1.0 + below;
        let n = DVec3::new((1.0 - z * z).sqrt() * 0.6, (1.0 - z * z).sqrt() * 0.8, z).as_vec3();
        bites("a11", basis_error(n, naive_basis(n)), tolerance);
        holds("a11 listed", basis_error(n, basis(n)), tolerance);
    }
    bites(
        "a11 at -z",
        basis_error(Vec3::NEG_Z, naive_basis(Vec3::NEG_Z)),
        tolerance,
    );

    let mut rng = generator(111);
    let mut worst = 0.0;
    let zeros = [
        Vec3::new(1.0, 0.0, -0.0),
        Vec3::new(0.0, -1.0, -0.0),
        Vec3::new(-0.0, -0.0, -1.0),
    ];
    for n in [Vec3::AXES.as_slice(), &Vec3::AXES.map(|a| -a), &zeros].concat() {
        worst = worse(worst, basis_error(n, basis(n)));
    }
    for _ in 0..1_000_000 {
        let n = unit_vector(&mut rng).as_vec3();
        worst = worse(worst, basis_error(n, basis(n)));
    }
    for _ in 0..10_000 {
        let small = 10.0_f64.powf(uniform(&mut rng, -9.0, -1.0));
        let n = (DVec3::NEG_Z + unit_vector(&mut rng) * small)
            .normalize()
            .as_vec3();
        worst = worse(worst, basis_error(n, basis(n)));
    }
    holds("a11", worst, tolerance);
}

#[test]
fn hc_a11_look_along_the_down_direction() {
    let naive = |forward: DVec3, down: DVec3| down.cross(forward).normalize();
    bites("a11 look", naive(DVec3::Y, DVec3::Y).length(), 1.0);

    let mut rng = generator(211);
    let mut worst = 0.0;
    for round in 0..2000 {
        let down = unit_vector(&mut rng);
        let forward = match round % 4 {
            0 => down,
            1 => -down,
            2 => down + unit_vector(&mut rng) * 1e-9,
            _ => unit_vector(&mut rng),
        };
        let forward = forward * 10.0_f64.powf(uniform(&mut rng, -250.0, 250.0));
        let m = look_along(forward, down).expect("a direction");
        let error = m.transpose() * m - DMat3::IDENTITY;
        worst = worse(
            worst,
            error
                .to_cols_array()
                .into_iter()
                .map(f64::abs)
                .fold(0.0, worse),
        );
        worst = worse(worst, (m.determinant() - 1.0).abs());
        worst = worse(worst, angle_between(m.z_axis, forward));
        if round % 4 == 3 {
            assert!(m.y_axis.dot(down) >= 0.0, "the image's down points down");
            assert!(
                m.x_axis.dot(down).abs() < 1e-12,
                "the image's rows are level"
            );
        }
    }
    holds("a11 look", worst, 1e-12);
    assert_eq!(look_along(DVec3::ZERO, DVec3::Y), None);
    assert_eq!(look_along(DVec3::NAN, DVec3::Y), None);
    assert_eq!(look_along(DVec3::INFINITY, DVec3::Y), None);
    assert!(
        look_along(DVec3::Z, DVec3::ZERO).is_some(),
        "no down is no reason to fail"
    );
}

#[test]
fn hc_a15_mirror_sign_and_interpolated_normals() {
    let tolerance = 1e-6;
    let paper = |incoming: Vec3, normal: Vec3| incoming - normal * (2.0 * incoming.dot(normal));
    let asymmetry = |outgoing: Vec3, normal: Vec3, reflected: Vec3| {
        let [o, n, r] = [outgoing, normal, reflected].map(Vec3::as_dvec3);
        let same_plane = o.normalize().cross(n.normalize()).dot(r.normalize()).abs();
        worse(
            (angle_between(o, n) - angle_between(r, n)).abs(),
            same_plane,
        )
    };
    // Two vertex normals 50° apart; their mean has length 0.906.
    let half = 25.0_f64.to_radians();
    let [left, right] = [-half, half].map(|a| DVec3::new(a.sin(), 0.0, a.cos()).as_vec3());
    let normal = (left + right) * 0.5;
    let outgoing = DVec3::new(0.6, 0.3, 0.7).normalize().as_vec3();
    bites(
        "a15 sign",
        asymmetry(outgoing, normal, paper(outgoing, normal.normalize())),
        tolerance,
    );
    bites(
        "a15 length",
        asymmetry(outgoing, normal, -paper(outgoing, normal)),
        tolerance,
    );
    let with_incoming = paper(-outgoing, normal.normalize());
    assert!(
        (with_incoming - reflect(outgoing, normal)).length() < 1e-6,
        "Park 2020 with omega = -outgoing"
    );

    let mut rng = generator(115);
    let mut worst = asymmetry(outgoing, normal, reflect(outgoing, normal));
    let mut worst_length = 0.0;
    for _ in 0..100_000 {
        let a = unit_vector(&mut rng);
        let b = turned(a, uniform(&mut rng, 0.0, 50.0_f64.to_radians()));
        let normal = a.lerp(b, uniform(&mut rng, 0.0, 1.0)).as_vec3();
        let outgoing = unit_vector(&mut rng).as_vec3();
        let reflected = reflect(outgoing, normal);
        worst = worse(worst, asymmetry(outgoing, normal, reflected));
        worst_length = worse(worst_length, (reflected.as_dvec3().length() - 1.0).abs());
    }
    holds("a15", worst, tolerance);
    holds("a15 length", worst_length, 2e-7);
    assert_eq!(
        reflect(Vec3::Z, Vec3::Z),
        Vec3::Z,
        "seen head on the mirror looks back"
    );
    assert_eq!(reflect(Vec3::Z, Vec3::ZERO), Vec3::ZERO);
}

#[test]
fn hc_a16_normals_under_scale_and_mirroring() {
    let tolerance = 1e-6;
    let ellipsoid = DMat3::from_diagonal(DVec3::new(1.0, 2.0, 4.0));
    let listed = DVec3::new(1.0, 2.0, 3.0).normalize();
    let tangent = listed.any_orthonormal_vector();
    let naive = (ellipsoid * listed).normalize();
    bites(
        "a16",
        naive.dot((ellipsoid * tangent).normalize()).abs(),
        tolerance,
    );
    // Cofactors without the sign of the determinant: the mirrored mesh turns inside out.
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let cofactors = mirror.determinant() * mirror.inverse().transpose();
    bites(
        "a16 mirrored",
        1.0 - (cofactors * listed).dot(mirror * listed),
        tolerance,
    );

    let mut rng = generator(116);
    let (mut worst_tangent, mut least_outward) = (0.0, f64::INFINITY);
    for round in 0..3000 {
        let scale = DVec3::new(
            uniform(&mut rng, 0.1, 4.0),
            uniform(&mut rng, 0.1, 4.0),
            1.0,
        );
        let sign = if round % 2 == 0 { 1.0 } else { -1.0 };
        let rotate = DMat3::from_axis_angle(unit_vector(&mut rng), uniform(&mut rng, 0.0, PI));
        let size = 10.0_f64.powf(uniform(&mut rng, -110.0, 90.0));
        let linear =
            rotate * ellipsoid * rotate.transpose() * DMat3::from_diagonal(scale * sign) * size;
        // A point of the unit sphere is its own normal.
        let point = unit_vector(&mut rng);
        let normal = transform_normal(linear, point).expect("a regular map");
        let tangent = linear * point.any_orthonormal_vector();
        worst_tangent = worse(worst_tangent, normal.dot(tangent / tangent.length()).abs());
        least_outward = least_outward.min(normal.dot((linear * point / size).normalize()));
        // The winding of a triangle agrees with the normal once it is flipped for det < 0.
        let [a, b, c] = [
            point,
            turned(point, 0.01),
            point + 0.01 * point.cross(turned(point, PI / 2.0)),
        ];
        let facing = (b - a).cross(c - a).dot(point).signum();
        let [a, b, c] = [a, b, c].map(|corner| linear * corner / size);
        let winding = (b - a).cross(c - a).dot(normal).signum();
        assert_eq!(
            winding,
            facing * sign,
            "a negative determinant flips the winding"
        );
    }
    holds("a16", worst_tangent, tolerance);
    assert!(
        least_outward > 0.0,
        "a mirrored ellipsoid keeps outward normals"
    );
}

#[test]
fn hc_a16_a_flattened_mesh_has_no_normals() {
    // Rank 2 up to rounding: the determinant is 7e-18, not 0.
    let flat = DMat3::from_cols_array(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]);
    assert!(
        flat.determinant() != 0.0,
        "rounding hides the singularity from a test for zero"
    );
    assert_eq!(transform_normal(flat, DVec3::X), None);
    assert_eq!(transform_normal(DMat3::ZERO, DVec3::X), None);
    assert_eq!(transform_normal(DMat3::IDENTITY, DVec3::ZERO), None);
    assert_eq!(transform_normal(DMat3::IDENTITY * f64::NAN, DVec3::X), None);
    assert_eq!(transform_normal(DMat3::IDENTITY, DVec3::NAN), None);
    let thin = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1e-14));
    assert_eq!(
        transform_normal(thin, DVec3::Z),
        Some(DVec3::Z),
        "thin is not singular"
    );
}
