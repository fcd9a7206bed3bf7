//! The wave components that the predictor rolls on: the vessel's, matched from message to message,
//! or the broad default, and always one short broad component for what they leave unexplained.

use alight_shared::msg::{MAX_COMPONENTS, WaveComponent, WaveModel};
use alight_shared::time::{DroneClock, Time};
use alight_shared::vessel_model::{VesselModelConfig, WaveNonlinearity, encounter_frequency};
use nalgebra::Complex;

use super::config::PredictorConfig;

/// Degrees of freedom: north, east, down, tilt about north, about east, heading.
pub const AXES: usize = 6;
/// Most oscillators: the vessel's components and the residual one.
pub const MAX_OSCILLATORS: usize = MAX_COMPONENTS + 1;
/// An oscillator that no message has named for this long is taken out, s.
const FORGET_S: f64 = 20.0;
/// What the hull's response and the vessel's covariance leave out, as a fraction of the amplitude.
const SEED_ERROR: f64 = 0.1;
/// Frequencies this near (logarithm) belong to the same component.
const SAME_COMPONENT: f64 = 0.12;
/// From this confidence on the vessel's wave height is used: it has observed some periods.
const HEIGHT_KNOWN: f64 = 0.3;
/// A sea that is this much higher than stated is still followed.
const HEIGHT_MARGIN: f64 = 1.5;
/// The least fraction of their configured spread that own oscillators keep.
const MIN_FRACTION: f64 = 0.1;

/// One oscillator `x'' + 2 lambda omega x' + omega² x = w`, the same frequency on every axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillator {
    /// Earth-frame angular frequency, rad/s.
    pub earth_omega: f64,
    /// Direction of travel from north towards east, rad.
    pub direction: f64,
    /// Its standard deviation, rad.
    pub direction_sd: f64,
    /// Angular frequency of encounter, rad/s.
    pub omega: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Stationary standard deviation per axis, m, rad.
    pub sd: [f64; AXES],
    /// The deck's motion by this component as the vessel knows it; None for the configuration's.
    pub seed: Option<Seed>,
}

/// The deck's motion by one component at some instant, from the vessel's oscillator state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Time of validity.
    pub at: Time<DroneClock>,
    /// Value per axis, m, rad.
    pub value: [f64; AXES],
    /// Rate per axis, m/s, rad/s.
    pub rate: [f64; AXES],
    /// Variance of the value; that of the rate is `omega²` times it.
    pub variance: [f64; AXES],
}

/// What a change of the components asks of the filter's states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Oscillator `.0` has a new frequency: its rate is multiplied by `.1`.
    Rescale(usize, f64),
    /// Oscillator `.0` has become another component: its motion is kept, but uncertain.
    Renew(usize),
    /// An oscillator is new at the end.
    Append,
    /// Oscillator `.0` is taken out.
    Remove(usize),
}

/// The oscillators; the residual one is always the first.
#[derive(Clone, Debug)]
pub struct Waves {
    oscillators: Vec<Oscillator>,
    min_damping: f64,
    scale: f64,
    min_sd: [f64; AXES],
    damping_scale: f64,
    wave_state_inflation: f64,
    vessel: VesselModelConfig,
    /// Trust in the vessel's identification, 0 to 1.
    pub confidence: f64,
    /// By how much the deck's motion is more than the oscillators' sum.
    pub nonlinearity: WaveNonlinearity,
    /// The residual oscillator as configured.
    residual: Oscillator,
    /// Spread of each own oscillator as configured, m, rad.
    bank_sd: [f64; AXES],
    /// Significant wave height of all own oscillators together as configured, m.
    bank_height: f64,
    /// Spread (rad) and frequency (rad/s) of the tilt as observed.
    rocking: Option<(f64, f64)>,
    /// Spread (rad) of the residual tilt by adaptive process noise.
    adaptive_noise: f64,
}

