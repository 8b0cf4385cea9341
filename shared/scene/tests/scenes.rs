//! Every scene of the catalogue, small.

use effects::{Effect, EffectSet};
use scene::catalogue;
use scene::world::LightQuality;
use scene::{Film, FilmOptions};

fn small(effects: Option<EffectSet>, seed: u64) -> FilmOptions {
    FilmOptions {
        width: 96,
        frame_count: Some(12),
        seed,
        effects,
        quality: LightQuality {
            light_count: 24,
            bounce_count: 2,
        },
        samples: 1,
        paths: 1,
        ..FilmOptions::default()
    }
}

#[test]
fn every_scene_is_lit_seen_and_measured() {
    for name in catalogue::names() {
        let film = Film::new(name, small(None, 1)).unwrap();
        let world = film.world();
        // A vertex normal that looks into its own body gets no light: each object is lit somewhere.
        for (index, object) in world.objects.iter().enumerate() {
            let brightest = world
                .mesh()
                .triangles
                .iter()
                .zip(world.object_of_triangle())
                .filter(|(_, owner)| usize::from(**owner) == index)
                .flat_map(|(corners, _)| corners)
                .map(|&v| world.vertex_light()[v as usize][1])
                .fold(0.0_f32, f32::max);
            assert!(
                brightest > 0.15,
                "{name}: {} is dark, {brightest}",
                object.name
            );
        }
        for index in [0, film.frame_count() - 1] {
            let frame = film.frame(index);
            let truth = film.truth(index, 0);
            let count = |marks: usize| marks as f64 / (96.0 * 72.0);
            let seen = count(truth.object.pixels().iter().filter(|&&o| o > 0).count());
            let measured = count(frame.shifts.pixels().iter().filter(|&&s| s > 0).count());
            assert!(seen > 0.015, "{name}, frame {index}: {seen} of the picture");
            assert!(
                measured > 0.5 * seen,
                "{name}, frame {index}: {measured} of {seen} measured"
            );
            let masked = truth.mask.pixels().contains(&true);
            let is_shiny = world
                .objects
                .iter()
                .any(|o| o.is_target && o.material.is_glossy());
            assert_eq!(masked, is_shiny, "{name}");
            let bright = frame.mosaic.pixels().iter().filter(|&&c| c > 6).count();
            assert!(count(bright) > 0.5, "{name}: the picture is dark");
        }
    }
}

#[test]
fn the_paths_of_the_tests_lie_far_from_training() {
    for name in [
        "cans", "figure", "bag", "bowls", "bottle", "foil", "plane", "fruits", "laptop", "room",
    ] {
        let design = catalogue::design(name).unwrap();
        assert!(design.split.test >= 60, "{name}");
        let film = Film::new(name, small(None, 1)).unwrap();
        let split = design.split.scaled(12);
        let center = design.path.center;
        let from = |index: u32| film.pose(index).translation() - center;
        let farthest = (0..split.train)
            .map(|train| geometry::direction::angle_between(from(11), from(train)))
            .fold(f64::MAX, f64::min);
        assert!(
            farthest.to_degrees() > 20.0,
            "{name}: {}",
            farthest.to_degrees()
        );
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_for_any_number_of_threads() {
    let film = Film::new("ball-on-table", small(None, 3)).unwrap();
    let frame = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| film.frame(5))
    };
    assert_eq!(frame(1), frame(3));
    let other = Film::new("ball-on-table", small(None, 4)).unwrap();
    assert_ne!(other.frame(5).mosaic, frame(1).mosaic);
}

#[test]
fn an_effect_that_is_off_is_not_computed() {
    let all = EffectSet::all();
    let counts = |effects: EffectSet| {
        let film = Film::new("bowls", small(Some(effects.closed()), 1)).unwrap();
        film.frame(3).counts
    };
    let on = counts(all);
    assert!(on.rays_closest > 0 && on.fresnel_evals > 0 && on.first_bounce_pixels > 0);
    assert!(on.second_bounce_pixels > 0);
    assert_eq!(counts(all.without(Effect::Fresnel)).fresnel_evals, 0);
    let single = counts(all.without(Effect::FirstBounceSpecular));
    assert_eq!(single.second_bounce_pixels, 0);
    assert!(single.first_bounce_pixels > 0);
    let blocked = counts(all.without(Effect::FirstBounce));
    assert_eq!((blocked.rays_closest, blocked.first_bounce_pixels), (0, 0));
    assert!(blocked.rays_occlusion > 0);
    let open = counts(all.without(Effect::Visibility));
    assert_eq!((open.rays_closest, open.rays_occlusion), (0, 0));
}

