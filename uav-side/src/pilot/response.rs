//! In-flight identification of the attitude response to set-points, and its compensation.
//!
//! Autopilots rotate towards a commanded attitude at a rate proportional to the remaining angle. A rate loop follows
//! that rate with its own lag, and the link and the autopilot delay the set-point:
//!
//! `T_r w'(t) + w(t) = (c(t - tau) - x(t)) / T`
//!
//! with the attitude `x`, the body rates `w`, the command `c`, and the unknown dead time `tau`, time constant `T` and
//! lag `T_r` of the rate loop. (ArduCopter's shaping with its time constant `t_c` and a rate loop of lag `t_r` is the
//! same equation with `T = t_c + t_r` and `T_r = t_c t_r / (t_c + t_r)`.) All times are time stamps of odometry and
//! set-points, so that neither the age nor the rate of the odometry is mistaken for a slow response.
//!
//! Integrated over a window the equation is linear in `1 / T` and `T_r`:
//!
//! `dx = (1 / T) int (c(s - tau) - x(s)) ds - T_r dw`
//!
//! It is solved per axis and candidate of `tau` by linear regression with forgetting and a prior. The candidate with
//! the smallest residuals, common to both axes, is the dead time (Ljung 1999, System Identification, sections 10.1 and
//! 11.2). With this equation error the fit does not mistake an oscillation of the loop for a slow response. A fit
//! without dead time would, and would amplify the oscillation.

use alight_shared::{
    msg::{AttitudeResponse, DroneState},
    time::{DroneTime, Span},
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::{
    config::LagConfig,
    delay::{SentCommands, parabola_minimum},
};

/// Number of candidate dead times, and their spacing, s.
const CANDIDATES: usize = 21;
const CANDIDATE_STEP_S: f64 = 0.02;
/// Minimum integration window, s: the rates change by more than their noise.
const WINDOW_S: f64 = 0.04;
/// Gap of odometry above which the integration stops, s.
const MAX_GAP_S: f64 = 0.08;
/// Sampling step of the commands, s.
const STEP_S: f64 = 0.01;
/// Maximum angle between command and attitude that is used, rad, because autopilots limit rates and accelerations.
const MAX_ANGLE_RAD: f64 = 0.4;
/// Prior information of `1 / T`: one second at 0.5 deg between command and attitude, rad² s².
const PRIOR_ANGLE: f64 = 3e-6;
/// Prior information of `T_r`: one second in which the rates change by 1.5 rad/s², rad²/s².
const PRIOR_RATE: f64 = 0.1;
/// Residual of a window at the correct dead time, rad.
const RESIDUAL_RAD: f64 = 1e-3;
/// Prior standard deviation of the dead time about the odometry's age, s.
const DEAD_TIME_SD_S: f64 = 0.03;
const MAX_RATE_LAG_S: f64 = 0.2;
/// Information above which a response counts as identified, in units of the prior's.
const IDENTIFIED: f64 = 12.0;

/// Normal equations of one axis and one candidate: `y = a i - T_r dw`.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    ii: f64,
    iw: f64,
    ww: f64,
    yi: f64,
    yw: f64,
    yy: f64,
}

impl Sums {
    fn fade(&mut self, keep: f64) {
        for v in [
            &mut self.ii,
            &mut self.iw,
            &mut self.ww,
            &mut self.yi,
            &mut self.yw,
            &mut self.yy,
        ] {
            *v *= keep;
        }
    }
    /// Adds a window: rotation `y` (rad), integral of the remaining angle `i` (rad s), rate change `dw` (rad/s).
    fn add(&mut self, y: f64, i: f64, dw: f64) {
        let w = -dw;
        self.ii += i * i;
        self.iw += i * w;
        self.ww += w * w;
        self.yi += y * i;
        self.yw += y * w;
        self.yy += y * y;
    }
    /// `1 / T`, `T_r` and the weighted sum of squared residuals, from the prior `[1 / T, T_r]`.
    fn solve(&self, prior: [f64; 2], bounds: [[f64; 2]; 2]) -> ([f64; 2], f64) {
        let ii = self.ii + PRIOR_ANGLE;
        let ww = self.ww + PRIOR_RATE;
        let yi = self.yi + PRIOR_ANGLE * prior[0];
        let yw = self.yw + PRIOR_RATE * prior[1];
        let det = ii * ww - self.iw * self.iw;
        let free = (ii * yw - self.iw * yi) / det;
        let lag = if free.is_finite() { free } else { prior[1] };
        let lag = lag.clamp(bounds[1][0], bounds[1][1]);
        let gain = ((yi - self.iw * lag) / ii).clamp(bounds[0][0], bounds[0][1]);
        let left = self.yy - 2.0 * (gain * self.yi + lag * self.yw)
            + gain * gain * self.ii
            + 2.0 * gain * lag * self.iw
            + lag * lag * self.ww;
        let prior_left = PRIOR_ANGLE * (gain - prior[0]).powi(2) + PRIOR_RATE * (lag - prior[1]).powi(2);
        ([gain, lag], left + prior_left)
    }
}

