//! Smooth odometry of the drone, from the autopilot's.
//!
//! An autopilot corrects position and velocity by each GNSS fix on its own: its position moves by a
//! centimetre ten times a second, and its velocity is not the derivative of its position. Landing
//! needs the opposite: a frame that may be off, but moves with the drone. So the inertial sensors
//! are integrated here once more and held to the autopilot's odometry so softly that over a second
//! only the accelerometers' noise counts. What is left is an error of velocity that changes slowly:
//! the predictor sees it with the camera (`predictor::axis::DRIFT`) and takes it off.
//!
//! The smooth frame is off from the autopilot's by some decimetres, so a set-point goes back through
//! [`Odometry::for_autopilot`].
//!
//! Here, too, and for all nodes is learnt what pushes the drone sideways besides its rotors: the drag that the accelerometers
//! show across the thrust, and what moves the smooth frame besides them, their bias and the tilt's error in it; both averaged
//! over [`DISTURBANCE_S`]. So a gust is known in 0.3 s, and a bias of 0.05 m/s² or a tilt of 0.3 deg, which would each cost
//! 3 cm, is taken out.
//!
//! Position 0.8 s ahead from a known position and velocity (simulated sensors, each axis):
//! autopilot 4.7 cm, here 1.6 cm.

pub(crate) mod hover;
pub(crate) mod origin;

use alight_shared::config;
use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{DroneState, SetPoint, SetPointKind};
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

/// After a longer gap the smoothing starts again from the autopilot's odometry, s.
const MAX_STEP_S: f64 = 0.1;
/// A position that is further than this from where the velocity would have brought it is a reset of
/// the autopilot's origin, m.
const JUMP_M: f64 = 0.4;
/// Further from the autopilot's position (m) or velocity (m/s) than this, one of the two is wrong:
/// the smoothing starts again from the autopilot's odometry.
const MAX_DIFFERENCE: f64 = 1.5;
/// A step in which the sampled force and the autopilot's velocity differ by more than this is an impact, m/s. A fix of GNSS
/// moves the velocity by less.
const IMPACT_MPS: f64 = 0.3;
/// The accelerometers' noise is averaged over this time, s.
pub(crate) const DISTURBANCE_S: f64 = 0.3;
/// No disturbance is larger, each axis, m/s²: drag of 14 m/s of wind on the default drone, which leans by 30 deg.
const MAX_DISTURBANCE_MPS2: f64 = 6.0;
/// Further from the autopilot's position than this, m, the smooth frame is drawn after it ...
const LAG_M: f64 = 0.6;
/// ... at this rate, 1/s: a drift of 5 cm/s, the fastest of a GNSS error of metres, moves it 0.5 m further.
const DRIFT_GAIN: f64 = 0.1;

// Softer gains leave less noise over a second and a larger error of velocity, which the camera then has to find.

/// Gain on the difference of velocity, 1/s.
const VELOCITY_GAIN: f64 = 1.0;
/// Gain on the difference of position, 1/s².
const POSITION_GAIN: f64 = 0.2;
/// Gain of the accelerometers' bias on the difference of velocity, 1/s².
const BIAS_GAIN: f64 = 0.3;
/// Largest bias accepted, tilt error included, m/s².
const BIAS_LIMIT_MPS2: f64 = 1.0;

config! {
    /// How softly the smooth odometry is held to the autopilot's.
    ///
    /// Chosen: Softer gains leave less noise over a second and a larger error of velocity, which
    /// the camera then has to find.
    #[derive(Copy)]
    pub struct OdometryConfig {
        /// On; else the autopilot's odometry is used as it is.
        pub smooth: bool = true;
    }
}

#[derive(Clone, Copy, Debug)]
struct SmoothState {
    at: Time<DroneClock>,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    bias: Vector3<f64>,
    /// The acceleration that is not the rotors', m/s².
    disturbance: Vector2<f64>,
    /// The autopilot's last odometry.
    reported: DroneState,
}

