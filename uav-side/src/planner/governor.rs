//! Reference governor: approaches a target with bounded speed and acceleration, so that the plan never sees a step of
//! 40 m.

use alight_shared::time::{DroneClock, Time};
use nalgebra::SVector;

/// Limits on how a reference approaches its target.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Maximum speed relative to the target, unit/s.
    pub speed: f64,
    /// Acceleration, unit/s².
    pub acceleration: f64,
    /// Time constant of the final exponential part, s.
    pub time_constant_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GovernedMotion<const D: usize> {
    pub place: SVector<f64, D>,
    pub velocity: SVector<f64, D>,
}

impl<const D: usize> GovernedMotion<D> {
    pub fn new(place: [f64; D], velocity: [f64; D]) -> Self {
        GovernedMotion {
            place: place.into(),
            velocity: velocity.into(),
        }
    }
    fn relative_to(&self, other: &Self) -> Self {
        GovernedMotion {
            place: self.place - other.place,
            velocity: self.velocity - other.velocity,
        }
    }
    /// Reduces the gap over `time_s`: constant deceleration at first, exponential near the end, with continuous
    /// velocity.
    pub fn advance(&mut self, time_s: f64, pace: &Pace) {
        const SUBSTEP_S: f64 = 0.025;
        const BRAKING: f64 = 1.15;
        const CLOSED: f64 = 1e-9;
        if self.place.norm() <= CLOSED && self.velocity.iter().all(|v| *v == 0.0) {
            return;
        }
        let n = (time_s / SUBSTEP_S).ceil().clamp(1.0, 40.0);
        let dt = time_s / n;
        for _ in 0..n as usize {
            let distance = self.place.norm();
            let near = pace.acceleration * pace.time_constant_s * pace.time_constant_s;
            let speed = if distance <= near {
                distance / pace.time_constant_s
            } else {
                (2.0 * pace.acceleration * (distance - 0.5 * near))
                    .sqrt()
                    .min(pace.speed)
            };
            let wanted = if distance > CLOSED {
                self.place * (-speed / distance)
            } else {
                SVector::zeros()
            };
            let change = wanted - self.velocity;
            let (max, size) = (BRAKING * pace.acceleration * dt, change.norm());
            self.velocity += if size > max { change * (max / size) } else { change };
            self.place += self.velocity * dt;
        }
    }
}

/// Reference point that approaches a moving target and then stays on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceGovernor<const D: usize> {
    pub gap: GovernedMotion<D>,
    /// Last update: time, kind of target, and target.
    from: Option<(Time<DroneClock>, bool, GovernedMotion<D>)>,
}

impl<const D: usize> Default for ReferenceGovernor<D> {
    fn default() -> Self {
        ReferenceGovernor {
            gap: GovernedMotion::new([0.0; D], [0.0; D]),
            from: None,
        }
    }
}

impl<const D: usize> ReferenceGovernor<D> {
    /// Propagates the gap to `now` for this target. If the kind of target has changed or the target has jumped by more
    /// than `limits[0]`, the reference stays in place. If it is farther than `limits[1]` from the plan's start, it
    /// restarts there.
    pub fn update(
        &mut self,
        now: Time<DroneClock>,
        kind: bool,
        target: &GovernedMotion<D>,
        start: &GovernedMotion<D>,
        pace: &Pace,
        limits: [f64; 2],
    ) {
        let fresh = start.relative_to(target);
        self.gap = match self.from {
            None => fresh,
            Some((at, old_kind, old)) => {
                let dt = (now - at).secs().clamp(0.0, 1.0);
                let expected = old.place + old.velocity * dt;
                let mut gap = self.gap;
                if dt > 0.0 {
                    gap.advance(dt, pace);
                }
                if old_kind != kind || (target.place - expected).norm() > limits[0] {
                    gap.place += expected - target.place;
                    gap.velocity += old.velocity - target.velocity;
                }
                if (target.place + gap.place - start.place).norm() > limits[1] {
                    gap = fresh;
                }
                gap
            }
        };
        self.from = Some((now, kind, *target));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACE: Pace = Pace {
        speed: 5.0,
        acceleration: 2.0,
        time_constant_s: 0.8,
    };

    #[test]
    fn reference_governor_within_its_limits() {
        let mut gap = GovernedMotion::new([30.0, -40.0], [0.0, 0.0]);
        let (mut before, mut time) = (gap.velocity, 0.0);
        while gap.place.norm() > 0.1 {
            gap.advance(0.02, &PACE);
            assert!(gap.velocity.norm() <= PACE.speed + 1e-9);
            assert!((gap.velocity - before).norm() <= 1.2 * PACE.acceleration * 0.02);
            assert!(gap.place[0] > 0.0, "no overshoot");
            before = gap.velocity;
            time += 0.02;
            assert!(time < 20.0);
        }
        // The time is at least that for 50 m at 5 m/s plus one ramp.
        assert!(time > 11.0, "{time}");
    }

    #[test]
    fn reference_governor_with_a_jumping_target() {
        let mut governor = ReferenceGovernor::<1>::default();
        let mut gap = |ms: i64, target: f64, start: f64| {
            let at_rest = |x: f64| GovernedMotion::new([x], [0.0]);
            let now = Time::from_nanos(ms * 1_000_000);
            governor.update(now, true, &at_rest(target), &at_rest(start), &PACE, [0.5, 50.0]);
            governor.gap.place[0]
        };
        gap(0, 2.0, 2.0);
        // A jump of 0.2 m is followed at once; one of 10 m is approached gradually.
        assert!(gap(20, 2.2, 2.0).abs() < 1e-12);
        assert!((gap(40, 12.2, 2.2) + 10.0).abs() < 1e-9);
        assert!((gap(60, 12.2, -60.0) + 72.2).abs() < 1e-9);
    }
}
