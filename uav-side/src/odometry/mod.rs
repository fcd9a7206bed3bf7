//! Smooth odometry of the drone, from the autopilot's odometry and inertial sensors.
//!
//! An autopilot corrects position and velocity separately at each GNSS fix: its position jumps by a centimetre ten
//! times a second, and its velocity is not the derivative of its position. A landing needs the opposite: a frame that
//! may be offset but is consistent with the drone's motion. This module therefore integrates the inertial sensors again
//! and couples them to the autopilot's odometry so softly that over a second only accelerometer noise matters. A slow
//! velocity error remains; the predictor estimates it with the camera (`predictor::axis::DRIFT`) and removes it.
//!
//! The smooth frame is offset from the autopilot's by decimetres; [`Odometry::for_autopilot`] converts set-points back.
//!
//! An autopilot's estimate jumps when it aligns its heading, when GNSS returns, or when another sensor takes over the
//! height; not every jump is counted. Only this module detects such jumps. The smooth frame continues across a jump, so
//! that plans, hold positions and vision measurements stay valid; the jump is added to [`DroneState::datum_offset`],
//! with which the predictor places points given by latitude and longitude. A heading jump is kept in the attitude,
//! because the autopilot uses that heading, and is summed in [`DroneState::heading_jumps`].
//!
//! The module also estimates the lateral disturbance for all nodes. It is the sum of the drag that the accelerometers
//! measure across the thrust, and the acceleration of the smooth frame that they do not measure, i.e. their bias and
//! the tilt error; both are averaged over [`DISTURBANCE_S`]. A gust is known within 0.3 s. A bias of 0.05 m/s² or a
//! tilt error of 0.3 deg, each of which would cause a position error of 3 cm, is removed. The true wind, the drone's
//! drag ([`air`]) and the wind over the deck ([`wind`]) follow from it.
//!
//! Position error after a prediction over 0.8 s (simulated sensors, each axis): autopilot 4.7 cm, smooth odometry 1.6
//! cm.

mod air;
pub(crate) mod hover;
pub(crate) mod origin;
pub(crate) mod wind;

use alight_shared::{
    config,
    estimation::low_pass,
    frames::wrap_angle,
    geometry::GRAVITY,
    msg::{DroneState, SetPoint, SetPointKind},
    time::DroneTime,
};
use nalgebra::{Vector2, Vector3};

use origin::yaw_jump;

/// Gap of odometry after which the smoothing restarts from the autopilot's odometry, s.
const MAX_STEP_S: f64 = 0.1;
/// Difference between the reported position and the one propagated with the velocity above which the estimate has
/// jumped, m. After a false alarm the frame follows the velocity for one step, which is harmless.
/// Source: twenty times the change due to a GNSS fix in one step (0.3 m of noise, 2 cm).
const JUMP_M: f64 = 0.2;
/// [`JUMP_M`] if the autopilot has counted a jump of its estimate, m.
const COUNTED_JUMP_M: f64 = 0.02;
/// Increase of [`JUMP_M`] in a gap of 1 s without samples, m; it grows with the square of the gap.
const JUMP_IN_GAP_M: f64 = 0.5;
/// Gap of odometry above which jumps within it are not detected, s.
const MAX_GAP_S: f64 = 1.0;
/// Difference from the autopilot's position (m) or velocity (m/s) at which one of the two must be wrong. The smoothing
/// then restarts from the autopilot's odometry, in the current frame.
const MAX_DIFFERENCE: f64 = 1.5;
/// Difference between the integrated specific force and the autopilot's velocity change in one step that indicates an
/// impact, m/s. A GNSS fix changes the velocity by less.
const IMPACT_MPS: f64 = 0.3;
/// Averaging time of the disturbance, against accelerometer noise, s.
pub(crate) const DISTURBANCE_S: f64 = 0.3;
/// Bound of the disturbance, each axis, m/s²: drag in 14 m/s of wind on the default drone, which then tilts by 30 deg.
const MAX_DISTURBANCE_MPS2: f64 = 6.0;
/// Distance from the autopilot's position above which the smooth frame drifts towards it, m.
const LAG_M: f64 = 0.6;
/// Rate of that drift, 1/s: with a drift of 5 cm/s, the fastest of a GNSS error of metres, the lag increases by 0.5 m.
const DRIFT_GAIN: f64 = 0.1;

/// Gain from the velocity difference to the acceleration, 1/s.
const VELOCITY_GAIN: f64 = 1.0;
/// Gain from the position difference to the acceleration, 1/s².
const POSITION_GAIN: f64 = 0.2;
/// Gain from the velocity difference to the rate of the accelerometer bias, 1/s².
const BIAS_GAIN: f64 = 0.3;
/// Maximum bias, including tilt error, m/s².
const BIAS_LIMIT_MPS2: f64 = 1.0;

