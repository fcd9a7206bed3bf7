//! The identified sea in the model.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::MAX_COMPONENTS;
use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::{
    Component, HEAVE, PITCH, ROLL, SURGE, SWAY, Term, VesselModel, encounter_frequency,
};

use nalgebra::Vector2;

use super::Filter;
use crate::VesselNodeConfig;
use crate::sea_state::{SeaComponent, SeaState, Verdict};

/// Shortest time between two rebuilds of the model, s.
const REST_S: f64 = 0.5;
/// Shift of a frequency of encounter that calls for a rebuild, relative.
const SHIFT: f64 = 0.002;
/// Time in which a shift is forgotten, in updates of the identification (1 s each).
const SHIFT_MEMORY_S: f64 = 10.0;
/// Shift above which the phases are re-initialised from the identification.
const MAX_SHIFT: f64 = 0.05;
/// Largest change of the mean velocity of a drifting vessel between two states of the identification, m/s.
const CHANGE_MPS: f64 = 0.5;
/// Change of an amplitude that calls for a rebuild, relative.
const GROWTH: f64 = 0.25;

/// Fraction of a component's process noise for its tilt at small slope, and slope (rad) at which 1 is added: the
/// linear model's error in tilt is of second order in the slope (Stokes 1847), where heave follows it closely (ours,
/// tuned at 0.5 m, 5 s and 0.8 m, 5 s).
const TILT_NOISE: (f64, f64) = (0.5, 1.0 / 16.0);

/// From this wave-following deficit on, the bound waves explain the harmonics (ours; seeds 300-319 at 0.8 m, 5 s: roll
/// 1 s ahead is wrong by 0.019 rad without the oscillator, 0.022 with).
const BOUND_DEFICIT: f64 = 0.3;
/// The same for crest steepening.
const BOUND_STEEPENING: f64 = 0.5;

/// What the estimator knows of the sea.
#[derive(Clone, Debug, Default)]
pub(crate) struct SeaView {
    /// Significant wave height, m.
    pub(crate) significant_height_m: f64,
    /// 0 with the broad default, up to 1.
    pub(crate) confidence: f64,
    pub(super) identified: bool,
    built: Option<Time<VesselClock>>,
    taken: Option<Time<VesselClock>>,
    components: Vec<Component>,
    /// The newest identification.
    pub(super) state: Option<SeaState>,
    /// Shift of the frequencies of encounter since the phases were certain, relative, fading.
    encounter_shift: f64,
}

/// Component of the model from an identified one, in the frame at the `reference` heading.
fn component(sea: &SeaComponent, damping: f64, reference: f64, mean_velocity: [f64; 2]) -> Component {
    let mut c = Component {
        omega: sea.omega,
        direction: sea.direction,
        direction_sd: sea.direction_sd,
        omega_encounter: sea.omega,
        damping,
        drive: [0.0; 6],
    };
    c.update_encounter(mean_velocity);
    // Standard deviations of the oscillators; a tenth goes across the direction of travel, for the
    // direction is not exact and the hull is not round.
    let half = core::f64::consts::FRAC_1_SQRT_2;
    let (s, k) = (sea.direction - reference).sin_cos();
    let (along, across) = ((0.1 + 0.9 * k * k).sqrt(), (0.1 + 0.9 * s * s).sqrt());
    let heave = half * sea.amplitude_heave_m.max(0.01);
    let tilt = half * sea.amplitude_tilt_rad.max(2e-3);
    // Deep water: the orbital acceleration is omega² times the amplitude.
    let orbital = heave * sea.omega * sea.omega;
    let o2 = c.omega_encounter * c.omega_encounter;
    let sd = [
        along * orbital,
        across * orbital,
        heave,
        across * tilt,
        along * tilt,
        0.1 * tilt * o2,
    ];
    c.drive = sd.map(|v| Component::drive_for(c.omega_encounter, damping, v));
    let (fraction, slope) = TILT_NOISE;
    let fraction = fraction + (sea.amplitude_tilt_rad / slope).powi(2);
    for dof in [ROLL, PITCH] {
        c.drive[dof] *= fraction;
    }
    c
}

