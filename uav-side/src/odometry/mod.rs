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
//! An autopilot's estimate jumps: when it aligns its heading, when GNSS comes back, when another sensor takes over the
//! height; some count it, some do not. Such a jump is detected here and nowhere else. The smooth frame goes on as if
//! nothing had happened, so that plans, holds and what the camera saw stay where they are; the jump goes into
//! [`DroneState::datum_offset`], by which the predictor places what is known by latitude and longitude. A jump of the heading
//! stays in the attitude, because the autopilot flies by it, and is summed in [`DroneState::heading_jumps`].
//!
//! Here, too, and for all nodes is learnt what pushes the drone sideways besides its rotors: the drag that the accelerometers
//! show across the thrust, and what moves the smooth frame besides them, their bias and the tilt's error in it; both averaged
//! over [`DISTURBANCE_S`]. So a gust is known in 0.3 s, and a bias of 0.05 m/s² or a tilt of 0.3 deg, which would each cost
//! 3 cm, is taken out. From it follow the true wind, the drone's drag ([`air`]), and the wind over the deck ([`wind`]).
//!
//! Position 0.8 s ahead from a known position and velocity (simulated sensors, each axis):
//! autopilot 4.7 cm, here 1.6 cm.

mod air;
pub(crate) mod hover;
pub(crate) mod origin;
pub(crate) mod wind;

use alight_shared::config;
use alight_shared::estimation::low_pass;
use alight_shared::frames::wrap_angle;
use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{DroneState, SetPoint, SetPointKind};
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

use origin::yaw_jump;

/// After a longer gap the smoothing starts again from the autopilot's odometry, s.
const MAX_STEP_S: f64 = 0.1;
/// A position that is further than this from where the velocity would have brought it has jumped, m. A false alarm
/// costs nothing: the frame goes on by the velocity for one step.
/// Source: twenty times what a fix of GNSS moves an estimate in one step (0.3 m of noise, 2 cm).
const JUMP_M: f64 = 0.2;
/// Threshold where the autopilot has counted a jump of its estimate, m.
const COUNTED_JUMP_M: f64 = 0.02;
/// By so much more in a gap of 1 s without samples, in proportion to its square, m.
const JUMP_IN_GAP_M: f64 = 0.5;
/// After a longer gap nothing is known of jumps in it, s.
const MAX_GAP_S: f64 = 1.0;
/// Further from the autopilot's position (m) or velocity (m/s) than this, one of the two is wrong:
/// the smoothing starts again from the autopilot's odometry, in the frame that it has.
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
    /// Gains that hold the smooth odometry to the autopilot's.
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
        // An impact lasts for milliseconds: a sample in it, or none, does not show its impulse. The autopilot, which
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
    fn learn_disturbance(&mut self, sample: &Vector2<f64>, dt: f64) {
        let within = |d: f64| d.clamp(-MAX_DISTURBANCE_MPS2, MAX_DISTURBANCE_MPS2);
        self.disturbance = low_pass(self.disturbance, *sample, dt, DISTURBANCE_S).map(within);
    }
}

/// Sum of the jumps of the autopilot's estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Jumps {
    /// [`DroneState::datum_offset`], m: what is added to the autopilot's position.
    pub(crate) offset: Vector3<f64>,
    /// [`DroneState::heading_jumps`], rad.
    pub(crate) heading: f64,
}

/// The smooth odometry.
#[derive(Clone, Debug, Default)]
pub struct Odometry {
    config: OdometryConfig,
    smoothed: Option<SmoothState>,
    jumps: Jumps,
    /// Offset of a beginning from the autopilot's position and velocity, its bias, and the disturbance.
    first: [[f64; 3]; 4],
}

impl Odometry {
    /// Begins with the autopilot's first odometry.
    pub fn new(config: &OdometryConfig) -> Self {
        Odometry {
            config: *config,
            smoothed: None,
            jumps: Jumps::default(),
            first: [[0.0; 3]; 4],
        }
    }
    /// Restarts in another frame of the autopilot.
    pub(crate) fn restart(&mut self) {
        let heading = self.jumps.heading;
        *self = Odometry::new(&self.config);
        self.jumps.heading = heading;
    }
    /// The jumps so far.
    pub(crate) fn jumps(&self) -> Jumps {
        self.jumps
    }
    /// Difference from the autopilot's odometry apart from the jumps: position (m), velocity (m/s), the bias and the
    /// disturbance (m/s²).
    pub(crate) fn difference(&self) -> [[f64; 3]; 4] {
        self.smoothed.map_or([[0.0; 3]; 4], |h| {
            let position = h.position - (h.reported.position() + self.jumps.offset);
            let velocity = h.velocity - h.reported.velocity();
            let disturbance = h.disturbance.push(0.0);
            [position, velocity, h.bias, disturbance].map(Into::into)
        })
    }
    /// Begins with such a difference, not with the autopilot's odometry: the frame stays where it was.
    pub(crate) fn resume(&mut self, difference: [[f64; 3]; 4], jumps: Jumps) {
        (self.first, self.jumps) = (difference, jumps);
    }

