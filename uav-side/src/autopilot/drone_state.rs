//! Drone state from the autopilot's reports. PX4 sends one `ODOMETRY`, ArduCopter `LOCAL_POSITION_NED` and
//! `ATTITUDE_QUATERNION`; both send inertial samples separately.

use alight_shared::{
    estimation::low_pass,
    frames::{DroneNed, Vector, wxyz},
    geodesy::Datum,
    geometry::DroneGeometry,
    mavlink::{
        dialect::{DISTANCE_SENSOR_DATA, MavFrame, ODOMETRY_DATA},
        fields,
    },
    msg::{DeckStage, DroneState, Header, Message as _, RangeSample, SetPoint},
    time::Span,
    topics,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{
    DroneTime, Output, OutputHeaders, config::AutopilotLinkConfig, heading::HeadingAlignment,
    inputs::LinkInputs, message::wide, modes::Firmware, origin::AutopilotOrigin, thrust::HoverThrust,
};
use crate::{
    odometry::{Odometry, OdometryConfig, wind::WindMonitor},
    range_witness::{BELOW_FEET_M, RangeWitness, disagree},
};

const MAX_IMU_OFFSET: Span = Span::from_millis(50);
/// Maximum time over which an attitude is propagated by its rates.
const MAX_ATTITUDE_OFFSET: Span = Span::from_millis(60);
/// Time after an `ODOMETRY` within which separate positions and attitudes are ignored.
const ODOMETRY_PREFERENCE: Span = Span::from_millis(500);
const MAX_SAMPLES: u32 = 50;
/// Position jump that triggers a new request for the origin, m.
const JUMPED_M: f64 = 1.0;
/// Low-pass time constant of the specific force in the disarm evidence, s.
const SPECIFIC_FORCE_TIME_S: f64 = 0.03;

/// Time for which an odometry quantity may stay bit-identical while the drone moves, s: 25 samples at 50 Hz,
/// the slowest rate. Inertial sensor noise changes every estimate.
const FROZEN_S: f64 = 0.5;
/// Rotation that changes the accelerometer's reading through gravity alone, rad: 0.2 m/s², ten steps of its
/// coarsest message.
const TURNED_RAD: f64 = 0.02;

/// Time, accelerometer reading and attitude of a report.
type Motion = (DroneTime, Vector3<f64>, UnitQuaternion<f64>);

/// Time of the first report with the current value, once it has been unchanged for [`FROZEN_S`].
fn repeated<const N: usize>(
    kept: &mut Option<([f64; N], Motion)>,
    value: [f64; N],
    now: Motion,
) -> Option<Motion> {
    let (before, first) = *kept.get_or_insert((value, now));
    if before != value {
        *kept = Some((value, now));
    }
    Some(first).filter(|f| before == value && (now.0 - f.0).secs() >= FROZEN_S)
}

#[derive(Clone, Copy, Debug, Default)]
struct Inertial {
    at: DroneTime,
    newest: Vector3<f64>,
    sum: Vector3<f64>,
    count: u32,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct DroneStateAssembler {
    inertial: Option<Inertial>,
    attitude: Option<(DroneTime, UnitQuaternion<f64>, Vector3<f64>)>,
    odometry_at: Option<DroneTime>,
    last: Option<DroneState>,
    pub(crate) reported_resets: Option<u8>,
    /// Number of jumps counted by the autopilot. [`crate::odometry`] detects uncounted ones.
    pub(crate) resets: u8,
    /// Number of the autopilot's frame; a restart begins a new one.
    pub(crate) frames: u8,
    pub(crate) rejected: u32,
    place: Option<([f64; 6], Motion)>,
    turned: Option<([f64; 4], Motion)>,
    force: Option<([f64; 3], Motion)>,
    /// Currently frozen quantity, and the one last reported to the operator.
    frozen: [Option<&'static str>; 2],
}

fn rotation(q: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    UnitQuaternion::try_new(Quaternion::new(q[0], q[1], q[2], q[3]), 0.5)
        .filter(|u| u.coords.iter().all(|v| v.is_finite()))
}

impl DroneStateAssembler {
    pub(crate) fn resume(&mut self, frames: u8, reported: Option<u8>) {
        self.frames = frames;
        self.reported_resets = reported;
    }
    fn reject<T>(&mut self) -> Option<T> {
        self.rejected = self.rejected.saturating_add(1);
        None
    }
    pub(crate) fn imu(&mut self, at: DroneTime, accelerometer: [f64; 3]) {
        let f = Vector3::from(accelerometer);
        // A missing sensor gives zeros; a real accelerometer always has noise.
        if !(f.norm() < 500.0) || f == Vector3::zeros() {
            self.rejected = self.rejected.saturating_add(1);
            return;
        }
        let i = self.inertial.get_or_insert_default();
        i.at = i.at.max(at);
        i.newest = f;
        if i.count < MAX_SAMPLES {
            i.sum += f;
            i.count += 1;
        }
    }
    pub(crate) fn attitude(&mut self, at: DroneTime, attitude: [f64; 4], rates: [f64; 3]) {
        match rotation(attitude) {
            Some(q) => self.attitude = Some((at, q, rates.into())),
            None => self.rejected = self.rejected.saturating_add(1),
        }
    }
    pub(crate) fn position(
        &mut self,
        at: DroneTime,
        position: [f64; 3],
        velocity: [f64; 3],
        c: &AutopilotLinkConfig,
    ) -> Option<DroneState> {
        if self.odometry_at.is_some_and(|o| at - o < ODOMETRY_PREFERENCE) {
            return None;
        }
        let (then, q, rates) = self.attitude?;
        let apart = at - then;
        if apart.abs() > MAX_ATTITUDE_OFFSET {
            return None;
        }
        let turned = q * UnitQuaternion::from_scaled_axis(rates * apart.secs());
        self.state(at, position, velocity, [q, turned], rates, None, c)
    }
    pub(crate) fn odometry(
        &mut self,
        at: DroneTime,
        d: &ODOMETRY_DATA,
        c: &AutopilotLinkConfig,
    ) -> Option<DroneState> {
        let Some(q) = rotation(wide(d.q)) else {
            return self.reject();
        };
        self.odometry_at = Some(at);
        if self.reported_resets.is_some_and(|r| r != d.reset_counter) {
            self.resets = self.resets.wrapping_add(1);
        }
        self.reported_resets = Some(d.reset_counter);
        let velocity = Vector3::from(wide(fields!(d, vx vy vz)));
        let velocity = match d.child_frame_id {
            MavFrame::MAV_FRAME_BODY_FRD => q * velocity,
            _ => velocity,
        };
        let rates = wide(fields!(d, rollspeed pitchspeed yawspeed));
        // Upper triangles of 6 x 6 matrices, row by row; the first element of an unknown covariance is NaN.
        let p = wide(d.pose_covariance);
        let v = wide(d.velocity_covariance);
        let known = p[0].is_finite() && v[0].is_finite();
        let variances = [[p[0], p[6], p[11]], [p[15], p[18], p[20]], [v[0], v[6], v[11]]];
        self.state(
            at,
            wide(fields!(d, x y z)),
            velocity.into(),
            [q; 2],
            rates.into(),
            known.then_some(variances),
            c,
        )
    }

    /// State at `at`, with both the `reported` attitude and the attitude `q` propagated to `at`.
    fn state(
        &mut self,
        at: DroneTime,
        position: [f64; 3],
        velocity: [f64; 3],
        [reported, q]: [UnitQuaternion<f64>; 2],
        rates: Vector3<f64>,
        variances: Option<[[f64; 3]; 3]>,
        c: &AutopilotLinkConfig,
    ) -> Option<DroneState> {
        if self.last.is_some_and(|l| at <= l.header.at) {
            return self.reject();
        }
        // Touchdown detection needs inertial samples, so the drone is not flown without them.
        let inertial = self.inertial.as_mut();
        let i = inertial.filter(|i| (at - i.at).abs() <= MAX_IMU_OFFSET)?;
        let accelerometer = i.newest;
        let force = if i.count > 0 {
            i.sum / f64::from(i.count)
        } else {
            i.newest
        };
        let sampled = i.count > 0;
        i.sum = Vector3::zeros();
        i.count = 0;
        let [x, y, z] = position;
        let [vx, vy, vz] = velocity;
        self.watch([x, y, z, vx, vy, vz], (at, accelerometer, reported), sampled);
        if self.frozen[0].is_some() {
            return self.reject();
        }
        let [p, v, a] = c.odometry_sd;
        let sd = |variances: Option<[f64; 3]>, default: f64| {
            let sqrt = |x: f64| if x > 0.0 && x < 1e6 { x.sqrt() } else { default };
            variances.map_or([default; 3], |variances| variances.map(sqrt))
        };
        let state = DroneState {
            header: Header::new(0, 0, 0, 0, at),
            frames: self.frames,
            position,
            velocity,
            attitude: wxyz(&q),
            rates: rates.into(),
            specific_force: force.into(),
            position_sd: sd(variances.map(|v| v[0]), p),
            velocity_sd: sd(variances.map(|v| v[2]), v),
            euler_sd: sd(variances.map(|v| v[1]), a),
            ..DroneState::default()
        };
        if state.check().is_err() {
            return self.reject();
        }
        self.last = Some(state);
        Some(state)
    }
    /// Checks the odometry for a quantity that is frozen while the drone moves and so is not a measurement. Without a new
    /// inertial sample (`sampled`) an unchanged accelerometer is silent, not frozen.
    fn watch(&mut self, place: [f64; 6], now: Motion, sampled: bool) {
        let (_, force, q) = now;
        let moves = |first: Motion| first.1 != force;
        self.frozen[0] = None;
        if repeated(&mut self.place, place, now).is_some_and(moves) {
            self.frozen[0] = Some("position and velocity");
        }
        if repeated(&mut self.turned, wxyz(&q), now).is_some_and(moves) {
            self.frozen[0] = Some("attitude");
        }
        if !sampled {
            self.force = None;
        } else if repeated(&mut self.force, force.into(), now).is_some_and(|f| f.2.angle_to(&q) > TURNED_RAD)
        {
            self.frozen[0] = Some("accelerometer");
        }
    }
    pub(super) fn news(&mut self) -> Option<String> {
        let [now, reported] = self.frozen;
        self.frozen[1] = now;
        let changed = now != reported;
        changed.then(|| match now {
            Some(what) => {
                format!("its {what} is frozen while the drone moves: odometry rejected")
            }
            None => "its odometry changes again and is used".into(),
        })
    }
    pub(crate) fn restart(&mut self) {
        *self = DroneStateAssembler {
            frozen: self.frozen,
            resets: self.resets,
            frames: self.frames.wrapping_add(u8::from(self.last.is_some())),
            rejected: self.rejected,
            ..DroneStateAssembler::default()
        };
    }
}

/// `signal_quality` of an invalid reading, and `covariance` of an unknown one.
const INVALID: u8 = 1;
const UNKNOWN: u8 = u8::MAX;

/// Whether a reading is invalid; rangefinders cannot measure 0 m.
pub(super) fn is_invalid(d: &DISTANCE_SENSOR_DATA) -> bool {
    d.signal_quality == INVALID || d.current_distance == 0
}

/// Range; None outside the rangefinder's limits and for an invalid reading.
pub(super) fn range(at: DroneTime, d: &DISTANCE_SENSOR_DATA, c: &AutopilotLinkConfig) -> Option<RangeSample> {
    let sample = RangeSample {
        header: Header::new(0, 0, 0, 0, at),
        range_m: f64::from(d.current_distance) * 0.01,
        variance: match d.covariance {
            0 | UNKNOWN => c.range_sd_m * c.range_sd_m,
            square_cm => f64::from(square_cm) * 1e-4,
        },
    };
    // A rangefinder without an echo reports its maximum distance.
    let within = (d.min_distance..d.max_distance).contains(&d.current_distance);
    (!is_invalid(d) && within && sample.check().is_ok()).then_some(sample)
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RangeReadings {
    pub(super) feet_m: f64,
    newest: Option<RangeSample>,
    pub(super) witness: RangeWitness,
}

impl RangeReadings {
    pub(super) fn take(&mut self, mut s: RangeSample, headers: &mut OutputHeaders) -> Option<RangeSample> {
        if self.newest.is_some_and(|r| s.header.at <= r.header.at) {
            return None;
        }
        s.header = headers.next(Output::Range, s.header.at);
        self.witness.reads(s.header.at, s.range_m);
        self.newest = Some(s);
        self.newest
    }
    pub(super) fn fresh_m(&self, now: DroneTime) -> Option<f64> {
        let fresh = (self.newest).filter(|r| now - r.header.at <= topics::RANGE.stale_after);
        fresh.map(|r| r.range_m)
    }
    /// Whether this range (m) is consistent with the drone's motion, the distance to the deck and the
    /// forecast.
    pub(super) fn believes(&self, range_m: f64, forecast_height: Option<f64>) -> bool {
        let height = range_m - self.feet_m;
        height >= -BELOW_FEET_M && !self.witness.contradicts() && !disagree(height, forecast_height)
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct DroneEstimate {
    pub(super) assembler: DroneStateAssembler,
    resets: u8,
    pub(super) origin: AutopilotOrigin,
    pub(super) heading: HeadingAlignment,
    pub(super) smooth: Odometry,
    pub(super) wind: WindMonitor,
    pub(super) state: Option<DroneState>,
    /// Specific force along the body's up axis, low-pass filtered, m/s².
    pub(super) force: Option<f64>,
    pub(super) hover: HoverThrust,
    pub(super) range: RangeReadings,
    feet_below_m: f64,
}

impl DroneEstimate {
    pub(super) fn new(odometry: &OdometryConfig, geometry: &DroneGeometry, hover: f64) -> DroneEstimate {
        let mut estimate = DroneEstimate {
            smooth: Odometry::new(odometry),
            hover: HoverThrust::new(hover),
            feet_below_m: geometry.feet_below_m,
            ..DroneEstimate::default()
        };
        estimate.range.feet_m = geometry.feet_below_m - geometry.rangefinder_m[2];
        estimate
    }
    pub(super) fn fresh(&self, now: DroneTime) -> Option<DroneState> {
        (self.state).filter(|s| now - s.header.at <= topics::DRONE_STATE.stale_after)
    }
    pub(super) fn restart(&mut self) {
        self.assembler.restart();
        self.smooth.restart();
    }
    /// Discards origin and heading when the autopilot is another one or has restarted.
    pub(super) fn forget(&mut self) {
        self.restart();
        (self.heading, self.origin) = Default::default();
    }
    /// Smooths new odometry, estimates the wind, and in flight with a known `thrust` (fraction) the hover
    /// thrust. Returns the drone's own odometry; None until origin and heading are known.
    pub(super) fn step(
        &mut self,
        now: DroneTime,
        mut reported: DroneState,
        inputs: &LinkInputs,
        thrust: Option<f64>,
        firmware: Option<Firmware>,
        c: &AutopilotLinkConfig,
        headers: &mut OutputHeaders,
    ) -> Option<DroneState> {
        self.heading.watch(&reported);
        // Directions are arbitrary until the heading is aligned.
        reported.datum = self.origin.datum.filter(|_| self.heading.was_aligned())?;
        let counted = core::mem::replace(&mut self.resets, self.assembler.resets) != self.assembler.resets;
        let scale = self.origin.map_scale(firmware);
        reported.position = reported.position().component_mul(&scale).into();
        let dt = (self.state).map_or(0.01, |s| (reported.header.at - s.header.at).secs());
        let up = -reported.specific_force[2];
        let since = dt.clamp(0.0, 1.0);
        self.force = Some(low_pass(self.force, up, since, SPECIFIC_FORCE_TIME_S));
        if let Some(thrust) = thrust {
            self.hover.learn(thrust, up, dt, c.hover_thrust_s);
        }
        let before = self.smooth.jumps();
        let mut state = self.smooth.step(&reported, counted);
        if state.check().is_err() {
            // The accumulated jumps have moved positions beyond the message's bounds.
            self.restart();
            state = self.smooth.step(&reported, false);
        }
        if counted || (self.smooth.jumps().offset - before.offset).norm() > JUMPED_M {
            self.origin.timer = Default::default();
        }
        state.header = headers.next(Output::Odometry, reported.header.at);
        self.wind.update(&mut state, inputs.followed_deck(now));
        self.state = Some(state);
        let speed = self.relative_to(now, inputs.deck(now)).map(|(_, _, away)| away);
        self.range.witness.moves(dt.clamp(0.0, 0.1), speed);
        Some(state)
    }
    /// Height of the feet above the deck, m, speed relative to the deck, and separation speed along its
    /// normal, m/s.
    pub(super) fn relative_to(&self, now: DroneTime, deck: Option<DeckStage>) -> Option<(f64, f64, f64)> {
        let state = self.fresh(now)?;
        let deck = deck?;
        let height = deck.height_of(&state.position()) - self.feet_below_m;
        let speed = (state.velocity() - Vector3::from(deck.velocity)).norm();
        Some((height, speed, deck.speed_away(&state.velocity())))
    }
    /// Transforms a set-point to the autopilot's frame for this firmware.
    pub(super) fn for_autopilot(&self, s: &SetPoint, firmware: Option<Firmware>) -> SetPoint {
        let mut s = self.smooth.for_autopilot(s);
        let scale = self.origin.map_scale(firmware);
        s.position = Vector3::from(s.position).component_div(&scale).into();
        s
    }
    /// Geodetic position of the deck's centre, and its height above the sea, m; None without an origin.
    pub(super) fn place(&self, deck: &DeckStage) -> Option<(Datum, f64)> {
        let (datum, geoid_m) = self.origin.datum.zip(self.origin.geoid_m)?;
        let from_datum = Vector3::from(deck.position) - self.smooth.jumps().offset;
        let place = datum.at(&Vector::<DroneNed>::from(from_datum));
        Some((place, place.height_m - geoid_m))
    }
}

#[cfg(test)]
mod tests {
    use super::{super::message::narrow, *};
    use MavFrame::{MAV_FRAME_BODY_FRD, MAV_FRAME_LOCAL_NED};
    use alight_shared::frames::yaw_rotation;

    fn t(s: f64) -> DroneTime {
        DroneTime::from_secs(s)
    }
    fn report(x: f64, child_frame_id: MavFrame, reset_counter: u8) -> ODOMETRY_DATA {
        let q = yaw_rotation(core::f64::consts::FRAC_PI_2);
        ODOMETRY_DATA {
            x: x as f32,
            q: narrow(wxyz(&q)),
            vx: 1.0,
            child_frame_id,
            pose_covariance: [f32::NAN; 21],
            reset_counter,
            ..ODOMETRY_DATA::DEFAULT
        }
    }

    #[test]
    fn body_frame_velocity_in_ned() {
        let c = AutopilotLinkConfig::default();
        let mut f = DroneStateAssembler::default();
        f.imu(t(1.0), [0.0, 0.0, -9.8]);
        let ned = f
            .odometry(t(1.0), &report(0.0, MAV_FRAME_LOCAL_NED, 0), &c)
            .unwrap();
        assert!((ned.velocity[0] - 1.0).abs() < 1e-12);
        let body = f
            .odometry(t(1.01), &report(0.0, MAV_FRAME_BODY_FRD, 0), &c)
            .unwrap();
        assert!((body.velocity[1] - 1.0).abs() < 1e-12, "{:?}", body.velocity);
        assert_eq!(body.position_sd, [0.3; 3]);
    }

    #[test]
    fn drone_state_inputs_and_time() {
        let c = AutopilotLinkConfig::default();
        let mut f = DroneStateAssembler::default();
        let r = report(0.0, MAV_FRAME_LOCAL_NED, 0);
        assert!(f.odometry(t(1.0), &r, &c).is_none());
        for k in 0..4 {
            f.imu(t(1.0 + 0.002 * f64::from(k)), [f64::from(k), 0.0, -9.8]);
        }
        let s = f.odometry(t(1.01), &r, &c).unwrap();
        assert!((s.specific_force[0] - 1.5).abs() < 1e-12);
        assert!(f.odometry(t(1.01), &r, &c).is_none());
        assert!(f.odometry(t(1.0), &r, &c).is_none());
        assert!(f.odometry(t(1.2), &r, &c).is_none());
        let broken = ODOMETRY_DATA {
            q: [f32::NAN; 4],
            ..r
        };
        assert!(f.odometry(t(1.21), &broken, &c).is_none());
        assert_eq!(f.rejected, 3);
    }

    /// Number of accepted states of a moving drone when one quantity freezes after 1 s, and the resulting
    /// texts.
    fn states(froze: [bool; 3]) -> (u32, Vec<String>) {
        let mut f = DroneStateAssembler::default();
        let mut taken = 0;
        let mut news = Vec::new();
        for k in 0..200_u32 {
            let at = |frozen: bool| 0.01 * f64::from(if frozen { k.min(100) } else { k });
            let q = UnitQuaternion::from_euler_angles(0.1 * at(froze[1]), 0.0, 0.0);
            let report = ODOMETRY_DATA {
                q: narrow(wxyz(&q)),
                vx: at(froze[0]) as f32,
                ..report(at(froze[0]), MAV_FRAME_LOCAL_NED, 0)
            };
            let now = t(1.0 + 0.01 * f64::from(k));
            f.imu(now, [0.1 * at(froze[2]), 0.0, -9.8]);
            taken += u32::from(
                f.odometry(now, &report, &AutopilotLinkConfig::default())
                    .is_some(),
            );
            news.extend(f.news());
        }
        (taken, news)
    }

    #[test]
    fn frozen_quantities_of_a_moving_drone() {
        assert_eq!(states([false; 3]), (200, Vec::new()));
        // A noise-free drone at rest: nothing contradicts constant values.
        assert_eq!(states([true; 3]).0, 200);
        for (froze, what) in [
            ([true, false, false], "position and velocity"),
            ([false, true, false], "attitude"),
            ([false, false, true], "accelerometer"),
        ] {
            let (taken, news) = states(froze);
            assert_eq!((taken, news.len()), (150, 1), "{what}");
            assert!(news[0].contains(what), "{news:?}");
        }
    }

    #[test]
    fn attitude_at_the_time_of_the_position() {
        let c = AutopilotLinkConfig::default();
        let mut f = DroneStateAssembler::default();
        f.imu(t(2.0), [0.0, 0.0, -9.8]);
        f.attitude(t(1.99), [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        let s = f.position(t(2.0), [1.0, 2.0, 3.0], [0.0; 3], &c).unwrap();
        assert!((s.euler().x - 0.01).abs() < 1e-9);
        assert!(f.position(t(2.5), [1.0, 2.0, 3.0], [0.0; 3], &c).is_none());
    }

    #[test]
    fn estimate_jumps_that_the_autopilot_counts() {
        let c = AutopilotLinkConfig::default();
        let mut f = DroneStateAssembler::default();
        for (k, resets) in [7, 7, 8].into_iter().enumerate() {
            let at = t(1.0 + 0.01 * k as f64);
            f.imu(at, [0.0, 0.0, -9.8]);
            f.odometry(at, &report(0.0, MAV_FRAME_LOCAL_NED, resets), &c);
        }
        assert_eq!((f.resets, f.frames), (1, 0));
        f.restart();
        assert_eq!((f.resets, f.frames), (1, 1));
    }
    #[test]
    fn rangefinder_at_its_limit() {
        let sample = |current_distance, covariance, signal_quality| {
            let report = DISTANCE_SENSOR_DATA {
                max_distance: 1000,
                current_distance,
                covariance,
                signal_quality,
                ..DISTANCE_SENSOR_DATA::DEFAULT
            };
            range(t(1.0), &report, &AutopilotLinkConfig::default())
        };
        for wrong in [(1000, 255, 0), (0, 255, 0), (150, 255, INVALID)] {
            assert_eq!(sample(wrong.0, wrong.1, wrong.2), None, "{wrong:?}");
        }
        assert!(sample(150, 255, 100).is_some_and(|s| (s.range_m - 1.5).abs() < 1e-9));
        let s = sample(200, 0, 0).unwrap();
        assert!((s.variance - 0.0004).abs() < 1e-12);
    }
}
