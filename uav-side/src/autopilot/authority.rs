//! Who commands the drone, and why: Alight does in the mode and armed state that a person gave, and
//! in no other.
//!
//! The rules, as this state machine keeps them:
//! - A mode is never chosen here but for a diversion (battery), which gives the drone away.
//! - One heartbeat in another mode ends our set-points. It takes two in our mode to begin, so that a
//!   heartbeat that was late on the way gives no permission.
//! - Once somebody else rules (a person, a failsafe, a geofence), only a mode that changes back gives
//!   a new permission; after a diversion or a refused drone the mode has to be left before.

use core::fmt;

use alight_shared::msg::AutopilotMode;
use alight_shared::time::{DroneClock, Span, Time};
use serde::{Deserialize, Serialize};

use super::config::Diversion;

/// Heartbeats in our mode that make a permission.
const SURE: u32 = 2;

/// Who commands, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Standing {
    /// No multirotor's autopilot was heard yet.
    #[default]
    Searching,
    /// Its heartbeats have ceased.
    LinkLost,
    /// It answers no question about its clock: nothing that it says can be dated.
    NoClock,
    /// It has not told where its NED begins.
    NoOrigin,
    /// No odometry with inertial samples comes.
    NoOdometry,
    /// ArduCopter has not said its GUID_OPTIONS.
    OptionUnknown,
    /// ArduCopter takes a thrust for a climb rate.
    OptionMissing,
    /// A person flies, or the autopilot on its own; ready.
    Standby {
        /// How it flies.
        mode: AutopilotMode,
    },
    /// In our mode and disarmed.
    Disarmed,
    /// Our set-points rule.
    Commanding,
    /// Somebody else took the drone.
    TakenOver {
        /// How it flies now.
        mode: AutopilotMode,
    },
    /// The battery's reserve was reached: the autopilot was told to go where it was configured.
    Diverted(Diversion),
}

impl Standing {
    /// Our set-points rule.
    pub fn commands(self) -> bool {
        self == Standing::Commanding
    }
    /// Somebody else rules, and set-points would only be offered.
    pub fn may_offer(self) -> bool {
        matches!(self, Standing::Standby { .. })
    }
}

impl fmt::Display for Standing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Standing::Searching => write!(f, "no multirotor's autopilot is heard; check link and address"),
            Standing::LinkLost => write!(f, "the autopilot's heartbeats have ceased"),
            Standing::NoClock => write!(f, "the autopilot answers no TIMESYNC"),
            Standing::NoOrigin => write!(
                f,
                "the autopilot has not told the origin of its estimate (GPS_GLOBAL_ORIGIN)"
            ),
            Standing::NoOdometry => {
                write!(f, "no odometry with inertial samples comes from the autopilot")
            }
            Standing::OptionUnknown => write!(f, "ArduCopter has not said its GUID_OPTIONS yet"),
            Standing::OptionMissing => write!(
                f,
                "ArduCopter reads thrust as a climb rate: set GUID_OPTIONS bit 3 (add 8), or land by \
                 trajectory (pilot.landing_output)"
            ),
            Standing::Standby { mode } => write!(f, "ready; the drone is in mode {mode:?}"),
            Standing::Disarmed => write!(f, "in our mode, disarmed"),
            Standing::Commanding => write!(f, "commanding"),
            Standing::TakenOver { mode } => {
                write!(f, "taken over: mode {mode:?}; give our mode again to go on")
            }
            Standing::Diverted(to) => write!(f, "battery at its reserve: diverted ({to:?})"),
        }
    }
}

/// What decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Facts {
    /// A multirotor's autopilot was ever heard.
    pub(crate) found: bool,
    /// Its heartbeats come.
    pub(crate) alive: bool,
    /// Its clock is known.
    pub(crate) clock: bool,
    /// Where its NED begins is known, or need not be.
    pub(crate) origin: bool,
    /// Odometry comes.
    pub(crate) odometry: bool,
    /// Whether thrust is read as thrust; None: not known yet.
    pub(crate) thrust: Option<bool>,
    /// A heartbeat arrived in this step.
    pub(crate) beat: bool,
    /// Its mode.
    pub(crate) mode: AutopilotMode,
    /// Motors may turn.
    pub(crate) armed: bool,
}

/// The state machine.
#[derive(Clone, Debug, Default)]
pub(crate) struct Authority {
    standing: Standing,
    since: Time<DroneClock>,
    sure: u32,
    /// The permission is used up until the mode is left.
    used_up: Option<Diversion>,
}