    /// The autopilot's odometry with smooth position and velocity:
    /// `v' = R f + g + b + k_v (v_a - v) + k_p (p_a - p)`, `p' = v + drift`, `b' = k_b (v_a - v)`.
    /// `counted`: the autopilot has counted a jump of its estimate since the last one.
    ///
    /// An autopilot whose position drifts (GNSS) without its velocity showing it is followed by these
    /// only in part, `k_p / (k_p + k_b)`. What is more than [`LAG_M`] is made up for slowly by `drift`;
    /// a stiffer loop would bring the fixes' noise into every landing (6 mm of place), and none would
    /// end in a jump, in a flare too.
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
            // Out of order: the readers reject it.
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

    /// Takes a jump of the autopilot's estimate since `last` into account.
    fn watch(&mut self, last: &DroneState, reported: &DroneState, dt: f64, counted: bool) {
        let rates = |d: &DroneState| Vector3::from(d.rates);
        let (before, now) = (last.attitude(), reported.attitude());
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

    /// None: out of order.
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
            // What the frames differ by stays.
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
        let (ahead, faster) = (place - h.position, reported.velocity() - h.velocity);
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

    /// A set-point of the smooth frame in the autopilot's own, for a loop that the autopilot closes:
    /// `p + p_a - p_s`, `v + v_a - v_s`. Else the drone would stay off its plan by as much as the
    /// frames are apart, and a plan that restarts at the drone would run away from it.
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
        let mut o = Odometry::new(&OdometryConfig::default());
        let mut s = DroneState::default();
        for k in 0..6000 {
            s = o.step(&state(k, 0.0, 0.0, 0.1), false);
        }
        assert!(s.velocity[0].abs() < 2e-3, "{}", s.velocity[0]);
        // The frame stays off by b / (k_p + k_b): constant, so it does no harm.
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
            let reported = DroneState {
                attitude: [roll.w, roll.i, roll.j, roll.k],
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
        let mut o = Odometry::new(&OdometryConfig::default());
        // At rest for a second, then pushed by 1 m/s².
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
        // Bounded whatever is sampled.
        let most = (200..400).map(|k| o.step(&state(k, 0.5, 1.0, 25.0), false).disturbance[0]);
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
                s = o.step(&state(k, x, moves, if k == 50 { sampled } else { 0.0 }), false);
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
            let s = o.step(&state(k, x, 0.0, 0.0), false).position[0];
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
            s = o.step(&state(k, x, v, 0.1), false);
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
    fn odometry_frame_at_jumps_and_gaps() {
        // Northward at 1 m/s. Jumps, counted or not, large or small; a gap; the frame goes on through all of it, and the
        // datum takes it up.
        for (jump, counted) in [
            (5.0, false),
            (0.4, false),
            (0.4, true),
            (0.1, true),
            (-80.0, true),
        ] {
            for gap in [1, 30] {
                let mut o = Odometry::new(&OdometryConfig::default());
                (0..100).for_each(|k| {
                    o.step(&state(k, 0.01 * f64::from(k), 1.0, 0.0), false);
                });
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
                    // What is led there by the autopilot is led to the same place.
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
        let mut o = Odometry::new(&OdometryConfig::default());
        let heading = |k: u32, yaw: f64| {
            let q = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
            DroneState {
                attitude: [q.w, q.i, q.j, q.k],
                ..state(k, 0.0, 0.0, 0.0)
            }
        };
        o.step(&heading(0, 0.2), false);
        let s = o.step(&heading(1, 2.2), false);
        assert!((s.heading_jumps - 2.0).abs() < 1e-9 && (s.euler().z - 2.2).abs() < 1e-9);
        let s = o.step(&heading(2, 4.2), false);
        assert!((s.heading_jumps - wrap_angle(4.0)).abs() < 1e-9);
    }

    #[test]
    fn odometry_stale_input() {
        let mut o = Odometry::new(&OdometryConfig::default());
        o.step(&state(1, 0.0, 1.0, 0.0), false);
        let old = state(0, 7.0, 0.0, 0.0);
        assert_eq!(o.step(&old, false), old);
    }
}