impl Waves {
    /// The broad default of the configuration.
    pub fn new(c: &PredictorConfig) -> Self {
        let own = |omega: f64, damping: f64, sd: [f64; AXES]| Oscillator {
            earth_omega: omega,
            direction: 0.0,
            direction_sd: core::f64::consts::PI,
            omega,
            damping,
            sd,
            seed: None,
        };
        let residual = own(c.residual_omega_radps, c.residual_damping, c.residual_sd_m_rad);
        let mut oscillators = vec![residual];
        oscillators.extend(
            c.bank_omega_radps
                .iter()
                .take(MAX_COMPONENTS)
                .map(|&w| own(w, c.bank_damping, c.bank_sd_m_rad)),
        );
        let count = (oscillators.len() - 1) as f64;
        Waves {
            oscillators,
            bank_sd: c.bank_sd_m_rad,
            bank_height: 4.0 * c.bank_sd_m_rad[2] * count.sqrt(),
            min_damping: c.min_damping,
            scale: c.wave_scale,
            min_sd: c.min_wave_sd_m_rad,
            damping_scale: c.damping_scale,
            wave_state_inflation: c.wave_state_inflation,
            vessel: c.vessel.clone(),
            confidence: 0.0,
            nonlinearity: WaveNonlinearity::default(),
            residual,
            rocking: None,
            adaptive_noise: 0.0,
        }
    }

    /// The components are the vessel's.
    pub fn are_identified(&self) -> bool {
        self.oscillators.iter().any(|o| o.seed.is_some())
    }
    /// Factor on the variance of the vessel's estimates of its oscillators, for their errors persist from
    /// message to message.
    pub fn wave_state_inflation(&self) -> f64 {
        self.wave_state_inflation
    }
    /// The oscillators now.
    pub fn oscillators(&self) -> &[Oscillator] {
        &self.oscillators
    }

    /// Takes the vessel's wave model; `height` is the deck centre's above the vessel's reference
    /// point, m. What the states must follow goes to `apply`, in order.
    pub fn receive(
        &mut self,
        now: Time<DroneClock>,
        m: &WaveModel<DroneClock>,
        height: f64,
        mut apply: impl FnMut(Change, &[Oscillator]),
    ) {
        self.confidence = f64::from(m.confidence).clamp(0.0, 1.0);
        self.nonlinearity = WaveNonlinearity {
            wave_following_deficit: f64::from(m.wave_following_deficit).clamp(0.0, 1.0),
            crest_steepening: f64::from(m.crest_steepening).clamp(0.0, 1.0),
        };
        self.follow_rocking(&mut apply);
        self.follow_height(f64::from(m.significant_height_m), &mut apply);
        let mut taken = [false; MAX_OSCILLATORS];
        if let Some(t) = taken.first_mut() {
            *t = true; // The residual oscillator belongs to nobody.
        }
        let mut unmatched = Vec::with_capacity(MAX_COMPONENTS);
        for c in m.components.iter() {
            let new = self.oscillator_of(m.header.at, c, height);
            let nearest = self
                .oscillators
                .iter()
                .enumerate()
                .filter(|(i, _)| !taken.get(*i).copied().unwrap_or(true))
                .map(|(i, o)| (i, (o.earth_omega / new.earth_omega).ln().abs()))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            match nearest {
                Some((i, distance)) if distance < SAME_COMPONENT => {
                    if let (Some(t), Some(o)) = (taken.get_mut(i), self.oscillators.get_mut(i)) {
                        *t = true;
                        let ratio = new.omega / o.omega;
                        *o = new;
                        apply(Change::Rescale(i, ratio), &self.oscillators);
                    }
                }
                _ => unmatched.push(new),
            }
        }
        for new in unmatched {
            let free = (0..self.oscillators.len()).find(|i| !taken.get(*i).copied().unwrap_or(true));
            // An own oscillator is replaced at once; one of an earlier message is kept, too.
            let room = self.oscillators.len() < MAX_OSCILLATORS;
            match free {
                Some(i) if !room || self.oscillators.get(i).is_some_and(|o| o.seed.is_none()) => {
                    if let (Some(t), Some(o)) = (taken.get_mut(i), self.oscillators.get_mut(i)) {
                        *t = true;
                        let ratio = new.omega / o.omega;
                        *o = new;
                        apply(Change::Rescale(i, ratio), &self.oscillators);
                        apply(Change::Renew(i), &self.oscillators);
                    }
                }
                _ if room => {
                    if let Some(t) = taken.get_mut(self.oscillators.len()) {
                        *t = true;
                    }
                    self.oscillators.push(new);
                    apply(Change::Append, &self.oscillators);
                }
                _ => {}
            }
        }
        // Those that nobody names any more are taken out, the default's at the first message.
        for i in (1..self.oscillators.len()).rev() {
            let gone = self.oscillators.get(i).is_some_and(|o| match o.seed {
                Some(seed) => (now - seed.at).secs() > FORGET_S,
                None => !m.components.is_empty(),
            });
            if gone {
                self.oscillators.remove(i);
                apply(Change::Remove(i), &self.oscillators);
            }
        }
    }