#[derive(Clone, Copy, Debug)]
struct Window {
    rates: Vector2<f64>,
    duration_s: f64,
    turned: Vector2<f64>,
    integrals: [Vector2<f64>; CANDIDATES],
    /// Whether every command in the window is known and none exceeds [`MAX_ANGLE_RAD`].
    usable: bool,
}

impl Window {
    fn from(drone: &DroneState) -> Window {
        Window {
            rates: Vector3::from(drone.rates).xy(),
            duration_s: 0.0,
            turned: Vector2::zeros(),
            integrals: [Vector2::zeros(); CANDIDATES],
            usable: true,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct ResponseEstimator {
    nominal_s: f64,
    sums: [[Sums; 2]; CANDIDATES],
    window: Option<Window>,
    last: Option<DroneState>,
    response: AttitudeResponse,
}

impl ResponseEstimator {
    pub(crate) fn new(nominal_s: f64, c: &LagConfig) -> Self {
        let nominal_s = nominal_s.clamp(c.bounds_s[0], c.bounds_s[1]);
        ResponseEstimator {
            nominal_s,
            sums: [[Sums::default(); 2]; CANDIDATES],
            window: None,
            last: None,
            response: AttitudeResponse {
                dead_time_s: 0.0,
                lag_s: [nominal_s; 2],
                rate_lag_s: c.rate_loop_s,
                identified: false,
            },
        }
    }

    pub(crate) fn get(&self) -> AttitudeResponse {
        self.response
    }

    /// Command with which a loop with the identified response rotates towards `wanted` like one with the design time
    /// constant. `is` is the attitude at the time when the command takes effect.
    pub(crate) fn command(
        &self,
        wanted: &UnitQuaternion<f64>,
        is: &UnitQuaternion<f64>,
        c: &LagConfig,
    ) -> UnitQuaternion<f64> {
        let angle = (is.inverse() * wanted).scaled_axis();
        let [roll, pitch] = self.factors(c);
        // Heading has its own loop.
        is * UnitQuaternion::from_scaled_axis(Vector3::new(roll * angle.x, pitch * angle.y, angle.z))
    }
    /// Factors on the roll and pitch angles of a command.
    fn factors(&self, c: &LagConfig) -> [f64; 2] {
        // Commands are not amplified for a loop slower than designed: rate and acceleration limits would delay a larger
        // step, and the loop would oscillate.
        self.response.lag_s.map(|lag| (lag / c.design_s).min(1.0))
    }
    /// Time constant of the slower axis with compensation, s.
    pub(crate) fn compensated_s(&self, c: &LagConfig) -> f64 {
        let [roll, pitch] = self.factors(c);
        let [t_roll, t_pitch] = self.response.lag_s;
        (t_roll / roll).max(t_pitch / pitch)
    }

    /// Time constant of the slower axis, s.
    pub(crate) fn slowest_s(&self) -> f64 {
        let [roll, pitch] = self.response.lag_s;
        roll.max(pitch)
    }

    /// Discards the window in progress, e.g. after a contact or while a pilot flies.
    pub(crate) fn interrupt(&mut self) {
        self.window = None;
        self.last = None;
    }

    /// Processes new odometry in free flight. `one_way_s`: age of the odometry, which is the prior mean of the dead
    /// time.
    pub(crate) fn learn(&mut self, drone: &DroneState, sent: &SentCommands, one_way_s: f64, c: &LagConfig) {
        let Some(last) = self.last.replace(*drone) else {
            return;
        };
        let dt = (drone.header.at - last.header.at).secs();
        let finite = drone.rates.iter().all(|w| w.is_finite());
        if !(dt > 0.0 && dt <= MAX_GAP_S && finite) {
            self.window = None;
            return;
        }
        let window = self.window.get_or_insert_with(|| Window::from(&last));
        integrate(window, &last, drone, dt, sent);
        if window.duration_s >= WINDOW_S {
            let full = *window;
            self.window = None;
            if full.usable {
                self.take(&full, &Vector3::from(drone.rates).xy(), one_way_s, c);
            }
        }
    }

    fn take(&mut self, window: &Window, rates: &Vector2<f64>, one_way_s: f64, c: &LagConfig) {
        let keep = (-window.duration_s / c.memory_s).exp();
        let change = rates - window.rates;
        for (sums, integral) in self.sums.iter_mut().zip(&window.integrals) {
            for axis in 0..2 {
                sums[axis].fade(keep);
                sums[axis].add(window.turned[axis], integral[axis], change[axis]);
            }
        }
        self.identify(one_way_s, c);
    }

    fn identify(&mut self, one_way_s: f64, c: &LagConfig) {
        let prior = [1.0 / self.nominal_s, c.rate_loop_s];
        let [low, high] = c.bounds_s;
        let bounds = [[1.0 / high, 1.0 / low], [0.0, MAX_RATE_LAG_S]];
        let cost = |k: usize| {
            let fits = self.sums[k].map(|s| s.solve(prior, bounds));
            let deviation = (CANDIDATE_STEP_S * k as f64 - one_way_s) / DEAD_TIME_SD_S;
            let left = fits[0].1 + fits[1].1 + (RESIDUAL_RAD * deviation).powi(2);
            (left, fits.map(|f| f.0))
        };
        let costs: [(f64, [[f64; 2]; 2]); CANDIDATES] = core::array::from_fn(cost);
        let left: [f64; CANDIDATES] = core::array::from_fn(|k| costs[k].0);
        let Some(steps) = parabola_minimum(&left) else {
            return;
        };
        let best = (steps.round() as usize).min(CANDIDATES - 1);
        let fits = costs[best].1;
        let information = self.sums[best].map(|s| s.ii);
        self.response = AttitudeResponse {
            dead_time_s: CANDIDATE_STEP_S * steps,
            lag_s: fits.map(|[gain, _]| 1.0 / gain),
            rate_lag_s: 0.5 * (fits[0][1] + fits[1][1]),
            identified: information.iter().all(|i| *i > IDENTIFIED * PRIOR_ANGLE),
        };
    }
}

/// Extends the window from `last` to `drone`, `dt` (s) later.
fn integrate(window: &mut Window, last: &DroneState, drone: &DroneState, dt: f64, sent: &SentCommands) {
    let [before, after] = [last, drone].map(|d| Vector3::from(d.rates));
    let start = last.attitude();
    let turns = before.lerp(&after, 0.5);
    window.turned += turns.xy() * dt;
    window.duration_s += dt;
    let steps = (dt / STEP_S).ceil().max(1.0);
    let h = dt / steps;
    for k in 0..steps as u32 {
        let ahead_s = (f64::from(k) + 0.5) * h;
        let is = start * UnitQuaternion::from_scaled_axis(turns * ahead_s);
        let at: DroneTime = last.header.at + Span::from_secs(ahead_s);
        for (n, integral) in window.integrals.iter_mut().enumerate() {
            let Some((command, _)) = sent.by(at - Span::from_secs(CANDIDATE_STEP_S * n as f64)) else {
                window.usable = false;
                return;
            };
            let left = (is.inverse() * command).scaled_axis().xy();
            window.usable &= left.norm() <= MAX_ANGLE_RAD;
            *integral += left * h;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::header;
    use alight_shared::{
        estimation::{low_pass, low_pass_gain},
        frames::wxyz,
        time::Time,
    };

    /// Roll and pitch axes of a drone with PX4's loop or ArduCopter's input shaping.
    struct Axes {
        attitude: UnitQuaternion<f64>,
        rates: Vector3<f64>,
        /// ArduCopter's target: angles and rates of roll and pitch.
        target: Option<(Vector2<f64>, Vector2<f64>)>,
        lag_s: f64,
        rate_s: f64,
    }

    impl Axes {
        fn new(lag_s: f64, rate_s: f64, shapes: bool) -> Axes {
            Axes {
                attitude: UnitQuaternion::identity(),
                rates: Vector3::zeros(),
                target: shapes.then(|| (Vector2::zeros(), Vector2::zeros())),
                lag_s,
                rate_s,
            }
        }
        fn step(&mut self, command: &UnitQuaternion<f64>, dt: f64) {
            let (roll, pitch, _) = command.euler_angles();
            let (is_roll, is_pitch, _) = self.attitude.euler_angles();
            let is = Vector2::new(is_roll, is_pitch);
            let wanted = match &mut self.target {
                None => (Vector2::new(roll, pitch) - is) / self.lag_s,
                Some((at, turning)) => {
                    // Acceleration limit by ATC_ACCEL_R_MAX and ATC_ACCEL_P_MAX, 1100 deg/s².
                    let max = 19.2 * dt;
                    let wanted = (Vector2::new(roll, pitch) - *at) / self.lag_s;
                    *turning += (wanted - *turning).map(|w| w.clamp(-max, max));
                    *at += *turning * dt;
                    (*at - is) * 4.5 + *turning
                }
            };
            self.rates = low_pass(self.rates, wanted.push(0.0), dt, self.rate_s);
            self.attitude *= UnitQuaternion::from_scaled_axis(self.rates * dt);
        }
    }

    fn state(k: u32, at_s: f64, axes: &Axes) -> DroneState {
        DroneState {
            header: header(k, Time::from_secs(at_s)),
            attitude: wxyz(&axes.attitude),
            rates: axes.rates.into(),
            ..DroneState::default()
        }
    }

    fn rocking(t: f64) -> UnitQuaternion<f64> {
        let wave = |a: f64, w: f64| a * (w * t).sin();
        UnitQuaternion::from_euler_angles(
            wave(0.11, 3.0) + wave(0.06, 9.0),
            wave(0.10, 2.0) + wave(0.06, 7.0),
            0.0,
        )
    }

    /// Response identified from 6 s of commands, with odometry every `odometry` steps of 10 ms.
    fn identified(dead_s: f64, axes: &mut Axes, odometry: u32) -> AttitudeResponse {
        let c = LagConfig::default();
        let mut x = ResponseEstimator::new(0.2, &c);
        let mut sent = SentCommands::default();
        for k in 0..600 {
            let t = 0.01 * f64::from(k);
            sent.push(Time::from_secs(t), Some((rocking(t), 0.4)));
            if k % odometry == 0 {
                x.learn(&state(k, t, axes), &sent, 0.005, &c);
            }
            for i in 0..5 {
                // The command sent one dead time ago is held until the next one.
                let applied = (t + 0.002 * f64::from(i) - dead_s) / 0.01;
                axes.step(&rocking(0.01 * (applied + 1e-9).floor()), 0.002);
            }
        }
        x.get()
    }

    #[test]
    fn response_of_loops_with_dead_times() {
        for (dead_s, lag_s) in [(0.0, 0.1), (0.0, 0.35), (0.1, 0.2), (0.25, 0.05), (0.25, 0.35)] {
            for odometry in [1, 2, 3] {
                let r = identified(dead_s, &mut Axes::new(lag_s, 0.06, false), odometry);
                let what = format!("{dead_s} s, {lag_s} s, every {odometry}: {r:?}");
                assert!(r.identified, "{what}");
                assert!((r.dead_time_s - dead_s).abs() < 0.05, "{what}");
                for lag in r.lag_s {
                    assert!((lag - lag_s).abs() < 0.05, "{what}");
                    // The response to a slow command lags by the dead time plus both lags.
                    let whole = r.dead_time_s + lag + r.rate_lag_s;
                    assert!((whole - dead_s - lag_s - 0.06).abs() < 0.02, "{what}");
                }
            }
        }
    }

    #[test]
    fn response_of_a_shaped_loop() {
        let r = identified(0.01, &mut Axes::new(0.15, 0.08, true), 3);
        let [roll, pitch] = r.lag_s.map(|lag| r.dead_time_s + lag);
        // The shaped target's rates are fed forward, so only the shaping delays a slow response.
        assert!(
            (0.16..0.20).contains(&roll) && (0.16..0.20).contains(&pitch),
            "{r:?}"
        );
    }

    #[test]
    fn response_before_anything_is_learnt() {
        let c = LagConfig::default();
        let mut x = ResponseEstimator::new(0.2, &c);
        let sent = SentCommands::default();
        let before = x.get();
        let axes = Axes {
            rates: Vector3::new(1.0, f64::NAN, 0.0),
            ..Axes::new(0.2, 0.06, false)
        };
        for k in 0..500 {
            x.learn(&state(k, 0.01 * f64::from(k), &axes), &sent, 0.005, &c);
        }
        assert_eq!(x.get(), before);
        assert!(!before.identified);
    }

    /// Compensation without dead time: `w = e / T` by arrival times, with a factor of `T / 0.2 s`, up to 3, on
    /// the angle.
    struct WithoutDeadTime {
        square: f64,
        product: f64,
        left: Vector2<f64>,
        commanded: UnitQuaternion<f64>,
    }

    impl WithoutDeadTime {
        fn new() -> Self {
            WithoutDeadTime {
                square: 3e-4,
                product: 3e-4 / 0.2,
                left: Vector2::zeros(),
                commanded: UnitQuaternion::identity(),
            }
        }
        fn learn(&mut self, d: &DroneState) {
            let angle = (d.attitude().inverse() * self.commanded).scaled_axis().xy();
            let dt = 0.01;
            self.left = low_pass(self.left, angle, dt, 0.06);
            let fade = low_pass_gain(dt, 10.0);
            self.square += fade * (3e-4 - self.square) + self.left.norm_squared() * dt;
            self.product +=
                fade * (3e-4 / 0.2 - self.product) + self.left.dot(&Vector3::from(d.rates).xy()) * dt;
        }
        fn factor(&self) -> f64 {
            (self.square / self.product.max(1e-9)).clamp(0.08, 0.6) / 0.2
        }
    }

    /// Standard deviation of the set-point's roll (deg) over the last 10 of 30 s, and the factor on the angle, for an
    /// ArduCopter on which `push` (m/s²) acts laterally.
    fn swing(old: bool, push: impl Fn(f64) -> f64) -> (f64, f64) {
        let c = LagConfig::default();
        let mut axes = Axes::new(0.15, 0.08, true);
        let (mut new, mut without, mut sent) = (
            ResponseEstimator::new(0.2, &c),
            WithoutDeadTime::new(),
            SentCommands::default(),
        );
        let mut y = 0.5;
        let mut v = 0.0;
        let mut d = state(0, 0.0, &axes);
        let mut received = (y, v);
        let mut command = UnitQuaternion::identity();
        let mut n = 0.0;
        let mut sum = 0.0;
        let mut square = 0.0;
        let wire = 2;
        let mut under_way = std::collections::VecDeque::from(vec![command; wire]);
        for k in 0..3000_u32 {
            let t = 0.01 * f64::from(k);
            if k % 5 == 0 || k % 5 == 3 {
                d = state(k, t, &axes);
                received = (y, v);
                without.learn(&d);
                new.learn(&d, &sent, 0.01, &c);
            }
            let (roll, _, _) = d.attitude().euler_angles();
            let wanted = -6.0 * received.0 - 5.5 * received.1;
            let wanted = (wanted + 1.2 * (wanted - 9.81 * roll)) / 9.81;
            let wanted = UnitQuaternion::from_euler_angles(wanted.clamp(-0.6, 0.6), 0.0, 0.0);
            let angle = (d.attitude().inverse() * wanted).scaled_axis();
            command = if old {
                d.attitude() * UnitQuaternion::from_scaled_axis(angle * without.factor())
            } else {
                new.command(&wanted, &d.attitude(), &c)
            };
            without.commanded = command;
            sent.push(Time::from_secs(t), Some((command, 0.4)));
            under_way.push_back(command);
            let applied = under_way.pop_front().unwrap();
            for _ in 0..5 {
                axes.step(&applied, 0.002);
                let (roll, _, _) = axes.attitude.euler_angles();
                v += (9.81 * roll + push(t)) * 0.002;
                y += v * 0.002;
            }
            if t > 20.0 {
                let (roll, _, _) = command.euler_angles();
                n += 1.0;
                sum += roll;
                square += roll * roll;
            }
        }
        let sd = f64::sqrt(square / n - (sum / n) * (sum / n));
        let [factor, _] = new.factors(&c);
        (sd.to_degrees(), if old { without.factor() } else { factor })
    }

    #[test]
    fn swing_of_the_loop_without_dead_time() {
        let waves = |t: f64| 0.8 * (1.2 * t).sin() + 0.4 * (2.9 * t).cos();
        let (old, factor) = swing(true, waves);
        println!("old: {old:.1} deg, factor {factor:.2}");
        let (new, own) = swing(false, waves);
        println!("new: {new:.1} deg, factor {own:.2}");
        assert!(old > 12.0 && factor > 1.3, "{old} {factor}");
        assert!(new < 8.0, "{new} {own}");
    }
}
