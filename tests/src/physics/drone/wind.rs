//! Wind over the water: a mean that decreases towards the surface, Dryden gusts, and the vessel's effect on
//! both above the deck.

use alight_shared::{geometry::GRAVITY, surroundings::KeepOut};
use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;

use super::{
    config::WindConfig,
    noise::normal,
    over_deck::{BodyWake, VISCOSITY, boundary_layer, fetch},
};
use crate::physics::streams::{Stream, Streams};

const FOOT_M: f64 = 0.3048;
/// Height at which a scenario states its wind speed, and that of the gust model (20 ft), m.
const STATED_M: f64 = 10.0;
const DRYDEN_M: f64 = 20.0 * FOOT_M;
/// Minimum height of the profile, m; between the waves there is no wind.
const LOWEST_M: f64 = 0.1;
/// Von Karman's constant, and Charnock's parameter for the open sea (Smith 1988).
const KARMAN: f64 = 0.4;
const CHARNOCK: f64 = 0.011;
/// Relative wind below which the air over the deck counts as still, m/s.
const STILL_MPS: f64 = 1e-3;

/// Mean wind speed over the water in neutral air, from U10: `U(z) = (u*/kappa) ln(z/z0)` with `z0 = alpha
/// u*²/g + 0.11 nu/u*` (Charnock 1955; Smith 1988, J. Geophys. Res. 93: alpha 0.011).
#[derive(Clone, Copy, Debug)]
struct Profile {
    /// `u*/kappa`, m/s.
    scale: f64,
    /// z0, m.
    roughness: f64,
}

impl Profile {
    fn new(u10: f64) -> Profile {
        let roughness = |u: f64| CHARNOCK * u * u / GRAVITY + 0.11 * VISCOSITY / u;
        // Each iteration reduces the error at least tenfold.
        let friction = (0..20).fold(0.035 * u10.max(1e-6), |u, _| {
            KARMAN * u10.max(1e-6) / (STATED_M / roughness(u)).ln().max(1.0)
        });
        Profile {
            scale: if u10 > 0.0 { friction / KARMAN } else { 0.0 },
            roughness: roughness(friction),
        }
    }
    fn at(&self, height: f64) -> f64 {
        self.scale * (height.max(LOWEST_M) / self.roughness).ln().max(0.0)
    }
}

pub(crate) struct OverDeck<'a> {
    /// Rotation NED from deck, and velocity of the deck's centre, NED.
    pub(crate) turn: UnitQuaternion<f64>,
    pub(crate) velocity: Vector3<f64>,
    /// Centre of mass in the deck's axes, m.
    pub(crate) place: Vector3<f64>,
    /// Extent below and above the centre of mass, m.
    pub(crate) reach: [f64; 2],
    /// Half the deck's length and width, m.
    pub(crate) half: [f64; 2],
    pub(crate) bodies: &'a [KeepOut],
}

/// Mean wind, Dryden gusts (MIL-F-8785C, section 3.7.3.4, low-altitude model), and eddies from obstacles upwind.
#[derive(Clone, Debug)]
pub(crate) struct SimulatedWind {
    /// Direction towards which the mean wind blows (unit vector, NED), and its profile.
    ahead: Vector3<f64>,
    profile: Profile,
    gusts: bool,
    along: f64,
    /// Two states for each second-order filter.
    lateral: [f64; 2],
    vertical: [f64; 2],
    rng: Stream,
    /// Wake eddies along the deck's axes, with unit variance, from a separate stream.
    eddies: Vector3<f64>,
    wake_rng: Stream,
    now: Vector3<f64>,
}

/// Direction towards which the mean wind blows, rad: the first draw of its stream.
pub(crate) fn drawn_direction(rng: &mut Stream) -> f64 {
    rng.random_range(0.0..core::f64::consts::TAU)
}

impl SimulatedWind {
    pub(crate) fn new(config: &WindConfig, streams: &Streams) -> Self {
        let mut rng = streams.stream("wind");
        let mut wake_rng = streams.stream("wind/wake");
        let drawn = drawn_direction(&mut rng);
        let to = config.to_deg.map_or(drawn, f64::to_radians);
        let ahead = Vector3::new(to.cos(), to.sin(), 0.0);
        SimulatedWind {
            ahead,
            profile: Profile::new(config.mean_mps),
            gusts: config.gusts && config.mean_mps > 0.0,
            along: normal(&mut rng),
            lateral: [normal(&mut rng), 0.0],
            vertical: [normal(&mut rng), 0.0],
            rng,
            eddies: Vector3::from_fn(|_, _| normal(&mut wake_rng)),
            wake_rng,
            now: ahead * config.mean_mps,
        }
    }

