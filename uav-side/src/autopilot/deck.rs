//! The deck for other users of the link, when that is configured: `LANDING_TARGET` and a list of numbers.

use alight_shared::msg::{DeckStage, SetPoint, SetPointKind};
use alight_shared::time::Span;
use alight_shared::topics;
use nalgebra::UnitQuaternion;

use super::message::Message;
use super::{AutopilotLink, AutopilotOut, DroneTime};

/// Time between two messages.
const DECK_PERIOD: Span = Span::from_millis(100);

impl AutopilotLink {
    /// The deck as forecast for now, for as long as the newest forecast reaches: the pilot flies by no other.
    pub(super) fn deck(&self, now: DroneTime) -> Option<DeckStage> {
        let forecast = self.forecast.get()?;
        forecast.at(now.max(forecast.header.at))
    }
    /// Sends the deck in the autopilot's frame and at its time.
    pub(super) fn publish_deck(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        if !self.config.publish_deck || !self.timers.deck.is_ready(now) || !self.clock.is_synchronised() {
            return;
        }
        if self.forecast.fresh(now, topics::FORECAST.stale_after).is_none() {
            return;
        }
        let Some(d) = self.deck(now) else { return };
        self.timers.deck.restart(now, DECK_PERIOD);
        // The forecast is in the frame that set-points are in.
        let there = self.in_its_frame(&SetPoint {
            kind: SetPointKind::Trajectory,
            position: d.position,
            velocity: d.velocity,
            ..SetPoint::default()
        });
        let time_us = self.clock.remote_time_us(now, now);
        let [roll, pitch, yaw] = d.euler;
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let (position, velocity) = (there.position, there.velocity);
        out.messages.push(Message::LandingTarget {
            time_us,
            position,
            attitude: [q.w, q.i, q.j, q.k],
            size_m: self.config.deck_tag_m,
        });
        out.messages.push(Message::Deck {
            time_us,
            values: [position, velocity, d.euler, d.euler_rates, d.position_sd],
        });
    }
}