config! {
    /// Coupling between the smooth odometry and the autopilot's.
    ///
    /// Chosen: softer gains reduce the noise over a second and increase the velocity error for the camera.
    #[derive(Copy)]
    pub struct OdometryConfig {
        /// Smooth the odometry; if false, the autopilot's odometry is used unchanged.
        pub smooth: bool = true;
    }
}

#[derive(Clone, Copy, Debug)]
struct SmoothState {
    at: DroneTime,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    bias: Vector3<f64>,
    /// Measured acceleration that the rotors do not cause, m/s².
    disturbance: Vector2<f64>,
    reported: DroneState,
}

impl SmoothState {
    /// Propagates by `dt` (s) with specific force and gravity; `ahead` (m) and `faster` (m/s) are the differences from
    /// the autopilot's position and velocity.
    fn advance(
        &mut self,
        reported: &DroneState,
        force: &Vector3<f64>,
        ahead: &Vector3<f64>,
        faster: &Vector3<f64>,
        dt: f64,
    ) {
        // A single sample does not show the impulse of an impact, which lasts for milliseconds. The autopilot's
        // velocity does, because the autopilot integrates its sensors at their own rate.
        let change = reported.velocity() - self.reported.velocity();
        let impact = (force * dt - change).norm() > IMPACT_MPS;
        let force = if impact { change / dt } else { *force };
        let unmeasured = self.bias + faster * VELOCITY_GAIN + ahead * POSITION_GAIN;
        if !impact {
            let [x, y, _] = reported.specific_force;
            let across = reported.attitude() * Vector3::new(x, y, 0.0);
            self.learn_disturbance(&(across + unmeasured).xy(), dt);
        }
        let acceleration = force + unmeasured;
        let drift = (ahead - ahead.cap_magnitude(LAG_M)) * DRIFT_GAIN;
        self.position += (self.velocity + drift) * dt + acceleration * (0.5 * dt * dt);
        self.velocity += acceleration * dt;
        let max = BIAS_LIMIT_MPS2;
        self.bias = (self.bias + faster * (BIAS_GAIN * dt)).map(|b| b.clamp(-max, max));
        self.at = reported.header.at;
        self.reported = *reported;
    }
    fn learn_disturbance(&mut self, sample: &Vector2<f64>, dt: f64) {
        let within = |d: f64| d.clamp(-MAX_DISTURBANCE_MPS2, MAX_DISTURBANCE_MPS2);
        self.disturbance = low_pass(self.disturbance, *sample, dt, DISTURBANCE_S).map(within);
    }
}

/// Sum of the jumps of the autopilot's estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Jumps {
    /// [`DroneState::datum_offset`], m: added to the autopilot's position.
    pub(crate) offset: Vector3<f64>,
    /// [`DroneState::heading_jumps`], rad.
    pub(crate) heading: f64,
}

#[derive(Clone, Debug, Default)]
pub struct Odometry {
    config: OdometryConfig,
    smoothed: Option<SmoothState>,
    jumps: Jumps,
    /// Initial differences from the autopilot's position (m) and velocity (m/s), and initial bias and disturbance
    /// (m/s²).
    first: [[f64; 3]; 4],
}

impl Odometry {
    pub fn new(config: &OdometryConfig) -> Self {
        Odometry {
            config: *config,
            smoothed: None,
            jumps: Jumps::default(),
            first: [[0.0; 3]; 4],
        }
    }
    pub(crate) fn restart(&mut self) {
        let heading = self.jumps.heading;
        *self = Odometry::new(&self.config);
        self.jumps.heading = heading;
    }
    pub(crate) fn jumps(&self) -> Jumps {
        self.jumps
    }
    /// Position (m) and velocity (m/s) relative to the autopilot's odometry without its jumps, and bias and disturbance
    /// (m/s²).
    pub(crate) fn difference(&self) -> [[f64; 3]; 4] {
        self.smoothed.map_or([[0.0; 3]; 4], |h| {
            let position = h.position - (h.reported.position() + self.jumps.offset);
            let velocity = h.velocity - h.reported.velocity();
            let disturbance = h.disturbance.push(0.0);
            [position, velocity, h.bias, disturbance].map(Into::into)
        })
    }
    /// Starts with a predecessor's [`Self::difference`], so that the smooth frame is continuous.
    pub(crate) fn resume(&mut self, difference: [[f64; 3]; 4], jumps: Jumps) {
        self.first = difference;
        self.jumps = jumps;
    }