    /// Wind velocity after the last `step`, NED, m/s.
    pub(crate) fn velocity(&self) -> Vector3<f64> {
        self.now
    }

    /// Advances by `dt` at `height` (m above the water) and ground velocity `velocity`.
    pub(crate) fn step(&mut self, dt: f64, height: f64, velocity: &Vector3<f64>, over: &OverDeck<'_>) {
        let mean = self.ahead * self.profile.at(height);
        let (gust, sd) = if self.gusts {
            self.gust(dt, height, (velocity - mean).norm())
        } else {
            (Vector3::zeros(), [0.0; 3])
        };
        self.now = self.over_deck(dt, mean + gust, sd, over);
    }

    /// Gust after `dt`, and its standard deviations along, across, down.
    ///
    /// With `W20` at 20 ft and h in ft: `sigma_w = 0.1 W20`, `sigma_u = sigma_v = sigma_w / (0.177 + 0.000823
    /// h)^0.4`, `L_w = h`, `L_u = L_v = h / (0.177 + 0.000823 h)^1.2`. The longitudinal filter is first-order
    /// with `T = L/V`, the others are `(1 + sqrt(3) T s) / (1 + T s)²`. V is the drone's speed relative to
    /// the mean wind, which carries the frozen gusts; it is at least 1 m/s.
    fn gust(&mut self, dt: f64, height: f64, airspeed: f64) -> (Vector3<f64>, [f64; 3]) {
        let h = (height / FOOT_M).clamp(10.0, 1000.0);
        let k = 0.177 + 0.000_823 * h;
        let sigma_w = 0.1 * self.profile.at(DRYDEN_M);
        let sigma_u = sigma_w / k.powf(0.4);
        let length_w = h * FOOT_M;
        let length_u = length_w / k.powf(1.2);
        let airspeed = airspeed.max(1.0);
        let second_order = |x: &mut [f64; 2], keep: f64, n: f64| {
            let before = x[0];
            x[0] = keep * x[0] + (1.0 - keep * keep).sqrt() * n;
            x[1] = keep * x[1] + (1.0 - keep) * 0.5 * (before + x[0]);
            // For unit variance of x[0] this sum has a stationary variance of 2.
            let root3 = 3.0_f64.sqrt();
            (root3 * x[0] + (1.0 - root3) * x[1]) / 2.0_f64.sqrt()
        };
        let keep_u = (-dt * airspeed / length_u).exp();
        let keep_w = (-dt * airspeed / length_w).exp();
        self.along = keep_u * self.along + (1.0 - keep_u * keep_u).sqrt() * normal(&mut self.rng);
        let lateral = second_order(&mut self.lateral, keep_u, normal(&mut self.rng));
        let vertical = second_order(&mut self.vertical, keep_w, normal(&mut self.rng));
        let across = Vector3::new(-self.ahead.y, self.ahead.x, 0.0);
        let gust = self.ahead * (sigma_u * self.along)
            + across * (sigma_u * lateral)
            + Vector3::z() * (sigma_w * vertical);
        (gust, [sigma_u, sigma_u, sigma_w])
    }

    /// Wind over the deck from `wind` (NED) with gusts of `sd`. The boundary layer and the deepest wake
    /// reduce the component along the deck. The wake's eddies are advected at the wind's speed and supply the
    /// turbulence that the gusts lack.
    fn over_deck(&mut self, dt: f64, wind: Vector3<f64>, sd: [f64; 3], over: &OverDeck<'_>) -> Vector3<f64> {
        let mut relative = over.turn.inverse_transform_vector(&(wind - over.velocity));
        let speed = relative.xy().norm();
        if speed < STILL_MPS {
            return wind;
        }
        let towards = relative.xy() / speed;
        let above = -over.place.z;
        let span = [above - over.reach[0], above + over.reach[1]];
        let layer = fetch(over.half, &over.place, &towards).map_or(1.0, |x| boundary_layer(speed, x, span));
        let ambient = sd.map(|sd| sd / speed);
        let wakes = (over.bodies.iter()).filter_map(|b| BodyWake::of(b, &over.place, &towards, ambient));
        let wake = wakes.min_by(|a, b| a.speed.total_cmp(&b.speed));
        let left = layer * wake.map_or(1.0, |w| w.speed);
        if left == 1.0 {
            return wind;
        }
        relative.x *= left;
        relative.y *= left;
        if let Some(wake) = wake {
            let keep = (-dt * speed / wake.length).exp();
            for i in 0..3 {
                let n = normal(&mut self.wake_rng);
                self.eddies[i] = keep * self.eddies[i] + (1.0 - keep * keep).sqrt() * n;
                let more = wake.intensity[i].powi(2) - ambient[i].powi(2);
                relative[i] += speed * more.max(0.0).sqrt() * self.eddies[i];
            }
        }
        over.velocity + over.turn * relative
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deck at rest around a drone at `place`.
    fn over(bodies: &[KeepOut], place: [f64; 3]) -> OverDeck<'_> {
        OverDeck {
            turn: UnitQuaternion::identity(),
            velocity: Vector3::zeros(),
            place: Vector3::from(place),
            reach: [0.3, 0.05],
            half: [1.25, 0.85],
            bodies,
        }
    }
    const FAR: [f64; 3] = [0.0, 0.0, -50.0];

