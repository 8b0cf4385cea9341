//! Tracking and fusion of one camera, frame by frame.
//!
//! ```text
//! load ─► track: prior ─► model view ─► ICP + photometry ─► verdict ─► (lost: keyframes) ─► fuse
//! ```
//! The three calls are apart so that a caller can time them and leave work out.

mod config;
mod relocalise;

use geometry::{DVec3, Pose};
use imaging::{DepthImage, LinearPixel, Registration};

pub use self::config::{Effort, LiveConfig, LiveRig};
use crate::error::LiveError;
use crate::model_view::ModelView;
use crate::tracking::points::half_camera;
use crate::tracking::{
    Alignment, GreyFrame, Icp, IcpInput, Keyframes, Motion, Photometric, PointPyramid, Thumbnail,
    TrackState, thumbnail,
};
use crate::volume::{IntegrateStats, Volume};

/// What is known of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// How sure it is.
    pub state: TrackState,
    /// World that the pose is in.
    pub map: u32,
    /// World from depth camera; the last that was known where the state is LOST.
    pub world_from_camera: Pose,
    /// Upper triangle by rows of rotation (radians) and translation (metres), camera axes.
    pub covariance: Option<[f32; 21]>,
    /// Share of the points that fall on the model.
    pub overlap: f64,
    /// Share of those that agree with it.
    pub agreement: f64,
    /// Whether the pose was found by looks.
    pub is_relocalised: bool,
}

/// One world: its surface, and the pose of its first frame.
struct Map {
    volume: Volume,
}

/// Where tracking stands.
enum Phase {
    /// Nothing seen yet.
    Empty,
    /// Each frame follows the one before.
    Following,
    /// A place was recognised; so many frames in a row agreed.
    Probation(u32),
    /// Nowhere; frames since then.
    Lost(u32),
}

/// Tracks and fuses one camera.
pub struct LiveFusion {
    config: LiveConfig,
    rig: LiveRig,
    start: Pose,
    maps: Vec<Map>,
    map: usize,
    phase: Phase,
    motion: Motion,
    icp: Icp,
    photometric: Photometric,
    points: PointPyramid,
    grey: Option<GreyFrame>,
    registration: Option<Registration>,
    registered: Vec<LinearPixel>,
    has_grey: bool,
    view: ModelView,
    now: Thumbnail,
    before: Thumbnail,
    keyframes: Keyframes,
    alike: Vec<(f64, usize)>,
    tracked: Tracked,
    last: Option<Alignment>,
    /// Photographs that were offered for fusion.
    photograph_count: u64,
}

impl LiveFusion {
    /// Starts at `start`, the pose of the first frame that holds enough depth.
    ///
    /// # Errors
    /// Settings that a volume refuses.
    pub fn new(config: LiveConfig, rig: LiveRig, start: Pose) -> Result<Self, LiveError> {
        let points = PointPyramid::new(&rig.depth_camera, config.level_count, config.noise);
        let view_camera = points
            .levels()
            .first()
            .map_or(rig.depth_camera, |level| level.camera);
        let depth_camera = &rig.depth_camera;
        let registration = match &rig.color_camera {
            Some(color) => Some(Registration::new(
                depth_camera,
                color,
                &rig.color_from_depth,
            )?),
            None => None,
        };
        let grey = rig
            .color_camera
            .and_then(|camera| half_camera(&camera))
            .map(|camera| GreyFrame::new(&camera, rig.color_from_depth, config.level_count));
        let pixel_count = rig.depth_camera.width() as usize * rig.depth_camera.height() as usize;
        let mut volume = Volume::new(config.volume.clone())?;
        volume.reserve(config.reserved_blocks, rig.color_camera.is_some());
        let first = Map { volume };
        Ok(Self {
            icp: Icp::new(config.icp.clone()),
            keyframes: Keyframes::new(config.keyframes),
            rig,
            start,
            maps: vec![first],
            map: 0,
            phase: Phase::Empty,
            motion: Motion::at_rest(start, 0),
            photometric: Photometric::default(),
            points,
            grey,
            registered: match &registration {
                Some(_) => vec![LinearPixel::INVALID; pixel_count],
                None => Vec::new(),
            },
            registration,
            has_grey: false,
            view: ModelView::new(&view_camera, &start),
            now: Thumbnail::default(),
            before: Thumbnail::default(),
            alike: Vec::new(),
            last: None,
            photograph_count: 0,
            tracked: Tracked {
                state: TrackState::Lost,
                map: 0,
                world_from_camera: start,
                covariance: None,
                overlap: 0.0,
                agreement: 0.0,
                is_relocalised: false,
            },
            config,
        })
    }