/// The second harmonic of a steep sea: crests are sharper than troughs, so the deck's tilt holds
/// twice and summed frequencies of the components (Stokes 1847), bound to them. One broad oscillator
/// at twice their mean frequency of encounter represents all, where a slot is free and the identification has not
/// found any itself.
fn harmonic(waves: &[Component], config: &VesselNodeConfig) -> Option<Component> {
    let tilt = |c: &Component| c.stationary_sd(PITCH).hypot(c.stationary_sd(ROLL));
    let power: f64 = waves.iter().map(|c| tilt(c).powi(2)).sum();
    if waves.len() >= MAX_COMPONENTS || !(power > 0.0) {
        return None;
    }
    let mean = waves
        .iter()
        .map(|c| tilt(c).powi(2) * c.omega_encounter)
        .sum::<f64>()
        / power;
    let (omega, damping) = (2.0 * mean, config.model.bank_damping);
    if waves
        .iter()
        .any(|c| (c.omega_encounter / omega).ln().abs() < 0.25)
    {
        return None;
    }
    // Second order in the slope.
    let sd = power.sqrt() * power.sqrt();
    let sd = sd.clamp(2e-4, 0.05);
    let heave = 0.5 * sd * GRAVITY / (omega * omega);
    Some(Component {
        omega,
        direction: 0.0,
        // No free wave: it has no direction, its frequency follows the others'.
        direction_sd: core::f64::consts::PI,
        omega_encounter: omega,
        damping,
        drive: [sd * 2.0, sd * 2.0, heave, sd, sd, sd].map(|v| Component::drive_for(omega, damping, v)),
    })
}

impl Filter {
    /// Updates the model with a new identification and with the vessel's own velocity.
    pub(super) fn take_sea(&mut self, config: &VesselNodeConfig, state: Option<&SeaState>) {
        let rested = self.sea.built.is_none_or(|t| (self.at - t).secs() >= REST_S);
        if !rested {
            return;
        }
        let Some(state) = state else { return };
        let velocity = self.encounter_velocity(state);
        let news = self.sea.taken != Some(state.at);
        if news {
            self.sea.taken = Some(state.at);
            self.sea.significant_height_m = state.significant_height_m;
        }
        if news {
            self.bound_waves.update_encounter(state);
            self.sea.state = Some(state.clone());
            self.reassign_bound_waves();
            self.sea.encounter_shift *= (-1.0_f64 / SHIFT_MEMORY_S).exp();
        }
        if news && self.sea.identified && self.sea.encounter_shift > MAX_SHIFT {
            self.reinitialise_phases(state);
        }
        match state.verdict {
            Verdict::Broad => {
                if news {
                    self.sea.confidence = 0.0;
                    if self.sea.identified {
                        self.sea.identified = false;
                        self.prediction_scale.forget();
                        self.sea.components.clear();
                        self.sea.built = Some(self.at);
                        let adapted = self.adaptive_noise.adapted(&config.model);
                        self.set_model(config, VesselModel::with_bank(&adapted));
                    }
                }
            }
            Verdict::Calm | Verdict::Identified => {
                self.sea.confidence = state.confidence;
                let mut wanted: Vec<Component> = state
                    .components
                    .iter()
                    .map(|c| component(c, config.model.wave_damping, self.reference, velocity))
                    .collect();
                // Bound waves include the harmonics.
                if self.bound_waves.wave_following_deficit() < BOUND_DEFICIT
                    && self.bound_waves.nonlinearity().crest_steepening < BOUND_STEEPENING
                {
                    wanted.extend(harmonic(&wanted, config));
                }
                if self.sea.identified && !differs(&wanted, &self.sea.components) {
                    return;
                }
                // A turn moves all frequencies of encounter; what has moved fades with 10 s.
                let moved = wanted
                    .iter()
                    .filter_map(|w| {
                        self.sea
                            .components
                            .iter()
                            .map(|h| (w.omega_encounter / h.omega_encounter).ln().abs())
                            .reduce(f64::min)
                    })
                    .fold(0.0, f64::max);
                self.sea.encounter_shift += moved;
                let first = !self.sea.identified;
                if first {
                    self.prediction_scale.forget();
                }
                let old = core::mem::take(&mut self.sea.components);
                self.sea.identified = true;
                self.sea.built = Some(self.at);
                let adapted = self.adaptive_noise.adapted(&config.model);
                self.set_model(config, VesselModel::new(&adapted, &wanted));
                for (j, c) in wanted.iter().enumerate() {
                    let known = old
                        .iter()
                        .any(|o| (o.omega_encounter / c.omega_encounter).ln().abs() < 0.05);
                    if let Some(s) = state.components.get(j)
                        && (first || !known)
                    {
                        self.seed(j, s, c, state.at);
                    }
                }
                self.sea.components = wanted;
            }
        }
    }

