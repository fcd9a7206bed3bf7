//! Position hold without mission or plan, and departure from a nearby deck.

use alight_shared::{geometry::DroneGeometry, msg::PlanStage};
use nalgebra::Vector2;

use super::{
    below::{Body, DeckBelow},
    climb::Climb,
    escape::escape_velocity,
};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hold {
    horizontal: Vector2<f64>,
    climb: Climb,
    yaw: f64,
}

impl Hold {
    /// Hold at the drone's position. It starts with the drone's vertical speed if the deck is `near`, otherwise at
    /// rest.
    pub(crate) fn at(body: &Body, near: bool, drone: &DroneGeometry) -> Hold {
        let sinks = if near { body.velocity.z } else { 0.0 };
        Hold {
            horizontal: body.position.xy(),
            climb: Climb::new(body.position.z, sinks, drone),
            yaw: body.yaw(),
        }
    }

    /// Stage `dt` (s) later. Over a deck that is `near` the drone rises relative to it and follows the vessel's escape
    /// direction; elsewhere it stays at rest.
    pub(crate) fn advance(
        &mut self,
        dt: f64,
        near: Option<&DeckBelow>,
        body: &Body,
        drone: &DroneGeometry,
    ) -> PlanStage {
        let before = self.climb.velocity;
        let velocity = match near {
            Some(b) => {
                if b.levels_first(body) {
                    self.climb.sink(dt, b.stage.velocity[2], 0.0);
                } else {
                    self.climb.advance(dt, b.stage.velocity[2]);
                }
                let out = escape_velocity(&b.around, &b.stage, drone, &body.position, b.clearance);
                Vector2::new(b.stage.velocity[0], b.stage.velocity[1]) + out
            }
            None => {
                self.climb.rest(dt);
                Vector2::zeros()
            }
        };
        self.horizontal += velocity * dt;
        PlanStage {
            position: [self.horizontal.x, self.horizontal.y, self.climb.z],
            velocity: [velocity.x, velocity.y, self.climb.velocity],
            acceleration: [0.0, 0.0, (self.climb.velocity - before) / dt.max(1e-3)],
            euler: [0.0, 0.0, self.yaw],
            euler_rates: [0.0; 3],
        }
    }
}