    /// Where the half-size luminance of the frame's photograph goes before [`LiveFusion::load_photograph`]: linear,
    /// 0 = unknown or saturated, as [`imaging::develop::Developer::develop`] writes it. `None` where the rig has no colour camera.
    pub fn grey_mut(&mut self) -> Option<&mut imaging::Image<f32>> {
        self.grey.as_mut().map(GreyFrame::finest_mut)
    }

    /// Takes a frame: [`LiveFusion::load_depth`], then [`LiveFusion::load_photograph`].
    pub fn load(&mut self, depth: &DepthImage, has_grey: bool) {
        self.load_depth(depth);
        self.load_photograph(has_grey);
    }

    /// Takes the depth of a frame: metres along z in the pinhole of [`LiveRig::depth_camera`], 0 = no measurement.
    pub fn load_depth(&mut self, depth: &DepthImage) {
        self.points.load(depth);
    }

    /// Takes the photograph of the frame whose depth was loaded: whether its luminance was written.
    pub fn load_photograph(&mut self, has_grey: bool) {
        self.has_grey = has_grey && self.grey.is_some();
        if let Some(grey) = self.grey.as_mut().filter(|_| has_grey) {
            grey.finish();
        }
        std::mem::swap(&mut self.now, &mut self.before);
        let image = self.grey.as_ref().filter(|_| self.has_grey);
        let image = image.and_then(|grey| grey.levels.get(1).or(grey.levels.first()));
        self.now
            .load(self.points.depth(), image.map(|(_, image)| image));
    }

    /// Finds the camera. Call after the frame was loaded.
    pub fn track(&mut self, time_nanos: i64, effort: Effort) -> Tracked {
        let is_measured = self.points.levels().first().is_some_and(|level| {
            level.points.measured_count() as f64 >= self.config.gates.least_inliers
        });
        self.tracked.is_relocalised = false;
        if !is_measured {
            return self.lose(time_nanos);
        }
        match self.phase {
            Phase::Empty => {
                self.motion = Motion::at_rest(self.start, time_nanos);
                self.phase = Phase::Following;
                self.tracked = Tracked {
                    state: TrackState::Ok,
                    map: self.map as u32,
                    world_from_camera: self.start,
                    covariance: Some([0.0; 21]),
                    overlap: 1.0,
                    agreement: 1.0,
                    is_relocalised: false,
                };
                self.tracked
            }
            Phase::Following => self.follow(time_nanos, effort),
            Phase::Probation(count) => self.prove(time_nanos, effort, count),
            Phase::Lost(count) => self.search(time_nanos, effort, count),
        }
    }

    /// Fuses the frame that was tracked, unless it is lost (`None`); also keeps keyframes. `depth` as for
    /// [`LiveFusion::load`]; `color`: the developed photograph in the colour camera's grid, which is registered
    /// here; one in [`LiveConfig::color_stride`] counts.
    ///
    /// # Errors
    /// When an image has not the size of its camera.
    pub fn fuse(
        &mut self,
        depth: &DepthImage,
        color: Option<&[LinearPixel]>,
    ) -> Result<Option<IntegrateStats>, LiveError> {
        if self.tracked.state == TrackState::Lost {
            return Ok(None);
        }
        let pose = self.tracked.world_from_camera;
        let volume = &mut self.maps[self.map].volume;
        let camera = &self.rig.depth_camera;
        let stride = u64::from(self.config.color_stride.get());
        // Photographs are counted, not frames: where only every second frame has one, it must not be the wrong one.
        let turn = self.photograph_count;
        self.photograph_count += u64::from(color.is_some());
        let color = color.filter(|_| turn.is_multiple_of(stride));
        let stats = match (color, &mut self.registration) {
            (Some(color), Some(registration)) => {
                registration.register(depth.pixels(), color, &mut self.registered)?;
                volume.integrate_colored(depth.pixels(), &self.registered, camera, &pose)?
            }
            _ => volume.integrate(depth.pixels(), camera, &pose)?,
        };
        if self.tracked.state == TrackState::Ok {
            self.keyframes.offer(self.map as u32, &pose, &self.now);
        }
        Ok(Some(stats))
    }

