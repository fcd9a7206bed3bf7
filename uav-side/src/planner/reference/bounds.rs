//! Bounds on references and plans due to the water, the minimum clearance, and volumes around the deck.

use alight_shared::msg::DeckStage;
use nalgebra::Vector3;

use super::{
    super::{
        mpc_faa::{Problem, Side},
        qp::NO_CEILING,
        view::View,
    },
    PlanReference, ReferenceGenerator,
};
use crate::{
    contingency::NEAR_DECK_M,
    surroundings::{Passage, margin_m},
};

/// Distance of the plan's bound below the reference's minimum clearance, m; a plan that follows the reference does not
/// reach it.
const UNDERCUT_M: f64 = 0.2;
/// Amount by which the deck's outline is widened for the area without a minimum altitude, m.
const OUTLINE_MARGIN_M: f64 = 0.5;

impl ReferenceGenerator {
    /// Chooses the side on which the plan passes each volume.
    pub(super) fn pass(
        &self,
        view: &View,
        here: &Vector3<f64>,
        reference: &mut PlanReference,
        problem: &Problem,
    ) {
        let former = core::mem::take(&mut reference.passages);
        let (deck, last) = (&reference.deck, problem.reference.last());
        if let (Some(f), Some(now), Some(then), Some(r)) = (&view.forecast, deck.first(), deck.last(), last) {
            let there = Vector3::new(r[0], r[1], r[2]);
            let margin = margin_m(&self.drone);
            let passage = |v| Passage::of(v, margin, (now, here), (then, &there), &former);
            let volumes = f.surroundings.keep_out.iter();
            reference.passages.extend(volumes.map(passage));
        }
    }

    /// Raises references to the minimum altitude away from the deck, and above the top of a volume.
    pub(in crate::planner) fn keep_above(&self, reference: &PlanReference, problem: &mut Problem) {
        for (k, r) in problem.reference.iter_mut().enumerate() {
            let ceiling = self.ceiling(reference, k, r[0], r[1]);
            if r[2] > ceiling {
                r[2] = ceiling;
                r[8] = r[8].min(0.0);
            }
        }
    }

    /// Moves references out of volumes that the plan passes sideways, and bounds its positions.
    pub(in crate::planner) fn keep_out(&self, reference: &PlanReference, problem: &mut Problem) {
        problem.sides.clear();
        if reference.passages.is_empty() {
            return;
        }
        let stages = problem.reference.iter_mut().zip(reference.deck.iter().skip(1));
        for (stage, (r, deck)) in stages.enumerate() {
            // Leaving one volume may lead into another. Two passes suffice for two volumes; a third volume has only its
            // soft bound.
            let passages = reference.passages.iter();
            let from = problem.sides.len();
            let sides = passages.filter_map(|p| p.side(deck));
            problem.sides.extend(sides.map(|(n, offset)| Side {
                stage,
                normal: n.into(),
                offset,
            }));
            let sides = &problem.sides[from..];
            for Side {
                normal: [nx, ny, nz],
                offset,
                ..
            } in sides.iter().chain(sides)
            {
                let push = (offset - nx * r[0] - ny * r[1] - nz * r[2]).max(0.0) / (nx * nx + ny * ny);
                (r[0], r[1]) = (r[0] + push * nx, r[1] + push * ny);
            }
        }
        self.keep_above(reference, problem);
    }

    /// Soft upper bound of z: above volumes that the plan passes over and, away from the deck, above the water.
    pub fn ceiling(&self, reference: &PlanReference, stage: usize, x: f64, y: f64) -> f64 {
        let water_z = self.water_ceiling(reference, stage, x, y);
        let Some(deck) = reference.deck.get(stage + 1) else {
            return water_z;
        };
        let tops = reference.passages.iter().filter_map(|p| p.top_z(deck, x, y));
        tops.fold(water_z.min(self.deck_ceiling(reference, deck, x, y)), f64::min)
    }

    /// Bound of z due to the minimum clearance, [`NO_CEILING`] if a plan may touch: `n (p - c) - l = h` solved for the
    /// height, with the normal `n`, the deck's centre `c` and the feet's distance `l`.
    fn deck_ceiling(&self, reference: &PlanReference, deck: &DeckStage, x: f64, y: f64) -> f64 {
        let (dx, dy) = (x - deck.position[0], y - deck.position[1]);
        let near = dx.hypot(dy) < NEAR_DECK_M;
        let Some(lowest) = reference.lowest_clearance_m.filter(|_| near) else {
            return NO_CEILING;
        };
        let n = deck.normal();
        let height = lowest - UNDERCUT_M + self.drone.feet_below_m - n.x * dx - n.y * dy;
        deck.position[2] + height / n.z.min(-0.3)
    }

    /// Bound of z due to the minimum altitude above the water, [`NO_CEILING`] over the deck.
    fn water_ceiling(&self, reference: &PlanReference, stage: usize, x: f64, y: f64) -> f64 {
        if let Some(d) = reference.deck.get(stage + 1) {
            let (s, c) = d.euler[2].sin_cos();
            let (dx, dy) = (x - d.position[0], y - d.position[1]);
            let (along, across) = (c * dx + s * dy, -s * dx + c * dy);
            let m = OUTLINE_MARGIN_M;
            if along.abs() <= 0.5 * self.deck.length_m + m && across.abs() <= 0.5 * self.deck.width_m + m {
                return NO_CEILING;
            }
        }
        -reference.minimum_altitude_m
    }
}
