//! The vessel's modes as the drone identifies them itself, by what camera and rangefinder see of the deck: for a vessel that
//! is silent, and for one whose radio has gone silent.
//!
//! A filter of its own, with the broad bank of oscillators, gives the deck's motion ten times a second to the same model by
//! which a vessel identifies its own ([`alight_shared::motion_model`]); what that finds is rolled on as if it had come by radio.
//! The filter that the forecast is made of would not do: it moves about the modes, and would find them again.

use alight_shared::admission::Periodic;
use alight_shared::apparent_slope::{self, ApparentSlope};
use alight_shared::motion_model::{MotionModel, MotionSample};
use alight_shared::msg::{DeckStage, PREDICTION_STAGES, SLOPE_WINDOWS, Seq};
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{Rotation2, UnitQuaternion, Vector3};

use super::axis::{Axis, AxisNoise, HEAD, MEAN, MeasurementRow, VISION};
use super::config::PredictorConfig;
use super::filter::{Filter, FilterState, Fused};
use super::observation::DeckObservation;
use super::track::FrameJump;
use super::waves::{AXES, Oscillator, Spread, Waves};

/// A sample is the state so long ago, s: images have come by then.
const SAMPLE_AGE: Span = Span::from_millis(80);
/// A deck that was not detected for so long is not sampled: its motion would be the filter's own, s.
const UNOBSERVED_S: f64 = 0.5;
/// Time of observing the deck after which its modes count, s: after 30 s the measured error is still too small, and 2 of 12
/// landings on a 12 m hull in a sea of 1 m were hard; after 60 s none of 12, and it is the time in which a vessel identifies
/// its own.
const IDENTIFIED_S: f64 = 60.0;
/// Time between two stages of the measured error, s.
const STAGE_S: f64 = 0.25;

/// Filter and model of the deck's motion by vision alone.
#[derive(Clone, Debug)]
pub(super) struct OwnModel {
    waves: Waves,
    filter: Option<Filter>,
    motion: MotionModel<DroneClock>,
    observed_at: Option<Time<DroneClock>>,
    slope: (Periodic<DroneClock>, ApparentSlope<DroneClock>),
}

impl OwnModel {
    /// A model without observations.
    pub(super) fn new(c: &PredictorConfig) -> Self {
        OwnModel {
            waves: Waves::new(c),
            filter: None,
            motion: MotionModel::default(),
            observed_at: None,
            slope: Default::default(),
        }
    }
    /// Takes an observation. A first one begins with the camera's rotation as the forecast's filter knows it by the radio.
    pub(super) fn fuse(&mut self, c: &PredictorConfig, o: &DeckObservation, known: Option<&FilterState>) {
        let waves = &self.waves;
        let filter = self.filter.get_or_insert_with(|| {
            let mut begun = Filter::new(AxisNoise::all(c), c.gate_sd, waves, o);
            known.into_iter().for_each(|k| begun.adopt_mount(k));
            begun
        });
        if filter.fuse(waves, o) == Fused::All {
            self.observed_at = self.observed_at.max(Some(o.at));
        }
    }
    /// The autopilot's estimate has jumped.
    pub(super) fn shift(&mut self, jump: &FrameJump) {
        if let Some(f) = &mut self.filter {
            f.shift(jump);
        }
    }
    /// Goes on to `now`; true when there is a newer sample, and with it newer modes.
    pub(super) fn step(&mut self, now: Time<DroneClock>, lever_arm: &Vector3<f64>) -> bool {
        // By its heading only modes are turned, of which it has none.
        self.waves.set_lever_arm(*lever_arm, 0.0);
        self.motion.work();
        let Some(filter) = self.filter.as_ref().filter(|f| f.is_finite()) else {
            self.filter = None;
            return false;
        };
        let at = now - SAMPLE_AGE;
        let recent = self.observed_at.is_some_and(|t| (now - t).secs() < UNOBSERVED_S);
        if !recent || at < filter.started() || !self.motion.is_due(at) {
            return false;
        }
        let axes = filter.at(&self.waves, at);
        let oscillators = self.waves.oscillators(at);
        self.motion.push(sample(at, &axes, &oscillators, lever_arm));
        true
    }
    /// The deck as it is now.
    pub(super) fn watch(&mut self, now: Time<DroneClock>, deck: &DeckStage) {
        let (next, slope) = &mut self.slope;
        if next.is_due(now, Span::from_secs(1.0 / apparent_slope::RATE_HZ)) {
            let [roll, pitch, yaw] = deck.euler;
            let attitude = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            slope.push(now, &attitude, Vector3::from(deck.velocity));
        }
    }
    /// Steepest recent apparent slopes, as a vessel would report them.
    pub(super) fn slopes(&self, now: Time<DroneClock>) -> Seq<u8, SLOPE_WINDOWS> {
        self.slope.1.slopes(now)
    }
    /// Gives its modes and what they are off by to `waves`: their time of validity, and whether a bank of oscillators has gone
    /// there. None before it has observed enough of the motion.
    pub(super) fn publish(&self, waves: &mut Waves) -> Option<(Time<DroneClock>, bool)> {
        let identified = self.motion.is_identified() && self.motion.observed_s() >= IDENTIFIED_S;
        let modes = self.motion.modes().filter(|_| identified)?;
        let stage = |k: usize| self.motion.spread(k as f64 * STAGE_S);
        waves.set_spread(Spread {
            stages: Seq::filled((0..PREDICTION_STAGES).map(stage)),
            step_s: STAGE_S,
        });
        if let Some(newest) = self.motion.newest() {
            waves.turn(newest.mean_heading);
        }
        Some((modes.at, waves.adopt(modes.clone(), self.motion.confidence())))
    }
}