    /// The last alignment that was tried, whether it was believed or not.
    pub fn last_alignment(&self) -> Option<&Alignment> {
        self.last.as_ref()
    }

    /// Bytes that all maps hold; [`crate::VolumeConfig::memory_limit_bytes`] bounds them together.
    pub fn memory_bytes(&self) -> usize {
        self.maps.iter().map(|map| map.volume.memory_bytes()).sum()
    }

    /// What the model looked like for the last alignment.
    pub fn view(&self) -> &ModelView {
        &self.view
    }

    /// The surface of the map at hand.
    pub fn volume(&self) -> &Volume {
        &self.maps[self.map].volume
    }

    /// The surface of the map with this id, as [`Tracked::map`] names it.
    pub fn map_volume(&self, map: u32) -> Option<&Volume> {
        self.maps.get(map as usize).map(|map| &map.volume)
    }

    fn follow(&mut self, time_nanos: i64, effort: Effort) -> Tracked {
        let prior = self.motion.predicted(time_nanos);
        match self.aligned(&prior, effort) {
            Some((alignment, state)) if state != TrackState::Lost => {
                self.accept(&alignment, state, time_nanos);
                self.tracked
            }
            _ => {
                self.phase = Phase::Lost(0);
                self.lose(time_nanos)
            }
        }
    }

    /// The best alignment from `prior` and from where the photographs say the camera turned to.
    fn aligned(&mut self, prior: &Pose, effort: Effort) -> Option<(Alignment, TrackState)> {
        self.predict(prior, effort);
        let mut starts = [Some(Pose::IDENTITY), None, None];
        let rest = prior.inverse() * self.motion.world_from_camera;
        if let Some(turned) = self.turned(&rest) {
            starts[1] = Some(turned);
        }
        starts[2] = Some(rest);
        let input = IcpInput {
            points: &self.points,
            view: &self.view,
            grey: None,
        };
        let pass_count = self.icp.config().passes.len();
        let mut best: Option<Alignment> = None;
        for start in starts.into_iter().flatten() {
            let found = self.icp.align(input, &mut self.photometric, start, 0..1);
            if let Some(found) = found
                && best
                    .as_ref()
                    .is_none_or(|best| found.cost < 0.98 * best.cost)
            {
                best = Some(found);
            }
        }
        let coarse = best?;
        // Photographs decide what shape leaves open; where nothing is open, what the model looks like is not needed.
        let knee = self.icp.config().photometric_knee;
        let grey = self.grey.as_ref().filter(|_| self.has_grey);
        let grey = grey.filter(|_| coarse.equations.has_open(knee));
        if grey.is_some() {
            self.maps[self.map].volume.shade(&mut self.view);
        }
        let input = IcpInput {
            points: &self.points,
            view: &self.view,
            grey,
        };
        let last = pass_count - usize::from(effort.skip_finest && pass_count > 2);
        let alignment = self
            .icp
            .align(
                input,
                &mut self.photometric,
                coarse.view_from_live,
                1..last.max(1),
            )
            .unwrap_or(coarse);
        self.last = Some(alignment);
        let state = self.config.gates.state(&alignment, &Pose::IDENTITY);
        Some((alignment, state))
    }

