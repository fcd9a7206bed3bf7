//! Modes of a vessel without radio, identified by the drone from camera and rangefinder.
//!
//! A separate filter with the broad default oscillators samples the deck's motion ten times per second for the model
//! with which a vessel identifies its own motion ([`alight_shared::motion_model`]). The result is extrapolated as if
//! received by radio. The forecast's own filter cannot serve here: it would only reproduce the modes that it assumes.

use alight_shared::{
    admission::Periodic,
    apparent_slope::{self, ApparentSlope},
    motion_model::{MotionModel, MotionSample},
    msg::{DeckStage, PREDICTION_STAGES, SLOPE_WINDOWS, Seq},
    time::{DroneClock, DroneTime, Span},
};
use nalgebra::{Rotation2, UnitQuaternion, Vector3};

use super::{
    axis::{Axis, AxisNoise, HEAD, MEAN, MeasurementRow, VISION},
    config::PredictorConfig,
    filter::{Filter, FilterState, Fused},
    observation::DeckObservation,
    track::FrameJump,
    waves::{AXES, Oscillator, Spread, Waves},
};

/// Age of the sampled state, so that late images are included.
const SAMPLE_AGE: Span = Span::from_millis(80);
/// Time without a detection after which the deck is not sampled, s, because only the filter's own motion remains.
const UNOBSERVED_S: f64 = 0.5;
/// Observation time after which the modes are used, s. After 30 s the measured error is still underestimated: 2 of 12
/// landings on a 12 m hull in a sea of 1 m were hard; after 60 s none was. A vessel needs as long to identify its own
/// motion.
const IDENTIFIED_S: f64 = 60.0;
/// Time between two stages of the measured prediction error, s.
const STAGE_S: f64 = 0.25;

#[derive(Clone, Debug)]
pub(super) struct OwnModel {
    waves: Waves,
    filter: Option<Filter>,
    motion: MotionModel<DroneClock>,
    observed_at: Option<DroneTime>,
    slope: (Periodic<DroneClock>, ApparentSlope<DroneClock>),
}

impl OwnModel {
    pub(super) fn new(c: &PredictorConfig) -> Self {
        OwnModel {
            waves: Waves::new(c),
            filter: None,
            motion: MotionModel::default(),
            observed_at: None,
            slope: Default::default(),
        }
    }
    /// Fuses an observation. The first observation takes the camera's rotation from the forecast's filter, where the
    /// radio makes it observable.
    pub(super) fn fuse(&mut self, c: &PredictorConfig, o: &DeckObservation, known: Option<&FilterState>) {
        let waves = &self.waves;
        let filter = self.filter.get_or_insert_with(|| {
            let mut begun = Filter::new(AxisNoise::all(c), c.gate_sd, waves, o);
            if let Some(k) = known {
                begun.adopt_mount(k);
            }
            begun
        });
        if filter.fuse(waves, o) == Fused::All {
            self.observed_at = self.observed_at.max(Some(o.at));
        }
    }
    pub(super) fn shift(&mut self, jump: &FrameJump) {
        if let Some(f) = &mut self.filter {
            f.shift(jump);
        }
    }
    /// Advances to `now`. Returns whether there are newer modes.
    pub(super) fn step(&mut self, now: DroneTime, lever_arm: &Vector3<f64>) -> bool {
        // The heading only rotates modes, and this filter has none.
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
    /// Records the current deck for the apparent slopes.
    pub(super) fn watch(&mut self, now: DroneTime, deck: &DeckStage) {
        let (next, slope) = &mut self.slope;
        if next.is_due(now, Span::from_secs(1.0 / apparent_slope::RATE_HZ)) {
            let [roll, pitch, yaw] = deck.euler;
            let attitude = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            slope.push(now, &attitude, Vector3::from(deck.velocity));
        }
    }
    /// Steepest recent apparent slopes, in the form that a vessel reports.
    pub(super) fn slopes(&self, now: DroneTime) -> Seq<u8, SLOPE_WINDOWS> {
        self.slope.1.slopes(now)
    }
    /// Passes the identified modes and their measured error to `waves`. Returns their time of validity and whether they
    /// replace the default oscillators. None until enough motion has been observed.
    pub(super) fn publish(&self, waves: &mut Waves) -> Option<(DroneTime, bool)> {
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

/// Motion of the vessel's reference point about its mean, from a deck whose centre is at `lever_arm` (m, vessel's
/// axes).
fn sample(
    at: DroneTime,
    axes: &FilterState,
    oscillators: &[Oscillator],
    lever_arm: &Vector3<f64>,
) -> MotionSample<DroneClock> {
    let motion: [[f64; 3]; AXES] = core::array::from_fn(|i| waves_of(&axes[i], oscillators, i));
    let mean_heading = axes[5].x[MEAN] + axes[5].x[VISION];
    let level = Rotation2::new(mean_heading) * lever_arm.xy();
    // Inverse of the deck's placement on the vessel in `Waves`.
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

/// Value, rate and acceleration of the sum of the oscillators.
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
    use alight_shared::time::Time;
    use core::f64::consts::FRAC_PI_2;

    /// A vessel heads east and pitches and yaws about its reference point, so its deck 4 m aft and 1.3 m up swings.
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
        let about_north = [0.02, -0.05];
        let about_east = [0.1, 0.07];
        let yaw = [0.03, 0.04];
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
