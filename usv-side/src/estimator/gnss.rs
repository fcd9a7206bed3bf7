//! GNSS and heading measurements. They arrive late and are compared with the state at their time of validity.

use core::f64::consts::FRAC_PI_2;

use alight_shared::{
    estimation::AidSource,
    frames::{VesselNed, wrap_angle},
    msg::{GnssFix, HeadingFix, MAX_SOURCES, NOT_MEASURED_SD},
    time::{VesselClock, VesselTime},
    vessel_model::{ETA, HEAD, HEAVE, NU, PITCH, ROLL, SURGE, SWAY, Term, YAW},
};
use nalgebra::{Rotation2, Vector2, Vector3};

use super::{GNSS_BIAS, InnovationChannel, STEP_S, VesselFilter, history::PastState};
use crate::VesselNodeConfig;

/// Gate on the normalised innovation squared (5 standard deviations).
const GATE: f64 = 25.0;
/// Gate for headings, smaller than [`GATE`]: a wrong first second that passes it takes at most 3 sd of the heading with it.
const HEADING_GATE: f64 = 20.0;
/// Standard deviation of a rate of turn, rad/s (our choice: smoothed, sent in tenths of a degree per minute).
const RATE_SD: f64 = 0.02;
/// Consecutive rejected fixes after which the position is re-initialised (2 s at 10 Hz).
const MAX_REJECTED: u32 = 20;
/// Consecutive rejected velocities of an axis after which they are accepted (0.5 s at 10 Hz). Slamming moves
/// a hull sideways faster than the inertial gate allows. Doppler errors are independent, whereas position
/// errors last for seconds.
const MAX_REJECTED_VELOCITIES: u32 = 5;
/// Index of the compass bias in the yaw block.
const COMPASS: usize = HEAD + 1;
/// Duration of consistent heading rejections after which they are not attributed to a disturbance, s.
const LASTING_S: f64 = 2.5;
/// Compass bias that raises no doubt about the heading, in its standard deviations.
const USUAL_BIAS: f64 = 5.0;
/// Standard deviation of course minus heading caused by leeway and current, rad, and the speed above which it applies, m/s.
const LEEWAY_SD: f64 = 0.1;
const COURSE_MPS: f64 = 1.5;
/// Standard deviation of an unmeasured height, m: above the distance between sea and ellipsoid.
const UNKNOWN_HEIGHT_SD: f64 = 200.0;
/// Age of the better of two height references above which the other one is used, s.
const REFERENCE_TIMEOUT_S: f64 = 10.0;

/// Reference surface of the receivers' heights. Its error is the same in every fix.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeightReference {
    pub(super) sd: f64,
    /// Time of the newest fix with this reference.
    at: VesselTime,
}

impl HeightReference {
    pub(super) fn of(fix: &GnssFix) -> Self {
        let measured = fix.position_sd[HEAVE] < NOT_MEASURED_SD;
        HeightReference {
            sd: if measured {
                fix.height_spread
            } else {
                UNKNOWN_HEIGHT_SD
            },
            at: fix.header.at,
        }
    }
    fn is_unknown(&self) -> bool {
        self.sd >= UNKNOWN_HEIGHT_SD
    }
    /// Adopts a fix's height reference if it is at least as good as the current one, or if that timed out.
    fn take(&mut self, fix: &GnssFix) {
        let gone = (fix.header.at - self.at).secs() > REFERENCE_TIMEOUT_S;
        if gone || fix.height_spread <= self.sd {
            *self = HeightReference::of(fix);
        }
    }
}

/// Tilt axis that moves an antenna at this offset (m) along `axis`, and the displacement per angle, m/rad.
fn lever(axis: usize, lever_arm: &Vector3<f64>) -> Option<(usize, f64)> {
    match axis {
        SURGE => Some((PITCH, lever_arm.z)),
        SWAY => Some((ROLL, -lever_arm.z)),
        _ => None,
    }
}