    /// Mean velocity for the frequencies of encounter: under way the filter's own, which follows a
    /// helmsman at once; adrift the identification's, which has no wave in it, moved on by what the
    /// filter's own has changed since, for most of that is orbital motion.
    pub(super) fn encounter_velocity(&self, state: &SeaState) -> [f64; 2] {
        let known = Vector2::from(state.mean_velocity);
        if !state.adrift {
            return self.mean_velocity.into();
        }
        let change = self.mean_velocity - known;
        let most = (CHANGE_MPS / change.norm().max(1e-9)).min(1.0);
        (known + change * most).into()
    }

    /// After a turn the filter's phases are uncertain, those of the identification are not: it fits the last minute
    /// along the vessel's path in the earth frame. Its phasors are fused as measurements with a standard deviation of
    /// a fifth of the amplitude (ours).
    fn reinitialise_phases(&mut self, state: &SeaState) {
        let layout = self.belief.layout().clone();
        for c in state.components.iter() {
            let o = encounter_frequency(c.omega, c.direction, self.encounter_velocity(state));
            let Some(j) = self
                .belief
                .components()
                .iter()
                .position(|h| (h.omega / c.omega).ln().abs() < 0.01)
            else {
                continue;
            };
            for (dof, [value, rate], amplitude) in self.phasor_states(c, o, state.at) {
                let slot = layout.value(dof, j);
                for (slot, z, sd) in [
                    (slot, value, 0.2 * amplitude),
                    (slot + 1, rate, 0.2 * amplitude * o),
                ] {
                    let innovation = z - self.belief.get(dof, slot);
                    self.belief
                        .update(&[Term::new(dof, slot, 1.0)], innovation, sd * sd, f64::INFINITY);
                }
            }
        }
    }

    /// (degree of freedom, [value, rate], amplitude) of a component's oscillators from its phasors.
    fn phasor_states(
        &self,
        sea: &SeaComponent,
        omega: f64,
        at: Time<VesselClock>,
    ) -> [(usize, [f64; 2], f64); 3] {
        let later = (self.at - at).secs();
        let (s, k) = (omega * later).sin_cos();
        // Re(q) and its derivative Re(i omega q).
        let now = |p: nalgebra::Complex<f64>| {
            let q = p * nalgebra::Complex::new(k, s);
            [q.re, -omega * q.im]
        };
        let (heave, north, east) = (now(sea.heave), now(sea.normal[0]), now(sea.normal[1]));
        // Upward normal at small tilt: north = -pitch, east = roll of a vessel that heads north.
        let (sin, cos) = self.reference.sin_cos();
        let tilt = sea.amplitude_tilt_rad.max(2e-3);
        let part = |f: &dyn Fn(usize) -> f64| [f(0), f(1)];
        [
            (HEAVE, part(&|i| -heave[i]), sea.amplitude_heave_m.max(0.01)),
            (ROLL, part(&|i| cos * east[i] - sin * north[i]), tilt),
            (PITCH, part(&|i| -sin * east[i] - cos * north[i]), tilt),
        ]
    }

    /// Starts the heave, roll and pitch oscillators of component `j` from the identified phasors.
    fn seed(&mut self, j: usize, sea: &SeaComponent, c: &Component, at: Time<VesselClock>) {
        let o = c.omega_encounter;
        let layout = self.belief.layout().clone();
        for (dof, [value, rate], amplitude) in self.phasor_states(sea, o, at) {
            let slot = layout.value(dof, j);
            // Ours: a fifth of the amplitude for what the identification may be wrong by.
            let sd = 0.2 * amplitude;
            self.belief.set(dof, slot, value);
            self.belief.set(dof, slot + 1, rate);
            self.belief.set_pair(dof, slot, [sd * sd, 0.0, (sd * o).powi(2)]);
        }
        for dof in [SURGE, SWAY] {
            let sd = c.stationary_sd(dof);
            for (part, scale) in [(0, 1.0), (1, o)] {
                let slot = layout.value(dof, j) + part;
                self.belief.set(dof, slot, 0.0);
                self.belief.set_variance(dof, slot, (sd * scale).powi(2));
            }
        }
    }
}

/// The model is no longer the one wanted.
fn differs(wanted: &[Component], have: &[Component]) -> bool {
    wanted.len() != have.len()
        || wanted.iter().zip(have).any(|(w, h)| {
            let shift = (w.omega_encounter / h.omega_encounter - 1.0).abs();
            let heave = w.stationary_sd(HEAVE) / h.stationary_sd(HEAVE).max(1e-9);
            let tilt = w.stationary_sd(PITCH).hypot(w.stationary_sd(ROLL))
                / h.stationary_sd(PITCH).hypot(h.stationary_sd(ROLL)).max(1e-9);
            shift > SHIFT || (heave.ln().abs() > GROWTH) || (tilt.ln().abs() > GROWTH)
        })
}
