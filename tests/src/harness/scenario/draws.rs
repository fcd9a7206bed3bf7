//! Parameter errors of the nodes' configurations (data sheets, tape measures): each seed draws true values
//! around those of the scenario; the nodes keep the scenario's values.
//!
//! Mass, thrust, lever arms, misalignment, biases and the camera's mount have separate keys. Each parameter
//! has its own random stream `draws/<name>`, so that adding a parameter does not change the others.

use alight_shared::config;

use super::{NodeConfigs, Scenario};
use crate::{physics::streams::Streams, sensors::noise::Noise};

config! {
    /// Differences between the simulated world and the nodes' configurations.
    pub struct DrawConfig {
        /// Draw true parameters; if false, the world has the scenario's values.
        pub on: bool = false;
        /// Maximum ratio of the true to the stated noise of every sensor; drawn log-uniformly between its
        /// inverse and itself.
        /// Chosen: data sheets state typical values; vibration, sky view and mounting change them by about half.
        pub noise_ratio: f64 = 1.5, in 1.0..=10.0;
        /// Bound of the relative error of the drone's moments of inertia, per axis.
        /// Chosen: a bifilar pendulum is accurate to a few per cent, a sum over parts to 10 or 20 per cent.
        pub inertia_error: f64 = 0.15, in 0.0..=0.8;
        /// Bound of the relative error of the drone's drag.
        /// Chosen: covers flights with and without payload, and propellers of another make.
        pub drag_error: f64 = 0.4, in 0.0..=0.9;
        /// Range of the attitude lag after a tilt set-point, relative to the nominal lag.
        /// Source: PX4 0.10 s with a gain of 10 to 12, 0.16 s with its default gain of 6.5; nominal 0.10 s.
        pub attitude_lag_factor: [f64; 2] = [0.9, 1.6], in 0.3..=3.0;
        /// Bound of the relative error of the friction between feet and deck.
        /// Chosen: difference between wet and dry, for one kind of paint and rubber.
        pub friction_error: f64 = 0.25, in 0.0..=0.9;
        /// Standard deviation of each tag's position relative to the printed layout, per axis, m.
        /// Chosen: sheets placed along printed lines.
        pub tag_place_sd_m: f64 = 0.002, in 0.0..=0.1;
        /// Standard deviation of the position of the deck's centre and tags relative to the measured one, per axis, m.
        /// Chosen: measured with a tape over a boat's length.
        pub deck_sd_m: f64 = 0.015, in 0.0..=0.5;
        /// Bound of the relative error of the tag's side.
        /// Chosen: scaling error of a printer.
        pub tag_error: f64 = 0.004, in 0.0..=0.2;
        /// Bound of the relative error of the autopilot's initial hover thrust.
        /// Source: PX4's MPC_THR_HOVER is set by hand; battery and payload change the true value.
        pub hover_thrust_error: f64 = 0.2, in 0.0..=0.5;
        /// Bound of the relative error of the simulated hull's mass and inertia.
        /// Chosen: variation of crew, fuel and payload on a boat of 200 kg.
        pub hull_mass_error: f64 = 0.15, in 0.0..=0.5;
        /// Bound of the relative error of the simulated hull's added mass and damping.
        /// Chosen: disagreement between model tests and strip theory in roll.
        pub hull_damping_error: f64 = 0.3, in 0.0..=0.8;
        /// Bound of the relative errors of the twin hulls' radius and spacing, which determine the stiffness.
        pub hull_shape_error: f64 = 0.04, in 0.0..=0.2;
    }
    check |this, at| {
        at.require(
            this.attitude_lag_factor[0] <= this.attitude_lag_factor[1],
            "attitude_lag_factor",
            format!("{:?}", this.attitude_lag_factor),
            "lower bound first",
        )?;
    }
}

struct Draws<'a>(&'a Streams);

impl Draws<'_> {
    fn noise(&self, name: &str) -> Noise {
        Noise::new(self.0, &format!("draws/{name}"))
    }
    fn between(&self, name: &str, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.noise(name).uniform()
    }
    /// Multiplies `value` by a factor within 1 ± `error`.
    fn vary(&self, name: &str, value: &mut f64, error: f64) {
        *value *= self.between(name, [1.0 - error, 1.0 + error]);
    }
    fn vary_each(&self, name: &str, values: &mut [f64], error: f64) {
        let mut noise = self.noise(name);
        for v in values {
            *v *= 1.0 + error * (2.0 * noise.uniform() - 1.0);
        }
    }
    /// `ratio` to a power drawn between -1 and 1.
    fn factor(&self, name: &str, ratio: f64) -> f64 {
        ratio.powf(self.between(name, [-1.0, 1.0]))
    }
}

