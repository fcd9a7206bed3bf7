//! UVDAR: blinking ultraviolet markers on the deck, which a fisheye camera detects from beyond the tag's
//! range (Walter et al. 2019, "UVDAR system for visual relative localization").
//!
//! Rate and errors of fixes are fitted to the camera node on rendered markers (`study camera` at commit
//! 279526b7). All markers are lit in 58 of 100 images at any range. The error across the line of sight is a
//! length, not an angle; the distance error is proportional to the distance until the markers merge.
//!
//! ```text
//! bearing² = (b g)² + (a/r)²,  distance / r = d g,  g = max(1, r/far)^8
//! ```
//!
//! The node reports four times the actual error up to `far`.

use alight_shared::{
    config,
    frames::{Deck, DroneBody, Vector},
    msg::UvdarFix,
    time::{DroneClock, Time, TrueTime},
};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::{
    camera::{CameraMotion, CameraMount},
    noise::{GaussMarkovError, Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// UVDAR system. Its fixes are in the belly camera's frame.
    pub struct UvdarConfig {
        /// Fixes per second.
        pub rate_hz: f64 = 20.0, in 0.1..=100.0;
        /// Delay from exposure to delivery, s.
        pub latency_s: f64 = 0.05, in 0.0..=2.0;
        /// Maximum distance, m.
        /// Source: rendered markers, detected in 57 % of the images at 28 m and in 10 % at 34 m.
        pub max_range_m: f64 = 31.0, in 0.0..=500.0;
        /// Minimum distance, m, below which markers leave the image.
        pub min_range_m: f64 = 1.5, in 0.1..=500.0;
        /// Full cone angle of the fisheye lens, deg.
        /// Chosen: one lens covers directions from straight ahead to straight down and aft.
        pub fov_deg: f64 = 180.0, in 10.0..=360.0;
        /// Angle of the optical axis below the body's forward axis, deg.
        pub tilt_down_deg: f64 = 45.0, in 0.0..=90.0;
        /// Standard deviation of distant markers' bearing in each of two axes, deg: `b`.
        /// Source: rendered markers.
        pub bearing_sd_deg: f64 = 0.06, in 1e-3..=45.0;
        /// Standard deviation across the line of sight, in each of two axes, m: `a`.
        pub aside_sd_m: f64 = 0.024, in 0.0..=10.0;
        /// Standard deviation of the distance relative to the distance: `d`.
        pub distance_sd: f64 = 0.022, in 1e-4..=1.0;
        /// Distance beyond which bearing and distance errors grow with its eighth power, m: `far`.
        pub far_m: f64 = 24.0, in 0.1..=500.0;
        /// Minimum reported standard deviation of the bearing, deg.
        /// Source: the camera node.
        pub stated_bearing_sd_deg: f64 = 0.5, in 1e-3..=45.0;
        /// Reported standard deviation of the distance, relative to the distance.
        pub stated_distance_sd: f64 = 0.07, in 1e-4..=1.0;
        /// Correlation time of the distance error, s. The error is caused by the apparent geometry of the
        /// markers, which changes slowly.
        pub distance_correlation_s: f64 = 0.5, in 1e-3..=1e4;
        /// Probability that a fix is missing.
        /// Source: rendered markers; in these images one marker is dark.
        pub miss: f64 = 0.42, in 0.0..=1.0;
        /// Windows `[start, end)` without fixes, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

#[derive(Clone, Debug)]
pub(super) struct SimulatedUvdar {
    config: UvdarConfig,
    /// Optical axis in camera coordinates.
    axis: Vector3<f64>,
    distance: GaussMarkovError,
    bearing: Noise,
    miss: Noise,
    outlet: Outlet<UvdarFix, DroneClock>,
}

impl SimulatedUvdar {
    pub(super) fn new(
        config: &UvdarConfig,
        mount: &CameraMount,
        identity: SenderIdentity,
        streams: &Streams,
    ) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("drone.uvdar.{what}"));
        let (down, forward) = config.tilt_down_deg.to_radians().sin_cos();
        let axis = mount.attitude.inverse() * Vector::<DroneBody>::new(forward, 0.0, down);
        SimulatedUvdar {
            axis: axis.0,
            distance: GaussMarkovError::new(noise("distance"), 1.0, config.distance_correlation_s),
            bearing: noise("bearing"),
            miss: noise("miss"),
            outlet: Outlet::new(config.rate_hz, config.latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        view: &CameraMotion,
        deck: &RigidState<Deck>,
    ) -> Vec<UvdarFix> {
        if let Some(dt) = self.outlet.due(t) {
            let stretch = self.distance.step(dt).x;
            let turn = self.bearing.normal3();
            let missed = self.miss.chance(self.config.miss);
            let in_camera = view.to_camera_frame(deck.position);
            let [bearing, far] = self.config.sd(in_camera.norm());
            let above = deck.position.0.z > view.centre.0.z;
            let missed = missed || !above || !self.visible(in_camera);
            // The component along the line of sight has no effect.
            let turn = UnitQuaternion::from_scaled_axis(turn * bearing);
            let measured = turn * in_camera * (1.0 + far * stretch).max(0.1);
            let variance = self.variance(measured);
            self.outlet.send(t, missed, |header| {
                Some(UvdarFix {
                    header,
                    position: measured.into(),
                    variance: variance.into(),
                })
            });
        }
        self.outlet.arrived(t)
    }
    fn visible(&self, in_camera: Vector3<f64>) -> bool {
        let range = in_camera.norm();
        let cone = (0.5 * self.config.fov_deg).to_radians().cos();
        (self.config.min_range_m..=self.config.max_range_m).contains(&range)
            && self.axis.dot(&in_camera) >= range * cone
    }
    /// Diagonal of `r² (s_d² u u' + s_b² (I - u u'))`, camera axes, m².
    fn variance(&self, p: Vector3<f64>) -> Vector3<f64> {
        let [bearing, far] = self.config.stated(p.norm());
        let (along, across) = (far.powi(2), bearing.powi(2));
        let uu = p * p.transpose();
        (uu * along + (Matrix3::identity() * p.norm_squared() - uu) * across).diagonal()
    }
}

impl UvdarConfig {
    /// Standard deviations at a distance in metres: bearing, rad; distance, relative to the distance.
    pub fn sd(&self, range_m: f64) -> [f64; 2] {
        let factor = (range_m / self.far_m).max(1.0).powi(8);
        let aside = self.aside_sd_m / range_m.max(1e-3);
        [
            (self.bearing_sd_deg.to_radians() * factor).hypot(aside),
            self.distance_sd * factor,
        ]
    }
    fn stated(&self, range_m: f64) -> [f64; 2] {
        let [bearing, far] = self.sd(range_m);
        [
            bearing.max(self.stated_bearing_sd_deg.to_radians()),
            far.max(self.stated_distance_sd),
        ]
    }
}
