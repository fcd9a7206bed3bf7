//! Position of the deck's centre from a receiver with the vessel as its moving base, confirmed by tags.
//!
//! Let `p` and `R` be the drone's position and attitude in its odometry, `a` (drone) and `v` (vessel, from the deck's
//! centre) the lever arms of the antennas, `Q` the vessel's attitude from the filters, and `b` the measured baseline,
//! NED. The deck's centre is `p + R a - b - Q v`. Like a detection it is in the odometry's frame, has vision's slow
//! error, and leaves the odometry's drift observable. The rotation of the camera does not affect it.
//!
//! A false fixed solution states centimetres and is wrong by decimetres for as long as it lasts, so each tag detection
//! is compared with the relative position. If they agree within `0.15 m + 3 sd`, the relative position is confirmed and
//! may replace missing detections. Otherwise it is contradicted: the tags are used, and the relative position is
//! ignored until a new solution agrees with the tags, or until there has been no fixed solution for some seconds. A
//! single float solution proves nothing, because the receiver may return to the same false ambiguities.

use alight_shared::{
    estimation::low_pass_gain,
    msg::{CarrierSolution, RelativePlace, RelativeState},
    time::DroneTime,
};
use nalgebra::Vector3;

use super::{
    config::PredictorConfig,
    observation::{DeckObservation, ObservationKind, Plane},
    track::Pose,
    waves::AXES,
};

/// Maximum stated standard deviation of a usable fixed solution, per component, m.
const MAX_SD_M: f64 = 0.1;
/// Minimum standard deviation of the deck's position, m: multipath and antenna phase centres.
const MIN_SD_M: f64 = 0.02;
/// Time without a fixed solution after which the next one is independent of the last, s.
const GONE_S: f64 = 10.0;
/// Time after the last fused relative position for which the filter is based on it, s.
const IN_USE_S: f64 = 1.0;
/// Maximum time between a detection and the compared relative position, s.
const PAIR_S: f64 = 0.3;
/// Time constant of the mean difference and maximum gap between its detections, s; and minimum number of detections.
const MEAN_TIME_S: f64 = 1.0;
const MIN_DETECTIONS: f64 = 5.0;
/// Tolerated difference in addition to a multiple of its standard deviation, m, for errors in the measured positions of
/// tags and antennas; and that multiple.
const APART_M: f64 = 0.15;
const APART_SD: f64 = 3.0;
/// Maximum uncertainty of a comparison that confirms the relative position, m; a touchdown still hits the deck.
const MAX_CONFIRMED_M: f64 = 0.4;
/// Distance between tags and a fixed solution above which the tags belong to another deck, m: more than the error of a
/// false fix, and less than the distance between decks.
const OTHER_DECK_M: f64 = 2.0;

/// Deck's centre from `m`, the drone's pose, and the deck's attitude about true north at the same time. `heading_sd`:
/// standard deviation of its heading, rad.
pub(super) fn observation(
    m: &RelativePlace,
    drone: &Pose,
    deck: &Plane,
    heading_sd: f64,
    c: &PredictorConfig,
) -> DeckObservation {
    let lever_arm = deck.rotation * Vector3::from(m.antenna_m.map(f64::from));
    let own = drone.attitude * Vector3::from(c.drone.gnss_antenna_m);
    let centre = drone.position + own - Vector3::from(m.baseline_m) - lever_arm;
    let square = lever_arm.component_mul(&lever_arm);
    let [tilt, heading] = [deck.tilt_sd, heading_sd].map(|sd| sd * sd);
    let turned = Vector3::new(
        tilt * square.z + heading * square.y,
        tilt * square.z + heading * square.x,
        tilt * (square.x + square.y),
    );
    let stated = Vector3::from(m.baseline_sd_m.map(|sd| sd * sd));
    let variance =
        (stated + turned + drone.variance * c.drone_variance_fraction).add_scalar(MIN_SD_M.powi(2));
    let mut value = [None; AXES];
    for i in 0..3 {
        value[i] = Some((centre[i], variance[i]));
    }
    DeckObservation {
        at: m.header.at,
        kind: ObservationKind::Relative,
        value,
        rate: [None; AXES],
        // The measurement is not along a camera's line of sight.
        from_drone: Vector3::zeros(),
    }
}

