//! Sign of roll and pitch, by the motion of an antenna above the vessel.
//!
//! A roll phi moves an antenna at the height h by `h phi` to the side. The water accelerates the hull along its slope a
//! by up to `g a`, and a hull with the natural frequency `w0` follows it with `phi = a / (1 - (w / w0)²)`, so the hull's
//! acceleration is `g phi + (g / w0²) phi''`, or a fraction of it. With `Phi`, the double integral of phi, the antenna's
//! lateral position is therefore `s (H phi + A Phi)` with `H >= h` and `A <= g`. The sign s is 1 for a correct roll and -1
//! for an inverted one. Both signs are fitted, and the sums of squared residuals decide. A low antenna in long waves fits
//! both signs, and then there is no verdict. Pitch moves the antenna backward in the same way.
//!
//! Each window of some seconds is fitted with a parabola in time as well, which removes the vessel's course and the
//! constants of integration. In the same windows the fixes' height without the lever arm's turn is compared with the
//! heave: its factor `k` is 1 for a correct heave, and negative for one of opposite sign.

use alight_shared::{
    frames::VesselNed,
    geodesy::Datum,
    geometry::GRAVITY,
    msg::{AttitudeFix, GnssFix, HeadingFix},
    time::{Time, VesselClock},
};
use nalgebra::{DMatrix, Rotation2, Vector2};

use super::has_height;

/// Length of a window, s, minimum and maximum number of its fixes.
const WINDOW_S: f64 = 10.0;
const MIN_FIXES: usize = 10;
const MAX_FIXES: usize = 256;
/// Maximum time between two attitudes, and from an attitude to a fix, s.
const STEP_S: f64 = 0.35;
/// Maximum age of the heading, s, and maximum turn within a window, rad.
const HEADING_S: f64 = 1.5;
const MAX_TURN_RAD: f64 = 0.35;
/// Minimum ratio of the squared residuals of the two signs, and minimum log likelihood ratio, which chance exceeds once in
/// 10^5 cases. A half wave counts as one sample, because the hull's other motion is correlated within it.
const MIN_RATIO: f64 = 2.0;
const SURE: f64 = 10.0;
/// Minimum fraction of the height's variance that the heave explains, limits of the factor of a correct heave, and
/// maximum standard deviation of a height that receivers do not smooth, m.
const MIN_EXPLAINED: f64 = 0.5;
const FACTORS: core::ops::Range<f64> = 0.5..2.0;
const UNSMOOTHED_SD_M: f64 = 0.1;
/// Fraction of the sums that is kept from window to window: a memory of a minute.
const KEPT: f64 = 0.85;

/// Roll or pitch whose sign contradicts the antenna's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Inverted {
    /// "roll" or "pitch".
    pub(super) axis: &'static str,
    /// Height of the antenna according to its motion and to the configuration, m.
    pub(super) measured_m: f64,
    pub(super) height_m: f64,
}

/// Angle and its double integral since the start of the window, rad and rad s².
#[derive(Clone, Copy, Debug, Default)]
struct Angle {
    value: f64,
    single: f64,
    double: f64,
}

impl Angle {
    fn integrate(&mut self, dt: f64, value: f64) {
        let mean = 0.5 * (self.value + value);
        self.double += dt * (self.single + 0.5 * dt * mean);
        self.single += dt * mean;
        self.value = value;
    }
}

/// Fix in a window: time, antenna's position along the angle's direction without the lever arm's turn, angle.
type Row = [f64; 4];

/// Sums over the windows of one axis, after removal of the parabolas: products of angle, its double integral, and
/// position, and number of half waves.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    pp: f64,
    pq: f64,
    qq: f64,
    py: f64,
    qy: f64,
    yy: f64,
    half_waves: f64,
}

