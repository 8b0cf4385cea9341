//! Frame after frame: lost, found, new worlds, weak axes, threads.

use fusion::VolumeConfig;
use fusion::live::{Effort, LiveConfig, LiveFusion, LiveRig, Tracked};
use fusion::tracking::TrackState;
use geometry::{DVec3, Intrinsics, Pose};
use imaging::DepthImage;

use crate::shapes;
use crate::steps::ROOM;

const INTERVAL: i64 = 33_000_000;

fn config() -> LiveConfig {
    LiveConfig {
        volume: VolumeConfig {
            voxel_size: 0.01,
            ..VolumeConfig::default()
        },
        ..LiveConfig::default()
    }
}

fn live(config: LiveConfig) -> LiveFusion {
    let rig = LiveRig {
        depth_camera: shapes::camera(),
        color_camera: None,
        color_from_depth: Pose::IDENTITY,
    };
    LiveFusion::new(config, rig, Pose::IDENTITY).expect("settings")
}

/// A slow swing: 4 mm and 0.3 degrees a frame.
fn swing(frame: u32) -> Pose {
    let t = f64::from(frame);
    Pose::new(
        geometry::rotation::exp(DVec3::new(0.001, 0.005, 0.0) * t),
        DVec3::new(-0.003, 0.001, 0.002) * t,
    )
    .expect("a pose")
}

struct Player {
    live: LiveFusion,
    time: i64,
}

impl Player {
    fn new(config: LiveConfig) -> Self {
        Self {
            live: live(config),
            time: 0,
        }
    }

    fn play(&mut self, depth: &DepthImage) -> Tracked {
        self.time += INTERVAL;
        self.live.load(depth, false);
        let tracked = self.live.track(self.time, Effort::default());
        self.live.fuse(depth, None).expect("a frame");
        tracked
    }

    fn see(&mut self, pose: &Pose) -> Tracked {
        self.play(&shapes::depth(ROOM, &shapes::camera(), pose))
    }
}

fn is_right(tracked: &Tracked, truth: &Pose) -> bool {
    let error = truth.inverse() * tracked.world_from_camera;
    error.translation().length() < 0.01 && geometry::rotation::log(error.rotation()).length() < 0.02
}

#[test]
fn a_swing_through_a_room_is_followed() {
    let mut player = Player::new(config());
    for frame in 0..40 {
        let tracked = player.see(&swing(frame));
        assert_eq!(tracked.state, TrackState::Ok, "frame {frame}");
        assert!(
            is_right(&tracked, &swing(frame)),
            "frame {frame}: {tracked:?}"
        );
        assert!(tracked.covariance.is_some());
    }
}

#[test]
fn a_covered_lens_is_lost_and_known_ground_is_found_again() {
    let mut player = Player::new(config());
    for frame in 0..30 {
        player.see(&swing(frame));
    }
    let blocks = player.live.volume().block_count();
    let nothing = DepthImage::new(160, 120, 0.0);
    for _ in 0..60 {
        let tracked = player.play(&nothing);
        assert_eq!(tracked.state, TrackState::Lost);
        assert_eq!(tracked.covariance, None);
    }
    assert_eq!(
        player.live.volume().block_count(),
        blocks,
        "nothing was fused"
    );
    // Back at frame 5, far from where it was lost.
    let states: Vec<Tracked> = (5..15).map(|frame| player.see(&swing(frame))).collect();
    let found = states.iter().position(|t| t.state == TrackState::Ok);
    assert!(found.is_some_and(|frames| frames <= 3), "{found:?}");
    for (frame, tracked) in (5..15).zip(&states) {
        assert!(tracked.state != TrackState::Ok || is_right(tracked, &swing(frame)));
    }
    assert_eq!(states[9].map, 0);
}

#[test]
fn a_camera_that_finds_no_way_back_begins_another_world() {
    let mut player = Player::new(LiveConfig {
        new_map_after: 5,
        ..config()
    });
    for frame in 0..10 {
        player.see(&swing(frame));
    }
    // A ball alone, as nothing in the room.
    let elsewhere = |_: u32| shapes::depth(shapes::SPHERE, &shapes::camera(), &Pose::IDENTITY);
    let states: Vec<Tracked> = (0..12)
        .map(|frame| player.play(&elsewhere(frame)))
        .collect();
    assert!(states[..5].iter().all(|t| t.state == TrackState::Lost));
    assert_eq!(states[11].map, 1, "{:?}", states[11]);
    assert_ne!(states[11].state, TrackState::Lost);
    // The first world is not forgotten.
    let back: Vec<Tracked> = (3..9).map(|frame| player.see(&swing(frame))).collect();
    assert!(back.iter().any(|t| t.state == TrackState::Ok && t.map == 0));
    for (frame, tracked) in (3..9).zip(&back) {
        assert!(tracked.state != TrackState::Ok || is_right(tracked, &swing(frame)));
    }
}