    /// Smooth position and velocity: `v' = R f + g + b + k_v (v_a - v) + k_p (p_a - p)`, `p' = v + drift`, `b' = k_b
    /// (v_a - v)`. `counted`: whether the autopilot has counted a jump since the last call.
    ///
    /// A drift of the autopilot's position (GNSS) that its velocity does not show is followed only in part,
    /// `k_p / (k_p + k_b)`. `drift` slowly removes a difference above [`LAG_M`]. A stiffer loop would add the fixes' noise to every
    /// landing (6 mm of position), and without the drift the frame would have to jump, even in a flare.
    pub fn step(&mut self, reported: &DroneState, counted: bool) -> DroneState {
        let smoothed = self.smoothed(reported, counted);
        let jumps = self.jumps;
        let (position, velocity, disturbance) = match smoothed {
            Some(h) if self.config.smooth => (h.position, h.velocity, h.disturbance),
            Some(h) => (
                reported.position() + jumps.offset,
                reported.velocity(),
                h.disturbance,
            ),
            // Consumers reject this sample because it is out of order.
            None => return *reported,
        };
        DroneState {
            position: position.into(),
            velocity: velocity.into(),
            disturbance: disturbance.into(),
            datum_offset: jumps.offset.into(),
            heading_jumps: jumps.heading,
            ..*reported
        }
    }

    /// Detects a jump of the autopilot's estimate since `last` and adds it to the sums.
    fn watch(&mut self, last: &DroneState, reported: &DroneState, dt: f64, counted: bool) {
        let rates = |d: &DroneState| Vector3::from(d.rates);
        let before = last.attitude();
        let now = reported.attitude();
        let yaw = yaw_jump((&before, rates(last)), (&now, rates(reported)), dt).unwrap_or(0.0);
        self.jumps.heading = wrap_angle(self.jumps.heading + yaw);
        if dt > MAX_GAP_S {
            return;
        }
        let expected = last.position() + (last.velocity() + reported.velocity()) * (0.5 * dt);
        let jump = reported.position() - expected;
        let limit = if counted { COUNTED_JUMP_M } else { JUMP_M } + JUMP_IN_GAP_M * dt * dt;
        if jump.norm() > limit {
            self.jumps.offset -= jump;
        }
    }

    /// Smooth state; None if `reported` is out of order.
    fn smoothed(&mut self, reported: &DroneState, counted: bool) -> Option<SmoothState> {
        let [position, velocity, bias, disturbance] = self.first.map(Vector3::from);
        let Some(mut h) = self.smoothed else {
            let first = SmoothState {
                at: reported.header.at,
                position: reported.position() + self.jumps.offset + position,
                velocity: reported.velocity() + velocity,
                bias,
                disturbance: disturbance.xy(),
                reported: *reported,
            };
            self.smoothed = Some(first);
            return self.smoothed;
        };
        let dt = (reported.header.at - h.at).secs();
        if !(dt > 0.0) {
            return None;
        }
        let left = h.position - (h.reported.position() + self.jumps.offset);
        self.watch(&h.reported, reported, dt, counted);
        let force = reported.attitude() * Vector3::from(reported.specific_force) + Vector3::z() * GRAVITY;
        if dt > MAX_STEP_S || !force.norm().is_finite() {
            // The offset between the frames stays the same.
            let begun = SmoothState {
                at: reported.header.at,
                position: reported.position() + self.jumps.offset + left,
                velocity: reported.velocity(),
                reported: *reported,
                ..h
            };
            self.smoothed = Some(begun);
            return self.smoothed;
        }
        let place = reported.position() + self.jumps.offset;
        let ahead = place - h.position;
        let faster = reported.velocity() - h.velocity;
        if !(ahead.norm() < MAX_DIFFERENCE && faster.norm() < MAX_DIFFERENCE) {
            let position = h.position + (h.velocity + reported.velocity()) * (0.5 * dt);
            self.jumps.offset = position - reported.position();
            self.smoothed = Some(SmoothState {
                at: reported.header.at,
                position,
                velocity: reported.velocity(),
                bias: Vector3::zeros(),
                disturbance: h.disturbance,
                reported: *reported,
            });
            return self.smoothed;
        }
        h.advance(reported, &force, &ahead, &faster, dt);
        self.smoothed = Some(h);
        self.smoothed
    }

