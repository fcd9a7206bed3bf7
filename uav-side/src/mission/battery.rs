//! Battery: lasting charge by gauge and voltage, rate of discharge, and charge needed to reach the deck. A gauge that falls
//! silent has not stopped the discharge: the charge is reckoned on from its last reading. Nor has one that sticks in flight: current,
//! voltage or, where neither is reported, the time contradict it, and the charge is reckoned on from its last change.

use std::collections::VecDeque;

use alight_shared::estimation::low_pass;
use alight_shared::msg::{AutopilotState, KnownBattery, LandedState};
use alight_shared::time::Span;

use super::phase::DroneTime;
use super::sortie::Energy;
use crate::mission_config::MissionConfig;

/// Readings kept at most: a minute at the rate of the autopilot's state, and some.
const MAX_READINGS: usize = 1024;
/// The gauge has to fall by this between two measurements of its rate, two of its steps.
const FALL: f64 = 0.02;
/// A gauge that jumps by this is another battery, or a gauge that has corrected itself: no measurement of the power.
const JUMP: f64 = 0.05;
/// Share of a new measurement in the power.
const NEW: f64 = 0.3;
/// Time constant of the current, s: gusts and manoeuvres pass.
const CURRENT_TIME_S: f64 = 10.0;
/// Time constant of the speed at which it comes nearer, s.
const CLOSING_TIME_S: f64 = 10.0;
/// Nearer than this the way has no speed of its own, m.
const ARRIVED_M: f64 = 30.0;
/// A drone that flies empties its battery so fast while that was not measured, 1/s: in ten minutes.
const UNMEASURED_PER_S: f64 = 1.0 / 600.0;
/// A gauge sticks that has not moved in flight while so much was used by the measured power: five of its steps.
const STUCK: f64 = 0.05;
/// Time after which it sticks before the power was measured, s: two steps of a drone that flies for an hour.
const STUCK_S: f64 = 72.0;
/// The voltage contradicts a gauge that has not moved once it has fallen by this share: what a tenth of the charge takes of it.
const STUCK_FALL: f64 = 0.015;
/// Time constant of the voltage, s, after which its load is that of the flight.
const VOLTAGE_TIME_S: f64 = 10.0;
/// No slower is assumed, m/s: the cost stays finite.
const MIN_MPS: f64 = 0.5;

/// Watches the battery.
#[derive(Clone, Debug, Default)]
pub(super) struct BatteryMonitor {
    /// Readings that nothing later has reached, falling: the first is the maximum of the watched time.
    readings: VecDeque<(DroneTime, f64)>,
    began: Option<DroneTime>,
    /// The newest reading of the gauge, reckoned on while it is silent or sticks.
    known: Option<(DroneTime, f64)>,
    gauge: Option<Gauge>,
    last: Option<DroneTime>,
    /// The gauge at its last fall that counted.
    anchor: Option<(DroneTime, f64)>,
    /// The gauge fell there: from the midst of a step to the second fall it looks up to twice as fast.
    at_step: bool,
    /// Charge per second, by the gauge.
    by_gauge: Option<f64>,
    /// The current, A.
    current_a: Option<f64>,
    /// The speed at which the drone comes nearer to the deck, m/s.
    closing_mps: Option<f64>,
}

/// The gauge since its last change in this flight.
#[derive(Clone, Copy, Debug)]
struct Gauge {
    /// When that was, and its reading since.
    moved: (DroneTime, f64),
    /// The voltage, and what it was [`VOLTAGE_TIME_S`] after the change, V.
    volts: Option<f64>,
    volts_then: Option<f64>,
}

impl Gauge {
    /// With the reading `charge` of a drone that flies, or does not; `dt`: since the one before, s.
    fn follow(before: Option<Gauge>, a: &AutopilotState, charge: f64, dt: f64) -> Gauge {
        let flies = a.armed && a.landed != LandedState::OnGround;
        let same = before.filter(|g| flies && g.moved.1 == charge);
        let moved = same.map_or((a.header.at, charge), |g| g.moved);
        let volts_before = before.and_then(|g| g.volts);
        let volts = a.battery_v.map(|v| low_pass(volts_before, v, dt, VOLTAGE_TIME_S));
        let settled = (a.header.at - moved.0).secs() > VOLTAGE_TIME_S;
        let volts_then = same.and_then(|g| g.volts_then).or(volts).filter(|_| settled);
        Gauge {
            moved,
            volts,
            volts_then,
        }
    }
}

