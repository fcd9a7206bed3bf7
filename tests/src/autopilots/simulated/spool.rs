//! ArduCopter's motors after arming (`AP_MotorsMulticopter::output_logic`): they stand still for
//! ARMING_DELAY_SEC, a build-time constant, spin up to idle within MOT_SPOOL_TIME once thrust is requested,
//! and then produce thrust. Measured with ArduCopter 4.7-dev: outputs of 1000 us for 2.0 s, a ramp to 1020 us
//! in 0.5 s, and the requested output one report later. Until then `ATTITUDE_TARGET` has zero thrust and the
//! landed state is "on ground". PX4's motors respond immediately.

const ARMING_DELAY_S: f64 = 2.0;
const SPOOL_S: f64 = 0.5;
/// Pulse widths of a motor: off, idle, full thrust, us.
pub(super) const PULSE_OFF_US: f64 = 1000.0;
const PULSE_IDLE_US: f64 = 20.0;
const PULSE_RANGE_US: f64 = 1000.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Spool {
    /// Time since arming, s.
    armed_s: f64,
    ratio: f64,
}

impl Spool {
    pub(super) const RUNNING: Spool = Spool {
        armed_s: f64::INFINITY,
        ratio: 1.0,
    };
    pub(super) const fn begun() -> Spool {
        Spool {
            armed_s: 0.0,
            ratio: 0.0,
        }
    }
    /// Advances by `dt` (s); `wants` is true if thrust is requested.
    pub(super) fn step(&mut self, wants: bool, dt: f64) {
        self.armed_s += dt;
        if wants && self.armed_s > ARMING_DELAY_S {
            self.ratio = (self.ratio + dt / SPOOL_S).min(1.0);
        }
    }
    pub(super) fn turns(&self) -> bool {
        self.ratio > 0.0
    }
    pub(super) fn gives_thrust(&self) -> bool {
        self.ratio >= 1.0
    }
    /// Pulse width for a requested thrust of 0 to 1, us.
    pub(super) fn pulse_us(&self, thrust: f64) -> f64 {
        let thrust = if self.gives_thrust() { thrust } else { 0.0 };
        PULSE_OFF_US + (PULSE_IDLE_US * self.ratio).max(PULSE_RANGE_US * thrust)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values are from ArduCopter's log of a take-off.
    #[test]
    fn motors_after_arming() {
        let mut spool = Spool::begun();
        for k in 1..=300 {
            spool.step(true, 0.01);
            let t = 0.01 * f64::from(k);
            let pulse_us = spool.pulse_us(0.1);
            match t {
                t if t < 1.99 => assert!(!spool.turns() && pulse_us == 1000.0, "{t}"),
                t if t > 2.02 && t < 2.49 => {
                    assert!(spool.turns() && !spool.gives_thrust());
                    assert!(
                        (pulse_us - 1000.0 - 40.0 * (t - 2.0)).abs() < 1.0,
                        "{pulse_us} at {t}"
                    );
                }
                t if t > 2.52 => assert!(spool.gives_thrust() && (pulse_us - 1100.0).abs() < 1e-9),
                _ => {}
            }
        }
        let mut waits = Spool::begun();
        waits.step(false, 5.0);
        assert!(!waits.turns(), "no thrust is commanded");
    }
}
