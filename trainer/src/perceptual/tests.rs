//! LPIPS against the published implementation, and hard case L09.

use std::path::PathBuf;

use imaging::{Image, Mask, Rgb8Image, decode_png_rgb8};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::Deserialize;

use super::*;

/// What golden values may differ by: float32 sums of a few thousand terms in another order.
const TOLERANCE: f64 = 1e-5;
/// Activations, as a share of the tap's maximum: the same.
const ACTIVATION_TOLERANCE: f64 = 1e-4;
const NEIGHBOURS: usize = 1000;

#[derive(Deserialize)]
struct Golden {
    pairs: Vec<GoldenPair>,
    activations: GoldenActivations,
}

#[derive(Deserialize)]
struct GoldenPair {
    a: String,
    b: String,
    lpips: f64,
    per_layer: [f64; 5],
}

#[derive(Deserialize)]
struct GoldenActivations {
    image: String,
    taps: Vec<GoldenTap>,
}

#[derive(Deserialize)]
struct GoldenTap {
    shape: [usize; 3],
    max: f64,
    sum_abs: f64,
    samples_c_y_x_value: Vec<(usize, usize, usize, f64)>,
}

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../recordings/perceptual")
}

fn golden() -> Golden {
    let text = std::fs::read_to_string(folder().join("golden.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn picture(name: &str) -> Image<[f32; 3]> {
    let codes: Rgb8Image = decode_png_rgb8(&std::fs::read(folder().join(name)).unwrap()).unwrap();
    codes.map(|color| color.map(|code| f32::from(code) / 255.0))
}

fn random_picture(rng: &mut Pcg64, width: u32, height: u32) -> Image<[f32; 3]> {
    Image::from_fn(width, height, |_, _| {
        std::array::from_fn(|_| rng.random::<f32>())
    })
}

fn report(id: &str, worst: f64, tolerance: f64) {
    println!("{id}: worst error {worst:.3e}, tolerance {tolerance:.3e}");
    assert!(worst <= tolerance, "{id}: {worst} is above {tolerance}");
}

/// The worst difference of total and layers over the golden pairs, with pictures made by `prepare`.
fn golden_error(net: &Lpips, prepare: impl Fn(&Image<[f32; 3]>) -> NetworkInput) -> f64 {
    let mut worst = 0.0_f64;
    for pair in golden().pairs {
        let [a, b] = [&pair.a, &pair.b].map(|name| net.features(&prepare(&picture(name))).unwrap());
        let found = net.distance(&a, &b).unwrap();
        worst = worst.max((found.total() - pair.lpips).abs());
        for (found, expected) in found.0.iter().zip(pair.per_layer) {
            worst = worst.max((found - expected).abs());
        }
    }
    worst
}

#[test]
fn activations_are_those_of_the_published_network() {
    let net = Lpips::bundled().unwrap();
    let golden = golden().activations;
    let features = net
        .features(&NetworkInput::whole(&picture(&golden.image)).unwrap())
        .unwrap();
    assert_eq!(golden.taps.len(), 5);
    for (tap, expected) in features.taps().iter().zip(&golden.taps) {
        let [channels, rows, columns] = expected.shape;
        assert_eq!(tap.values.len(), channels * rows * columns);
        for &(channel, y, x, value) in &expected.samples_c_y_x_value {
            let found = tap.values[(channel * rows + y) * columns + x];
            let error = (f64::from(found) - value).abs() / expected.max;
            assert!(error <= ACTIVATION_TOLERANCE, "{found} for {value}");
        }
        let sum: f64 = tap.values.iter().map(|v| f64::from(v.abs())).sum();
        assert!((sum / expected.sum_abs - 1.0).abs() <= ACTIVATION_TOLERANCE);
    }
}

#[test]
fn hc_l09_inputs_of_lpips_are_prepared_once() {
    let net = Lpips::bundled().unwrap();
    let right = golden_error(&net, |picture| NetworkInput::whole(picture).unwrap());
    report("L09 golden pairs, total and layers", right, TOLERANCE);

    // Bite: the wrong order of channels, and values that were not taken to [-1, 1], look plausible.
    let naive_bgr = golden_error(&net, |picture| {
        NetworkInput::whole(&picture.map(|[r, g, b]| [b, g, r])).unwrap()
    });
    let naive_range = golden_error(&net, |picture| {
        NetworkInput::whole(&picture.map(|color| color.map(|v| f32::midpoint(v, 1.0)))).unwrap()
    });
    println!("L09: naive BGR errs by {naive_bgr:.3e}, values in [0, 1] by {naive_range:.3e}");
    assert!(naive_bgr > 10.0 * TOLERANCE && naive_range > 10.0 * TOLERANCE);

    // Bite: black around the object counts as equal, more of it the larger the frame.
    let (a, b) = (
        picture("small_highlight_moved_a.png"),
        picture("small_highlight_moved_b.png"),
    );
    let (near, far) = (framed(&a, 40), framed(&a, 200));
    let other = [framed(&b, 40), framed(&b, 200)];
    let mask = [40, 200].map(|border| mask_of(64, border));
    let naive_black = |a: &Image<[f32; 3]>, b: &Image<[f32; 3]>| net.whole(a, b).unwrap().total();
    let diluted = naive_black(&far, &other[1]) / naive_black(&near, &other[0]);
    println!("L09: naive black borders leave {diluted:.2} of the distance in a larger frame");
    assert!(diluted < 0.5, "{diluted}");
    let masked = |a, b, mask| net.masked(a, b, mask).unwrap().unwrap().total();
    let change = (masked(&far, &other[1], &mask[1]) - masked(&near, &other[0], &mask[0])).abs();
    report("L09 masked, two frame sizes", change, 0.0);
    report(
        "L09 masked random neighbours",
        worst_of_neighbours(&net),
        0.0,
    );
}

/// The picture with a black border.
fn framed(picture: &Image<[f32; 3]>, border: u32) -> Image<[f32; 3]> {
    let (width, height) = (picture.width() + 2 * border, picture.height() + 2 * border);
    Image::from_fn(width, height, |x, y| {
        let from = |at: u32| i64::from(at) - i64::from(border);
        picture.get(from(x), from(y)).unwrap_or([0.0; 3])
    })
}

fn mask_of(side: u32, border: u32) -> Mask {
    let inside = |at: u32| (border..border + side).contains(&at);
    Image::from_fn(side + 2 * border, side + 2 * border, |x, y| {
        inside(x) && inside(y)
    })
}

/// What lies outside the mask must not matter at all: the network gets the same bits, and gives distance 0.
fn worst_of_neighbours(net: &Lpips) -> f64 {
    /// The network runs on every so many of them; equal inputs have equal outputs.
    const RUN_EVERY: usize = 50;
    let mut rng = Pcg64::seed_from_u64(9);
    let mut worst = 0.0_f64;
    for round in 0..NEIGHBOURS {
        let (width, height) = (rng.random_range(31..36), rng.random_range(31..36));
        let a = random_picture(&mut rng, width, height);
        let threshold = rng.random::<f32>();
        let mask = Image::from_fn(width, height, |x, y| a.at(x, y)[0] < threshold || x == y);
        let elsewhere = random_picture(&mut rng, width, height);
        let b = Image::from_fn(width, height, |x, y| {
            if mask.at(x, y) {
                a.at(x, y)
            } else {
                elsewhere.at(x, y)
            }
        });
        let inputs = [&a, &b].map(|picture| NetworkInput::masked(picture, &mask).unwrap().unwrap());
        for (a, b) in inputs[0].planes.iter().zip(&inputs[1].planes) {
            worst = worst.max(f64::from((a - b).abs()));
        }
        if round % RUN_EVERY == 0 {
            worst = worst.max(net.masked(&a, &b, &mask).unwrap().unwrap().total());
        }
    }
    worst
}

#[test]
fn a_picture_is_at_distance_zero_from_itself() {
    let net = Lpips::bundled().unwrap();
    for pair in golden().pairs {
        let a = picture(&pair.a);
        assert_eq!(net.whole(&a, &a).unwrap(), LayerDistances([0.0; 5]));
    }
    // Dead features have norm 0.
    let black = Image::new(64, 64, [0.0; 3]);
    assert_eq!(net.whole(&black, &black).unwrap().total(), 0.0);
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let net = Lpips::bundled().unwrap();
    let (a, b) = (picture("large_blur_a.png"), picture("large_blur_b.png"));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| net.whole(&a, &b).unwrap())
    };
    assert_eq!(with(1), with(2));
    assert_eq!(with(1), with(5));
}

