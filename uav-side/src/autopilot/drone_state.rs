//! The drone's state from what the autopilot reports: PX4 in one `ODOMETRY`, ArduCopter in
//! `LOCAL_POSITION_NED` with `ATTITUDE_QUATERNION`, both with separate inertial samples.

use alight_shared::msg::{DroneState, Header, Message as _, RangeSample};
use alight_shared::time::Span;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::DroneTime;
use super::config::AutopilotLinkConfig;
use super::message::{DistanceReport, OdometryReport, VelocityFrame};

/// An inertial sample further than this from the pose does not belong to it.
const MAX_IMU_OFFSET: Span = Span::from_millis(50);
/// An attitude is propagated by its rates over at most this long.
const MAX_ATTITUDE_OFFSET: Span = Span::from_millis(60);
/// Position and attitude on their own are not used within this time after an `ODOMETRY`.
const ODOMETRY_PREFERENCE: Span = Span::from_millis(500);
/// Inertial samples averaged at most.
const MAX_SAMPLES: u32 = 50;

/// The inertial samples since the last pose.
#[derive(Clone, Copy, Debug, Default)]
struct Inertial {
    at: DroneTime,
    newest: Vector3<f64>,
    sum: Vector3<f64>,
    count: u32,
}

/// Assembles drone states from reports of pose, motion and specific force.
#[derive(Clone, Debug, Default)]
pub(crate) struct DroneStateAssembler {
    inertial: Option<Inertial>,
    attitude: Option<(DroneTime, UnitQuaternion<f64>, Vector3<f64>)>,
    odometry_at: Option<DroneTime>,
    last: Option<DroneState>,
    pub(crate) reported_resets: Option<u8>,
    /// Jumps of its estimate that the autopilot has counted so far. Those that it does not count are detected in
    /// [`crate::odometry`].
    pub(crate) resets: u8,
    /// Frames so far.
    pub(crate) frames: u8,
    /// Samples rejected.
    pub(crate) rejected: u32,
}

fn rotation(q: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    UnitQuaternion::try_new(Quaternion::new(q[0], q[1], q[2], q[3]), 0.5)
        .filter(|u| u.coords.iter().all(|v| v.is_finite()))
}

