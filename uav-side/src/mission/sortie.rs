//! Time until a drone on a sortie must return to the vessel's future position.
//!
//! A drone at the offset `-r` from a vessel that moves at `u` meets it, in the wind `w`, after the smallest `T >= 0`
//! with `|r + (u - w) T| = v T` at its airspeed `v`. It turns back when its charge `b` has fallen to the sum of the
//! reserve (for the landing), the return and one missed attempt: after the time `t` with `b_r + P (T(t) + t_a) = b - P
//! t` for the power `P`, while the vessel moves on and the drone stays.
//!
//! Out of radio range the vessel is extrapolated with its last velocity, with an increasing margin.

use alight_shared::{
    estimation::low_pass,
    frames::{DroneNed, Vector},
    msg::{DeckForecast, DroneState, LastVessel, Reason, ReasonCode},
};
use nalgebra::Vector2;

use super::{
    MissionNode,
    phase::DroneTime,
    situation::{SilentVessel, Situation},
};

/// Maximum duration of a return, s; also returned for a vessel out of reach.
const MAX_WAY_S: f64 = 3600.0;
/// Number of bisection steps: from an hour down to a tenth of a second.
const STEPS: u32 = 16;

/// Random walk of a vessel's velocity without reception, to allow for turns: after 1 s, m/s, and as a fraction of its
/// speed. The same applies to a beacon between its messages.
const WALK_MPS: f64 = 0.02;
const SPEED_WALK: f64 = 0.1;
/// Time constant of the vessel's mean velocity, and age after which the mean restarts, s: three periods of the longest
/// waves that move a small boat.
const STEADY_S: f64 = 20.0;
const KNOWN_S: f64 = 10.0;
/// Margin, in standard deviations of the vessel's position.
const MARGIN_SD: f64 = 2.0;
/// Drift in the margin's upper bound, m/s; the bound also covers a vessel that reverses at once.
const DRIFT_MPS: f64 = 0.3;

/// Maximum distance between the vessel and its extrapolated position, m: `2 q sqrt(t³ / 3)` after `t`, where `q` is the
/// velocity's random walk in 1 s, but at most `(2 u + 0.3 m/s) t`.
fn margin_m(speed_mps: f64, silent_s: f64) -> f64 {
    let walk = WALK_MPS + SPEED_WALK * speed_mps;
    let sd_m = walk * (silent_s.powi(3) / 3.0).sqrt();
    (MARGIN_SD * sd_m).min((2.0 * speed_mps + DRIFT_MPS) * silent_s)
}

/// Mean velocity of the vessel, and deck position as latitude and longitude, because the drone's frame may jump.
fn vessel(forecast: &DeckForecast, drone: &DroneState) -> Option<LastVessel> {
    let [north, east, _] = forecast.stages.first()?.position;
    let mean = |k: usize| forecast.stages.iter().map(|d| d.velocity[k]).sum::<f64>();
    let stages = forecast.stages.len().max(1) as f64;
    let local = Vector2::new(north, east) - drone.datum_offset().xy();
    Some(LastVessel {
        at: forecast.header.at,
        place: drone.datum.at(&Vector::<DroneNed>::new(local.x, local.y, 0.0)),
        velocity: [mean(0) / stages, mean(1) / stages],
    })
}

/// Low-pass of the velocity, because a forecast of seconds does not average the longest waves.
fn steadied(before: Option<&LastVessel>, now: LastVessel) -> LastVessel {
    let Some((before, dt)) = before.map(|b| (b, (now.at - b.at).secs())) else {
        return now;
    };
    if !(0.0..=KNOWN_S).contains(&dt) {
        return now;
    }
    let velocity = core::array::from_fn(|k| low_pass(before.velocity[k], now.velocity[k], dt, STEADY_S));
    LastVessel { velocity, ..now }
}

/// Vessel extrapolated to `now`, relative to the drone.
fn seeks(vessel: &LastVessel, drone: &DroneState, now: DroneTime) -> SilentVessel {
    let velocity = Vector2::from(vessel.velocity);
    let silent_s = (now - vessel.at).secs().max(0.0);
    let place: Vector<DroneNed> = drone.datum.to(&vessel.place);
    let there = place.0.xy() + drone.datum_offset().xy() + velocity * silent_s;
    SilentVessel {
        offset: there - drone.position().xy(),
        silent_s,
    }
}