impl VesselFilter {
    /// Fuses a fix. Returns the number of rejected components.
    pub(super) fn fuse_gnss(&mut self, config: &VesselNodeConfig, fix: &GnssFix) -> u64 {
        let has_height = fix.position_sd[HEAVE] < NOT_MEASURED_SD;
        if has_height {
            self.refer_height(config, fix);
        }
        let shift = self.datum.to::<VesselNed>(&fix.datum).0;
        let turn = Rotation2::new(-self.reference);
        let flat = |v: Vector3<f64>| {
            let h = turn * Vector2::new(v.x, v.y);
            Vector3::new(h.x, h.y, v.z)
        };
        let position = flat(Vector3::from(fix.position) + shift);
        let velocity = flat(self.present_velocity(fix, &shift));
        let lever_arm_body = Vector3::from(fix.lever_arm.unwrap_or(config.gnss.antenna_m));
        let mut rejected = 0;
        for axis in [SURGE, SWAY, HEAVE] {
            let before = [ETA, NU].map(|slot| self.belief.get(axis, slot));
            let then = self.state_at(fix.header.at);
            let measured = [position, velocity].map(|v| v[axis]);
            let fused = [
                self.fuse_position(axis, fix, &then, measured[0], &lever_arm_body),
                self.fuse_velocity(axis, fix, &then, measured[1], &lever_arm_body),
            ];
            rejected += fused.into_iter().filter(|fused| !fused).count() as u64;
            let [eta, nu] = [ETA, NU].map(|slot| self.belief.get(axis, slot));
            self.correct_history(axis, eta - before[0], nu - before[1]);
        }
        self.weigh_course(config);
        self.fixes.record(fix.header.at, 0.0, rejected <= 2);
        if self.fixes.rejections > MAX_REJECTED {
            // Either the receiver's frame has jumped or the filter has diverged.
            self.fixes = AidSource::default();
            self.history.clear();
            let lever_arm = self.tilt().rotation() * lever_arm_body;
            for axis in [SURGE, SWAY] {
                self.belief.set(axis, ETA, position[axis] - lever_arm[axis]);
                self.belief.set_variance(axis, ETA, 1.0);
                if fix.velocity_sd[axis] < NOT_MEASURED_SD {
                    self.belief.set(axis, NU, velocity[axis]);
                    self.belief.set_variance(axis, NU, 0.25);
                }
            }
            if has_height {
                self.set_level(position[2] - lever_arm.z);
            }
        }
        rejected
    }

    /// Velocity of a fix (NED, m/s), corrected for the turn of the course during the receiver's lag.
    fn present_velocity(&mut self, fix: &GnssFix, shift: &Vector3<f64>) -> Vector3<f64> {
        let is_measured = |sd: &[f64; 3]| sd[SURGE].max(sd[SWAY]) < NOT_MEASURED_SD;
        let at = fix.header.at;
        let velocity = Vector3::from(fix.velocity);
        let heading = self.reference + self.state_at(at).tilt.heading;
        let Some(lag) = self.velocity_lags.of(fix.source) else {
            return velocity;
        };
        if is_measured(&fix.position_sd) {
            let place = Vector3::from(fix.position) + shift;
            lag.position(at, place.xy());
        }
        if !is_measured(&fix.velocity_sd) {
            return velocity;
        }
        let turned = Rotation2::new(lag.velocity(at, velocity.xy(), heading)) * velocity.xy();
        Vector3::new(turned.x, turned.y, velocity.z)
    }
    /// Fuses the position along an axis of an antenna at `lever_arm` (m, body), measured in the state `then`. Returns
    /// false if it was rejected.
    fn fuse_position(
        &mut self,
        axis: usize,
        fix: &GnssFix,
        then: &PastState,
        position: f64,
        lever_arm: &Vector3<f64>,
    ) -> bool {
        let late = (self.at - fix.header.at).secs();
        let lever_arm = then.tilt.rotation() * lever_arm;
        let level = if axis == HEAVE {
            self.belief.get(HEAVE, GNSS_BIAS)
        } else {
            0.0
        };
        let mut row = core::mem::take(&mut self.row);
        row.clear();
        row.extend([Term::new(axis, ETA, 1.0), Term::new(axis, NU, -late)]);
        if let Some((tilt, lever_arm)) = lever(axis, &lever_arm) {
            row.extend([
                Term::new(tilt, ETA, lever_arm),
                Term::new(tilt, NU, -late * lever_arm),
            ]);
        }
        if axis == HEAVE {
            row.push(Term::new(HEAVE, GNSS_BIAS, 1.0));
        }
        let innovation = position - (then.eta[axis] + level + lever_arm[axis]);
        let worse = match axis {
            HEAVE => fix.height_spread.powi(2) - self.height_reference.sd.powi(2),
            _ => 0.0,
        };
        let r = fix.position_sd[axis].powi(2) + worse.max(0.0);
        let gate = self.gate(axis, ETA, MAX_REJECTED, innovation);
        let update = self.belief.update(&row, innovation, r, gate);
        self.row = row;
        self.rows[ETA][axis].record(fix.header.at, innovation, update.fused());
        // Components that are not measured do not count.
        if fix.position_sd[axis] < NOT_MEASURED_SD {
            self.consistency.observe(InnovationChannel::Position, update);
        }
        update.fused()
    }
    /// Fuses the velocity along an axis of an antenna at `lever_arm` (m, body). Returns false if it was rejected.
    fn fuse_velocity(
        &mut self,
        axis: usize,
        fix: &GnssFix,
        then: &PastState,
        velocity: f64,
        lever_arm: &Vector3<f64>,
    ) -> bool {
        let late = (self.at - fix.header.at).secs();
        let lever_arm = then.tilt.rotation() * lever_arm;
        let spin = then.tilt.rotation() * then.tilt.body_rates();
        let mut row = core::mem::take(&mut self.row);
        row.clear();
        row.push(Term::new(axis, NU, 1.0));
        self.belief.acceleration_terms(&self.model, axis, -late, &mut row);
        if let Some((tilt, lever_arm)) = lever(axis, &lever_arm) {
            row.push(Term::new(tilt, NU, lever_arm));
        }
        let innovation = velocity - (then.nu[axis] + spin.cross(&lever_arm)[axis]);
        let r = fix.velocity_sd[axis].powi(2);
        let source = &self.rows[NU][axis];
        if axis == HEAVE && source.rejections >= MAX_REJECTED_VELOCITIES {
            // Or the accelerometer has been off by this much since the last fused velocity (downwards, where
            // tilt errors have no effect).
            let since = source.fused_at.unwrap_or(self.started);
            let bias = innovation / (fix.header.at - since).secs().max(STEP_S);
            self.belief.inflate(HEAVE, HEAD, bias * bias);
        }
        let gate = self.gate(axis, NU, MAX_REJECTED_VELOCITIES, innovation);
        let update = self.belief.update(&row, innovation, r, gate);
        self.row = row;
        self.rows[NU][axis].record(fix.header.at, innovation, update.fused());
        if fix.velocity_sd[axis] < NOT_MEASURED_SD {
            self.consistency.observe(InnovationChannel::Velocity, update);
        }
        update.fused()
    }

