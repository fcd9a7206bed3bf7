//! Detects the spin-up of the rotors after arming from the autopilot's outputs (`SERVO_OUTPUT_RAW`).
//!
//! After arming, ArduCopter keeps its rotors at rest for ARMING_DELAY_SEC and then spins them up for MOT_SPOOL_TIME,
//! regardless of the commanded thrust; PX4's rotors respond at once. Outputs are compared with their values while
//! disarmed and with those a moment ago, so their protocol and order do not matter. The heartbeat that reports arming
//! may arrive a second after the rotors start, so older outputs serve as the values at rest.

use alight_shared::{
    mavlink::{dialect::SERVO_OUTPUT_RAW_DATA, fields},
    time::Span,
};

use super::DroneTime;

/// Number of outputs that are read, enough for an octorotor.
const OUTPUTS: usize = 8;
const PORTS: usize = 2;
/// Minimum number of rising outputs: a multirotor has at least three rotors, and fewer servos than that move at arming.
const ROTORS: usize = 3;
/// Smallest significant rise of an output, us or steps of a digital protocol.
const RISEN: f64 = 5.0;
/// Maximum ratio of two rises [`SPUN_UP`] apart once spin-up is complete; ArduCopter's ramp doubles them.
const GROWS: f64 = 1.5;
const SPUN_UP: Span = Span::from_millis(200);
const STALE: Span = Span::from_millis(500);
/// Maximum time from the outputs at rest to a disarmed report: two heartbeats.
const REPORTED_WITHIN: Span = Span::from_millis(2000);
/// Time after arming from which outputs that have not risen are not motors.
const OTHERS: Span = Span::from_millis(5000);

#[derive(Clone, Copy, Debug)]
struct AtRest {
    pulses: [u16; OUTPUTS],
    /// Later outputs, possibly from an autopilot that has just armed.
    later: [u16; OUTPUTS],
    later_at: DroneTime,
}

impl AtRest {
    fn begun(now: DroneTime, pulses: &[u16; OUTPUTS]) -> AtRest {
        let (pulses, later) = (*pulses, *pulses);
        AtRest {
            pulses,
            later,
            later_at: now,
        }
    }
    fn update(&mut self, now: DroneTime, pulses: &[u16; OUTPUTS]) {
        if now - self.later_at >= REPORTED_WITHIN {
            *self = AtRest {
                pulses: self.later,
                ..AtRest::begun(now, pulses)
            };
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RotorOutputs {
    at_rest: [Option<AtRest>; PORTS],
    armed_at: Option<DroneTime>,
    newest: Option<DroneTime>,
    before: Option<(DroneTime, f64)>,
    follow: bool,
}

impl RotorOutputs {
    pub(crate) fn outputs(&mut self, now: DroneTime, armed: bool, d: &SERVO_OUTPUT_RAW_DATA) {
        let pulses = &fields!(d, servo1_raw servo2_raw servo3_raw servo4_raw servo5_raw servo6_raw servo7_raw servo8_raw);
        let port = d.port;
        let Some(at_rest) = self.at_rest.get_mut(usize::from(port)) else {
            return;
        };
        if !armed {
            let begun = || AtRest::begun(now, pulses);
            at_rest.get_or_insert_with(begun).update(now, pulses);
            self.armed_at = None;
            self.before = None;
            self.follow = false;
            return;
        }
        // A link that starts with an armed autopilot does not know the values at rest.
        let Some(at_rest) = at_rest else { return };
        self.newest = Some(now);
        self.armed_at = self.armed_at.or(Some(now));
        let mut rises = [0.0; OUTPUTS];
        for ((rise, rest), pulse) in rises.iter_mut().zip(&mut at_rest.pulses).zip(pulses) {
            if *rest == 0 {
                // Before arming this output had no pulses.
                *rest = *pulse;
            }
            *rise = f64::from(*pulse) - f64::from(*rest);
        }
        rises.sort_by(|a, b| b.total_cmp(a));
        let rise = rises.get(ROTORS - 1).copied().unwrap_or_default();
        let (at, before) = *self.before.get_or_insert((now, rise));
        if now - at >= SPUN_UP {
            self.follow |= before > RISEN && rise > RISEN && rise <= GROWS * before;
            self.before = Some((now, rise));
        }
    }
    /// Whether the rotors do not yet follow the commanded thrust.
    pub(crate) fn wait(&self, now: DroneTime) -> bool {
        let reported = self.newest.is_some_and(|at| now - at <= STALE);
        let recent = self.armed_at.is_some_and(|at| now - at <= OTHERS);
        reported && recent && !self.follow
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    /// Time after arming at which outputs `pulse_us` (a function of that time, s; 20 Hz) show that the rotors follow.
    /// The heartbeat reports armed at `reported_s`.
    fn follow_s(at_rest: u16, reported_s: f64, pulse_us: impl Fn(f64) -> f64) -> Option<f64> {
        let mut rotors = RotorOutputs::default();
        let mut outputs = |t: f64, armed, pulse: f64| {
            let number = |k: f64| (pulse + if pulse > 1050.0 { 4.0 * k } else { 0.0 }) as u16;
            let all = SERVO_OUTPUT_RAW_DATA {
                servo1_raw: number(0.0),
                servo2_raw: number(1.0),
                servo3_raw: number(2.0),
                servo4_raw: number(3.0),
                servo7_raw: 1500,
                ..SERVO_OUTPUT_RAW_DATA::DEFAULT
            };
            rotors.outputs(Time::from_secs(t), armed, &all);
            rotors.wait(Time::from_secs(t))
        };
        for k in 0..100 {
            assert!(!outputs(5.0 + 0.05 * f64::from(k), false, f64::from(at_rest)));
        }
        (0..200)
            .map(|k| 0.05 * f64::from(k))
            .find(|t| !outputs(10.0 + t, *t >= reported_s, pulse_us(*t)) && *t >= reported_s)
    }

    #[test]
    fn outputs_of_motors_that_spin_up() {
        // From a log of ArduCopter 4.7-dev.
        let arducopter = |t: f64| match t {
            t if t < 2.0 => 1000.0,
            t if t < 2.5 => 1000.0 + 40.0 * (t - 2.0),
            _ => 1110.0,
        };
        for at_rest in [1000, 0] {
            let s = follow_s(at_rest, 0.0, arducopter).unwrap();
            assert!((2.6..3.0).contains(&s), "{s}");
        }
        // PX4 with PWM, and with a digital protocol.
        for (at_rest, turns) in [(900, 1200.0), (54, 400.0)] {
            for reported_s in [0.0, 0.6, 1.2] {
                let s = follow_s(at_rest, reported_s, |_| turns).unwrap();
                assert!(s < reported_s + 0.3, "{s} s, reported after {reported_s} s");
            }
        }
        // Outputs other than motors delay the flight only for a limited time.
        let s = follow_s(1000, 0.0, |_| 1000.0).unwrap();
        assert!((5.0..5.2).contains(&s), "{s}");
    }
}