    /// Converts a set-point from the smooth frame to the autopilot's, for a loop that the autopilot closes: `p + p_a -
    /// p_s`, `v + v_a - v_s`. Otherwise the drone would stay off its plan by the offset between the frames, and a plan
    /// that restarts at the drone would drift away continuously.
    pub fn for_autopilot(&self, set_point: &SetPoint) -> SetPoint {
        match (set_point.kind, &self.smoothed) {
            (SetPointKind::Trajectory, Some(h)) if self.config.smooth => SetPoint {
                position: (Vector3::from(set_point.position) + h.reported.position() - h.position).into(),
                velocity: (Vector3::from(set_point.velocity) + h.reported.velocity() - h.velocity).into(),
                ..*set_point
            },
            (SetPointKind::Trajectory, Some(_)) => SetPoint {
                position: (Vector3::from(set_point.position) - self.jumps.offset).into(),
                ..*set_point
            },
            (SetPointKind::Trajectory | SetPointKind::Attitude | SetPointKind::None, _) => *set_point,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        frames::{wxyz, yaw_rotation},
        msg::Header,
        time::Time,
    };
    use nalgebra::UnitQuaternion;

    fn odometry() -> Odometry {
        Odometry::new(&OdometryConfig::default())
    }
    fn state(k: u32, position: f64, velocity: f64, force: f64) -> DroneState {
        DroneState {
            header: Header::new(1, 1, 1, k, Time::from_secs(0.01 * f64::from(k))),
            position: [position, 0.0, -5.0],
            velocity: [velocity, 0.0, 0.0],
            specific_force: [force, 0.0, -GRAVITY],
            ..Default::default()
        }
    }

    #[test]
    fn odometry_position_steps() {
        let mut o = odometry();
        let mut last = None::<DroneState>;
        let mut largest = 0.0_f64;
        for k in 0..3000_u32 {
            // A drone at rest whose reported position moves by 2 cm and back, ten times a second.
            let reported = state(k, if (k / 10) % 2 == 0 { 0.02 } else { -0.02 }, 0.0, 0.0);
            let s = o.step(&reported, false);
            if let Some(l) = last {
                let moved = s.position[0] - l.position[0];
                largest = largest.max((moved - 0.005 * (s.velocity[0] + l.velocity[0])).abs());
            }
            last = Some(s);
        }
        assert!(largest < 1e-5, "{largest}");
        assert!(last.unwrap().position[0].abs() < 0.02);
    }

    #[test]
    fn odometry_accelerometer_bias() {
        let mut o = odometry();
        let mut s = DroneState::default();
        for k in 0..6000 {
            s = o.step(&state(k, 0.0, 0.0, 0.1), false);
        }
        assert!(s.velocity[0].abs() < 2e-3, "{}", s.velocity[0]);
        // The frame keeps a constant offset of b / (k_p + k_b), which is harmless.
        assert!((s.position[0] - 0.2).abs() < 0.01, "{}", s.position[0]);
    }

    #[test]
    fn disturbance_by_wind_and_level_error() {
        // Wind of 0.6 m/s² from the south, with an error of 0.01 rad in the reported roll; the true tilt balances the
        // wind.
        let mut o = odometry();
        let roll = UnitQuaternion::from_euler_angles(0.01, 0.0, 0.0);
        let mut s = DroneState::default();
        for k in 0..1500_u32 {
            let t = 0.01 * f64::from(k);
            let reported = DroneState {
                attitude: wxyz(&roll),
                ..state(k, 0.3 * t * t, 0.6 * t, 0.6)
            };
            s = o.step(&reported, false);
        }
        let [north, east] = s.disturbance;
        assert!((north - 0.6).abs() < 0.03, "{north}");
        assert!((east + 0.01 * GRAVITY).abs() < 0.01, "{east}");
    }

    #[test]
    fn disturbance_of_a_gust_after_a_second() {
        let mut o = odometry();
        // The drone is at rest for a second and is then accelerated at 1 m/s².
        let pushed = |k: u32| {
            let t = 0.01 * f64::from(k.saturating_sub(100));
            state(k, 0.5 * t * t, t, if k > 100 { 1.0 } else { 0.0 })
        };
        let mut known = Vec::new();
        for k in 0..200 {
            known.push(o.step(&pushed(k), false).disturbance[0]);
        }
        assert!(known[99].abs() < 1e-9, "{}", known[99]);
        assert!(known[130] > 0.6 && (known[199] - 1.0).abs() < 0.05, "{known:?}");
        let most = (200..400).map(|k| o.step(&state(k, 0.5, 1.0, 25.0), false).disturbance[0]);
        assert!(most.fold(0.0, f64::max) <= MAX_DISTURBANCE_MPS2);
    }

    #[test]
    fn odometry_impact() {
        // In a contact at 0.6 m/s the impact of 168 m/s² lasts 3 ms, within a sample of 10 ms or between two samples.
        for sampled in [-168.0, 0.0] {
            let mut o = odometry();
            let mut s = DroneState::default();
            for k in 0..100_u32 {
                let moves = if k < 50 { 0.6 } else { 0.0 };
                let x = 0.6 * 0.01 * f64::from(k.min(50));
                s = o.step(&state(k, x, moves, if k == 50 { sampled } else { 0.0 }), false);
                assert!((s.velocity[0] - moves).abs() < 0.05, "{k}: {}", s.velocity[0]);
            }
            assert!((s.position[0] - 0.3).abs() < 0.02, "{}", s.position[0]);
        }
    }

    #[test]
    fn odometry_position_drift() {
        // The GNSS error grows slowly, by 3 cm/s for two minutes, to 3.6 m.
        let mut o = odometry();
        let mut max = 0.0_f64;
        let mut jump = 0.0_f64;
        let mut last = 0.0;
        for k in 0..12_000_u32 {
            let x = 0.03 * 0.01 * f64::from(k);
            let s = o.step(&state(k, x, 0.0, 0.0), false).position[0];
            max = max.max((s - x).abs());
            jump = jump.max((s - last).abs());
            last = s;
        }
        assert!(max < 1.0 && jump < 2e-3, "{max} {jump}");
    }

    #[test]
    fn odometry_set_points_in_the_autopilot_frame() {
        let mut o = odometry();
        let wanted = SetPoint {
            kind: SetPointKind::Trajectory,
            position: [1.0, 0.0, -5.0],
            ..SetPoint::default()
        };
        // Half a degree of tilt error would move the frames 0.2 m apart.
        let mut x = 0.0;
        let mut v = 0.0;
        let mut s = DroneState::default();
        for k in 0..6000 {
            s = o.step(&state(k, x, v, 0.1), false);
            v = 0.5 * (o.for_autopilot(&wanted).position[0] - x);
            x += 0.01 * v;
        }
        assert!(
            (s.position[0] - x).abs() > 0.1,
            "no offset between the frames: {x}"
        );
        assert!((s.position[0] - 1.0).abs() < 0.01, "{}", s.position[0]);
        let attitude = SetPoint {
            kind: SetPointKind::Attitude,
            ..wanted
        };
        assert_eq!(o.for_autopilot(&attitude), attitude);
    }

    #[test]
    fn odometry_frame_at_jumps_and_gaps() {
        // The drone moves north at 1 m/s, with counted and uncounted jumps of several sizes and a gap.
        for (jump, counted) in [
            (5.0, false),
            (0.4, false),
            (0.4, true),
            (0.1, true),
            (-80.0, true),
        ] {
            for gap in [1, 30] {
                let mut o = odometry();
                for k in 0..100 {
                    o.step(&state(k, 0.01 * f64::from(k), 1.0, 0.0), false);
                }
                for k in (99 + gap)..(200 + gap) {
                    let x = 0.01 * f64::from(k);
                    let s = o.step(&state(k, x + jump, 1.0, 0.0), counted && k == 99 + gap);
                    let off = (s.position[0] - x).abs();
                    assert!(off < 0.01, "{jump} {counted} {gap}: {off}");
                    assert!(
                        (s.datum_offset[0] + jump).abs() < 1e-6,
                        "{jump}: {:?}",
                        s.datum_offset
                    );
                    let here = SetPoint {
                        kind: SetPointKind::Trajectory,
                        position: s.position,
                        ..SetPoint::default()
                    };
                    assert!((o.for_autopilot(&here).position[0] - x - jump).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn odometry_heading_jump() {
        let mut o = odometry();
        let heading = |k: u32, yaw: f64| DroneState {
            attitude: wxyz(&yaw_rotation(yaw)),
            ..state(k, 0.0, 0.0, 0.0)
        };
        o.step(&heading(0, 0.2), false);
        let s = o.step(&heading(1, 2.2), false);
        assert!((s.heading_jumps - 2.0).abs() < 1e-9 && (s.euler().z - 2.2).abs() < 1e-9);
        let s = o.step(&heading(2, 4.2), false);
        assert!((s.heading_jumps - wrap_angle(4.0)).abs() < 1e-9);
    }

    #[test]
    fn odometry_stale_input() {
        let mut o = odometry();
        o.step(&state(1, 0.0, 1.0, 0.0), false);
        let old = state(0, 7.0, 0.0, 0.0);
        assert_eq!(o.step(&old, false), old);
    }
}
