//! The forced disarm on the deck.
//!
//! Stock land detectors do not disarm on a deck that heaves (PX4: none within 90 s at 0.5 m), so the
//! pilot's confirmed touchdown is followed by `MAV_CMD_COMPONENT_ARM_DISARM` with 21196, which an
//! autopilot obeys in the air too. So the pilot's word is not enough: beside it the drone has to be
//! near the deck, slow relative to it, and carried by something other than its rotors. Each command
//! needs all of it anew; their number is bounded.

use core::fmt;

use alight_shared::time::{DroneClock, Span, Time};
use serde::{Deserialize, Serialize};

use super::config::DisarmConfig;

/// What is known of the contact, apart from the pilot's word.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Contact {
    /// The mission lands.
    pub(crate) landing: bool,
    /// Feet above the deck by the rangefinder, m.
    pub(crate) range_height: Option<f64>,
    /// Feet above the deck by the forecast, m.
    pub(crate) forecast_height: Option<f64>,
    /// Speed relative to the deck, or over ground when there is no forecast, m/s.
    pub(crate) speed: Option<f64>,
    /// Specific force along the body's up axis as a share of gravity.
    pub(crate) carried: Option<f64>,
    /// Thrust as a share of hover.
    pub(crate) thrust: Option<f64>,
    /// The autopilot says that it stands on the ground.
    pub(crate) told_ground: bool,
}

/// What speaks against a disarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Doubt {
    /// The mission is in no state of landing.
    NotLanding,
    /// Neither rangefinder nor forecast says how high the feet are.
    HeightUnknown,
    /// The rangefinder sees air below the feet.
    RangeHigh,
    /// The forecast has the deck further below.
    ForecastHigh,
    /// Too fast relative to the deck, or not known.
    Fast,
    /// Nothing but the rotors carries the drone, or it falls.
    NotCarried,
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Doubt::NotLanding => "the mission does not land",
            Doubt::HeightUnknown => "neither rangefinder nor forecast says how high the feet are",
            Doubt::RangeHigh => "the rangefinder sees air below the feet",
            Doubt::ForecastHigh => "the deck is forecast further below",
            Doubt::Fast => "too fast relative to the deck",
            Doubt::NotCarried => "the deck does not carry the drone",
        })
    }
}

/// What speaks against a disarm now; None: nothing does.
pub(crate) fn doubt(e: &Contact, c: &DisarmConfig) -> Option<Doubt> {
    if !e.landing {
        return Some(Doubt::NotLanding);
    }
    // What is no number is high, fast and not carried.
    let high = |h: Option<f64>| h.is_some_and(|h| !(h <= c.height_m));
    if high(e.range_height) {
        return Some(Doubt::RangeHigh);
    }
    if high(e.forecast_height) {
        return Some(Doubt::ForecastHigh);
    }
    if e.range_height.is_none() && e.forecast_height.is_none() {
        return Some(Doubt::HeightUnknown);
    }
    if !e.speed.is_some_and(|v| v <= c.speed_mps) {
        return Some(Doubt::Fast);
    }
    let carried = e.carried.is_some_and(|f| f >= c.carried_of_g);
    let idle = e.thrust.is_some_and(|t| t <= c.thrust_of_hover);
    // The autopilot's own word stands for the thrust, never for being carried.
    if !(carried && (idle || e.told_ground)) {
        return Some(Doubt::NotCarried);
    }
    None
}

/// What to do with the pilot's word that the drone is on the deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// Press on as before: the evidence is awaited.
    Press,
    /// Send the command; thrust off.
    Command,
    /// Thrust off; the next command is not due, or all are used up.
    Idle,
    /// The evidence has been missing for too long: the drone is in the air.
    InAir(Doubt),
}

/// The way from the pilot's word to a disarmed drone.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Disarm {
    /// The evidence has been missing since.
    missing: Option<Time<DroneClock>>,
    /// It has been complete since.
    sound: Option<Time<DroneClock>>,
    next: Option<Time<DroneClock>>,
    sent: u32,
}

