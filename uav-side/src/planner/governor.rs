//! The reference governor: a reference point that approaches a target at bounded speed and acceleration,
//! so that the optimisation is never asked for a step of 40 m.

use alight_shared::time::{DroneClock, Time};
use nalgebra::SVector;

/// How fast a reference approaches its target.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Greatest speed relative to the target, unit/s.
    pub speed: f64,
    /// Acceleration, unit/s².
    pub acceleration: f64,
    /// Time constant of the last part, s.
    pub settle_s: f64,
}

/// Offset of the reference from its target, and its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap<const D: usize> {
    /// Reference minus target.
    pub offset: SVector<f64, D>,
    /// Its rate, 1/s.
    pub rate: SVector<f64, D>,
}

impl<const D: usize> Gap<D> {
    /// Closes in: constant deceleration far away, exponentially near, speed and acceleration
    /// bounded; continuous in velocity.
    pub fn advance(&mut self, time_s: f64, pace: &Pace) {
        const SUBSTEP_S: f64 = 0.025;
        const BRAKING: f64 = 1.15;
        let n = (time_s / SUBSTEP_S).ceil().clamp(1.0, 40.0);
        let dt = time_s / n;
        for _ in 0..n as usize {
            let distance = self.offset.norm();
            let near = pace.acceleration * pace.settle_s * pace.settle_s;
            let speed = if distance <= near {
                distance / pace.settle_s
            } else {
                (2.0 * pace.acceleration * (distance - 0.5 * near))
                    .sqrt()
                    .min(pace.speed)
            };
            let wanted = if distance > 1e-9 {
                self.offset * (-speed / distance)
            } else {
                SVector::zeros()
            };
            let change = wanted - self.rate;
            let (max, size) = (BRAKING * pace.acceleration * dt, change.norm());
            self.rate += if size > max { change * (max / size) } else { change };
            self.offset += self.rate * dt;
        }
    }
}

/// A target as it was met.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Target<const D: usize> {
    at: Time<DroneClock>,
    kind: bool,
    place: SVector<f64, D>,
    velocity: SVector<f64, D>,
}

/// A reference point that moves towards a moving target and then stays on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceGovernor<const D: usize> {
    /// Where it is relative to the target.
    pub gap: Gap<D>,
    /// What the gap was last measured from.
    from: Option<Target<D>>,
}

impl<const D: usize> Default for ReferenceGovernor<D> {
    fn default() -> Self {
        ReferenceGovernor {
            gap: Gap {
                offset: SVector::zeros(),
                rate: SVector::zeros(),
            },
            from: None,
        }
    }
}

impl<const D: usize> ReferenceGovernor<D> {
    /// Brings the gap to `now` against this target. A target of another kind, or one that jumped by
    /// more than `limits[0]`, leaves the reference where it was; a reference further than `limits[1]`
    /// from the plan's own start is brought back to it.
    pub fn update(
        &mut self,
        now: Time<DroneClock>,
        kind: bool,
        target: &SVector<f64, D>,
        velocity: &SVector<f64, D>,
        start: &SVector<f64, D>,
        start_velocity: &SVector<f64, D>,
        pace: &Pace,
        limits: [f64; 2],
    ) {
        let fresh = Gap {
            offset: start - target,
            rate: start_velocity - velocity,
        };
        self.gap = match self.from {
            None => fresh,
            Some(old) => {
                let dt = (now - old.at).secs().clamp(0.0, 1.0);
                let expected = old.place + old.velocity * dt;
                let mut gap = self.gap;
                if dt > 0.0 {
                    gap.advance(dt, pace);
                }
                if old.kind != kind || (target - expected).norm() > limits[0] {
                    gap.offset += expected - target;
                    gap.rate += old.velocity - velocity;
                }
                if (target + gap.offset - start).norm() > limits[1] {
                    gap = fresh;
                }
                gap
            }
        };
        self.from = Some(Target {
            at: now,
            kind,
            place: *target,
            velocity: *velocity,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACE: Pace = Pace {
        speed: 5.0,
        acceleration: 2.0,
        settle_s: 0.8,
    };

    #[test]
    fn reference_governor_closes_a_gap_without_overshoot_inside_its_limits() {
        let mut gap = Gap {
            offset: SVector::from([30.0, -40.0]),
            rate: SVector::from([0.0, 0.0]),
        };
        let (mut before, mut time) = (gap.rate, 0.0);
        while gap.offset.norm() > 0.1 {
            gap.advance(0.02, &PACE);
            assert!(gap.rate.norm() <= PACE.speed + 1e-9);
            assert!((gap.rate - before).norm() <= 1.2 * PACE.acceleration * 0.02);
            assert!(gap.offset[0] > 0.0, "no overshoot");
            before = gap.rate;
            time += 0.02;
            assert!(time < 20.0);
        }
        // At least the time of the limits alone: 50 m at 5 m/s and one ramp.
        assert!(time > 11.0, "{time}");
    }

    #[test]
    fn reference_governor_stays_in_place_when_its_target_jumps() {
        let zero = SVector::<f64, 1>::zeros();
        let at = |ms: i64| Time::from_nanos(ms * 1_000_000);
        let place = |x: f64| SVector::from([x]);
        let mut c = ReferenceGovernor::<1>::default();
        c.update(
            at(0),
            true,
            &place(2.0),
            &zero,
            &place(2.0),
            &zero,
            &PACE,
            [0.5, 50.0],
        );
        // A revision of 0.2 m is followed, one of 10 m is approached.
        c.update(
            at(20),
            true,
            &place(2.2),
            &zero,
            &place(2.0),
            &zero,
            &PACE,
            [0.5, 50.0],
        );
        assert!(c.gap.offset[0].abs() < 1e-12);
        c.update(
            at(40),
            true,
            &place(12.2),
            &zero,
            &place(2.2),
            &zero,
            &PACE,
            [0.5, 50.0],
        );
        assert!((c.gap.offset[0] + 10.0).abs() < 1e-9);
        // Too far from the plan's start: begins anew there.
        c.update(
            at(60),
            true,
            &place(12.2),
            &zero,
            &place(-60.0),
            &zero,
            &PACE,
            [0.5, 50.0],
        );
        assert!((c.gap.offset[0] + 72.2).abs() < 1e-9);
    }
}