/// Variances of a detection's position due to common errors: the camera's rotation across the line of sight, the scale
/// error along it, and the camera's position.
fn camera_variance(line: &Vector3<f64>, c: &PredictorConfig) -> Vector3<f64> {
    let turn = c.vision_bias_sd_m_rad[3].max(c.vision_bias_sd_m_rad[4]);
    let across = |i: usize| line.norm_squared() - line[i] * line[i];
    let of = |i: usize| turn * turn * across(i) + (c.vision_scale_sd * line[i]).powi(2);
    Vector3::from_fn(|i, _| of(i) + c.camera_mount_sd_m.powi(2))
}

/// Detection for fusion in addition to a relative position. In a view from the side no state models the camera's
/// rotation, so its uncertainty is added.
pub(super) fn with_camera_error(mut o: DeckObservation, c: &PredictorConfig) -> DeckObservation {
    if o.lever() == [0.0; 2] {
        let more = camera_variance(&o.from_drone, c);
        for (value, more) in o.value.iter_mut().zip(more.iter()) {
            if let Some((_, variance)) = value {
                *variance += more;
            }
        }
    }
    o
}

/// Measured position, m, and its variances.
fn place(o: &DeckObservation) -> Option<[Vector3<f64>; 2]> {
    let [Some(north), Some(east), Some(down), ..] = o.value else {
        return None;
    };
    let all = [north, east, down];
    Some([all.map(|(v, _)| v).into(), all.map(|(_, r)| r).into()])
}

/// Mean difference between the positions by tags and by the receiver, m, number of detections, and time of the newest.
#[derive(Clone, Copy, Debug)]
struct MeanDifference {
    at: DroneTime,
    mean: Vector3<f64>,
    n: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// Fuse it, and compare it with detections.
    Fuse,
    /// Only compare it with detections.
    Compare,
    Ignore,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RelativeTrust {
    newest: Option<RelativePlace>,
    fixed_at: Option<DroneTime>,
    fixed: Option<DeckObservation>,
    used: Option<DroneTime>,
    difference: Option<MeanDifference>,
    confirmed: bool,
    contradicted_m: Option<f64>,
    /// Whether the contradicted solution was lost, so that the current one may be a different one.
    solved_again: bool,
}

impl RelativeTrust {
    /// Registers a measurement. Returns its permitted use; None if it is not newer than the previous one.
    pub(super) fn take(&mut self, m: &RelativePlace) -> Option<Use> {
        let at = m.header.at;
        if self.newest.is_some_and(|n| at <= n.header.at) {
            return None;
        }
        let gone = self.fixed_at.is_some_and(|then| (at - then).secs() > GONE_S);
        self.newest = Some(*m);
        if m.solution != CarrierSolution::Fixed || gone {
            self.forget_frame();
            self.solved_again = true;
        }
        if m.solution != CarrierSolution::Fixed {
            return Some(Use::Ignore);
        }
        self.fixed_at = Some(at);
        if gone {
            self.contradicted_m = None;
        }
        let exact = m.baseline_sd_m.iter().all(|sd| *sd <= MAX_SD_M);
        Some(match self.contradicted_m {
            None if exact => Use::Fuse,
            Some(_) if exact && self.solved_again => Use::Compare,
            None | Some(_) => Use::Ignore,
        })
    }
    /// Drops measurements and confirmation after the drone's frame has moved.
    pub(super) fn forget_frame(&mut self) {
        self.fixed = None;
        self.used = None;
        self.difference = None;
        self.confirmed = false;
    }
    /// Stores the deck from a measurement, to compare it with detections.
    pub(super) fn locate(&mut self, o: &DeckObservation) {
        self.fixed = Some(*o);
    }
    pub(super) fn count(&mut self, at: DroneTime) {
        self.used = Some(at);
    }
    pub(super) fn is_in_use(&self, now: DroneTime) -> bool {
        self.used.is_some_and(|t| (now - t).secs() <= IN_USE_S)
    }