impl DroneStateAssembler {
    /// Goes on counting from these, as [`Self::frames`] and as the autopilot counts.
    pub(crate) fn resume(&mut self, frames: u8, reported: Option<u8>) {
        (self.frames, self.reported_resets) = (frames, reported);
    }
    fn reject<T>(&mut self) -> Option<T> {
        self.rejected = self.rejected.saturating_add(1);
        None
    }
    /// An inertial sample.
    pub(crate) fn imu(&mut self, at: DroneTime, accelerometer: [f64; 3]) {
        let f = Vector3::from(accelerometer);
        if !(f.norm() < 500.0) {
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
    /// An attitude with its rates.
    pub(crate) fn attitude(&mut self, at: DroneTime, attitude: [f64; 4], rates: [f64; 3]) {
        match rotation(attitude) {
            Some(q) => self.attitude = Some((at, q, rates.into())),
            None => self.rejected = self.rejected.saturating_add(1),
        }
    }
    /// A position with its velocity, to go with the newest attitude.
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
        self.state(at, position, velocity, turned, rates, None, c)
    }
    /// Position, velocity and attitude in one.
    pub(crate) fn odometry(
        &mut self,
        at: DroneTime,
        o: &OdometryReport,
        c: &AutopilotLinkConfig,
    ) -> Option<DroneState> {
        let Some(q) = rotation(o.attitude) else {
            return self.reject();
        };
        self.odometry_at = Some(at);
        if self.reported_resets.is_some_and(|r| r != o.resets) {
            self.resets = self.resets.wrapping_add(1);
        }
        self.reported_resets = Some(o.resets);
        let velocity = match o.frame {
            VelocityFrame::Ned => Vector3::from(o.velocity),
            VelocityFrame::Body => q * Vector3::from(o.velocity),
        };
        self.state(at, o.position, velocity.into(), q, o.rates.into(), o.variances, c)
    }

    fn state(
        &mut self,
        at: DroneTime,
        position: [f64; 3],
        velocity: [f64; 3],
        q: UnitQuaternion<f64>,
        rates: Vector3<f64>,
        variances: Option<[[f64; 3]; 3]>,
        c: &AutopilotLinkConfig,
    ) -> Option<DroneState> {
        // Twice the same, or overtaken on the way.
        if self.last.is_some_and(|l| at <= l.header.at) {
            return self.reject();
        }
        // Without inertial samples touchdown cannot be detected, and nothing is flown.
        let i = self
            .inertial
            .as_mut()
            .filter(|i| (at - i.at).abs() <= MAX_IMU_OFFSET)?;
        let force = if i.count > 0 {
            i.sum / f64::from(i.count)
        } else {
            i.newest
        };
        (i.sum, i.count) = (Vector3::zeros(), 0);
        let [p, v, a] = c.odometry_sd;
        let sd = |reported: Option<[f64; 3]>, default: f64| {
            let sqrt = |x: f64| if x > 0.0 && x < 1e6 { x.sqrt() } else { default };
            reported.map_or([default; 3], |variances| variances.map(sqrt))
        };
        let state = DroneState {
            header: Header::new(0, 0, 0, 0, at),
            frames: self.frames,
            position,
            velocity,
            attitude: [q.w, q.i, q.j, q.k],
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
    /// The autopilot is another one, or restarted: its frame is another.
    pub(crate) fn restart(&mut self) {
        *self = DroneStateAssembler {
            resets: self.resets,
            frames: self.frames.wrapping_add(u8::from(self.last.is_some())),
            rejected: self.rejected,
            ..DroneStateAssembler::default()
        };
    }
}

/// A reading of the rangefinder; None out of its limits, and of 0 m, which is no reading whatever its limits.
pub(crate) fn range(at: DroneTime, d: &DistanceReport, c: &AutopilotLinkConfig) -> Option<RangeSample> {
    let [low, high] = d.limits_m;
    let sample = RangeSample {
        header: Header::new(0, 0, 0, 0, at),
        range_m: d.range_m,
        variance: d
            .variance
            .filter(|v| *v > 0.0)
            .unwrap_or(c.range_sd_m * c.range_sd_m),
    };
    // A rangefinder without an echo reports its greatest distance.
    (d.range_m > 0.0 && (low..high).contains(&d.range_m) && sample.check().is_ok()).then_some(sample)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn t(s: f64) -> DroneTime {
        DroneTime::from_secs(s)
    }
    fn report(position: [f64; 3], frame: VelocityFrame, resets: u8) -> OdometryReport {
        let q = UnitQuaternion::from_euler_angles(0.0, 0.0, core::f64::consts::FRAC_PI_2);
        OdometryReport {
            time_us: 0,
            position,
            attitude: [q.w, q.i, q.j, q.k],
            velocity: [1.0, 0.0, 0.0],
            frame,
            rates: [0.0; 3],
            variances: None,
            resets,
        }
    }

    #[test]
    fn body_frame_velocity_in_ned() {
        let c = AutopilotLinkConfig::default();
        let mut f = DroneStateAssembler::default();
        f.imu(t(1.0), [0.0, 0.0, -9.8]);
        let ned = f
            .odometry(t(1.0), &report([0.0; 3], VelocityFrame::Ned, 0), &c)
            .unwrap();
        assert!((ned.velocity[0] - 1.0).abs() < 1e-12);
        let body = f
            .odometry(t(1.01), &report([0.0; 3], VelocityFrame::Body, 0), &c)
            .unwrap();
        assert!((body.velocity[1] - 1.0).abs() < 1e-12, "{:?}", body.velocity);
        assert_eq!(body.position_sd, [0.3; 3]);
    }

    #[test]
    fn drone_state_inputs_and_time() {
        let c = AutopilotLinkConfig::default();
        let mut f = DroneStateAssembler::default();
        let r = report([0.0; 3], VelocityFrame::Ned, 0);
        assert!(f.odometry(t(1.0), &r, &c).is_none());
        for k in 0..4 {
            f.imu(t(1.0 + 0.002 * f64::from(k)), [f64::from(k), 0.0, -9.8]);
        }
        let s = f.odometry(t(1.01), &r, &c).unwrap();
        assert!((s.specific_force[0] - 1.5).abs() < 1e-12);
        assert!(f.odometry(t(1.01), &r, &c).is_none());
        assert!(f.odometry(t(1.0), &r, &c).is_none());
        // The samples have ceased.
        assert!(f.odometry(t(1.2), &r, &c).is_none());
        let broken = OdometryReport {
            attitude: [f64::NAN; 4],
            ..r
        };
        assert!(f.odometry(t(1.21), &broken, &c).is_none());
        assert_eq!(f.rejected, 3);
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
            f.odometry(at, &report([0.0; 3], VelocityFrame::Ned, resets), &c);
        }
        assert_eq!((f.resets, f.frames), (1, 0));
        f.restart();
        assert_eq!((f.resets, f.frames), (1, 1));
    }

    #[test]
    fn rangefinder_at_its_limit() {
        let sample = |range_m, variance| {
            let report = DistanceReport {
                time_ms: 0,
                range_m,
                limits_m: [0.0, 10.0],
                variance,
            };
            range(t(1.0), &report, &AutopilotLinkConfig::default())
        };
        assert!(sample(10.0, None).is_none() && sample(f64::NAN, None).is_none());
        // No reading, of a rangefinder that states no minimum distance.
        let none = DistanceReport {
            time_ms: 0,
            range_m: 0.0,
            limits_m: [0.0, 30.0],
            variance: None,
        };
        assert!(range(t(1.0), &none, &AutopilotLinkConfig::default()).is_none());
        let s = sample(2.0, Some(0.0)).unwrap();
        assert!((s.variance - 0.0004).abs() < 1e-12);
    }
}
