//! Control authority and its reason. Alight commands only in the mode and armed state that the pilot has
//! chosen.
//!
//! Rules of the state machine:
//! - Alight changes the mode in three cases: to divert on low battery, which hands the drone to the
//!   autopilot; for a take-off that an operator has ordered and the crew has cleared; and to end the
//!   autopilot's own mission when a sortie returns, once per flight for each reason.
//! - One heartbeat in another mode ends our set-points. Two heartbeats in our mode are needed to start them,
//!   because one may be delayed.
//! - After another authority (pilot, ground station, geofence) has taken command, only a change back to our mode
//!   gives permission again; after a failsafe's hold (`failsafe`) the link asks for this change. After a diversion the pilot must leave the mode first.

use core::fmt;

use alight_shared::msg::AutopilotMode;
use serde::{Deserialize, Serialize};

use super::{DroneTime, config::Diversion};

const CONFIRMATIONS: u32 = 2;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ControlAuthority {
    /// No heartbeat from a multirotor's autopilot received yet.
    #[default]
    Searching,
    LinkLost,
    /// A second vehicle's autopilot is also received, and the configuration selects neither.
    SeveralAutopilots,
    /// TIMESYNC is not answered, so samples cannot be dated.
    NoClock,
    NoOrigin,
    NoHeading,
    NoOdometry,
    OptionUnknown,
    /// ArduCopter interprets thrust as a climb rate.
    OptionMissing,
    /// Ready, while the pilot or the autopilot flies without our set-points.
    Standby {
        mode: AutopilotMode,
    },
    Disarmed,
    Commanding,
    TakenOver {
        mode: AutopilotMode,
    },
    /// Diverted at the battery reserve: the autopilot was commanded to return or to land.
    Diverted(Diversion),
}

impl ControlAuthority {
    pub fn commands(self) -> bool {
        self == ControlAuthority::Commanding
    }
    /// Whether set-points may be streamed for a handover while another authority is in command.
    pub fn may_offer(self) -> bool {
        matches!(self, ControlAuthority::Standby { .. })
    }
    pub(crate) fn has_the_mode(self) -> bool {
        match self {
            ControlAuthority::Commanding
            | ControlAuthority::NoOdometry
            | ControlAuthority::NoClock
            | ControlAuthority::Disarmed => true,
            ControlAuthority::Searching
            | ControlAuthority::LinkLost
            | ControlAuthority::SeveralAutopilots
            | ControlAuthority::NoOrigin
            | ControlAuthority::NoHeading
            | ControlAuthority::OptionUnknown
            | ControlAuthority::OptionMissing
            | ControlAuthority::Standby { .. }
            | ControlAuthority::TakenOver { .. }
            | ControlAuthority::Diverted(_) => false,
        }
    }
}