    /// How the deck rocks, from the vessel's estimates.
    pub fn observe(&mut self, rocking: Option<(f64, f64)>) {
        self.rocking = rocking.or(self.rocking);
    }

    /// Sets the spread (rad) of the residual tilt by adaptive process noise.
    pub fn set_adaptive_noise(&mut self, sd: f64) {
        self.adaptive_noise = sd;
    }

    /// The fraction of the tilt that the identification does not explain goes to the residual oscillator,
    /// at the frequency with which the deck rocks; so does the adaptive process noise.
    fn follow_rocking(&mut self, apply: &mut impl FnMut(Change, &[Oscillator])) {
        let (sd, omega) = self.rocking.unwrap_or((0.0, self.residual.omega));
        let unexplained = 1.0 - self.confidence;
        let mut wanted = self.residual;
        wanted.omega += unexplained * (omega - wanted.omega);
        wanted.earth_omega = wanted.omega;
        for axis in [3, 4] {
            wanted.sd[axis] = wanted.sd[axis].max(unexplained * sd).max(self.adaptive_noise);
        }
        let Some(o) = self.oscillators.first_mut() else {
            return;
        };
        let ratio = wanted.omega / o.omega;
        let grown = (wanted.sd[3] / o.sd[3]).ln().abs();
        // Every change costs new transitions; a few per cent are not worth them.
        if (ratio - 1.0).abs() > 0.05 || grown > 0.1 {
            *o = wanted;
            apply(Change::Rescale(0, ratio), &self.oscillators);
        }
    }

    /// Own oscillators move the deck no more than the height of the sea allows: on flat water five
    /// oscillators of the configured spread would fit the noise of a vessel under way as waves.
    fn follow_height(&mut self, height: f64, apply: &mut impl FnMut(Change, &[Oscillator])) {
        if !(self.confidence >= HEIGHT_KNOWN && height >= 0.0 && self.bank_height > 0.0) {
            return;
        }
        let fraction = (HEIGHT_MARGIN * height / self.bank_height).clamp(MIN_FRACTION, 1.0);
        for i in 1..self.oscillators.len() {
            let Some(o) = self.oscillators.get_mut(i) else {
                return;
            };
            let wanted = self.bank_sd.map(|sd| fraction * sd);
            // Every change costs new transitions; a few per cent are not worth them.
            if o.seed.is_none() && (wanted[2] / o.sd[2]).ln().abs() > 0.1 {
                o.sd = wanted;
                apply(Change::Rescale(i, 1.0), &self.oscillators);
            }
        }
    }

    /// Frequencies of encounter at the mean velocity (north, east, m/s).
    pub fn update_encounter(&mut self, mean_velocity: [f64; 2], mut apply: impl FnMut(Change)) {
        for (i, o) in self.oscillators.iter_mut().enumerate().skip(1) {
            if o.direction_sd < 1.0 {
                let omega = encounter_frequency(o.earth_omega, o.direction, mean_velocity);
                let ratio = omega / o.omega;
                if (ratio - 1.0).abs() > 0.005 {
                    o.omega = omega;
                    apply(Change::Rescale(i, ratio));
                }
            }
        }
    }