impl Sums {
    fn add(&mut self, rows: &[Row]) {
        let n = rows.len();
        let middle = 0.5 * WINDOW_S;
        let t = |k: usize| rows.get(k).map_or(0.0, |r| (r[0] - middle) / middle);
        let parabola = DMatrix::from_fn(n, 3, |k, power| t(k).powi(power as i32));
        let values = DMatrix::from_fn(n, 3, |k, c| rows.get(k).map_or(0.0, |r| r[c + 1]));
        let basis = parabola.qr().q();
        let rest = &values - &basis * (basis.transpose() * &values);
        let product = rest.transpose() * &rest;
        let rises: Vec<bool> = rest.column(1).iter().map(|angle| *angle > 0.0).collect();
        let crossings = rises
            .windows(2)
            .filter(|pair| pair.first() != pair.last())
            .count();
        for (sum, add) in [
            (&mut self.yy, product[(0, 0)]),
            (&mut self.py, product[(0, 1)]),
            (&mut self.qy, product[(0, 2)]),
            (&mut self.pp, product[(1, 1)]),
            (&mut self.pq, product[(1, 2)]),
            (&mut self.qq, product[(2, 2)]),
            (&mut self.half_waves, crossings as f64),
        ] {
            *sum = KEPT * *sum + add;
        }
    }
    /// Smallest sum of squared residuals `y - s (H phi + A Phi)` over H above `height_m` and A within gravity.
    fn residual(&self, height_m: f64, sign: f64) -> f64 {
        let [pp, qq] = [self.pp, self.qq].map(|sum| sum.max(f64::MIN_POSITIVE));
        let [py, qy, pq] = [sign * self.py, sign * self.qy, self.pq];
        let of = |[h, a]: [f64; 2]| {
            self.yy - 2.0 * (h * py + a * qy) + h * h * self.pp + 2.0 * h * a * pq + a * a * self.qq
        };
        // The optimum of a convex function lies inside, or on one of the edges.
        let det = pp * qq - pq * pq;
        let inside = [(py * qq - qy * pq) / det, (qy * pp - py * pq) / det];
        let at_height = [height_m, ((qy - height_m * pq) / qq).clamp(-GRAVITY, GRAVITY)];
        let at_slope = |a: f64| [((py - a * pq) / pp).max(height_m), a];
        let is_inside = inside[0] >= height_m && (-GRAVITY..=GRAVITY).contains(&inside[1]);
        let edges = [at_height, at_slope(-GRAVITY), at_slope(GRAVITY)];
        let all = edges.into_iter().chain(is_inside.then_some(inside));
        all.map(of).fold(f64::INFINITY, f64::min)
    }
    /// Metres of heave for each metre of the fixes' height, if they contradict each other.
    fn heave_per_height(&self, sd_m: f64) -> Option<f64> {
        let best = (self.yy - self.py * self.py / self.pp).max(1e-6 * self.yy);
        let right = self.yy - 2.0 * self.py + self.pp;
        let likelihood = 0.5 * self.half_waves * (right / best).ln();
        let factor = self.py / self.pp;
        let is_wrong = factor < 0.0 || sd_m <= UNSMOOTHED_SD_M && !FACTORS.contains(&factor);
        let is_sure = 1.0 - best / self.yy > MIN_EXPLAINED && likelihood > SURE;
        (is_wrong && is_sure).then_some(factor.recip())
    }
    /// Height of the antenna according to its motion alone, m, if an antenna at `height_m` contradicts the angle's sign.
    fn contradiction(&self, height_m: f64) -> Option<f64> {
        let [right, inverted] = [1.0, -1.0].map(|sign| self.residual(height_m, sign).max(0.0));
        let ratio = right / inverted.max(1e-6 * self.yy);
        let likelihood = 0.5 * self.half_waves * ratio.max(1.0).ln();
        (self.yy > 0.0 && ratio > MIN_RATIO && likelihood > SURE).then(|| self.py / self.pp)
    }
}

/// Window in progress: start, origin, heading at the start, rad, and number of the receiver.
#[derive(Clone, Copy, Debug)]
struct Window {
    begun: Time<VesselClock>,
    origin: Datum,
    course: f64,
    receiver: u8,
}

/// Motion of an antenna next to the attitudes of one sensor.
#[derive(Clone, Debug, Default)]
pub(super) struct Antenna {
    window: Option<Window>,
    attitude: Option<Time<VesselClock>>,
    /// Roll and pitch.
    angles: [Angle; 2],
    /// Number of the sensor, time, and heading, rad.
    heading: Option<(u8, Time<VesselClock>, f64)>,
    /// Fixes to the side with the roll, and backward with the pitch.
    rows: [Vec<Row>; 2],
    sums: [Sums; 2],
    inverted: Option<Inverted>,
    /// Newest heave, m down, the fixes' heights with it, and the largest standard deviation of these, m.
    heave: Option<(Time<VesselClock>, f64)>,
    heights: Vec<Row>,
    height_sd_m: f64,
    height_sums: Sums,
    heave_per_height: Option<f64>,
}