impl fmt::Display for ControlAuthority {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ControlAuthority::Searching => "no heartbeat from a multirotor's autopilot; check link and address",
            ControlAuthority::LinkLost => "the autopilot's heartbeats have stopped",
            ControlAuthority::SeveralAutopilots => {
                "autopilots of two vehicles are received: set autopilot.vehicle to this drone's system number"
            }
            ControlAuthority::NoClock => "the autopilot does not answer TIMESYNC",
            ControlAuthority::NoOrigin => "the autopilot has not reported its origin (GPS_GLOBAL_ORIGIN)",
            ControlAuthority::NoHeading => {
                "the autopilot has not aligned its heading yet (PX4: ESTIMATOR_STATUS, ArduPilot: EKF_STATUS_REPORT); \
                 leave the drone still, away from steel"
            }
            ControlAuthority::NoOdometry => "no odometry with inertial samples arrives from the autopilot",
            ControlAuthority::OptionUnknown => "ArduCopter has not reported its GUID_OPTIONS yet",
            ControlAuthority::OptionMissing => {
                "ArduCopter reads thrust as a climb rate: set GUID_OPTIONS bit 3 (add 8), or land by trajectory \
                 (drone.pilot.output)"
            }
            ControlAuthority::Disarmed => "in our mode, disarmed",
            ControlAuthority::Commanding => "commanding",
            ControlAuthority::Standby { mode } => return write!(f, "ready; the drone is in mode {mode:?}"),
            ControlAuthority::TakenOver { mode } => {
                return write!(f, "taken over: mode {mode:?}; choose our mode again to continue");
            }
            ControlAuthority::Diverted(to) => {
                return write!(f, "battery at its reserve: diverted ({to:?})");
            }
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AuthorityEvidence {
    pub(crate) found: bool,
    pub(crate) alive: bool,
    pub(crate) several: bool,
    pub(crate) clock: bool,
    /// Whether the origin of the autopilot's NED is known, or not needed.
    pub(crate) origin: bool,
    /// Whether the heading is aligned now, or was when this flight's odometry began.
    pub(crate) heading: bool,
    pub(crate) odometry: bool,
    /// Whether the autopilot interprets thrust as thrust rather than as a climb rate; None while unknown.
    pub(crate) thrust: Option<bool>,
    pub(crate) heartbeat: bool,
    pub(crate) mode: AutopilotMode,
    pub(crate) armed: bool,
    pub(crate) set_points_lost: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct AuthorityStateMachine {
    control_authority: ControlAuthority,
    since: DroneTime,
    confirmations: u32,
    /// Whether set-points have been followed and no pilot has taken over since. A second autopilot in range
    /// does not interrupt such a flight.
    flown: bool,
    /// Diversion that revoked the permission; kept until the pilot leaves the mode.
    revoked: Option<Diversion>,
}

impl AuthorityStateMachine {
    pub(crate) fn control_authority(&self) -> ControlAuthority {
        self.control_authority
    }
    pub(crate) fn since(&self) -> DroneTime {
        self.since
    }
    /// Resumes the permission of the previous link.
    pub(crate) fn resume(&mut self) {
        self.confirmations = CONFIRMATIONS;
        self.flown = true;
    }
    pub(crate) fn forget(&mut self) {
        self.confirmations = 0;
        self.flown = false;
    }
    /// Hands the drone to the autopilot until permission is given again.
    pub(crate) fn divert(&mut self, now: DroneTime, to: Diversion) {
        self.revoked = Some(to);
        self.enter(now, ControlAuthority::Diverted(to));
    }
    /// Decides the authority. Set-points are streamed during a pilot's takeover as well, because every other mode ignores
    /// them and PX4 needs a second of them before it can be handed back.
    pub(crate) fn step(&mut self, now: DroneTime, f: &AuthorityEvidence) -> ControlAuthority {
        let ours = f.mode == AutopilotMode::Offboard;
        if f.heartbeat {
            self.confirmations = if ours && f.armed {
                self.confirmations.saturating_add(1)
            } else {
                0
            };
            self.flown &= f.armed && (ours || f.set_points_lost);
        }
        if !f.alive {
            self.confirmations = 0;
        }
        if f.alive && !ours {
            self.revoked = None;
        }
        let next = if !f.found {
            ControlAuthority::Searching
        } else if !f.alive {
            ControlAuthority::LinkLost
        } else if let (true, Some(to)) = (ours, self.revoked) {
            ControlAuthority::Diverted(to)
        } else if !ours && self.was_in_command() && !self.fell_back(f) {
            ControlAuthority::TakenOver { mode: f.mode }
        } else if f.several && !self.flown {
            ControlAuthority::SeveralAutopilots
        } else if !f.clock {
            ControlAuthority::NoClock
        } else if !f.origin {
            ControlAuthority::NoOrigin
        } else if !f.odometry {
            ControlAuthority::NoOdometry
        } else if !f.heading {
            ControlAuthority::NoHeading
        } else if f.thrust.is_none() {
            ControlAuthority::OptionUnknown
        } else if f.thrust == Some(false) {
            ControlAuthority::OptionMissing
        } else if !ours {
            ControlAuthority::Standby { mode: f.mode }
        } else if !f.armed {
            ControlAuthority::Disarmed
        } else if self.confirmations >= CONFIRMATIONS
            || self.control_authority == ControlAuthority::Commanding
        {
            ControlAuthority::Commanding
        } else {
            self.control_authority
        };
        self.flown |= next.commands();
        self.enter(now, next);
        self.control_authority
    }
    /// Whether the autopilot holds by itself after a set-point loss. A set-point stream returns the autopilot
    /// only to the mode that the pilot chose, so it overrides no choice.
    fn fell_back(&self, f: &AuthorityEvidence) -> bool {
        let commanded = self.control_authority == ControlAuthority::Commanding;
        commanded && f.set_points_lost
    }
    fn was_in_command(&self) -> bool {
        matches!(
            self.control_authority,
            ControlAuthority::Commanding | ControlAuthority::Diverted(_)
        )
    }
    fn enter(&mut self, now: DroneTime, next: ControlAuthority) {
        if core::mem::discriminant(&next) != core::mem::discriminant(&self.control_authority) {
            self.since = now;
        }
        self.control_authority = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    const READY: AuthorityEvidence = AuthorityEvidence {
        found: true,
        alive: true,
        several: false,
        clock: true,
        origin: true,
        heading: true,
        odometry: true,
        thrust: Some(true),
        heartbeat: true,
        mode: AutopilotMode::Offboard,
        armed: true,
        set_points_lost: false,
    };

    fn run(
        a: &mut AuthorityStateMachine,
        from_ms: i64,
        evidence: &[AuthorityEvidence],
    ) -> Vec<ControlAuthority> {
        evidence
            .iter()
            .enumerate()
            .map(|(k, f)| {
                let now = Time::from_nanos((from_ms + 20 * k as i64) * 1_000_000);
                a.step(now, f)
            })
            .collect()
    }
    fn commanding() -> AuthorityStateMachine {
        let mut a = AuthorityStateMachine::default();
        run(&mut a, 0, &[READY; 3]);
        a
    }
    fn by(mode: AutopilotMode) -> AuthorityEvidence {
        AuthorityEvidence { mode, ..READY }
    }

    #[test]
    fn authority_conditions() {
        let mut a = AuthorityStateMachine::default();
        let disarmed = AuthorityEvidence {
            armed: false,
            ..READY
        };
        let s = run(&mut a, 0, &[disarmed, disarmed, READY, READY]);
        assert_eq!(s[..3], [ControlAuthority::Disarmed; 3]);
        assert_eq!(s[3], ControlAuthority::Commanding);
        let gaps: [fn(&mut AuthorityEvidence); 9] = [
            |e| e.several = true,
            |e| e.clock = false,
            |e| e.origin = false,
            |e| e.heading = false,
            |e| e.odometry = false,
            |e| e.thrust = None,
            |e| e.thrust = Some(false),
            |e| e.alive = false,
            |e| e.found = false,
        ];
        for gap in gaps {
            let mut missing = READY;
            gap(&mut missing);
            let mut a = AuthorityStateMachine::default();
            let s = run(&mut a, 0, &[missing; 10]);
            assert!(s.iter().all(|s| !s.commands() && !s.may_offer()), "{s:?}");
        }
    }

    #[test]
    fn authority_with_a_second_autopilot_in_flight() {
        let several = AuthorityEvidence {
            several: true,
            ..READY
        };
        let mut a = commanding();
        assert!(run(&mut a, 60, &[several; 3]).iter().all(|s| s.commands()));
        // Neither a gap in the odometry nor the autopilot's own hold ends the command.
        let gap = AuthorityEvidence {
            odometry: false,
            ..several
        };
        assert_eq!(
            run(&mut a, 120, &[gap, several]),
            [ControlAuthority::NoOdometry, ControlAuthority::Commanding]
        );
        let mode = AutopilotMode::Hold;
        let hold = AuthorityEvidence {
            mode,
            set_points_lost: true,
            ..several
        };
        assert_eq!(run(&mut a, 160, &[hold]), [ControlAuthority::Standby { mode }]);
        let pilot = AuthorityEvidence {
            mode: AutopilotMode::Other,
            ..several
        };
        let s = run(&mut a, 180, &[pilot, several, several]);
        assert_eq!(s[2], ControlAuthority::SeveralAutopilots);
    }

    #[test]
    fn authority_with_a_heartbeat_in_another_mode() {
        let mut a = commanding();
        let mode = AutopilotMode::Other;
        let person = by(mode);
        let s = run(&mut a, 60, &[person, READY, person, person]);
        assert_eq!(s[0], ControlAuthority::TakenOver { mode });
        assert!(s.iter().all(|s| !s.commands()), "{s:?}");
        assert_eq!(s[3], ControlAuthority::Standby { mode });
        assert!(s[3].may_offer());
        assert_eq!(run(&mut a, 140, &[READY; 2])[1], ControlAuthority::Commanding);
    }

    /// In return mode set-points are streamed at once, and the mode ends the command like any other mode.
    #[test]
    fn authority_after_a_return() {
        let mut a = commanding();
        let mode = AutopilotMode::Return;
        let s = run(&mut a, 60, &[by(mode); 3]);
        assert_eq!(s[0], ControlAuthority::TakenOver { mode });
        assert_eq!(s[1], ControlAuthority::Standby { mode });
        assert!(s[1].may_offer() && !s[1].commands());
        assert_eq!(run(&mut a, 120, &[READY; 2])[1], ControlAuthority::Commanding);
    }

    #[test]
    fn authority_with_a_failsafe_of_the_autopilot() {
        for mode in [AutopilotMode::Return, AutopilotMode::Land, AutopilotMode::Hold] {
            for set_points_lost in [false, true] {
                let mut a = commanding();
                let s = run(
                    &mut a,
                    60,
                    &[AuthorityEvidence {
                        set_points_lost,
                        ..by(mode)
                    }],
                )[0];
                // A mode after a set-point loss needs no new permission.
                let expected = if set_points_lost {
                    ControlAuthority::Standby { mode }
                } else {
                    ControlAuthority::TakenOver { mode }
                };
                assert_eq!(s, expected, "set-points lost: {set_points_lost}");
            }
        }
    }

    #[test]
    fn authority_after_a_diversion() {
        let mut a = commanding();
        a.divert(Time::from_secs(0.06), Diversion::Return);
        // The autopilot is still in our mode after a lost or denied command.
        let s = run(&mut a, 60, &[READY; 50]);
        assert!(
            s.iter()
                .all(|s| *s == ControlAuthority::Diverted(Diversion::Return))
        );
        run(&mut a, 1060, &[by(AutopilotMode::Return); 10]);
        assert!(run(&mut a, 1260, &[READY; 3])[2].commands());
    }

    #[test]
    fn authority_after_link_loss() {
        let mut a = commanding();
        let gone = AuthorityEvidence {
            alive: false,
            heartbeat: false,
            ..READY
        };
        assert_eq!(run(&mut a, 60, &[gone])[0], ControlAuthority::LinkLost);
        let s = run(&mut a, 80, &[READY; 2]);
        assert_eq!(s, [ControlAuthority::LinkLost, ControlAuthority::Commanding]);
    }
}
