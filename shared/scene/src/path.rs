//! Paths of a camera held by hand: an arc around the object, with sway and shake, as a function of time.

use geometry::{DVec3, Pose, direction, rotation};

use crate::random::{Purpose, Stream};

/// A walk around an object. Angles in degrees, azimuth 0 in front of the object (on −z), growing towards +x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandHeld {
    /// What the camera looks at, metres.
    pub center: DVec3,
    /// Distance of the camera, metres.
    pub distance: f64,
    /// Azimuth at the start.
    pub start_deg: f64,
    /// Azimuth a second.
    pub speed_deg: f64,
    /// Mean elevation.
    pub elevation_deg: f64,
    /// Amplitude of the slow rise and fall.
    pub sway_deg: f64,
    /// Amplitude of the hand's shake, metres; its rotation follows (half a degree a centimetre).
    pub shake: f64,
    /// Chooses the shake.
    pub seed: u64,
}

/// Frequencies of the shake, 1/s.
const SHAKE_HZ: [f64; 4] = [0.31, 0.83, 1.7, 2.9];

impl HandHeld {
    /// World from camera at a time in seconds.
    pub fn pose(&self, seconds: f64) -> Pose {
        let azimuth = (self.start_deg + self.speed_deg * seconds).to_radians();
        let sway = (0.9 * seconds).sin() + 0.35 * (2.3 * seconds + 1.0).sin();
        let elevation = (self.elevation_deg + self.sway_deg * sway).to_radians();
        let distance = self.distance * (1.0 + 0.06 * (0.7 * seconds).sin());
        let away = DVec3::new(
            elevation.cos() * azimuth.sin(),
            -elevation.sin(),
            -elevation.cos() * azimuth.cos(),
        );
        let eye = self.center + distance * away + self.shake * self.wobble(0, seconds);
        let aim = self.center + 1.5 * self.shake * self.wobble(1, seconds);
        let upright = direction::look_along(aim - eye, DVec3::Y).unwrap_or(glam::DMat3::IDENTITY);
        let twist = rotation::exp((50.0 * self.shake).to_radians() * self.wobble(2, seconds));
        let base = rotation::from_matrix(upright);
        Pose::new((base * twist).normalize(), eye).unwrap_or(Pose::IDENTITY)
    }

    /// Smooth, each axis within about ±1.
    fn wobble(&self, which: u64, seconds: f64) -> DVec3 {
        let mut random = Stream::new(self.seed, Purpose::Design, 1, which);
        let mut axis = || {
            SHAKE_HZ
                .iter()
                .map(|hz| {
                    let phase = std::f64::consts::TAU * f64::from(random.unit());
                    (std::f64::consts::TAU * hz * seconds + phase).sin() * 0.4 / hz.sqrt().max(0.6)
                })
                .sum::<f64>()
        };
        DVec3::new(axis(), axis(), axis())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path() -> HandHeld {
        HandHeld {
            center: DVec3::new(0.0, -0.1, 0.0),
            distance: 0.65,
            start_deg: -60.0,
            speed_deg: 12.0,
            elevation_deg: 35.0,
            sway_deg: 10.0,
            shake: 0.004,
            seed: 1,
        }
    }

    #[test]
    fn the_camera_looks_at_the_object_and_moves_smoothly() {
        let path = path();
        let mut last: Option<Pose> = None;
        for step in 0..120 {
            let pose = path.pose(0.1 * f64::from(step));
            let seen = pose.inverse().transform_point(path.center);
            assert!(seen.z > 0.5 && seen.truncate().length() < 0.05, "{seen}");
            // World −y is up in the picture.
            assert!(pose.transform_vector(DVec3::Y).y > 0.5);
            if let Some(last) = last {
                let moved = (pose.translation() - last.translation()).length();
                assert!(moved < 0.03, "{moved} m in a tenth of a second");
            }
            last = Some(pose);
        }
    }
}
