use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;

#[test]
fn a_square_of_two_triangles_covers_each_centre_once() {
    let corner = |x: i64, y: i64| [x * UNITS, y * UNITS];
    let mut count = [0; 64];
    for triangle in [
        [corner(1, 1), corner(5, 1), corner(5, 5)],
        [corner(1, 1), corner(5, 5), corner(1, 5)],
    ] {
        cover(triangle, 0..8, 0..8, |x, y| {
            count[(y * 8 + x) as usize] += 1;
        });
    }
    for (index, &count) in count.iter().enumerate() {
        let (x, y) = (index % 8, index / 8);
        let inside = (1..5).contains(&x) && (1..5).contains(&y);
        assert_eq!(count, i32::from(inside), "pixel ({x}, {y})");
    }
}

#[test]
fn far_corners_do_not_overflow() {
    let far = (1 << 21) * UNITS;
    let mut count = 0;
    cover(
        [[-far, -far], [far, -far], [-far, far]],
        0..4,
        0..4,
        |_, _| count += 1,
    );
    cover(
        [[far, far], [far, -far], [-far, far]],
        0..4,
        0..4,
        |_, _| count += 1,
    );
    assert_eq!(count, 16);
}

/// A grid of 5 x 5 corners over [0, width] x [0, height] pixels, inner ones moved, split into triangles along
/// random diagonals. Half of the corners lie exactly on pixel centres.
fn triangulation(rng: &mut Pcg64, width: i64, height: i64) -> Vec<[FixedPoint; 3]> {
    let mut corners = [[[0_i64; 2]; 5]; 5];
    for (row, line) in corners.iter_mut().enumerate() {
        for (column, corner) in line.iter_mut().enumerate() {
            let mut place = |index: usize, size: i64| {
                let cell = size * UNITS / 4;
                let moved = if (1..4).contains(&index) {
                    rng.random_range(-cell / 4..cell / 4)
                } else {
                    0
                };
                let at = index as i64 * cell + moved;
                if rng.random::<bool>() {
                    at.div_euclid(UNITS) * UNITS
                } else {
                    at
                }
            };
            *corner = [place(column, width), place(row, height)];
        }
    }
    let mut triangles = Vec::new();
    for row in 0..4 {
        for column in 0..4 {
            let [a, b] = [corners[row][column], corners[row][column + 1]];
            let [c, d] = [corners[row + 1][column + 1], corners[row + 1][column]];
            triangles.extend(if rng.random::<bool>() {
                [[a, b, c], [a, c, d]]
            } else {
                [[b, c, d], [d, a, b]]
            });
        }
    }
    triangles
}

/// Pixels inside the grid's frame that are not covered exactly once.
fn wrong_count(
    triangles: &[[FixedPoint; 3]],
    width: i64,
    height: i64,
    cover: impl Fn([FixedPoint; 3], &mut dyn FnMut(i64, i64)),
) -> usize {
    let mut count = vec![0_u8; (width * height) as usize];
    for &triangle in triangles {
        cover(triangle, &mut |x, y| {
            count[(y * width + x) as usize] += 1;
        });
    }
    count.iter().filter(|count| **count != 1).count()
}

/// Edges in i32 that count points on them for both sides.
fn naive_cover(corners: [FixedPoint; 3], width: i64, height: i64, visit: &mut dyn FnMut(i64, i64)) {
    let value = |p: FixedPoint, q: FixedPoint, r: FixedPoint| {
        let [px, py, qx, qy, rx, ry] = [p[0], p[1], q[0], q[1], r[0], r[1]].map(|x| x as i32);
        let forwards = (qx - px).wrapping_mul(ry - py);
        forwards.wrapping_sub((qy - py).wrapping_mul(rx - px))
    };
    let [a, b, c] = corners;
    let sign = value(a, b, c).signum();
    for y in 0..height {
        for x in 0..width {
            let center = [x * UNITS, y * UNITS];
            if [(a, b), (b, c), (c, a)]
                .iter()
                .all(|&(p, q)| value(p, q, center) * sign >= 0)
            {
                visit(x, y);
            }
        }
    }
}

#[test]
fn hc_e10_every_pixel_once() {
    let mut rng = Pcg64::seed_from_u64(510);
    // VGA, where i32 overflows.
    let listed = triangulation(&mut rng, 640, 480);
    let naive = wrong_count(&listed, 640, 480, |t, visit| {
        naive_cover(t, 640, 480, visit);
    });
    println!("e10: naive error {naive}, tolerance 0");
    assert!(naive > 0, "e10: the naive form passes");
    let mut wrong = wrong_count(&listed, 640, 480, |t, visit| {
        cover(t, 0..640, 0..480, visit);
    });
    for _ in 0..2000 {
        let (width, height) = (rng.random_range(8..40), rng.random_range(8..40));
        let (width, height) = (width * 4, height * 4);
        let triangles = triangulation(&mut rng, width, height);
        wrong += wrong_count(&triangles, width, height, |t, visit| {
            cover(t, 0..width, 0..height, visit);
        });
    }
    println!("e10: worst error {wrong}, tolerance 0");
    assert_eq!(wrong, 0, "pixels not covered exactly once");
}
