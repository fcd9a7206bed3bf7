//! The deck for other users of the link, when that is configured: `LANDING_TARGET` and a plain list
//! of figures.

use alight_shared::time::Span;
use alight_shared::topics;
use nalgebra::UnitQuaternion;

use super::message::Message;
use super::{AutopilotLink, AutopilotOut, Instant};
use alight_shared::msg::{SetPoint, SetPointKind};

/// Between two offers, s.
const DECK_PERIOD_S: f64 = 0.1;

impl AutopilotLink {
    /// The deck as forecast for now, in the autopilot's frame and at its time.
    pub(super) fn publish_deck(&mut self, now: Instant, out: &mut AutopilotOut) {
        if !self.config.publish_deck || now < self.deck_next || !self.clock.known() {
            return;
        }
        let deck = self
            .forecast
            .fresh(now, topics::FORECAST.stale_after)
            .and_then(|f| f.at(now.max(f.header.at)));
        let Some(d) = deck else { return };
        self.deck_next = now + Span::from_secs(DECK_PERIOD_S);
        // The forecast is in the frame that set-points are in.
        let there = self.in_its_frame(&SetPoint {
            kind: SetPointKind::Trajectory,
            position: d.position,
            velocity: d.velocity,
            ..SetPoint::default()
        });
        let time_us = self.clock.theirs_us(now, now);
        let [roll, pitch, yaw] = d.euler;
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        out.messages.push(Message::LandingTarget {
            time_us,
            position: there.position,
            attitude: [q.w, q.i, q.j, q.k],
            size_m: self.config.deck_tag_m,
        });
        out.messages.push(Message::Deck {
            time_us,
            values: [
                there.position,
                there.velocity,
                d.euler,
                d.euler_rates,
                d.position_sd,
            ],
        });
    }
}
