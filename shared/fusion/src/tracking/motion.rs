//! Where the camera should be now: constant velocity by time.

use geometry::{DVec3, Pose, rotation};

/// Longest time over which velocity is believed, seconds; a hand turns round in less than a second.
const LONGEST_SECONDS: f64 = 0.25;

/// Predicted motion below which the camera is expected to rest: metres and radians.
const LEAST_SHIFT: f64 = 5e-4;
const LEAST_TURN: f64 = 5e-4;

/// The last pose, and how the camera moved there.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// The last pose.
    pub world_from_camera: Pose,
    /// Its time, nanoseconds.
    pub time_nanos: i64,
    /// Rotation vector (radians) and translation (metres) a second, camera axes.
    velocity: (DVec3, DVec3),
}

impl Motion {
    /// A camera at rest.
    pub fn at_rest(world_from_camera: Pose, time_nanos: i64) -> Self {
        Self {
            world_from_camera,
            time_nanos,
            velocity: (DVec3::ZERO, DVec3::ZERO),
        }
    }

    /// The pose at a time, if the camera goes on as it did.
    ///
    /// Less than [`LEAST_SHIFT`] and [`LEAST_TURN`] is noise of the last pose: then it stands still, and a camera at
    /// rest comes to rest (hard-cases C12).
    pub fn predicted(&self, time_nanos: i64) -> Pose {
        let seconds = self.seconds_to(time_nanos).clamp(0.0, LONGEST_SECONDS);
        let (turn, shift) = (self.velocity.0 * seconds, self.velocity.1 * seconds);
        if turn.length() < LEAST_TURN && shift.length() < LEAST_SHIFT {
            return self.world_from_camera;
        }
        self.world_from_camera * rotation::exp_twist(turn, shift)
    }

    /// Goes on to a pose that was found.
    pub fn arrive(&mut self, world_from_camera: Pose, time_nanos: i64) {
        let seconds = self.seconds_to(time_nanos);
        let change = self.world_from_camera.inverse() * world_from_camera;
        self.velocity = if seconds > 0.0 && seconds <= LONGEST_SECONDS {
            let (turn, shift) = rotation::log_twist(&change);
            (turn / seconds, shift / seconds)
        } else {
            (DVec3::ZERO, DVec3::ZERO)
        };
        self.world_from_camera = world_from_camera;
        self.time_nanos = time_nanos;
    }

    fn seconds_to(&self, time_nanos: i64) -> f64 {
        time_nanos.saturating_sub(self.time_nanos) as f64 * 1e-9
    }
}