impl BatteryMonitor {
    /// Goes on from the charge that counted at `at` for a mission before this one, and what that one knew.
    pub(super) fn resume(&mut self, at: DroneTime, charge: f64, known: &KnownBattery, c: &MissionConfig) {
        self.by_gauge = known.power;
        self.gauge = Some(Gauge {
            moved: (known.at, known.gauge),
            volts: self.gauge.and_then(|g| g.volts),
            volts_then: known.volts,
        });
        self.known = Some((at, charge));
        // It had lasted.
        self.began = Some(at - Span::from_secs(c.battery_lasts_s));
        self.last = Some(at);
        self.readings = [(at, charge)].into();
    }
    /// State for a mission after this one; None before any reading.
    pub(super) fn memory(&self) -> Option<KnownBattery> {
        self.gauge.map(|g| KnownBattery {
            at: g.moved.0,
            gauge: g.moved.1,
            volts: g.volts_then,
            power: self.by_gauge,
        })
    }

    /// Takes the autopilot's newest state.
    pub(super) fn update(&mut self, a: &AutopilotState, c: &MissionConfig) {
        let now = a.header.at;
        let empty = a.battery_v.is_some_and(|v| v < c.battery_minimum_v);
        let dt = self.last.map_or(0.0, |at| (now - at).secs()).clamp(0.0, 1.0);
        let filtered = |amps: f64| low_pass(self.current_a, amps, dt, CURRENT_TIME_S);
        self.current_a = a.battery_a.map(filtered).or(self.current_a).filter(|_| a.armed);
        if let Some(charge) = a.battery {
            self.gauge = Some(Gauge::follow(self.gauge, a, charge, dt));
        }
        let stuck = self.gauge.filter(|g| self.contradicts(now, g, c));
        let reported = if empty {
            Some(0.0)
        } else {
            a.battery.filter(|_| stuck.is_none())
        };
        // From the last change on.
        if let Some(g) = stuck.filter(|_| a.battery.is_some()) {
            self.known = Some(g.moved);
        }
        let silent = reported.is_none();
        let Some(charge) = reported.or_else(|| self.reckoned(now, a.armed, c)) else {
            return;
        };
        self.known = Some((now, charge));
        self.began.get_or_insert(now);
        while self.readings.back().is_some_and(|(_, r)| *r <= charge) {
            self.readings.pop_back();
        }
        if self.readings.len() == MAX_READINGS {
            self.readings.pop_front();
        }
        self.readings.push_back((now, charge));
        while self
            .readings
            .front()
            .is_some_and(|(at, _)| (now - *at).secs() > c.battery_lasts_s)
        {
            self.readings.pop_front();
        }
        if silent {
            self.last = Some(now);
        } else {
            self.measure(now, a, c);
        }
    }

    /// Whether a gauge that has not moved is contradicted: by the current, where that gives the power, else by the time and, where it
    /// is reported, the voltage.
    fn contradicts(&self, now: DroneTime, g: &Gauge, c: &MissionConfig) -> bool {
        let still_s = (now - g.moved.0).secs();
        if self.current_a.is_some() && c.battery_capacity_ah > 0.0 {
            return self.power(c) * still_s > STUCK;
        }
        let limit_s = self.by_gauge.filter(|p| *p > 0.0).map_or(STUCK_S, |p| STUCK / p);
        let fell = |(volts, then): (f64, f64)| volts < (1.0 - STUCK_FALL) * then;
        still_s > limit_s && g.volts.zip(g.volts_then).is_none_or(fell)
    }

    /// The charge by its last reading, the power and the time since; None before any.
    fn reckoned(&self, now: DroneTime, armed: bool, c: &MissionConfig) -> Option<f64> {
        let (at, before) = self.known?;
        let power = self.usual_power(c);
        let dt = if armed { (now - at).secs().max(0.0) } else { 0.0 };
        Some((before - power * dt).max(0.0))
    }

    /// Measures how fast it empties, by the charge that counts: a reading that is lost is no fall.
    fn measure(&mut self, now: DroneTime, a: &AutopilotState, c: &MissionConfig) {
        self.last = Some(now);
        if !a.armed {
            (self.anchor, self.by_gauge) = (None, None);
            return;
        }
        let Some(charge) = self.charge(c) else { return };
        let Some((at, before)) = self.anchor.filter(|(_, before)| (charge - before).abs() < JUMP) else {
            (self.anchor, self.at_step) = (Some((now, charge)), false);
            return;
        };
        if !self.at_step {
            if charge < before {
                (self.anchor, self.at_step) = (Some((now, charge)), true);
            }
            return;
        }
        let lasted = (now - at).secs();
        if before - charge >= FALL && lasted > 0.0 {
            let measured = (before - charge) / lasted;
            self.by_gauge = Some(self.by_gauge.map_or(measured, |p| p + NEW * (measured - p)));
            self.anchor = Some((now, charge));
        }
    }