impl Scenario {
    /// Enables the draws: true parameters differ from the nodes' parameters. A GNSS mast inside the deck's
    /// outline moves aft of the deck, in the world and in the vessel's configuration.
    pub fn differ_from_belief(&mut self, nodes: &mut NodeConfigs) {
        self.draws.on = true;
        let deck = &self.deck;
        let antenna = &mut self.sensors.vessel_gnss.antenna_m;
        let [ahead, right] = [0, 1].map(|i| antenna[i] - deck.centre_m[i]);
        if ahead.abs() < 0.5 * deck.length_m && right.abs() < 0.5 * deck.width_m {
            antenna[0] = deck.centre_m[0] - 0.5 * deck.length_m - MAST_CLEARANCE_M;
            nodes.vessel.gnss.antenna_m = *antenna;
        }
    }

    /// The true scenario of `seed`. A scenario that is already drawn is returned unchanged.
    pub fn drawn(&self, seed: impl Into<Streams>) -> Scenario {
        self.drawn_from(&seed.into())
    }
    fn drawn_from(&self, streams: &Streams) -> Scenario {
        let mut world = self.clone();
        if !self.draws.on {
            return world;
        }
        world.draws.on = false;
        let c = &self.draws;
        let draws = Draws(streams);
        world.draw_sensors(c, &draws);
        world.draw_drone(c, &draws);
        world.draw_hull(c, &draws);
        let mut place = draws.noise("deck");
        let mut moved = || [0, 1, 2].map(|_| c.deck_sd_m * place.normal());
        let add = |to: &mut [f64; 3], by: [f64; 3]| (0..3).for_each(|i| to[i] += by[i]);
        add(&mut world.deck.centre_m, moved());
        world.draw_tags(c, &draws, moved());
        world
    }

    /// Shifts all tags by `moved` and each tag by a small random offset; scales them relative to the nodes' size.
    fn draw_tags(&mut self, c: &DrawConfig, draws: &Draws<'_>, moved: [f64; 3]) {
        let mut scale = 1.0;
        let mut place = draws.noise("tag-place");
        draws.vary("tag-side", &mut scale, c.tag_error);
        let mut tags = self.deck.tags();
        self.sensors.tag.known = tags;
        let several = tags.len() > 1;
        for tag in tags.iter_mut() {
            tag.side_m *= scale;
            for i in 0..2 {
                let own = if several {
                    c.tag_place_sd_m * place.normal()
                } else {
                    0.0
                };
                tag.centre_m[i] += moved[i] + own;
            }
        }
        self.deck = self.deck.with_tags(&tags);
    }

    fn draw_sensors(&mut self, c: &DrawConfig, draws: &Draws<'_>) {
        let factor = |name: &str| draws.factor(name, c.noise_ratio);
        let s = &mut self.sensors;
        s.vessel_imu.gyro_white_sd_radps *= factor("vessel-gyro");
        s.vessel_imu.gyro_bias_sd_radps *= factor("vessel-gyro-bias");
        s.vessel_imu.accelerometer_white_sd_mps2 *= factor("vessel-accelerometer");
        s.vessel_imu.accelerometer_bias_sd_mps2 *= factor("vessel-accelerometer-bias");
        // Receivers and compasses report their data sheet's accuracy.
        let white = factor("vessel-gnss");
        s.vessel_gnss.error.white_sd_m *= white;
        s.vessel_gnss.error.velocity_sd_mps *= white;
        s.vessel_gnss.stated_factor /= white;
        s.vessel_gnss.error.bias_sd_m *= factor("vessel-gnss-bias");
        let heading = factor("vessel-heading");
        s.vessel_heading.white_sd_deg *= heading;
        s.vessel_heading.bias_sd_deg *= heading;
        s.vessel_heading.stated_factor /= heading;
        let tag = factor("tag");
        s.tag.corner_sd_px *= tag;
        s.tag.small_sd_px *= tag;
        s.tag.blur_sd *= tag;
        let uvdar = factor("uvdar");
        s.uvdar.bearing_sd_deg *= uvdar;
        s.uvdar.distance_sd *= uvdar;
        s.rangefinder.white_sd_m *= factor("rangefinder");
        let n = &mut self.drone.navigation;
        n.gnss_noise_m *= factor("drone-gnss");
        n.gnss_bias_m *= factor("drone-gnss-bias");
        n.gyro_noise_rps *= factor("drone-gyro");
        n.vibration_mps2 *= factor("drone-vibration");
        n.tilt_error_deg *= factor("drone-tilt");
        n.heading_error_deg *= factor("drone-heading");
    }