#[test]
fn a_wall_alone_is_weak_and_says_where() {
    let mut player = Player::new(config());
    let wall = |z: f64| {
        let pose = Pose::from_translation(DVec3::new(0.0, 0.0, z));
        shapes::depth(shapes::PLANE, &shapes::camera(), &pose)
    };
    player.play(&wall(0.0));
    let tracked = player.play(&wall(0.002));
    assert_eq!(tracked.state, TrackState::Weak(0b01_1100), "{tracked:?}");
    let at = tracked.world_from_camera.translation();
    assert!((at.z - 0.002).abs() < 5e-4 && at.x.abs() < 1e-6 && at.y.abs() < 1e-6);
    let covariance = tracked.covariance.expect("a pose");
    // Sliding right is unsure by a centimetre, depth by less than a millimetre.
    assert!(
        covariance[15] > 5e-5 && covariance[20] < 1e-6,
        "{covariance:?}"
    );
}

#[test]
fn one_and_two_workers_give_the_same_bits() {
    let poses_with = |threads: usize| -> Vec<Tracked> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| {
            let mut player = Player::new(config());
            (0..12).map(|frame| player.see(&swing(frame))).collect()
        })
    };
    assert_eq!(poses_with(1), poses_with(2));
}

fn bounded(limit: usize) -> LiveConfig {
    LiveConfig {
        new_map_after: 3,
        volume: VolumeConfig {
            memory_limit_bytes: limit,
            ..config().volume
        },
        ..config()
    }
}

/// A room, then a ball that is nowhere in it.
fn room_and_ball(config: LiveConfig) -> (Player, usize, Tracked) {
    let mut player = Player::new(config);
    for frame in 0..3 {
        player.see(&swing(frame));
    }
    let held = player.live.memory_bytes();
    let ball = shapes::depth(shapes::SPHERE, &shapes::camera(), &Pose::IDENTITY);
    let last = (0..6).map(|_| player.play(&ball)).last().expect("frames");
    (player, held, last)
}

#[test]
fn worlds_share_one_memory() {
    let limit = 100 << 20;
    let (player, held, last) = room_and_ball(bounded(limit));
    assert_eq!(last.map, 1);
    assert_eq!(
        player.live.volume().config().memory_limit_bytes + held,
        limit
    );
    assert!(player.live.memory_bytes() > held);
}

#[test]
fn no_world_begins_without_memory() {
    let (player, held, last) = room_and_ball(bounded(64 << 20));
    assert_eq!((last.map, last.state), (0, TrackState::Lost));
    assert_eq!(player.live.memory_bytes(), held);
}

#[test]
fn colour_comes_in_where_only_every_second_frame_has_a_photograph() {
    let camera = Intrinsics::pinhole(160, 120, 150.0, 150.0, 79.5, 59.5).expect("usable");
    let depth = DepthImage::from_fn(160, 120, |x, y| {
        1.0 + 0.05 * ((x as f32 * 0.11).sin() + (y as f32 * 0.13).cos())
    });
    let photograph = vec![imaging::LinearPixel::from_radiance([0.5; 3], false); 160 * 120];
    let rig = LiveRig {
        depth_camera: camera,
        color_camera: Some(camera),
        color_from_depth: Pose::IDENTITY,
    };
    let config = LiveConfig {
        volume: VolumeConfig {
            voxel_size: 0.01,
            ..LiveConfig::default().volume
        },
        ..LiveConfig::default()
    };
    let mut live = LiveFusion::new(config, rig, Pose::IDENTITY).expect("usable");
    for frame in 0..6 {
        live.load(&depth, false);
        live.track(frame * INTERVAL, Effort::default());
        let color = (frame % 2 == 1).then_some(&photograph[..]);
        live.fuse(&depth, color).expect("a frame");
    }
    assert!(live.volume().has_color());
}