impl Disarm {
    /// The pilot does not say so (any more).
    pub(crate) fn clear(&mut self) {
        *self = Disarm::default();
    }
    /// Commands sent.
    pub(crate) fn sent(&self) -> u32 {
        self.sent
    }
    /// The pilot says that the drone is on the deck.
    pub(crate) fn step(&mut self, now: Time<DroneClock>, e: &Contact, c: &DisarmConfig) -> Stop {
        if let Some(d) = doubt(e, c) {
            self.sound = None;
            let missing = *self.missing.get_or_insert(now);
            return if (now - missing).secs() <= c.patience_s {
                Stop::Press
            } else {
                Stop::InAir(d)
            };
        }
        self.missing = None;
        let sound = *self.sound.get_or_insert(now);
        if (now - sound).secs() < c.hold_s {
            return Stop::Press;
        }
        let due = self.next.is_none_or(|t| now >= t);
        if !c.on_deck || !due || self.sent >= c.tries {
            return Stop::Idle;
        }
        self.sent += 1;
        self.next = Some(now + Span::from_secs(c.pause_s));
        Stop::Command
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOWN: Contact = Contact {
        landing: true,
        range_height: Some(0.02),
        forecast_height: Some(0.05),
        speed: Some(0.2),
        carried: Some(1.0),
        thrust: Some(0.3),
        told_ground: false,
    };

    fn commands(d: &mut Disarm, from_ms: i64, ms: i64, e: &Contact, c: &DisarmConfig) -> u32 {
        (0..ms / 10)
            .filter(|k| d.step(Time::from_nanos((from_ms + 10 * k) * 1_000_000), e, c) == Stop::Command)
            .count() as u32
    }

    #[test]
    fn on_the_deck_it_is_sent_at_once_and_a_bounded_number_of_times() {
        let c = DisarmConfig::default();
        let mut d = Disarm::default();
        assert_eq!(commands(&mut d, 0, 40, &DOWN, &c), 1);
        assert_eq!(commands(&mut d, 40, 60_000, &DOWN, &c), c.tries - 1);
        let off = DisarmConfig { on_deck: false, ..c };
        assert_eq!(commands(&mut Disarm::default(), 0, 10_000, &DOWN, &off), 0);
    }

    #[test]
    fn every_piece_of_evidence_is_needed() {
        let c = DisarmConfig::default();
        for (e, why) in [
            (
                Contact {
                    landing: false,
                    ..DOWN
                },
                Doubt::NotLanding,
            ),
            (
                Contact {
                    range_height: Some(1.0),
                    ..DOWN
                },
                Doubt::RangeHigh,
            ),
            (
                Contact {
                    range_height: Some(f64::NAN),
                    ..DOWN
                },
                Doubt::RangeHigh,
            ),
            (
                Contact {
                    forecast_height: Some(1.0),
                    ..DOWN
                },
                Doubt::ForecastHigh,
            ),
            (
                Contact {
                    range_height: None,
                    forecast_height: None,
                    ..DOWN
                },
                Doubt::HeightUnknown,
            ),
            (
                Contact {
                    speed: Some(3.0),
                    ..DOWN
                },
                Doubt::Fast,
            ),
            (Contact { speed: None, ..DOWN }, Doubt::Fast),
            // It hovers; it falls with the thrust cut, and the autopilot believes to stand.
            (
                Contact {
                    thrust: Some(1.0),
                    ..DOWN
                },
                Doubt::NotCarried,
            ),
            (
                Contact {
                    carried: Some(0.4),
                    told_ground: true,
                    ..DOWN
                },
                Doubt::NotCarried,
            ),
            (
                Contact {
                    carried: None,
                    ..DOWN
                },
                Doubt::NotCarried,
            ),
        ] {
            assert_eq!(doubt(&e, &c), Some(why), "{e:?}");
            assert_eq!(commands(&mut Disarm::default(), 0, 10_000, &e, &c), 0, "{e:?}");
            let mut d = Disarm::default();
            assert_eq!(d.step(Time::from_secs(0.0), &e, &c), Stop::Press);
            assert_eq!(d.step(Time::from_secs(1.0), &e, &c), Stop::InAir(why));
        }
        let blind = Contact {
            range_height: None,
            told_ground: true,
            thrust: None,
            ..DOWN
        };
        assert_eq!(doubt(&blind, &c), None);
    }

    #[test]
    fn a_drone_that_comes_off_the_deck_again_gets_no_further_command() {
        let c = DisarmConfig::default();
        let mut d = Disarm::default();
        assert_eq!(commands(&mut d, 0, 100, &DOWN, &c), 1);
        let falls = Contact {
            carried: Some(0.1),
            ..DOWN
        };
        assert_eq!(commands(&mut d, 100, 5_000, &falls, &c), 0);
    }
}