    pub(super) fn is_comparable(&self, at: DroneTime) -> bool {
        (self.fixed.as_ref()).is_some_and(|f| (at - f.at).secs().abs() <= PAIR_S)
    }
    /// Position of a detection minus the relative position, m, excluding the deck's motion between them, and the
    /// variances of the difference. None without a fixed solution of about the same time.
    fn difference(
        &self,
        o: &DeckObservation,
        velocity: &Vector3<f64>,
        c: &PredictorConfig,
    ) -> Option<[Vector3<f64>; 2]> {
        let fixed = self.fixed.as_ref().filter(|_| self.is_comparable(o.at))?;
        let dt = (o.at - fixed.at).secs();
        let [detected, r] = place(o)?;
        let [relative, q] = place(fixed)?;
        Some([
            detected - relative - velocity * dt,
            r + q + camera_variance(&o.from_drone, c),
        ])
    }
    /// Horizontal distance between another detected deck and the relative position, and its limit, m.
    pub(super) fn elsewhere(
        &self,
        o: &DeckObservation,
        velocity: &Vector3<f64>,
        c: &PredictorConfig,
    ) -> Option<[f64; 2]> {
        let [apart, variance] = self.difference(o, velocity, c)?;
        let limit = OTHER_DECK_M + APART_SD * variance.xy().max().sqrt();
        let apart = apart.xy().norm();
        (!(apart <= limit)).then_some([apart, limit])
    }
    /// Compares the vessel's own tags. Returns the difference, m, when it begins to contradict the relative position.
    pub(super) fn compare(
        &mut self,
        tag: &DeckObservation,
        velocity: &Vector3<f64>,
        c: &PredictorConfig,
    ) -> Option<f64> {
        let [apart, variance] = self.difference(tag, velocity, c)?;
        let recent = |d: &MeanDifference| (0.0..=MEAN_TIME_S).contains(&(tag.at - d.at).secs());
        let (mean, n) = self.difference.filter(recent).map_or((apart, 1.0), |d| {
            let n = d.n + 1.0;
            // The first samples have equal weights.
            let gain = low_pass_gain((tag.at - d.at).secs(), MEAN_TIME_S).max(1.0 / n);
            (d.mean + (apart - d.mean) * gain, n)
        });
        self.difference = Some(MeanDifference { at: tag.at, mean, n });
        if n < MIN_DETECTIONS {
            return None;
        }
        let limits = [variance.xy().max(), variance.z].map(|v| APART_M + APART_SD * v.sqrt());
        let agree = mean.xy().norm() <= limits[0] && mean.z.abs() <= limits[1];
        if agree {
            if limits.iter().all(|limit| *limit <= MAX_CONFIRMED_M) {
                self.confirmed = true;
                self.contradicted_m = None;
            }
            return None;
        }
        self.forget_frame();
        self.contradicted_m = Some(mean.norm());
        self.solved_again = false;
        self.contradicted_m
    }