#[test]
fn pictures_that_cannot_be_judged_are_refused() {
    let net = Lpips::bundled().unwrap();
    let small = Image::new(30, 64, [0.2; 3]);
    let smallest = Image::new(31, 31, [0.2; 3]);
    assert!(matches!(
        net.whole(&small, &small),
        Err(PerceptualError::TooSmall {
            width: 30,
            height: 64
        })
    ));
    assert!(net.whole(&smallest, &smallest).is_ok());
    assert!(matches!(
        net.whole(&smallest, &Image::new(31, 32, [0.2; 3])),
        Err(PerceptualError::SizeMismatch { .. })
    ));
    for value in [f32::NAN, 255.0, -0.2] {
        let mut wrong = smallest.clone();
        *wrong.at_mut(3, 4) = [0.1, value, 0.1];
        assert!(matches!(
            NetworkInput::whole(&wrong),
            Err(PerceptualError::ValueOutOfRange { x: 3, y: 4, .. })
        ));
    }
    let large = Image::new(100, 100, [0.2; 3]);
    let nothing = Image::new(100, 100, false);
    assert!(net.masked(&large, &large, &nothing).unwrap().is_none());
    let mut corner = nothing.clone();
    *corner.at_mut(0, 0) = true;
    assert!(matches!(
        net.masked(&large, &large, &corner),
        Err(PerceptualError::TooSmall { .. })
    ));
    assert!(net.masked(&smallest, &smallest, &corner).is_err());
}

#[test]
fn boxes_of_masks_keep_their_margin_and_stay_inside() {
    let mut mask = Image::new(100, 80, false);
    assert_eq!(CropBox::around(&mask, 4), None);
    *mask.at_mut(50, 30) = true;
    *mask.at_mut(70, 78) = true;
    let (x0, y0, x1, y1) = (46, 26, 75, 80);
    assert_eq!(CropBox::around(&mask, 4), Some(CropBox { x0, y0, x1, y1 }));
}