    /// The charge that counts, 0 to 1: the maximum of the last `battery_lasts_s`, so that neither one reading nor a voltage
    /// that sags under thrust does anything; 0 where the voltage has been below its minimum for so long. None while nothing
    /// is reported, or not for so long.
    pub(super) fn charge(&self, c: &MissionConfig) -> Option<f64> {
        let lasted = (self.last? - self.began?).secs();
        let (_, charge) = self.readings.front()?;
        (lasted >= c.battery_lasts_s).then_some(*charge)
    }

    /// Follows the speed at which the drone comes nearer to a deck that is `distance_m` away, while it flies there;
    /// `assumed_mps` before. Wind and the vessel's way are in it.
    pub(super) fn approach(&mut self, dt: f64, distance_m: f64, closing_mps: Option<f64>, assumed_mps: f64) {
        let closing = closing_mps.filter(|_| distance_m > ARRIVED_M);
        let before = self.closing_mps.unwrap_or(assumed_mps);
        self.closing_mps = closing.map(|v| low_pass(before, v, dt, CLOSING_TIME_S));
    }

    /// Charge per second, 0 to 1 per second: the current over the capacity where both are known, or the gauge's own fall;
    /// 0 until that is measured.
    fn power(&self, c: &MissionConfig) -> f64 {
        let by_current = self.current_a.filter(|_| c.battery_capacity_ah > 0.0);
        let by_current = by_current.map(|i| i / (3600.0 * c.battery_capacity_ah));
        by_current.or(self.by_gauge).unwrap_or(0.0).max(0.0)
    }

    /// The charge that a take-off needs: the reserve, and one attempt to land again by the power that was measured last, or
    /// that of a drone which flies for ten minutes.
    pub(super) fn for_take_off(&self, c: &MissionConfig) -> f64 {
        (c.battery_reserve + self.usual_power(c) * c.battery_attempt_s).min(1.0)
    }
    /// The measured power, or that of a drone which flies for ten minutes, 1/s.
    pub(super) fn usual_power(&self, c: &MissionConfig) -> f64 {
        match self.power(c) {
            measured if measured > 0.0 => measured,
            _ => UNMEASURED_PER_S,
        }
    }
    /// Charge that a drone away from its vessel has and needs; None while the charge is not known.
    pub(super) fn energy(&self, c: &MissionConfig) -> Option<Energy> {
        Some(Energy {
            charge: self.charge(c)?,
            power: self.usual_power(c),
            reserve: c.battery_reserve,
            attempt_s: c.battery_attempt_s,
        })
    }