    /// State; None if no measurement arrived recently.
    pub(super) fn state(&self, now: DroneTime) -> Option<RelativeState> {
        let age = |t: DroneTime| (now - t).secs().max(0.0);
        let newest = self.newest.filter(|m| age(m.header.at) < GONE_S)?;
        let [north, east, _] = newest.baseline_sd_m;
        Some(RelativeState {
            solution: newest.solution,
            sd_m: north.max(east),
            age_s: age(newest.header.at),
            used_age_s: self.used.map_or(f64::INFINITY, age),
            confirmed: self.confirmed,
            contradicted_m: self.contradicted_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};
    use nalgebra::UnitQuaternion;

    fn measured(t: f64, solution: CarrierSolution) -> RelativePlace {
        RelativePlace {
            header: Header::new(1, 1, 1, 0, Time::from_secs(t)),
            baseline_sd_m: [0.01, 0.01, 0.02],
            solution,
            ..RelativePlace::default()
        }
    }
    /// Deck detected at this position from `above_m` above it.
    fn detection(t: f64, at: [f64; 3], above_m: f64) -> DeckObservation {
        let [n, e, d] = at.map(|v| Some((v, 1e-4)));
        DeckObservation {
            at: Time::from_secs(t),
            kind: ObservationKind::Tag,
            value: [n, e, d, None, None, None],
            rate: [None; AXES],
            from_drone: Vector3::z() * above_m,
        }
    }
    /// Trust after one second with a fixed solution at the origin, at 5 Hz, and tags at `place`, at 30 Hz.
    fn after(trust: &mut RelativeTrust, from_s: f64, place: [f64; 3], above_m: f64) -> RelativeState {
        let c = PredictorConfig::default();
        for k in 0..30 {
            let t = from_s + f64::from(k) / 30.0;
            let used = (k % 6 == 0).then(|| trust.take(&measured(t, CarrierSolution::Fixed)));
            if let Some(Some(used @ (Use::Fuse | Use::Compare))) = used {
                trust.locate(&detection(t, [0.0; 3], 0.0));
                if used == Use::Fuse {
                    trust.count(Time::from_secs(t));
                }
            }
            trust.compare(&detection(t, place, above_m), &Vector3::zeros(), &c);
        }
        trust.state(Time::from_secs(from_s + 1.0)).unwrap()
    }

    #[test]
    fn deck_below_a_tilted_drone_and_antenna() {
        let c = PredictorConfig::default();
        let drone = Pose {
            position: Vector3::new(3.0, -2.0, -9.0),
            attitude: UnitQuaternion::from_euler_angles(0.1, -0.2, 0.9),
            variance: Vector3::zeros(),
        };
        let deck = Plane {
            centre: Vector3::new(1.0, -3.0, -1.3),
            rotation: UnitQuaternion::from_euler_angles(0.15, -0.05, 1.0),
            position_sd: 1.0,
            tilt_sd: 0.01,
        };
        let antenna_m = [-2.0_f32, 0.5, -3.0];
        let lever_arm = deck.rotation * Vector3::from(antenna_m.map(f64::from));
        let from = deck.centre + lever_arm;
        let to = drone.position + drone.attitude * Vector3::from(c.drone.gnss_antenna_m);
        let m = RelativePlace {
            baseline_m: (to - from).into(),
            antenna_m,
            ..measured(1.0, CarrierSolution::Fixed)
        };
        let [centre, variance] = place(&observation(&m, &drone, &deck, 0.02, &c)).unwrap();
        assert!((centre - deck.centre).norm() < 1e-9, "{centre}");
        // Rotations about the three axes, with their standard deviations.
        let turns = [(Vector3::x(), 0.01), (Vector3::y(), 0.01), (Vector3::z(), 0.02)];
        let shifts = turns.map(|(axis, sd)| (axis * sd).cross(&lever_arm));
        let turned: Vector3<f64> = shifts.iter().map(|s| s.component_mul(s)).sum();
        let expected = turned + Vector3::new(1e-4, 1e-4, 4e-4).add_scalar(4e-4);
        assert!((variance - expected).norm() < 1e-12, "{variance} {expected}");
    }

    #[test]
    fn fix_confirmed_by_tags_from_near() {
        let mut trust = RelativeTrust::default();
        assert!(
            !after(&mut trust, 0.0, [0.1, 0.0, 0.1], 7.0).confirmed,
            "from far"
        );
        let near = after(&mut trust, 1.0, [0.1, 0.0, 0.1], 2.0);
        assert!(near.confirmed && near.used_age_s < 0.3, "{near:?}");
        // A confirmation applies to one fix in one frame.
        assert_eq!(
            trust.take(&measured(2.0, CarrierSolution::Float)),
            Some(Use::Ignore)
        );
        let float = trust.state(Time::from_secs(2.0)).unwrap();
        assert!(!float.confirmed && float.used_age_s == f64::INFINITY, "{float:?}");
        assert!(after(&mut trust, 3.0, [0.0; 3], 2.0).confirmed);
        trust.forget_frame();
        assert!(!trust.state(Time::from_secs(4.0)).unwrap().confirmed);
    }

    #[test]
    fn fix_contradicted_until_solved_again() {
        for apart in [[0.5, 0.0, 0.0], [0.0, 0.0, -0.5]] {
            let mut trust = RelativeTrust::default();
            let s = after(&mut trust, 0.0, apart, 2.0);
            assert!((s.contradicted_m.unwrap() - 0.5).abs() < 1e-9 && !s.confirmed);
            assert_eq!(s.used_age_s, f64::INFINITY);
            // The tags agree with a fix that is still false.
            assert!(after(&mut trust, 1.0, [0.0; 3], 2.0).contradicted_m.is_some());
            let mut gone = trust;
            trust.take(&measured(2.0, CarrierSolution::Float));
            let mut same = trust;
            let fixed = same.take(&measured(2.2, CarrierSolution::Fixed));
            assert_eq!(fixed, Some(Use::Compare), "without tags");
            assert!(after(&mut same, 3.0, apart, 2.0).contradicted_m.is_some());
            assert!(after(&mut trust, 3.0, [0.0; 3], 2.0).confirmed);
            assert!(gone.state(Time::from_secs(12.0)).is_none());
            assert!(after(&mut gone, 12.0, [0.0; 3], 2.0).confirmed);
        }
    }

    #[test]
    fn single_misread_tag_next_to_a_fix() {
        let c = PredictorConfig::default();
        let mut trust = RelativeTrust::default();
        after(&mut trust, 0.0, [0.0; 3], 2.0);
        let misread = detection(1.0, [1.0, 0.0, 0.0], 2.0);
        assert_eq!(trust.compare(&misread, &Vector3::zeros(), &c), None);
        // A more distant detection belongs to another deck.
        assert_eq!(trust.elsewhere(&misread, &Vector3::zeros(), &c), None);
        let other = detection(1.0, [3.0, 0.0, 0.0], 2.0);
        assert!(trust.elsewhere(&other, &Vector3::zeros(), &c).is_some());
    }

    /// Whether tags at the distance `apart` (m) from the fixes contradict these; the deck moves at 8 m/s.
    fn contradicts(apart: f64, times_s: impl Iterator<Item = f64>) -> bool {
        let c = PredictorConfig::default();
        let mut trust = RelativeTrust::default();
        let velocity = Vector3::new(8.0, 0.0, 0.0);
        let at = |t: f64, more: f64| detection(t, [8.0 * t + more, 0.0, 0.0], 2.0);
        let mut compared = times_s.map(|t| {
            trust.locate(&at((t * 5.0).floor() / 5.0, 0.0));
            trust.compare(&at(t, apart), &velocity, &c).is_some()
        });
        compared.any(|contradicted| contradicted)
    }

    #[test]
    fn tags_between_the_fixes_of_a_moving_deck() {
        let times_s = || (0..60).map(|k| f64::from(k) / 30.0);
        assert!(!contradicts(0.0, times_s()));
        assert!(contradicts(0.5, times_s()));
        // There are too few detections before and after a gap.
        let with_gap = [0, 1, 2, 3, 40, 41, 42, 43].map(|k| f64::from(k) / 30.0);
        assert!(!contradicts(0.5, with_gap.into_iter()));
    }

    #[test]
    fn measurements_that_are_not_used() {
        let mut trust = RelativeTrust::default();
        let vague = RelativePlace {
            baseline_sd_m: [0.01, 0.01, 0.2],
            ..measured(1.0, CarrierSolution::Fixed)
        };
        assert_eq!(trust.take(&vague), Some(Use::Ignore));
        for (t, solution, used) in [
            (1.0, CarrierSolution::Fixed, None),
            (1.2, CarrierSolution::None, Some(Use::Ignore)),
            (1.4, CarrierSolution::Float, Some(Use::Ignore)),
            (1.6, CarrierSolution::Fixed, Some(Use::Fuse)),
            (1.5, CarrierSolution::Fixed, None),
        ] {
            assert_eq!(trust.take(&measured(t, solution)), used, "{t} s");
        }
    }
}