impl SmoothState {
    /// `dt` later (s), by the specific force and gravity, with the autopilot `ahead` (m) and `faster` (m/s).
    fn advance(
        &mut self,
        reported: &DroneState,
        force: &Vector3<f64>,
        ahead: &Vector3<f64>,
        faster: &Vector3<f64>,
        dt: f64,
    ) {
        // An impact lasts for milliseconds: a sample in it, or none, tells nothing of its impulse. The autopilot, which
        // integrates its sensors at their own rate, has it.
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
    fn state(&self) -> DroneState {
        DroneState {
            position: self.position.into(),
            velocity: self.velocity.into(),
            disturbance: self.disturbance.into(),
            ..self.reported
        }
    }
    fn learn_disturbance(&mut self, sample: &Vector2<f64>, dt: f64) {
        let within = |d: f64| d.clamp(-MAX_DISTURBANCE_MPS2, MAX_DISTURBANCE_MPS2);
        let gain = 1.0 - (-dt / DISTURBANCE_S).exp();
        self.disturbance = (self.disturbance + (sample - self.disturbance) * gain).map(within);
    }
}

/// The smooth odometry.
#[derive(Clone, Debug, Default)]
pub struct Odometry {
    config: OdometryConfig,
    smoothed: Option<SmoothState>,
    /// What a beginning adds to the autopilot's position and velocity, its bias, and the disturbance.
    first: [[f64; 3]; 4],
}

impl Odometry {
    /// Begins with the autopilot's first odometry.
    pub fn new(config: &OdometryConfig) -> Self {
        Odometry {
            config: *config,
            smoothed: None,
            first: [[0.0; 3]; 4],
        }
    }
    /// How this differs from the autopilot's odometry: position (m), velocity (m/s), the bias and the disturbance (m/s²).
    pub(crate) fn difference(&self) -> [[f64; 3]; 4] {
        self.smoothed.map_or([[0.0; 3]; 4], |h| {
            let position = h.position - h.reported.position();
            let velocity = h.velocity - h.reported.velocity();
            let disturbance = h.disturbance.push(0.0);
            [position, velocity, h.bias, disturbance].map(Into::into)
        })
    }
    /// Begins with such a difference, not with the autopilot's odometry: the frame stays where it was.
    pub(crate) fn resume(&mut self, difference: [[f64; 3]; 4]) {
        self.first = difference;
    }

    /// The autopilot's odometry with smooth position and velocity:
    /// `v' = R f + g + b + k_v (v_a - v) + k_p (p_a - p)`, `p' = v + drift`, `b' = k_b (v_a - v)`.
    ///
    /// An autopilot whose position drifts (GNSS) without its velocity saying so is followed by these
    /// only in part, `k_p / (k_p + k_b)`. What is more than [`LAG_M`] is made up for slowly by `drift`;
    /// a stiffer loop would bring the fixes' noise into every landing (6 mm of place), and none would
    /// end in a jump, in a flare too.
    pub fn step(&mut self, reported: &DroneState) -> DroneState {
        let smoothed = self.smoothed(reported);
        if self.config.smooth {
            return smoothed;
        }
        DroneState {
            disturbance: smoothed.disturbance,
            ..*reported
        }
    }
    fn smoothed(&mut self, reported: &DroneState) -> DroneState {
        let [position, velocity, bias, disturbance] = self.first.map(Vector3::from);
        let fresh = SmoothState {
            at: reported.header.at,
            position: reported.position(),
            velocity: reported.velocity(),
            bias: Vector3::zeros(),
            disturbance: self.smoothed.map_or(disturbance.xy(), |h| h.disturbance),
            reported: *reported,
        };
        let Some(mut h) = self.smoothed else {
            let first = SmoothState {
                position: fresh.position + position,
                velocity: fresh.velocity + velocity,
                bias,
                ..fresh
            };
            self.smoothed = Some(first);
            return first.state();
        };
        let dt = (reported.header.at - h.at).secs();
        let force = reported.attitude() * Vector3::from(reported.specific_force) + Vector3::z() * GRAVITY;
        if !(dt > 0.0) {
            // Out of order: the readers reject it.
            return *reported;
        }
        if dt > MAX_STEP_S || !force.norm().is_finite() {
            let begun = SmoothState {
                bias: h.bias,
                ..fresh
            };
            self.smoothed = Some(begun);
            return begun.state();
        }
        let expected = h.reported.position() + (h.reported.velocity() + reported.velocity()) * (0.5 * dt);
        let jump = reported.position() - expected;
        if jump.norm() > JUMP_M {
            h.position += jump;
        }
        let (ahead, faster) = (reported.position() - h.position, reported.velocity() - h.velocity);
        if !(ahead.norm() < MAX_DIFFERENCE && faster.norm() < MAX_DIFFERENCE) {
            self.smoothed = Some(fresh);
            return fresh.state();
        }
        h.advance(reported, &force, &ahead, &faster, dt);
        self.smoothed = Some(h);
        h.state()
    }