impl Antenna {
    /// Axis whose sign is contradicted at present.
    pub(super) fn inverted(&self) -> Option<Inverted> {
        self.inverted
    }
    /// Metres of heave for each metre of the fixes' height, if they contradict each other.
    pub(super) fn heave_per_height(&self) -> Option<f64> {
        self.heave_per_height
    }
    pub(super) fn attitude(&mut self, fix: &AttitudeFix) {
        let at = fix.header.at;
        self.heave = fix.heave.filter(|h| h.is_finite()).map(|h| (at, h));
        let dt = self.attitude.replace(at).map(|then| (at - then).secs());
        let is_finite = fix.tilt.iter().all(|angle| angle.is_finite());
        match dt.filter(|dt| is_finite && (0.0..=STEP_S).contains(dt)) {
            Some(dt) => {
                let angles = self.angles.iter_mut().zip(fix.tilt);
                angles.for_each(|(angle, value)| angle.integrate(dt, value));
            }
            None => {
                self.angles = Default::default();
                self.restart();
            }
        }
    }
    /// Adds a heading of sensor `number`. Another sensor's heading is used only once that of the first is too old.
    pub(super) fn heading(&mut self, number: u8, fix: &HeadingFix) {
        let at = fix.header.at;
        let other =
            |(k, then, _): (u8, Time<VesselClock>, f64)| k != number && (at - then).abs().secs() <= HEADING_S;
        if !self.heading.is_some_and(other) {
            self.heading = Some((number, at, fix.heading));
        }
    }
    fn restart(&mut self) {
        self.window = None;
        self.height_sd_m = 0.0;
        self.rows.iter_mut().for_each(Vec::clear);
        self.heights.clear();
    }
    /// Adds a fix of receiver `number` with a place.
    pub(super) fn fix(&mut self, number: u8, fix: &GnssFix) {
        let at = fix.header.at;
        let (Some(tilted), Some((_, headed, heading)), Some([ahead, right, down])) =
            (self.attitude, self.heading, fix.lever_arm)
        else {
            return;
        };
        if (at - tilted).abs().secs() > STEP_S || (at - headed).abs().secs() > HEADING_S {
            self.restart();
            return;
        }
        let window = *self.window.get_or_insert_with(|| {
            self.angles.iter_mut().for_each(|a| {
                (a.single, a.double) = (0.0, 0.0);
            });
            Window {
                begun: at,
                origin: fix.datum,
                course: heading,
                receiver: number,
            }
        });
        if number != window.receiver {
            return;
        }
        let t = (at - window.begun).secs();
        let turned = Rotation2::new(heading - window.course);
        if t < 0.0 || self.rows[0].len() >= MAX_FIXES || turned.angle().abs() > MAX_TURN_RAD {
            self.restart();
            return;
        }
        let from_origin = window.origin.to::<VesselNed>(&fix.datum).0;
        let [north, east, _] = fix.position;
        let place = Vector2::new(from_origin.x + north, from_origin.y + east);
        let aside = Rotation2::new(-window.course) * place - turned * Vector2::new(ahead, right);
        for ((rows, angle), y) in self.rows.iter_mut().zip(self.angles).zip([aside.y, -aside.x]) {
            rows.push([t, y, angle.value, angle.double]);
        }
        if let Some((_, heave)) = self.heave.filter(|_| has_height(fix)) {
            let [roll, pitch] = self.angles.map(|angle| angle.value);
            // Heave is down, as the antenna behind a bow that rises, and one to starboard of a roll.
            let down = window.origin.height_m - fix.datum.height_m + fix.position[2];
            self.heights
                .push([t, down + ahead * pitch - right * roll, heave, 0.0]);
            self.height_sd_m = self.height_sd_m.max(fix.position_sd[2]);
        }
        if t >= WINDOW_S {
            self.judge(-down);
            self.restart();
        }
    }
    /// Adds the window to the sums, and compares the signs for an antenna at this height, m.
    fn judge(&mut self, height_m: f64) {
        for (sums, rows) in self.sums.iter_mut().zip(&self.rows) {
            if rows.len() >= MIN_FIXES {
                sums.add(rows);
            }
            if !(sums.yy + sums.pp).is_finite() {
                *sums = Sums::default();
            }
        }
        let found = |(sums, axis): (&Sums, &'static str)| {
            sums.contradiction(height_m).map(|measured_m| Inverted {
                axis,
                measured_m,
                height_m,
            })
        };
        self.inverted = self.sums.iter().zip(["roll", "pitch"]).find_map(found);
        if self.heights.len() >= MIN_FIXES {
            self.height_sums.add(&self.heights);
        }
        self.heave_per_height = self.height_sums.heave_per_height(self.height_sd_m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    /// Boat with an antenna, on a course of 0.7 rad at 3 m/s.
    #[derive(Clone, Copy, Debug)]
    struct Boat {
        antenna_m: [f64; 3],
        /// Amplitude, rad, and period, s, of roll and pitch.
        waves: [[f64; 2]; 2],
        /// Fraction of the water's acceleration along the slope that reaches the hull.
        slope: f64,
        /// Natural period of roll and pitch, s.
        natural_s: f64,
        /// Factors on the reported roll and pitch.
        shown: [f64; 2],
        /// Noise of the fixes, m, and their interval in tenths of a second.
        noise: f64,
        every: u32,
    }

    impl Boat {
        /// Verdict after this many seconds.
        fn after(&self, seconds: u32) -> Option<Inverted> {
            let mut antenna = Antenna::default();
            for k in 0..10 * seconds {
                let t = 0.1 * f64::from(k);
                let header = Header::new(1, 0, 1, 0, Time::from_secs(t));
                let component = |a: f64, period: f64, phase: f64| {
                    let angle = a * (TAU * t / period + phase).sin();
                    let follows = 1.0 - (self.natural_s / period).powi(2);
                    [
                        angle,
                        -self.slope * GRAVITY * follows * (period / TAU).powi(2) * angle,
                    ]
                };
                let [[roll, sway], [pitch, surge]] = self.waves.map(|[a, period]| {
                    let both = [component(a, period, 0.0), component(0.3 * a, 0.7 * period, 1.0)];
                    [both[0][0] + both[1][0], both[0][1] + both[1][1]]
                });
                let heading = 0.7 + 0.05 * (TAU * t / 9.0).sin();
                let [ahead, right, down] = self.antenna_m;
                let random = f64::from((k.wrapping_mul(2_654_435_761) >> 16) % 1000) / 500.0 - 1.0;
                let body = Rotation2::new(heading - 0.7) * Vector2::new(ahead, right)
                    + Vector2::new(pitch * down - surge, -roll * down + sway)
                    + Vector2::new(3.0 * t, 0.0);
                let place = Rotation2::new(0.7) * body + Vector2::repeat(self.noise * random);
                let attitude = AttitudeFix {
                    header,
                    tilt: [self.shown[0] * roll, self.shown[1] * pitch],
                    ..AttitudeFix::default()
                };
                let compass = HeadingFix {
                    header,
                    heading,
                    ..HeadingFix::default()
                };
                antenna.heading(0, &compass);
                antenna.attitude(&attitude);
                if k % self.every == 0 {
                    let fix = GnssFix {
                        header,
                        position: [place.x, place.y, 0.0],
                        lever_arm: Some(self.antenna_m),
                        ..GnssFix::default()
                    };
                    antenna.fix(0, &fix);
                }
            }
            antenna.inverted()
        }
    }

    /// Antenna of a mast in waves of 3.5 s.
    const MAST: Boat = Boat {
        antenna_m: [-1.0, 0.3, -3.5],
        waves: [[0.1, 3.5], [0.05, 3.0]],
        slope: 0.3,
        natural_s: 2.5,
        shown: [1.0, 1.0],
        noise: 0.03,
        every: 2,
    };

    #[test]
    fn roll_or_pitch_of_the_wrong_sign() {
        assert_eq!(MAST.after(90), None);
        for (shown, axis) in [
            ([-1.0, 1.0], "roll"),
            ([1.0, -1.0], "pitch"),
            ([-1.0, -1.0], "roll"),
        ] {
            for every in [1, 2, 10] {
                let found = Boat { shown, every, ..MAST }.after(90).unwrap();
                assert_eq!(found.axis, axis);
                assert!(found.measured_m < 0.0 && found.height_m == 3.5, "{found:?}");
            }
        }
        // An antenna at the height of the origin shows nothing.
        let low = Boat {
            antenna_m: [0.0; 3],
            waves: [[0.1, 6.0], [0.0, 5.0]],
            slope: 0.0,
            shown: [-1.0, 1.0],
            ..MAST
        };
        assert_eq!(low.after(90), None);
    }

    proptest! {
        #[test]
        fn correct_signs_are_never_contradicted(
            ahead in -6.0..6.0, right in -2.0..2.0, down in -8.0..1.0,
            roll in 0.0..0.3, pitch in 0.0..0.15, periods in [1.5..8.0, 1.5..8.0],
            slope in 0.0..1.0, natural_s in 1.5..8.0, noise in 0.0..1.5, every in 1_u32..=10,
        ) {
            let boat = Boat {
                antenna_m: [ahead, right, down],
                waves: [[roll, periods[0]], [pitch, periods[1]]],
                slope,
                natural_s,
                shown: [1.0, 1.0],
                noise,
                every,
            };
            prop_assert_eq!(boat.after(70), None);
        }
    }
}