    /// Selects the height reference. The first measured height replaces the assumed level.
    fn refer_height(&mut self, config: &VesselNodeConfig, fix: &GnssFix) {
        if self.height_reference.is_unknown() {
            let lever_arm = Vector3::from(fix.lever_arm.unwrap_or(config.gnss.antenna_m));
            self.datum.height_m = fix.datum.height_m;
            self.set_level(fix.position[2] - (self.tilt().rotation() * lever_arm).z);
        }
        self.height_reference.take(fix);
    }
    /// Sets the mean water level from the vessel's position `down` (m) in its plane.
    fn set_level(&mut self, down: f64) {
        let heave = self.belief.get(HEAVE, ETA);
        self.belief.set(HEAVE, GNSS_BIAS, down - heave);
        self.belief.set_variance(HEAVE, GNSS_BIAS, 4.0);
    }

    /// Gate for the position ([`ETA`]) or velocity ([`NU`]) of an axis. After `max_rejected` consecutive
    /// rejections it raises the variance to the squared innovation: of the state, or in height of the
    /// receiver's bias, because the water supports the hull.
    fn gate(&mut self, axis: usize, slot: usize, max_rejected: u32, innovation: f64) -> f64 {
        let gate = self.rows[slot][axis].gate(GATE, max_rejected);
        if gate.is_infinite() {
            let state = if (axis, slot) == (HEAVE, ETA) {
                GNSS_BIAS
            } else {
                slot
            };
            self.belief.inflate(axis, state, innovation * innovation);
        }
        gate
    }