    /// The charge that has to be left: for the way of `distance_m` to the deck at the speed made good, and one attempt, by
    /// the power that is measured, `P (d / v + t)`; at least the configured reserve.
    pub(super) fn reserve(&self, distance_m: f64, assumed_mps: f64, c: &MissionConfig) -> f64 {
        let speed = self.closing_mps.unwrap_or(assumed_mps).max(MIN_MPS);
        let way_s = if distance_m.is_finite() {
            distance_m / speed
        } else {
            0.0
        };
        let needed = self.power(c) * (way_s + c.battery_attempt_s);
        c.battery_reserve.max(needed.min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use alight_shared::time::Time;

    fn config() -> MissionConfig {
        MissionConfig::default()
    }
    fn state(t: f64, battery: Option<f64>) -> AutopilotState {
        AutopilotState {
            header: Header::new(0, 1, 1, 0, Time::from_secs(t)),
            armed: true,
            battery,
            ..AutopilotState::default()
        }
    }
    /// Ten readings a second for `seconds` from `from_s` on.
    fn run(
        m: &mut BatteryMonitor,
        c: &MissionConfig,
        from_s: f64,
        seconds: f64,
        a: impl Fn(f64) -> AutopilotState,
    ) {
        for k in 0..(10.0 * seconds) as u32 {
            let t = from_s + 0.1 * f64::from(k);
            m.update(&a(t), c);
        }
    }

    #[test]
    fn battery_at_0_percent() {
        let (mut m, c) = (BatteryMonitor::default(), config());
        run(&mut m, &c, 0.0, 10.0, |t| state(t, Some(0.0)));
        assert_eq!(m.charge(&c), Some(0.0));
        // Silence has not filled it.
        run(&mut m, &c, 10.0, 10.0, |t| state(t, None));
        assert_eq!(m.charge(&c), Some(0.0));
        let mut none = BatteryMonitor::default();
        run(&mut none, &c, 0.0, 20.0, |t| state(t, None));
        assert_eq!(none.charge(&c), None);
    }

    /// A gauge that falls silent at 57 %: the battery empties on, as fast as was measured or as a drone of ten minutes.
    #[test]
    fn battery_gauge_that_falls_silent() {
        let c = config();
        for (per_s, measured_s) in [(0.001, 200.0), (UNMEASURED_PER_S, 0.0)] {
            let mut m = BatteryMonitor::default();
            run(&mut m, &c, 0.0, measured_s + 10.0, |t| {
                let left = 0.57 + per_s * (measured_s - t).max(0.0);
                state(t, Some((100.0 * left).round() / 100.0))
            });
            let from = measured_s + 10.0;
            run(&mut m, &c, from, 200.0, |t| state(t, None));
            let (found, expected) = (m.charge(&c).unwrap(), 0.57 - per_s * 200.0);
            assert!((found - expected).abs() < 0.03, "{per_s}: {found} of {expected}");
            run(&mut m, &c, from + 200.0, 600.0, |t| state(t, None));
            assert_eq!(m.charge(&c), Some(0.0));
            // On the ground it does not empty.
            let mut m = BatteryMonitor::default();
            run(&mut m, &c, 0.0, 10.0, |t| state(t, Some(0.57)));
            run(&mut m, &c, 10.0, 600.0, |t| AutopilotState {
                armed: false,
                ..state(t, None)
            });
            assert_eq!(m.charge(&c), Some(0.57));
        }
    }

    /// A gauge that sticks at 57 % in flight: by the time, the current or the voltage the charge falls on, and once it moves again it
    /// counts again. A tethered drone's voltage does not fall.
    #[test]
    fn battery_gauge_that_sticks() {
        let by_current = MissionConfig {
            battery_capacity_ah: 10.0,
            ..config()
        };
        let used = |t: f64| (t - 10.0).max(0.0) / 1000.0;
        type Case = (MissionConfig, fn(f64) -> [Option<f64>; 2], [f64; 2]);
        let cases: [Case; 4] = [
            (config(), |_| [None; 2], [0.0, 0.3]),
            (config(), |t| [Some(16.0 - 2.5 * t / 1000.0), None], [0.0, 0.3]),
            (by_current, |_| [Some(16.0), Some(36.0)], [0.2, 0.3]),
            (config(), |t| [Some(16.0 + 0.2 * t.sin()), None], [0.57, 0.58]),
        ];
        for (k, (c, witness, [low, high])) in cases.into_iter().enumerate() {
            let mut m = BatteryMonitor::default();
            let reading = |t: f64, charge: f64| {
                let [battery_v, battery_a] = witness(t);
                AutopilotState {
                    battery_v,
                    battery_a,
                    ..state(t, Some(charge))
                }
            };
            run(&mut m, &c, 0.0, 40.0, |t| reading(t, 0.57));
            assert_eq!(m.charge(&c), Some(0.57), "{k}: not yet");
            run(&mut m, &c, 40.0, 280.0, |t| reading(t, 0.57));
            let charge = m.charge(&c).unwrap();
            assert!(
                (low..high).contains(&charge),
                "{k}: {charge} of {}",
                0.57 - used(320.0)
            );
            run(&mut m, &c, 320.0, 10.0, |t| reading(t, 0.25));
            assert_eq!(m.charge(&c), Some(0.25), "{k}: it moves again");
        }
        // On the ground nothing is used.
        let (mut m, c) = (BatteryMonitor::default(), config());
        run(&mut m, &c, 0.0, 300.0, |t| AutopilotState {
            landed: LandedState::OnGround,
            ..state(t, Some(0.57))
        });
        assert_eq!(m.charge(&c), Some(0.57));
    }

    /// A successor reckons on where its predecessor was.
    #[test]
    fn battery_reckoned_on_by_a_successor() {
        let c = config();
        let known = KnownBattery {
            at: Time::from_secs(20.0),
            gauge: 0.57,
            volts: None,
            power: Some(0.001),
        };
        // It has observed the gauge before it is given that: silent, or stuck since.
        for (gauge, expected) in [(None, 0.3), (Some(0.57), 0.57 - 0.181), (Some(0.5), 0.5)] {
            let mut m = BatteryMonitor::default();
            m.update(&state(100.8, gauge), &c);
            m.resume(Time::from_secs(100.0), 0.4, &known, &c);
            run(&mut m, &c, 101.0, 100.0, |t| {
                state(t, gauge.map(|g| if t > 150.0 && g == 0.5 { 0.49 } else { g }))
            });
            let charge = m.charge(&c).unwrap();
            assert!(
                (charge - expected).abs() < 0.02,
                "{gauge:?}: {charge}, {expected}"
            );
        }
    }

    /// A gauge that corrects itself from 90 to 19 % has not emptied the battery within seconds.
    #[test]
    fn battery_gauge_that_corrects_itself() {
        let (mut m, c) = (BatteryMonitor::default(), config());
        run(&mut m, &c, 0.0, 20.0, |t| state(t, Some(0.9)));
        run(&mut m, &c, 20.0, 20.0, |t| state(t, Some(0.19)));
        assert_eq!(m.charge(&c), Some(0.19));
        assert_eq!(m.reserve(0.0, 5.0, &c), c.battery_reserve);
    }

    #[test]
    fn battery_low_for_less_than_its_time() {
        let (mut m, c) = (BatteryMonitor::default(), config());
        run(&mut m, &c, 0.0, 10.0, |t| state(t, Some(0.5)));
        m.update(&state(10.0, Some(0.0)), &c);
        assert_eq!(m.charge(&c), Some(0.5), "one reading");
        run(&mut m, &c, 10.1, 4.5, |t| state(t, Some(0.1)));
        assert_eq!(m.charge(&c), Some(0.5), "4.5 s");
        run(&mut m, &c, 14.6, 1.0, |t| state(t, Some(0.1)));
        assert_eq!(m.charge(&c), Some(0.1));
    }

    #[test]
    fn battery_voltage_low_briefly_or_for_long() {
        let c = MissionConfig {
            battery_minimum_v: 13.6,
            ..config()
        };
        let at = |t: f64, v: f64| AutopilotState {
            battery_v: Some(v),
            ..state(t, Some(0.6))
        };
        let mut m = BatteryMonitor::default();
        // Two seconds of full thrust, every five.
        run(&mut m, &c, 0.0, 60.0, |t| {
            at(t, if t % 5.0 < 2.0 { 13.0 } else { 14.8 })
        });
        assert_eq!(m.charge(&c), Some(0.6));
        run(&mut m, &c, 60.0, 6.0, |t| at(t, 13.0));
        assert_eq!(m.charge(&c), Some(0.0));
    }

    #[test]
    fn battery_reserve_of_a_way_and_an_attempt() {
        let (mut m, c) = (BatteryMonitor::default(), config());
        // A gauge in whole per cents, of a battery for 1000 s.
        run(&mut m, &c, 0.0, 300.0, |t| {
            state(t, Some((90.0 - 0.1 * t).round() / 100.0))
        });
        let (d, v) = (3000.0, 8.0);
        let needed = 1e-3 * (d / v + c.battery_attempt_s);
        let found = m.reserve(d, v, &c);
        assert!((found / needed - 1.0).abs() < 0.1, "{found} of {needed}");
        assert_eq!(m.reserve(20.0, v, &c), c.battery_reserve);
        // Into the wind, after a vessel that leaves: 4 m/s made good.
        for _ in 0..600 {
            m.approach(0.1, d, Some(4.0), v);
        }
        let against = m.reserve(d, v, &c);
        let needed = 1e-3 * (d / 4.0 + c.battery_attempt_s);
        assert!((against / needed - 1.0).abs() < 0.1, "{against} of {needed}");
        // By the current: 20 A of 10 Ah empty it in 1800 s.
        let c = MissionConfig {
            battery_capacity_ah: 10.0,
            ..c
        };
        run(&mut m, &c, 300.0, 60.0, |t| AutopilotState {
            battery_a: Some(20.0),
            ..state(t, Some(0.6))
        });
        let needed = (d / 4.0 + c.battery_attempt_s) / 1800.0;
        assert!((m.reserve(d, v, &c) - needed).abs() < 0.01);
    }
}
