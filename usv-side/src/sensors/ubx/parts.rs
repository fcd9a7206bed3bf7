//! Fix from separate messages with one time of week: position (NAV-POSLLH, NAV-HPPOSLLH), velocity
//! (NAV-VELNED) and state (NAV-SOL, NAV-STATUS).

use alight_shared::{
    geodesy::Datum,
    msg::{GnssFix, NOT_MEASURED_SD},
};

use super::sd;
use crate::sensors::{Mounting, SourceMeasurement, nmea::partner::Partner};

/// Time without a NAV-PVT fix after which the parts are used, ns.
const SILENT_NS: i64 = 2_000_000_000;
/// Maximum stated error of a position, m: the default mask (CFG-NAV5). Without a fix, receivers state kilometres.
const NO_FIX_M: f64 = 100.0;

/// Position and its stated errors, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FixPlace {
    pub(super) datum: Datum,
    pub(super) across_m: f64,
    pub(super) down_m: f64,
    pub(super) grade: Grade,
}

/// Kind of position message; the best of an epoch is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Grade {
    /// Earth-centred, with one error for all axes.
    Ecef,
    Geodetic,
    /// With a resolution below a centimetre.
    Fine,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FixState {
    NoFix,
    /// Fix without a height.
    Flat,
    Whole,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FixPart {
    Place(FixPlace),
    /// North, east, down, and the stated error, m/s.
    Velocity([f64; 3], f64),
    State(FixState),
    /// Fix state and position.
    Solution(FixState, FixPlace),
}

#[derive(Clone, Copy, Debug, Default)]
struct Epoch {
    at_ns: i64,
    place: Option<FixPlace>,
    velocity: Option<([f64; 3], f64)>,
    state: Option<FixState>,
    given: bool,
}

/// Parts received in the current epoch, and parts expected in each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FixParts {
    epoch: Option<Epoch>,
    velocity: Partner,
    geodetic: Partner,
    fine: Partner,
    state: Partner,
    /// After the first complete epoch, it is known which parts arrive in each.
    is_known: bool,
    /// Time of the newest whole fix, ns.
    whole_ns: Option<i64>,
    /// Whether any position, or any state, was received.
    pub(super) has_place: bool,
    pub(super) has_state: bool,
}

impl FixParts {
    /// Records a whole fix; parts are ignored while whole fixes arrive.
    pub(super) fn whole(&mut self, at_ns: i64) {
        self.whole_ns = Some(at_ns);
        self.epoch = None;
    }
    pub(super) fn are_spare(&self, at_ns: i64) -> bool {
        self.whole_ns
            .is_some_and(|whole| at_ns.abs_diff(whole) <= SILENT_NS.unsigned_abs())
    }
    pub(super) fn take(
        &mut self,
        at_ns: i64,
        part: FixPart,
        mounting: &Mounting,
        out: &mut Vec<SourceMeasurement>,
    ) {
        if self.epoch.is_none_or(|e| e.at_ns != at_ns) {
            self.finish(mounting, out);
            self.epoch = Some(Epoch {
                at_ns,
                ..Epoch::default()
            });
        }
        let Some(e) = self.epoch.as_mut() else { return };
        match part {
            FixPart::Place(place) => {
                self.has_place = true;
                if e.place.is_none_or(|p| p.grade <= place.grade) {
                    e.place = Some(place);
                }
            }
            FixPart::Solution(state, place) => {
                (self.has_state, e.state) = (true, Some(state));
                if state != FixState::NoFix {
                    self.has_place = true;
                    e.place.get_or_insert(place);
                }
            }
            FixPart::Velocity(velocity, stated) => e.velocity = Some((velocity, stated)),
            FixPart::State(state) => {
                self.has_state = true;
                e.state = Some(state);
            }
        }
        self.give(false, mounting, out);
    }
    pub(super) fn finish(&mut self, mounting: &Mounting, out: &mut Vec<SourceMeasurement>) {
        self.give(true, mounting, out);
        let Some(e) = self.epoch.take() else { return };
        self.is_known = true;
        if let Some(place) = e.place {
            self.velocity.end_epoch(e.at_ns, e.velocity.is_some());
            self.geodetic.end_epoch(e.at_ns, place.grade >= Grade::Geodetic);
            self.fine.end_epoch(e.at_ns, place.grade == Grade::Fine);
            self.state.end_epoch(e.at_ns, e.state.is_some());
        }
    }
    /// Emits the fix once, with all expected parts or at the end of the epoch.
    fn give(&mut self, last: bool, mounting: &Mounting, out: &mut Vec<SourceMeasurement>) {
        let Some(e) = self.epoch.as_mut().filter(|e| !e.given) else {
            return;
        };
        let Some(place) = e.place.filter(|_| self.is_known) else {
            return;
        };
        let at_ns = e.at_ns;
        let waits = |here: bool, partner: Partner| !here && !last && partner.is_due(at_ns);
        if waits(e.velocity.is_some(), self.velocity)
            || waits(place.grade >= Grade::Geodetic, self.geodetic)
            || waits(place.grade == Grade::Fine, self.fine)
            || waits(e.state.is_some(), self.state)
        {
            return;
        }
        e.given = true;
        out.extend(
            e.fix(&place, mounting)
                .map(|fix| SourceMeasurement::new(at_ns, fix)),
        );
    }
}

impl Epoch {
    /// None if the receiver has no fix.
    fn fix(&self, place: &FixPlace, mounting: &Mounting) -> Option<GnssFix> {
        if self.state == Some(FixState::NoFix) || place.across_m > NO_FIX_M {
            return None;
        }
        let across = sd(place.across_m);
        let down = match self.state {
            Some(FixState::Flat) => NOT_MEASURED_SD,
            Some(FixState::Whole | FixState::NoFix) | None => sd(place.down_m),
        };
        let (velocity, velocity_sd) = match self.velocity {
            Some((velocity, stated)) => (velocity, stated.clamp(0.02, 100.0)),
            None => ([0.0; 3], NOT_MEASURED_SD),
        };
        Some(mounting.fix(place.datum, velocity, [across, across, down], [velocity_sd; 3]))
    }
}