    /// Start of the alignment by rotation alone: the last position, turned as the photographs say.
    fn turned(&self, view_from_last: &Pose) -> Option<Pose> {
        let grey = self.grey.as_ref().filter(|_| self.has_grey)?;
        let (camera, _) = &grey.levels[0];
        let color_from_depth = self.rig.color_from_depth.rotation();
        // now_from_before of the depth camera at constant velocity.
        let expected = view_from_last.rotation();
        let start = color_from_depth * expected * color_from_depth.inverse();
        let turn = thumbnail::rotation_between(&self.before, &self.now, camera, start)?;
        let now_from_before = color_from_depth.inverse() * turn * color_from_depth;
        let view_from_now = view_from_last.rotation() * now_from_before.inverse();
        Pose::new(view_from_now, DVec3::ZERO).ok()
    }

    fn predict(&mut self, world_from_camera: &Pose, effort: Effort) {
        let level = self.config.view_level + usize::from(effort.coarse_view);
        let level = level.min(self.points.levels().len() - 1);
        let level = &self.points.levels()[level];
        self.maps[self.map].volume.predict_near(
            &level.camera,
            world_from_camera,
            level.points.depth(),
            &mut self.view,
        );
    }

    fn accept(&mut self, alignment: &Alignment, state: TrackState, time_nanos: i64) {
        let mut pose = self.view.world_from_camera * alignment.view_from_live;
        let change = self.motion.world_from_camera.inverse() * pose;
        // A camera that stands still stays where it is, or pairs that change sides at the border of a pixel make it
        // wander (hard-cases C12).
        if change.translation().length() < STANDSTILL
            && geometry::rotation::log(change.rotation()).length() < STANDSTILL
        {
            pose = self.motion.world_from_camera;
        }
        self.motion.arrive(pose, time_nanos);
        let met = f64::from(alignment.sums.met_count).max(1.0);
        self.tracked = Tracked {
            state,
            map: self.map as u32,
            world_from_camera: pose,
            covariance: Some(covariance(alignment)),
            overlap: met / alignment.point_count.max(1) as f64,
            agreement: f64::from(alignment.sums.inlier_count) / met,
            is_relocalised: false,
        };
    }

    fn lose(&mut self, _time_nanos: i64) -> Tracked {
        if !matches!(self.phase, Phase::Empty | Phase::Lost(_)) {
            self.phase = Phase::Lost(0);
        }
        self.tracked.state = TrackState::Lost;
        self.tracked.covariance = None;
        self.tracked
    }
}

/// Motion between two frames, metres and radians, that is none: a tenth of a millimetre is far below what the sensor
/// shows, and what is left grows until it is seen.
const STANDSTILL: f64 = 1e-4;
/// Residuals of neighbouring points are alike, so the equations promise too much by about this factor.
const CORRELATED_POINTS: f64 = 50.0;
/// Standard deviation of a direction that nothing observes, metres at the root mean square radius: how far a hand
/// strays from constant velocity in a frame.
const PRIOR_SIGMA: f64 = 0.01;

/// Covariance of rotation (radians) and translation (metres) of the live camera in its own axes.
fn covariance(alignment: &Alignment) -> [f32; 21] {
    let solution = &alignment.solution;
    let arm = alignment.view_from_live.translation() - alignment.center;
    let live_from_view = alignment.view_from_live.matrix().transpose();
    let mut sum = [[0.0; 6]; 6];
    for (index, (value, vector)) in solution
        .eigen
        .values
        .iter()
        .zip(&solution.eigen.vectors)
        .enumerate()
    {
        let prior = PRIOR_SIGMA * PRIOR_SIGMA;
        let variance = if index < solution.rank {
            (CORRELATED_POINTS / value).min(prior)
        } else {
            prior
        };
        let turn = DVec3::new(vector[0], vector[1], vector[2]) / alignment.radius;
        let shift = DVec3::new(vector[3], vector[4], vector[5]) + turn.cross(arm);
        let (turn, shift) = (live_from_view * turn, live_from_view * shift);
        let motion = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        for row in 0..6 {
            for column in row..6 {
                sum[row][column] += variance * motion[row] * motion[column];
            }
        }
    }
    let mut triangle = [0.0; 21];
    let mut place = 0;
    for (row, values) in sum.iter().enumerate() {
        for &value in &values[row..] {
            triangle[place] = value as f32;
            place += 1;
        }
    }
    triangle
}