    /// A set-point of the smooth frame in the autopilot's own, for a loop that the autopilot closes:
    /// `p + p_a - p_s`, `v + v_a - v_s`. Else the drone would stay off its plan by as much as the
    /// frames are apart, and a plan that begins anew at the drone would run away from it.
    pub fn for_autopilot(&self, set_point: &SetPoint) -> SetPoint {
        match (set_point.kind, &self.smoothed) {
            (SetPointKind::Trajectory, Some(h)) if self.config.smooth => SetPoint {
                position: (Vector3::from(set_point.position) + h.reported.position() - h.position).into(),
                velocity: (Vector3::from(set_point.velocity) + h.reported.velocity() - h.velocity).into(),
                ..*set_point
            },
            (SetPointKind::Trajectory | SetPointKind::Attitude | SetPointKind::None, _) => *set_point,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use nalgebra::UnitQuaternion;

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
        let mut o = Odometry::new(&OdometryConfig::default());
        let (mut last, mut largest) = (None::<DroneState>, 0.0_f64);
        for k in 0..3000_u32 {
            // A drone at rest whose reported position moves by 2 cm and back, ten times a second.
            let reported = state(k, if (k / 10) % 2 == 0 { 0.02 } else { -0.02 }, 0.0, 0.0);
            let s = o.step(&reported);
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
        let mut o = Odometry::new(&OdometryConfig::default());
        let mut s = DroneState::default();
        for k in 0..6000 {
            s = o.step(&state(k, 0.0, 0.0, 0.1));
        }
        assert!(s.velocity[0].abs() < 2e-3, "{}", s.velocity[0]);
        // The frame stays off by b / (k_p + k_b): constant, so nobody minds.
        assert!((s.position[0] - 0.2).abs() < 0.01, "{}", s.position[0]);
    }

    #[test]
    fn disturbance_by_wind_and_level_error() {
        // Wind of 0.6 m/s² north while the attitude reads 0.01 rad too much roll: held by the true tilt.
        let mut o = Odometry::new(&OdometryConfig::default());
        let roll = UnitQuaternion::from_euler_angles(0.01, 0.0, 0.0);
        let mut s = DroneState::default();
        for k in 0..1500_u32 {
            let t = 0.01 * f64::from(k);
            s = o.step(&DroneState {
                attitude: [roll.w, roll.i, roll.j, roll.k],
                ..state(k, 0.3 * t * t, 0.6 * t, 0.6)
            });
        }
        let [north, east] = s.disturbance;
        assert!((north - 0.6).abs() < 0.03, "{north}");
        assert!((east + 0.01 * GRAVITY).abs() < 0.01, "{east}");
    }

    #[test]
    fn disturbance_of_a_gust_after_a_second() {
        let mut o = Odometry::new(&OdometryConfig::default());
        // At rest for a second, then pushed by 1 m/s².
        let pushed = |k: u32| {
            let t = 0.01 * f64::from(k.saturating_sub(100));
            state(k, 0.5 * t * t, t, if k > 100 { 1.0 } else { 0.0 })
        };
        let mut known = Vec::new();
        for k in 0..200 {
            known.push(o.step(&pushed(k)).disturbance[0]);
        }
        assert!(known[99].abs() < 1e-9, "{}", known[99]);
        assert!(known[130] > 0.6 && (known[199] - 1.0).abs() < 0.05, "{known:?}");
        // Bounded whatever is sampled.
        let most = (200..400).map(|k| o.step(&state(k, 0.5, 1.0, 25.0)).disturbance[0]);
        assert!(most.fold(0.0, f64::max) <= MAX_DISTURBANCE_MPS2);
    }

    #[test]
    fn odometry_impact() {
        // Onto the deck at 0.6 m/s: the sample lasts 10 ms, the impact of 168 m/s² lasted 3 ms, or fell between samples.
        for sampled in [-168.0, 0.0] {
            let mut o = Odometry::new(&OdometryConfig::default());
            let mut s = DroneState::default();
            for k in 0..100_u32 {
                let moves = if k < 50 { 0.6 } else { 0.0 };
                let x = 0.6 * 0.01 * f64::from(k.min(50));
                s = o.step(&state(k, x, moves, if k == 50 { sampled } else { 0.0 }));
                assert!((s.velocity[0] - moves).abs() < 0.05, "{k}: {}", s.velocity[0]);
            }
            assert!((s.position[0] - 0.3).abs() < 0.02, "{}", s.position[0]);
        }
    }

    #[test]
    fn odometry_position_drift() {
        // The slow error of a GNSS: 3 cm/s for two minutes, 3.6 m in all.
        let (mut o, mut max, mut jump) = (Odometry::new(&OdometryConfig::default()), 0.0_f64, 0.0_f64);
        let mut last = 0.0;
        for k in 0..12_000_u32 {
            let x = 0.03 * 0.01 * f64::from(k);
            let s = o.step(&state(k, x, 0.0, 0.0)).position[0];
            (max, jump) = (max.max((s - x).abs()), jump.max((s - last).abs()));
            last = s;
        }
        assert!(max < 1.0 && jump < 2e-3, "{max} {jump}");
    }

    #[test]
    fn odometry_set_points_in_the_autopilot_frame() {
        let mut o = Odometry::new(&OdometryConfig::default());
        let wanted = SetPoint {
            kind: SetPointKind::Trajectory,
            position: [1.0, 0.0, -5.0],
            ..SetPoint::default()
        };
        // Half a degree of tilt error lays the frames 0.2 m apart.
        let (mut x, mut v, mut s) = (0.0, 0.0, DroneState::default());
        for k in 0..6000 {
            s = o.step(&state(k, x, v, 0.1));
            v = 0.5 * (o.for_autopilot(&wanted).position[0] - x);
            x += 0.01 * v;
        }
        assert!((s.position[0] - x).abs() > 0.1, "nothing to make up for: {x}");
        assert!((s.position[0] - 1.0).abs() < 0.01, "{}", s.position[0]);
        let attitude = SetPoint {
            kind: SetPointKind::Attitude,
            ..wanted
        };
        assert_eq!(o.for_autopilot(&attitude), attitude);
    }

    #[test]
    fn odometry_origin_reset_gap_and_stale_input() {
        let mut o = Odometry::new(&OdometryConfig::default());
        o.step(&state(0, 0.0, 1.0, 0.0));
        let moved = o.step(&state(1, 5.01, 1.0, 0.0));
        assert!((moved.position[0] - 5.01).abs() < 1e-3);
        let old = state(0, 7.0, 0.0, 0.0);
        assert_eq!(o.step(&old), old);
        // What pushes it does so after a gap, too.
        let late = DroneState {
            disturbance: moved.disturbance,
            ..state(100, 9.0, 0.0, 0.0)
        };
        assert_eq!(o.step(&late), late);
    }
}