    fn spread(mean_mps: f64, height: f64, over: &OverDeck<'_>) -> (Vector3<f64>, Vector3<f64>) {
        let config = WindConfig {
            mean_mps,
            to_deg: Some(180.0),
            with_waves: false,
            gusts: true,
        };
        let mut wind = SimulatedWind::new(&config, &Streams::new(7));
        let mut sum = Vector3::zeros();
        let mut square = Vector3::zeros();
        let n = 400_000;
        for _ in 0..n {
            wind.step(0.05, height, &Vector3::zeros(), over);
            sum += wind.velocity();
            square += wind.velocity().component_mul(&wind.velocity());
        }
        let mean = sum / f64::from(n);
        (
            mean,
            (square / f64::from(n) - mean.component_mul(&mean)).map(f64::sqrt),
        )
    }

    #[test]
    fn dryden_gust_standard_deviation() {
        let (mean, sd) = spread(10.0, 6.096, &over(&[], FAR));
        // At h = 20 ft: sigma_w = 0.1 W20, sigma_u = sigma_w / (0.177 + 0.01646)^0.4 = 0.1929 W20; W20 = 9.556 m/s.
        let w20 = 9.556;
        assert!((mean.x + w20).abs() < 0.15 && mean.y.abs() < 0.15, "{mean}");
        assert!((sd.x / (0.1929 * w20) - 1.0).abs() < 0.1, "{sd}");
        assert!((sd.y / (0.1929 * w20) - 1.0).abs() < 0.1, "{sd}");
        assert!((sd.z / (0.1 * w20) - 1.0).abs() < 0.1, "{sd}");
    }

    #[test]
    fn wind_without_a_mean() {
        let (mean, sd) = spread(0.0, 10.0, &over(&[], FAR));
        assert_eq!((mean, sd), (Vector3::zeros(), Vector3::zeros()));
    }

    #[test]
    fn wind_profile_over_waves() {
        // Smith 1988, table 1: drag coefficient (u*/U10)² of neutral air, in thousandths.
        for (u10, thousandths) in [(4.0, 0.98), (10.0, 1.30), (20.0, 1.85)] {
            let p = Profile::new(u10);
            assert!((p.at(10.0) / u10 - 1.0).abs() < 1e-9, "{u10}");
            let drag = (p.scale * KARMAN / u10).powi(2) * 1000.0;
            assert!((drag / thousandths - 1.0).abs() < 0.05, "{u10} m/s: {drag}");
        }
        let p = Profile::new(10.0);
        assert!((0.82..0.85).contains(&(p.at(1.6) / 10.0)), "{}", p.at(1.6));
        assert_eq!(Profile::new(0.0).at(2.0), 0.0);
    }

    #[test]
    fn wind_behind_a_wheelhouse() {
        let cube = [KeepOut {
            low: [2.0, -1.0, -2.0],
            high: [4.0, 1.0, 0.0],
        }];
        let lee = [0.0, 0.0, -0.5];
        let (free, _) = spread(8.0, 1.8, &over(&[], lee));
        let (mean, sd) = spread(8.0, 1.8, &over(&cube, lee));
        assert!(mean.x.abs() < 0.5 * free.x.abs(), "{mean} of {free}");
        assert!(sd.z > 0.12 * free.x.abs(), "{sd}");
        // The vessel's motion causes a relative wind in still air.
        let config = WindConfig::default();
        let mut wind = SimulatedWind::new(&config, &Streams::new(7));
        let mut under_way = over(&cube, lee);
        under_way.velocity.x = 6.0;
        wind.step(0.01, 1.8, &under_way.velocity, &under_way);
        assert!(wind.velocity().x > 1.5, "drawn along: {}", wind.velocity());
    }
}