    fn oscillator_of(&self, at: Time<DroneClock>, c: &WaveComponent, height: f64) -> Oscillator {
        let omega = f64::from(c.omega_encounter);
        let stated = f64::from(c.damping).max(1e-4);
        // Stationary spread of the vessel's oscillator, and no less than its present amplitude.
        let spread = |dof: usize| {
            let q = c.drive.get(dof).copied().map_or(0.0, f64::from);
            let stationary = q / (4.0 * stated * omega.powi(3));
            let [v, r] = c.state.get(dof).copied().unwrap_or_default().map(f64::from);
            let present = 0.5 * (v * v + (r / omega).powi(2));
            stationary.max(present).sqrt()
        };
        let mut tilt = spread(3).hypot(spread(4)) / 2f64.sqrt();
        // A broad default holds no information on this deck; its tilt is no more than was observed, and its
        // phase lasts no longer than the vessel states.
        let broad = self.confidence < 0.5;
        if let Some((sd, _)) = self.rocking.filter(|_| broad) {
            tilt = tilt.min(sd / self.scale);
        }
        let damping_scale = if broad {
            self.damping_scale.max(1.0)
        } else {
            self.damping_scale
        };
        // Surge, sway and yaw are accelerations: a / omega² is their displacement. The deck is
        // above the reference point and so moves with the tilt.
        let orbital = spread(0).hypot(spread(1)) / 2f64.sqrt() / (omega * omega);
        let across = orbital.hypot(height * tilt);
        let raw = [across, across, spread(2), tilt, tilt, spread(5) / (omega * omega)];
        Oscillator {
            earth_omega: f64::from(c.omega),
            direction: f64::from(c.direction),
            direction_sd: f64::from(c.direction_sd),
            omega,
            damping: (damping_scale * stated).clamp(self.min_damping, 0.9),
            sd: core::array::from_fn(|i| {
                let limit = [5.0, 5.0, 5.0, 0.5, 0.5, 0.5];
                (self.scale * raw[i]).clamp(self.min_sd[i], limit[i])
            }),
            seed: Some(self.seed(at, c, height)),
        }
    }

