//! Law of `mpc-faa`, Forcing Attitude Alignment (Procházka et al. 2024, section III and Table 4): weights that increase
//! as the foot plane approaches the deck. Only the flare's reference contains a deck attitude to align with.

use alight_shared::{
    geometry::DroneGeometry,
    time::{DroneClock, Time},
};
use nalgebra::Vector3;

use super::{
    law::{Law, View},
    model::clearance,
    mpc_faa::Problem,
    reference::{PlanReference, ReferenceGenerator},
    weights::{Faa, FaaDistance},
};

#[derive(Clone, Debug)]
pub struct FaaAlignment {
    faa: Faa,
    feet_below_m: f64,
}

impl FaaAlignment {
    pub fn new(faa: &Faa, drone: &DroneGeometry) -> Self {
        FaaAlignment {
            faa: *faa,
            feet_below_m: drone.feet_below_m,
        }
    }
}

impl Law for FaaAlignment {
    fn refine(
        &mut self,
        _now: Time<DroneClock>,
        _view: &View,
        _generator: &ReferenceGenerator,
        problem: &mut Problem,
        reference: &mut PlanReference,
    ) -> Option<f64> {
        if !reference.touch {
            return None;
        }
        for (k, (weight, r)) in problem.weight.iter_mut().zip(&problem.reference).enumerate() {
            let d = match (self.faa.distance, reference.deck.get(k + 1)) {
                (FaaDistance::Current, _) | (FaaDistance::PerStage, None) => reference.clearance_m,
                (FaaDistance::PerStage, Some(deck)) => {
                    let p = Vector3::new(r[0], r[1], r[2]);
                    clearance(&p, &deck.normal(), deck, self.feet_below_m)
                }
            };
            *weight = self.faa.apply(weight, d);
        }
        reference.alignment = problem.alignment();
        None
    }
}