/// Offset of a vessel without reception, including the margin, and its velocity.
fn towards(vessel: &LastVessel, seeks: &SilentVessel) -> (Vector2<f64>, Vector2<f64>) {
    let velocity = Vector2::from(vessel.velocity);
    let SilentVessel { offset, silent_s } = *seeks;
    let away = offset.try_normalize(1e-3).unwrap_or(Vector2::x());
    (offset + away * margin_m(velocity.norm(), silent_s), velocity)
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReturnLeg {
    /// Offset of the deck from the drone, m.
    pub(super) offset: Vector2<f64>,
    pub(super) vessel: Vector2<f64>,
    /// Velocity of the air, north and east, m/s.
    pub(super) wind: Vector2<f64>,
    pub(super) air_mps: f64,
}

impl ReturnLeg {
    /// Time until the drone meets the vessel after staying for `stays_s`, s; [`MAX_WAY_S`] if out of reach.
    pub(super) fn time_s(&self, stays_s: f64) -> f64 {
        let r = self.offset + self.vessel * stays_s;
        let drift = self.vessel - self.wind;
        // (v² - |d|²) T² - 2 r.d T - |r|² = 0.
        let (a, b, c) = (
            self.air_mps.powi(2) - drift.norm_squared(),
            r.dot(&drift),
            r.norm_squared(),
        );
        let square = b * b + a * c;
        if square < 0.0 {
            return MAX_WAY_S;
        }
        let root = square.sqrt();
        let time = if a > 1e-6 {
            (b + root) / a
        } else if b < -1e-6 {
            c / (root - b)
        } else if c < 1e-6 {
            0.0
        } else {
            MAX_WAY_S
        };
        time.clamp(0.0, MAX_WAY_S)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Energy {
    pub(super) charge: f64,
    pub(super) power: f64,
    pub(super) reserve: f64,
    pub(super) attempt_s: f64,
}

impl Energy {
    /// Charge at which the drone turns back after staying for `stays_s`, 0 to 1.
    fn needed(&self, way: &ReturnLeg, stays_s: f64) -> f64 {
        self.reserve + self.power * (way.time_s(stays_s) + self.attempt_s)
    }
    /// Time until the drone turns back, s.
    pub(super) fn turns_in_s(&self, way: &ReturnLeg) -> f64 {
        let left = |t: f64| self.charge - self.power * t - self.needed(way, t);
        if !(left(0.0) > 0.0) {
            return 0.0;
        }
        let (mut low, mut high) = (0.0, (self.charge / self.power).min(MAX_WAY_S));
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if left(middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
    pub(super) fn turns_back(&self, way: &ReturnLeg) -> Option<Reason> {
        let needed = self.needed(way, 0.0);
        (!(self.charge > needed)).then(|| Reason::new(ReasonCode::TurnsBack, self.charge, needed.min(1.0)))
    }
}

impl MissionNode {
    pub(super) fn judge_sortie(&mut self, now: DroneTime, s: &mut Situation) {
        let (c, drone) = (&self.config, self.drone.get());
        if let (Some(forecast), Some(drone), Some(_)) = (self.forecast.get(), drone, s.fresh_deck()) {
            let newest = vessel(forecast, drone).map(|v| steadied(self.last_vessel.as_ref(), v));
            self.last_vessel = newest.or(self.last_vessel);
        }
        s.sortie.seeks = (self.last_vessel.as_ref().zip(drone)).map(|(last, drone)| seeks(last, drone, now));
        let energy = self.battery.energy(c);
        let (Some(energy), Some(seeks), Some(last)) = (energy, &s.sortie.seeks, &self.last_vessel) else {
            return;
        };
        let (offset, velocity) = towards(last, seeks);
        let way = ReturnLeg {
            offset,
            vessel: velocity,
            wind: (drone.and_then(|d| d.wind)).map_or(Vector2::zeros(), Vector2::from),
            air_mps: c.battery_air_speed_mps,
        };
        s.sortie.turns_back = energy.turns_back(&way);
        s.sortie.turns_in_s = (self.progress.sortie).then(|| energy.turns_in_s(&way));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{geodesy::Datum, msg::DeckStage, time::Time};
    use proptest::prelude::*;

    fn way(offset: [f64; 2], vessel: [f64; 2], wind: [f64; 2]) -> ReturnLeg {
        ReturnLeg {
            offset: offset.into(),
            vessel: vessel.into(),
            wind: wind.into(),
            air_mps: 8.0,
        }
    }

    #[test]
    fn way_to_a_vessel_that_leaves_or_comes() {
        for (w, expected) in [
            (way([800.0, 0.0], [0.0, 0.0], [0.0, 0.0]), 100.0),
            (way([800.0, 0.0], [3.0, 0.0], [0.0, 0.0]), 160.0),
            (way([800.0, 0.0], [-2.0, 0.0], [0.0, 0.0]), 80.0),
            (way([800.0, 0.0], [0.0, 0.0], [-4.0, 0.0]), 200.0),
            (way([0.0, 0.0], [5.0, 0.0], [0.0, 0.0]), 0.0),
            // The vessel is faster than the drone and moves away from it or towards it.
            (way([100.0, 0.0], [9.0, 0.0], [0.0, 0.0]), MAX_WAY_S),
            (way([170.0, 0.0], [-9.0, 0.0], [0.0, 0.0]), 10.0),
        ] {
            let found = w.time_s(0.0);
            assert!((found - expected).abs() < 1e-6, "{w:?}: {found}");
        }
    }

    /// One and ten minutes after the vessel was last received, 1 km to the north and moving north at 2 m/s.
    #[test]
    fn way_to_a_vessel_out_of_radio_range() {
        let drone = DroneState {
            datum: Datum::new(47.6, -122.4, 12.0),
            datum_offset: [5.0, -3.0, 0.0],
            ..DroneState::default()
        };
        let forecast = crate::fixtures::forecast(crate::fixtures::header(0, Time::EPOCH), |t| DeckStage {
            position: [1000.0 + 2.0 * t, 0.0, 0.0],
            velocity: [2.0, 0.0, 0.0],
            ..DeckStage::default()
        });
        let last = vessel(&forecast, &drone).unwrap();
        let jumped = DroneState {
            datum_offset: [105.0, -3.0, 0.0],
            position: [100.0, 0.0, 0.0],
            ..drone
        };
        for (silent_s, margin) in [(0.0, 0.0..0.1), (60.0, 100.0..140.0), (600.0, 2500.0..2600.0)] {
            let (offset, velocity) = towards(&last, &seeks(&last, &jumped, Time::from_secs(silent_s)));
            let more_m = offset.x - (1000.0 + 2.0 * silent_s);
            assert!(margin.contains(&(more_m + 0.01)), "{more_m} m after {silent_s} s");
            assert!(offset.y.abs() < 0.01 && (velocity - Vector2::new(2.0, 0.0)).norm() < 1e-9);
        }
    }

    /// For a vessel at 2 m/s in waves of 0.7 m/s, the mean velocity is known to a tenth, and a new one within a minute.
    #[test]
    fn way_of_a_vessel_in_waves() {
        let mut last: Option<LastVessel> = None;
        for k in 0..12_000 {
            let t = 0.01 * f64::from(k);
            let way = if t < 60.0 { 2.0 } else { -1.0 };
            let now = LastVessel {
                at: Time::from_secs(t),
                velocity: [way + 0.7 * (1.2 * t).sin(), 0.0],
                ..LastVessel::default()
            };
            last = Some(steadied(last.as_ref(), now));
            if k == 5_999 || k == 11_999 {
                let error = (last.unwrap().velocity[0] - way).abs();
                assert!(error < 0.25, "{error} m/s at {t} s");
            }
        }
    }

    proptest! {
        #[test]
        fn margin_grows_and_stays_within_reach(u in 0.0..10.0_f64, t in 0.0..3600.0_f64, dt in 0.0..60.0_f64) {
            let m = margin_m(u, t);
            prop_assert!(m <= (2.0 * u + DRIFT_MPS) * t && margin_m(u, t + dt) >= m);
        }
        #[test]
        fn drone_meets_the_vessel_then(
            r in prop::array::uniform2(-3e3..3e3_f64), u in prop::array::uniform2(-2.0..2.0_f64),
            w in prop::array::uniform2(-2.0..2.0_f64),
        ) {
            let way = way(r, u, w);
            let t = way.time_s(0.0);
            let gap = (way.offset + (way.vessel - way.wind) * t).norm() - way.air_mps * t;
            prop_assert!(gap.abs() < 1e-6 * (1.0 + t), "{gap} m after {t} s");
        }
        #[test]
        fn charge_suffices_until_it_turns(
            charge in 0.3..1.0_f64, d in 0.0..3e3_f64, speed in 0.0..4.0_f64, endurance_s in 300.0..3000.0_f64,
        ) {
            let energy = Energy { charge, power: 1.0 / endurance_s, reserve: 0.2, attempt_s: 60.0 };
            let way = way([d, 0.0], [speed, 0.0], [0.0, 0.0]);
            let t = energy.turns_in_s(&way);
            let left = charge - t / endurance_s - energy.needed(&way, t);
            prop_assert!(t == 0.0 || left >= -1e-9, "{left} after {t} s");
            prop_assert!(t == 0.0 || energy.turns_back(&way).is_none());
        }
    }
}