#[test]
fn switching_one_effect_off_leaves_the_numbers_of_the_others() {
    // Without noise and vignetting the frames are those of a scene that has neither.
    let all = EffectSet::all();
    let off = all.without(Effect::Noise).without(Effect::Vignetting);
    let film = Film::new("plastic-ball", small(Some(off), 1)).unwrap();
    let mut design = catalogue::design("plastic-ball").unwrap();
    design.corner_light = 1.0;
    design.noise = scene::sensor::NoiseModel {
        full_well: f32::INFINITY,
        read: 0.0,
    };
    let plain = Film::of(design, small(Some(all), 1)).unwrap();
    assert_eq!(film.frame(4).mosaic, plain.frame(4).mosaic);
    // The light itself does not depend on the sensor's effects.
    let noisy = Film::new("plastic-ball", small(Some(all), 1)).unwrap();
    assert_eq!(film.light(4).0, noisy.light(4).0);
}

#[test]
fn truth_adds_up_to_the_light_that_is_filmed() {
    let options = FilmOptions {
        samples: 16,
        paths: 8,
        ..small(None, 1)
    };
    let film = Film::new("ball-on-table", options).unwrap();
    let (light, _) = film.light(2);
    let truth = film.truth(2, 16);
    let (mut sum, mut weight) = (0.0, 0.0);
    for y in 0..72 {
        for x in 0..96 {
            if truth.object.at(x, y) == 0 {
                continue;
            }
            for c in 0..3 {
                let told = truth.diffuse.at(x, y)[c] + truth.specular.at(x, y)[c];
                sum += f64::from(told.min(1.0) - light.at(x, y)[c].min(1.0));
                weight += f64::from(light.at(x, y)[c].min(1.0));
            }
        }
    }
    // A pixel's centre is not its mean: at silhouettes and on clipped lamps they differ.
    assert!((sum / weight).abs() < 0.02, "{}", sum / weight);
}

/// The mean over many paths agrees with a mean of far more of them, as its own variance says (z-test), and twice the
/// paths have half the variance.
#[test]
fn renders_have_the_mean_and_variance_of_their_samples() {
    let film_of = |paths: u32, seed: u64| {
        let options = FilmOptions {
            width: 32,
            paths,
            ..small(Some(EffectSet::all().without(Effect::Noise)), seed)
        };
        Film::new("one-material", options).unwrap()
    };
    let statistics = |paths: u32, seeds: std::ops::Range<u64>| {
        let images: Vec<_> = seeds.map(|seed| film_of(paths, seed).light(1).0).collect();
        let n = images.len() as f64;
        let pixels = images[0].pixels().len();
        let mut result = Vec::with_capacity(pixels);
        for index in 0..pixels {
            let values = images
                .iter()
                .map(|image| f64::from(image.pixels()[index][1]));
            let mean = values.clone().sum::<f64>() / n;
            let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            result.push((mean, variance / n));
        }
        result
    };
    let few = statistics(1, 0..24);
    let many = statistics(8, 100..124);
    let scores: Vec<f64> = few
        .iter()
        .zip(&many)
        .filter(|((_, a), (_, b))| a + b > 1e-12)
        .map(|((ma, va), (mb, vb))| (ma - mb) / (va + vb).sqrt())
        .collect();
    let n = scores.len() as f64;
    assert!(n > 50.0, "{n} pixels vary");
    let mean = scores.iter().sum::<f64>() / n;
    // Each score is normal: their mean has deviation 1/√n; neighbours share nothing.
    assert!(mean.abs() < 4.0 / n.sqrt(), "mean score {mean} of {n}");
    let outside = scores.iter().filter(|z| z.abs() > 4.0).count() as f64 / n;
    assert!(outside < 0.02, "{outside} beyond four deviations");
    let total = |statistics: &[(f64, f64)]| statistics.iter().map(|(_, v)| v).sum::<f64>();
    assert!(total(&many) < 0.9 * total(&few), "more paths vary less");
}