    /// The deck's motion from the vessel's oscillators, which are what drives the hull (module
    /// `vessel_model`): `eta = K / (K - omega² + i omega D) w` where there is stiffness, else
    /// `eta = w / (-omega² + i omega D)`, with K and D per unit of inertia.
    fn seed(&self, at: Time<DroneClock>, c: &WaveComponent, height: f64) -> Seed {
        let omega = f64::from(c.omega_encounter);
        let v = &self.vessel;
        let response = |i: usize| {
            let (m, d, g) = (
                v.inertia_kg_kgm2[i],
                v.damping_npmps_nmpradps[i],
                v.stiffness_npm_nmprad[i],
            );
            let below = Complex::new(g / m - omega * omega, omega * d / m);
            Complex::new(if g > 0.0 { g / m } else { 1.0 }, 0.0) / below
        };
        let eta: [Complex<f64>; AXES] = core::array::from_fn(|i| {
            let [value, rate] = c.state[i].map(f64::from);
            response(i) * Complex::new(value, -rate / omega)
        });
        // The deck is `height` above the reference point: bow up moves it aft, starboard down to
        // starboard.
        let deck = [
            eta[0] - eta[4] * height,
            eta[1] + eta[3] * height,
            eta[2],
            eta[3],
            eta[4],
            eta[5],
        ];
        let own = |i: usize| f64::from(c.covariance[i][0]) * response(i).norm_sqr();
        let lever = height * height;
        let stated = [
            own(0) + lever * own(4),
            own(1) + lever * own(3),
            own(2),
            own(3),
            own(4),
            own(5),
        ];
        Seed {
            at,
            value: deck.map(|d| d.re),
            rate: deck.map(|d| -omega * d.im),
            variance: core::array::from_fn(|i| {
                stated[i] + deck[i].norm_sqr() * SEED_ERROR.powi(2) + self.min_sd[i].powi(2)
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use alight_shared::msg::Seq;

    fn model(omegas: &[f32]) -> WaveModel<DroneClock> {
        WaveModel {
            header: Header::default(),
            significant_height_m: 1.0,
            confidence: 1.0,
            wave_following_deficit: 0.0,
            crest_steepening: 0.0,
            components: Seq::filled(omegas.iter().map(|&w| WaveComponent {
                omega: w,
                omega_encounter: w,
                direction_sd: 0.1,
                damping: 0.01,
                ..Default::default()
            })),
            slopes: Seq::new(),
        }
    }

    #[test]
    fn waves_match_components_from_message_to_message() {
        let mut w = Waves::new(&PredictorConfig::default());
        let mut size = w.oscillators().len();
        let mut follow = |c: Change, all: &[Oscillator]| {
            match c {
                Change::Append => size += 1,
                Change::Remove(_) => size -= 1,
                Change::Rescale(..) | Change::Renew(_) => {}
            }
            assert_eq!(size, all.len());
        };
        let at = |s: f64| Time::from_secs(s);
        w.receive(at(0.0), &model(&[1.2, 1.05, 1.4]), 1.3, &mut follow);
        assert_eq!(w.oscillators().len(), 4, "residual and three");
        let before: Vec<f64> = w.oscillators().iter().map(|o| o.omega).collect();
        // Another order, slightly other frequencies.
        w.receive(at(0.2), &model(&[1.41, 1.19, 1.06]), 1.3, &mut follow);
        for (a, b) in before.iter().zip(w.oscillators()) {
            assert!((a / b.omega - 1.0).abs() < 0.02);
        }
        // One vanishes for good.
        let mut later = model(&[1.4, 1.2]);
        later.header.at = at(30.0);
        w.receive(at(30.0), &later, 1.3, &mut follow);
        assert_eq!(w.oscillators().len(), 3);
    }

    #[test]
    fn residual_oscillator_rocks_as_observed_where_no_component_explains_it() {
        let mut w = Waves::new(&PredictorConfig::default());
        let configured = w.oscillators()[0];
        w.observe(Some((0.06, 7.0)));
        let mut m = model(&[1.0]);
        w.receive(Time::from_secs(0.0), &m, 1.3, |_, _| {});
        assert_eq!(w.oscillators()[0], configured, "all is explained");
        m.confidence = 0.0;
        m.components = Seq::filled([WaveComponent {
            omega: 2.5,
            omega_encounter: 2.5,
            direction_sd: core::f32::consts::PI,
            damping: 0.1,
            drive: [1.0; 6],
            ..Default::default()
        }]);
        let mut rescaled = 0;
        w.receive(Time::from_secs(0.2), &m, 1.3, |c, _| {
            rescaled += u32::from(matches!(c, Change::Rescale(0, r) if r > 1.5));
        });
        assert_eq!(rescaled, 1);
        let residual = w.oscillators()[0];
        assert!((residual.omega - 7.0).abs() < 1e-9 && (residual.sd[3] - 0.06).abs() < 1e-9);
        let broad = w.oscillators().last().unwrap();
        assert!(broad.sd[3] <= 0.06 + 1e-9 && broad.damping >= 0.1);
    }

    #[test]
    fn waves_replace_a_full_set_of_components() {
        let mut w = Waves::new(&PredictorConfig::default());
        w.receive(
            Time::from_secs(0.0),
            &model(&[0.5, 0.6, 0.75, 0.9, 1.1, 1.4]),
            1.3,
            |_, _| {},
        );
        w.receive(
            Time::from_secs(1.0),
            &model(&[2.0, 2.4, 3.0, 3.6, 4.5, 5.5]),
            1.3,
            |_, _| {},
        );
        assert_eq!(w.oscillators().len(), MAX_OSCILLATORS);
        assert!(w.oscillators().iter().all(|o| o.omega >= 2.0));
    }
}
