//! A second boat with the same tags, moored alongside. It moves with the vessel, and rolls and pitches in the
//! waves at its own position.

use alight_shared::{
    frames::{Deck, Point, TrueNed, Vector},
    time::{Span, WorldTime},
};
use nalgebra::Vector2;

use crate::{
    harness::scenario::{Scenario, SetupError},
    physics::{
        body::RigidState,
        deck_motion::DeckCarrier,
        sea::Sea,
        streams::Streams,
        vessel::response::{HullFiles, ResponseVessel},
    },
    sensors::noise::Noise,
};

pub(super) struct Neighbour {
    carrier: DeckCarrier,
    sea: Sea,
    /// Offset of the neighbour's deck centre from the vessel's, north and east, m.
    apart: Vector2<f64>,
}

impl Neighbour {
    /// Places the neighbour at the scenario's distance, in a random direction drawn from the stream `neighbour`.
    pub(super) fn new(
        scenario: &Scenario,
        sea: &Sea,
        streams: &Streams,
    ) -> Result<Option<Neighbour>, SetupError> {
        let Some(distance_m) = scenario.neighbour_m else {
            return Ok(None);
        };
        let bearing = core::f64::consts::TAU * Noise::new(streams, "neighbour").uniform();
        let apart = Vector2::new(bearing.cos(), bearing.sin()) * distance_m;
        let sea = sea.about(&apart);
        let carrier = match &scenario.hull {
            Some(hull) => {
                let files = HullFiles::load(&hull.table)?;
                let vessel = ResponseVessel::new(&files, hull, &scenario.vessel, &sea, streams);
                DeckCarrier::Responding(Box::new(vessel))
            }
            None => {
                let motion = scenario.deck_motion.as_ref();
                DeckCarrier::new(&scenario.vessel, motion, &scenario.deck, &sea, streams)?
            }
        };
        Ok(Some(Neighbour { carrier, sea, apart }))
    }
    pub(super) fn step(&mut self, t: WorldTime, dt: Span) {
        self.carrier.step(t, dt.secs(), &self.sea);
    }
    pub(super) fn deck(&self, vessels: &RigidState<Deck>, scenario: &Scenario) -> RigidState<Deck> {
        let own: RigidState<Deck> = self.carrier.state().at(scenario.deck.centre());
        let place = vessels.position.0;
        let velocity = vessels.velocity.0;
        RigidState {
            position: Point::<TrueNed>::from(nalgebra::Vector3::new(
                place.x + self.apart.x,
                place.y + self.apart.y,
                own.position.0.z,
            )),
            velocity: Vector::from(nalgebra::Vector3::new(velocity.x, velocity.y, own.velocity.0.z)),
            ..own
        }
    }
}