/// The motion of the vessel's reference point about its mean, by the state of the filter of a deck whose centre is at
/// `lever_arm` (m) in the vessel's axes.
fn sample(
    at: Time<DroneClock>,
    axes: &FilterState,
    oscillators: &[Oscillator],
    lever_arm: &Vector3<f64>,
) -> MotionSample<DroneClock> {
    let motion: [[f64; 3]; AXES] = core::array::from_fn(|i| waves_of(&axes[i], oscillators, i));
    let mean_heading = axes[5].x[MEAN] + axes[5].x[VISION];
    let level = Rotation2::new(mean_heading) * lever_arm.xy();
    // As `Waves` places the deck on the vessel, backwards.
    let north = |k: usize| motion[0][k] - motion[4][k] * lever_arm.z + motion[5][k] * level.y;
    let east = |k: usize| motion[1][k] + motion[3][k] * lever_arm.z - motion[5][k] * level.x;
    let tilt = |i: usize| axes[i].project(MeasurementRow::Level).0;
    MotionSample {
        at,
        mean_heading,
        value: [north(1), east(1), motion[2][0], tilt(3), tilt(4), motion[5][0]],
        rate: [motion[2][1], motion[3][1], motion[4][1], north(2), east(2)],
        level_variance: axes[2].project(MeasurementRow::Residual).1,
    }
}

/// Value, rate and acceleration of the oscillators' sum.
fn waves_of(axis: &Axis, oscillators: &[Oscillator], i: usize) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (k, o) in oscillators.iter().enumerate() {
        let [value, rate] = [0, 1].map(|j| axis.x[HEAD + 2 * k + j]);
        sum[0] += value;
        sum[1] += rate;
        sum[2] -= o.omega * o.omega * value + 2.0 * o.damping[i] * o.omega * rate;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    /// A vessel that heads east and pitches and yaws about its reference point, with its deck 4 m aft and 1.3 m up: the deck's
    /// centre swings, and the reference point stays.
    #[test]
    fn motion_of_a_deck_off_the_reference_point() {
        let c = PredictorConfig::default();
        let oscillators = [Oscillator {
            omega: 1.3,
            damping: [0.1; AXES],
            sd: [1.0; AXES],
        }];
        let lever_arm = Vector3::new(-4.0, 0.0, -1.3);
        let noise = AxisNoise::all(&c);
        let mut axes: FilterState =
            core::array::from_fn(|i| Axis::new(&noise[i], &oscillators, i, 0.0, 0.1, 0.1));
        axes[5].x[MEAN] = FRAC_PI_2;
        let (about_north, about_east, yaw) = ([0.02, -0.05], [0.1, 0.07], [0.03, 0.04]);
        for (axis, motion) in [(3, about_north), (4, about_east), (5, yaw)] {
            axes[axis].x[HEAD..HEAD + 2].copy_from_slice(&motion);
        }
        // Aft of a vessel that heads east is west: (0, -4).
        for k in 0..2 {
            axes[0].x[HEAD + k] = lever_arm.z * about_east[k] + 4.0 * yaw[k];
            axes[1].x[HEAD + k] = -lever_arm.z * about_north[k];
        }
        let s = sample(Time::EPOCH, &axes, &oscillators, &lever_arm);
        let [north, east, _, roll, pitch, heading] = s.value;
        assert!(north.abs() < 1e-12 && east.abs() < 1e-12, "{s:?}");
        assert!(s.rate[3].abs() < 1e-12 && s.rate[4].abs() < 1e-12, "{s:?}");
        assert_eq!([roll, pitch, heading], [about_north[0], about_east[0], yaw[0]]);
    }
}