    fn draw_drone(&mut self, c: &DrawConfig, draws: &Draws<'_>) {
        draws.vary_each("inertia", &mut self.airframe.inertia_kgm2, c.inertia_error);
        let airframe = &mut self.drone.airframe;
        draws.vary("drag", &mut airframe.drag_n_per_mps2, c.drag_error);
        draws.vary("drag", &mut airframe.parked_drag_n_per_mps2, c.drag_error);
        draws.vary("friction", &mut self.drone.contact.friction, c.friction_error);
        let autopilot = &mut self.drone.autopilot;
        let lag_s = autopilot.attitude_lag_s() * draws.between("attitude-lag", c.attitude_lag_factor);
        autopilot.attitude_lag_s = Some(lag_s);
        draws.vary(
            "hover-thrust",
            &mut autopilot.initial_hover_factor,
            c.hover_thrust_error,
        );
    }

    fn draw_hull(&mut self, c: &DrawConfig, draws: &Draws<'_>) {
        let v = &mut self.vessel;
        draws.vary("hull-mass", &mut v.mass_kg, c.hull_mass_error);
        draws.vary_each("hull-inertia", &mut v.inertia_kgm2, c.hull_mass_error);
        draws.vary_each("hull-added-mass", &mut v.added_mass, c.hull_damping_error);
        draws.vary_each("hull-damping", &mut v.damping_ratio, c.hull_damping_error);
        draws.vary_each("hull-drag", &mut v.linear_drag_nspm, c.hull_damping_error);
        draws.vary_each("hull-drag-2", &mut v.quadratic_drag_ns2pm2, c.hull_damping_error);
        draws.vary("hull-radius", &mut v.hull_radius_m, c.hull_shape_error);
        draws.vary("hull-offset", &mut v.hull_offset_m, c.hull_shape_error);
    }
}

/// Distance from the deck's edge to the mast, m.
const MAST_CLEARANCE_M: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::config::{Check, Keys};

    #[test]
    fn draws_off_and_drawn() {
        let plain = Scenario::default();
        assert_eq!(plain.drawn(3), plain);
        let mut varied = Scenario::default();
        let mut nodes = NodeConfigs::default();
        varied.differ_from_belief(&mut nodes);
        let world = varied.drawn(3);
        assert_eq!(world.drawn(7), world);
        assert_eq!(varied.drawn(3), world);
        assert_ne!(varied.drawn(4), world);
    }

    #[test]
    fn mast_clear_of_the_deck() {
        let mut world = Scenario::default();
        let mut nodes = NodeConfigs::default();
        world.differ_from_belief(&mut nodes);
        let antenna = world.sensors.vessel_gnss.antenna_m;
        assert_eq!(antenna, nodes.vessel.gnss.antenna_m);
        assert!(antenna[0] < -0.5 * world.deck.length_m - 0.2);
        let before = antenna;
        world.differ_from_belief(&mut nodes);
        assert_eq!(world.sensors.vessel_gnss.antenna_m, before);
    }

    #[test]
    fn draws_within_their_ranges() {
        let mut varied = Scenario::default();
        let mut nodes = NodeConfigs::default();
        varied.differ_from_belief(&mut nodes);
        let plain = Scenario::default();
        let mut lags = Vec::new();
        for seed in 0..200 {
            let w = varied.drawn(seed);
            assert!(w.check(&Keys::ROOT).is_ok(), "{seed}");
            let ratio =
                w.sensors.vessel_imu.gyro_white_sd_radps / plain.sensors.vessel_imu.gyro_white_sd_radps;
            assert!((1.0 / 1.5..=1.5).contains(&ratio) && ratio != 1.0);
            // The reported accuracy does not change.
            let stated = w.sensors.vessel_gnss.error.white_sd_m * w.sensors.vessel_gnss.stated_factor;
            assert!((stated / plain.sensors.vessel_gnss.error.white_sd_m - 1.0).abs() < 1e-12);
            let mass = w.vessel.mass_kg / plain.vessel.mass_kg;
            assert!((0.85..=1.15).contains(&mass) && (mass - 1.0).abs() > 1e-9);
            assert!((w.deck.centre_m[2] - plain.deck.centre_m[2]).abs() < 0.08);
            assert_eq!(
                (w.deck.length_m, w.deck.width_m),
                (plain.deck.length_m, plain.deck.width_m)
            );
            lags.push(w.drone.autopilot.attitude_lag_s());
        }
        let (low, high) = lags
            .iter()
            .fold((1.0_f64, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(
            (0.09..0.095).contains(&low) && (0.155..0.16001).contains(&high),
            "{low} {high}"
        );
    }
}