impl Authority {
    /// Who commands.
    pub(crate) fn standing(&self) -> Standing {
        self.standing
    }
    /// The drone is given away; only a new permission brings it back.
    pub(crate) fn divert(&mut self, now: Time<DroneClock>, to: Diversion) {
        self.used_up = Some(to);
        self.enter(now, Standing::Diverted(to));
    }
    /// Looks at the facts; `quiet` is how long nothing is offered after somebody took over.
    pub(crate) fn step(&mut self, now: Time<DroneClock>, f: &Facts, quiet: Span) -> Standing {
        let ours = f.mode == AutopilotMode::Offboard;
        if f.beat {
            self.sure = if ours && f.armed {
                self.sure.saturating_add(1)
            } else {
                0
            };
        }
        if !f.alive {
            self.sure = 0;
        }
        if f.alive && !ours {
            self.used_up = None;
        }
        let next = if !f.found {
            Standing::Searching
        } else if !f.alive {
            Standing::LinkLost
        } else if let (true, Some(to)) = (ours, self.used_up) {
            Standing::Diverted(to)
        } else if !ours && self.held_command() {
            Standing::TakenOver { mode: f.mode }
        } else if let (false, Standing::TakenOver { .. }) = (ours || now - self.since >= quiet, self.standing)
        {
            Standing::TakenOver { mode: f.mode }
        } else if !f.clock {
            Standing::NoClock
        } else if !f.origin {
            Standing::NoOrigin
        } else if !f.odometry {
            Standing::NoOdometry
        } else if f.thrust.is_none() {
            Standing::OptionUnknown
        } else if f.thrust == Some(false) {
            Standing::OptionMissing
        } else if !ours {
            Standing::Standby { mode: f.mode }
        } else if !f.armed {
            Standing::Disarmed
        } else if self.sure >= SURE || self.standing == Standing::Commanding {
            Standing::Commanding
        } else {
            self.standing
        };
        self.enter(now, next);
        self.standing
    }
    fn held_command(&self) -> bool {
        matches!(self.standing, Standing::Commanding | Standing::Diverted(_))
    }
    fn enter(&mut self, now: Time<DroneClock>, next: Standing) {
        if core::mem::discriminant(&next) != core::mem::discriminant(&self.standing) {
            self.since = now;
        }
        self.standing = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const READY: Facts = Facts {
        found: true,
        alive: true,
        clock: true,
        origin: true,
        odometry: true,
        thrust: Some(true),
        beat: true,
        mode: AutopilotMode::Offboard,
        armed: true,
    };

    /// Steps 20 ms apart, each with a heartbeat.
    fn run(a: &mut Authority, from_ms: i64, facts: &[Facts]) -> Vec<Standing> {
        facts
            .iter()
            .enumerate()
            .map(|(k, f)| {
                let now = Time::from_nanos((from_ms + 20 * k as i64) * 1_000_000);
                a.step(now, f, Span::from_secs(0.1))
            })
            .collect()
    }
    fn by(mode: AutopilotMode) -> Facts {
        Facts { mode, ..READY }
    }

    #[test]
    fn a_permission_is_mode_and_arming_together_and_two_heartbeats() {
        let mut a = Authority::default();
        let disarmed = Facts {
            armed: false,
            ..READY
        };
        let s = run(&mut a, 0, &[disarmed, disarmed, READY, READY]);
        assert_eq!(
            s,
            [
                Standing::Disarmed,
                Standing::Disarmed,
                Standing::Disarmed,
                Standing::Commanding
            ]
        );
        for missing in [
            Facts {
                clock: false,
                ..READY
            },
            Facts {
                origin: false,
                ..READY
            },
            Facts {
                odometry: false,
                ..READY
            },
            Facts {
                thrust: None,
                ..READY
            },
            Facts {
                thrust: Some(false),
                ..READY
            },
            Facts {
                alive: false,
                ..READY
            },
            Facts {
                found: false,
                ..READY
            },
        ] {
            let mut a = Authority::default();
            let s = run(&mut a, 0, &[missing; 10]);
            assert!(s.iter().all(|s| !s.commands() && !s.may_offer()), "{s:?}");
        }
    }

    #[test]
    fn one_heartbeat_in_another_mode_ends_it_and_one_late_one_does_not_bring_it_back() {
        let mut a = Authority::default();
        run(&mut a, 0, &[READY; 3]);
        let person = by(AutopilotMode::Other);
        let s = run(&mut a, 60, &[person, READY, person, person]);
        let taken = Standing::TakenOver {
            mode: AutopilotMode::Other,
        };
        assert_eq!(s[0], taken);
        assert!(s.iter().all(|s| !s.commands()), "{s:?}");
        // Quiet at first, then an offer; then a new permission.
        let s = run(&mut a, 140, &[person; 10]);
        assert_eq!(
            s[9],
            Standing::Standby {
                mode: AutopilotMode::Other
            }
        );
        assert_eq!(run(&mut a, 340, &[READY; 2])[1], Standing::Commanding);
    }

    #[test]
    fn a_failsafe_of_the_autopilot_is_a_take_over_too() {
        for mode in [AutopilotMode::Return, AutopilotMode::Land, AutopilotMode::Hold] {
            let mut a = Authority::default();
            run(&mut a, 0, &[READY; 3]);
            assert_eq!(run(&mut a, 60, &[by(mode)])[0], Standing::TakenOver { mode });
        }
    }

    #[test]
    fn a_diverted_drone_is_not_taken_back_until_the_mode_was_left() {
        let mut a = Authority::default();
        run(&mut a, 0, &[READY; 3]);
        a.divert(Time::from_secs(0.06), Diversion::Return);
        // The command was lost, or refused: the autopilot is still in our mode.
        let s = run(&mut a, 60, &[READY; 50]);
        assert!(s.iter().all(|s| *s == Standing::Diverted(Diversion::Return)));
        run(&mut a, 1060, &[by(AutopilotMode::Return); 10]);
        assert!(run(&mut a, 1260, &[READY; 3])[2].commands());
    }

    #[test]
    fn a_link_that_was_lost_needs_two_heartbeats_again() {
        let mut a = Authority::default();
        run(&mut a, 0, &[READY; 3]);
        let gone = Facts {
            alive: false,
            beat: false,
            ..READY
        };
        assert_eq!(run(&mut a, 60, &[gone])[0], Standing::LinkLost);
        let s = run(&mut a, 80, &[READY; 2]);
        assert_eq!(s, [Standing::LinkLost, Standing::Commanding]);
    }
}