    /// Returns false if rejected.
    pub(super) fn fuse_heading(&mut self, fix: &HeadingFix) -> bool {
        let (at, late) = (fix.header.at, (self.at - fix.header.at).secs());
        let row = [
            Term::new(YAW, ETA, 1.0),
            Term::new(YAW, NU, -late),
            Term::new(YAW, COMPASS, 1.0),
        ];
        let source = usize::from(fix.source).min(MAX_SOURCES - 1);
        let innovation = wrap_angle(fix.heading - self.belief.predicted(&row));
        let (gate, of_state) = self.heading_gate(source, at, innovation);
        let before = self.belief.get(YAW, ETA);
        let update = self.belief.update(&row, innovation, fix.heading_sd.powi(2), gate);
        // Near 180 deg, the wrapped innovations of a run keep the sign of the first one.
        let own = &mut self.headings[source];
        let last = if own.rejections > 0 { own.innovation } else { 0.0 };
        own.record(at, last + wrap_angle(innovation - last), update.fused());
        if of_state {
            self.turn_means(self.belief.get(YAW, ETA) - before);
        }
        self.consistency.observe(InnovationChannel::Heading, update);
        if let Some(rate) = fix.rate.filter(|_| !self.has_inertial(at)) {
            let innovation =
                rate - (self.belief.get(YAW, NU) - late * self.belief.acceleration(&self.model, YAW));
            let update = self
                .belief
                .update(&[Term::new(YAW, NU, 1.0)], innovation, RATE_SD * RATE_SD, GATE);
            self.consistency.observe(InnovationChannel::Rate, update);
        }
        update.fused()
    }

    /// Gate for a heading. It opens after lasting rejections with consistent innovations, unless another
    /// heading source contradicts this one, and raises the variance of the state (returns true) or of the
    /// compass bias to the squared innovation. The state is assumed wrong without a gyroscope, if the heading
    /// was accepted for less time than rejected, if the innovation grows, or if another source agrees.
    fn heading_gate(&mut self, source: usize, at: VesselTime, innovation: f64) -> (f64, bool) {
        let own = self.headings[source];
        let others = || (self.headings.iter().enumerate()).filter(|(k, _)| *k != source);
        let (lasted_s, drift) = own.contradiction();
        if lasted_s < LASTING_S || others().any(|(_, other)| other.age_s(at) < LASTING_S) {
            return (HEADING_GATE, false);
        }
        let accepted_s = own.fused_at.map_or(0.0, |t| (t - self.started).secs());
        let grows = drift.abs() > 0.5 * (innovation - drift).abs();
        let agrees = |other: &AidSource<VesselClock>| {
            let apart = wrap_angle(other.innovation - innovation);
            other.contradiction().0 >= LASTING_S && apart.abs() < 0.5 * innovation.abs()
        };
        let of_state = grows
            || accepted_s < lasted_s
            || !self.has_inertial(at)
            || others().any(|(_, other)| agrees(other));
        if grows {
            self.belief.inflate(YAW, HEAD, (drift / lasted_s).powi(2));
        }
        let state = if of_state { ETA } else { COMPASS };
        self.belief.inflate(YAW, state, innovation * innovation);
        (f64::INFINITY, of_state)
    }
    /// Rotates the mean heading by `by` (rad) to correct an error. The mean velocity keeps its direction in NED.
    fn turn_means(&mut self, by: f64) {
        self.mean_heading = wrap_angle(self.mean_heading + by);
        self.slow.turn(by);
    }

    /// Standard deviation of a suspected heading error, rad: a large compass bias may be a heading error.
    pub(super) fn heading_doubt(&self, config: &VesselNodeConfig) -> f64 {
        let bias = self.belief.get(YAW, COMPASS).abs();
        if bias > USUAL_BIAS * config.heading.bias_sd_deg.to_radians() {
            0.5 * bias
        } else {
            0.0
        }
    }
    /// While the heading is in doubt, separates heading and compass error by the course over ground.
    fn weigh_course(&mut self, config: &VesselNodeConfig) {
        let doubt = self.heading_doubt(config);
        let [north, east] = self.mean_velocity.into();
        let apart = wrap_angle(f64::atan2(east, north) - self.mean_heading);
        // The course of a vessel going astern is not usable.
        if doubt < LEEWAY_SD || north.hypot(east) < COURSE_MPS || apart.abs() > FRAC_PI_2 {
            return;
        }
        let heading = self.belief.get(YAW, ETA);
        let bias = self.belief.get(YAW, COMPASS);
        let fraction = doubt * doubt / (doubt * doubt + LEEWAY_SD * LEEWAY_SD);
        let by = (fraction * apart).clamp(bias.min(0.0), bias.max(0.0));
        self.belief.set(YAW, ETA, heading + by);
        self.belief.set(YAW, COMPASS, bias - by);
        self.turn_means(by);
    }
}
