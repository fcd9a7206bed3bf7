//! True state of the drone; its autopilot is in [`crate::autopilots`].
//!
//! [`SimulatedDrone::step`] advances a tick in sub-steps of at most 2 ms: wind, rotors, forces, contact. Free
//! flight is integrated in double precision; near the deck rapier3d solves contact.

mod airframe;
mod config;
mod contact;
mod frame;
pub(crate) mod noise;
mod over_deck;
mod wind;

#[cfg(test)]
mod tests;

use alight_shared::{
    frames::{Deck, DroneBody, Point, Rotation, Vector, yaw_rotation},
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    msg::Seq,
    surroundings::{KeepOut, MAX_KEEP_OUT},
    time::{Span, WorldTime},
};
use nalgebra::{UnitQuaternion, Vector3};

use crate::physics::{body::RigidState, streams::Streams};
use airframe::{Airframe, AirframeMotion};
use contact::{DeckSpan, GearContact};
use wind::{OverDeck, SimulatedWind};

pub use config::{
    AirframeConfig, AutopilotConfig, ContactConfig, DroneConfig, LossAction, NavigationConfig, WindConfig,
};
pub use contact::{Impact, Part};
pub use frame::{MAX_ROTORS, RotorFrame};

const SUB_STEP_S: f64 = 0.002;
/// Distance from the deck above which the ground effect is omitted, m; it is below 0.1 %.
const GROUND_EFFECT_M: f64 = 3.0;
/// Clearance below which rapier runs, m: more than the distance of a sub-step at 10 m/s plus rapier's margin.
const CONTACT_MARGIN_M: f64 = 0.05;

#[derive(Clone, Copy, Debug)]
pub struct DroneStart {
    /// Centre of mass, true NED, m.
    pub position: Vector3<f64>,
    /// Heading, rad.
    pub yaw: f64,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepReport {
    pub impacts: Vec<Impact>,
    /// Feet that touch the deck at the tick's end (within the last 10 ms): front right, rear left, front
    /// left, rear right.
    pub feet: [bool; 4],
    /// A part other than a foot touches at the tick's end.
    pub other: bool,
    /// A foot is below the water's surface.
    pub in_water: bool,
    /// The motors may turn.
    pub armed: bool,
}

pub struct SimulatedDrone {
    airframe: Airframe,
    contact: GearContact,
    wind: SimulatedWind,
    /// Obstacles around the deck, with their wakes.
    bodies: Seq<KeepOut, MAX_KEEP_OUT>,
    deck_half: [f64; 2],
    /// Extent of the drone below and above the centre of mass, m.
    reach: [f64; 2],
    motion: AirframeMotion,
    acceleration: Vector3<f64>,
    angular_acceleration: Vector3<f64>,
    /// Height (NED z, m) of the pad before a take-off.
    pad: Option<f64>,
    /// Specific force over the last step, body frame, m/s².
    specific_force: Vector3<f64>,
}

/// Truth for a firmware's sensors, SI units: position and velocity of the centre of mass in NED, rotation NED
/// from body, rates and specific force in the body frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlantState {
    pub at: WorldTime,
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub attitude: UnitQuaternion<f64>,
    pub rates: Vector3<f64>,
    pub specific_force: Vector3<f64>,
}

/// The deck at the fraction `s` of the interval of `h` seconds from `a` to `b`: cubic in position, constant
/// rotation rate.
fn between([a, b]: &[RigidState<Deck>; 2], h: f64, s: f64) -> RigidState<Deck> {
    let p = a.position.0;
    let q = b.position.0;
    let v = a.velocity.0 * h;
    let w = b.velocity.0 * h;
    let c2 = (q - p) * 3.0 - v * 2.0 - w;
    let c3 = (p - q) * 2.0 + v + w;
    RigidState {
        position: Point::from(p + (v + (c2 + c3 * s) * s) * s),
        velocity: Vector::from((v + (c2 * 2.0 + c3 * (3.0 * s)) * s) / h),
        attitude: Rotation::from(a.attitude.0.slerp(&b.attitude.0, s)),
        ..*a
    }
}

/// Direction towards which the seed's wind blows if none is configured, deg from north towards east.
pub fn wind_to_deg(streams: &Streams) -> f64 {
    wind::drawn_direction(&mut streams.stream("wind")).to_degrees()
}

impl SimulatedDrone {
    /// Drone that hovers at `start`. Mass, thrust and wind come from the random streams `drone.airframe`,
    /// `wind` and `wind/wake`.
    pub fn new(
        config: &DroneConfig,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
        bodies: Seq<KeepOut, MAX_KEEP_OUT>,
        streams: &Streams,
        start: DroneStart,
    ) -> Self {
        let mut airframe = Airframe::new(&config.airframe, drone, deck, streams);
        airframe.spin_up();
        let motion = AirframeMotion {
            position: start.position,
            velocity: Vector3::zeros(),
            attitude: yaw_rotation(start.yaw),
            rates: Vector3::zeros(),
        };
        SimulatedDrone {
            contact: GearContact::new(&config.contact, &airframe, drone, deck),
            wind: SimulatedWind::new(&config.wind, streams),
            bodies,
            deck_half: [0.5 * deck.length_m, 0.5 * deck.width_m],
            reach: [drone.feet_below_m, config.airframe.rotor_above_m.max(0.0)],
            airframe,
            motion,
            acceleration: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
            pad: None,
            specific_force: Vector3::new(0.0, 0.0, -GRAVITY),
        }
    }

    /// Puts the drone on a pad at its position, motors off.
    pub fn stand(&mut self) {
        self.pad = Some(self.motion.position.z);
        self.airframe.stand_still();
    }
    /// Puts the drone on the deck's centre, motors off; it moves with the deck.
    pub fn stand_on(&mut self, deck: &RigidState<Deck>, yaw: f64) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw - deck.euler().z);
        let feet = Vector3::new(0.0, 0.0, -self.reach[0]);
        let here = deck.at::<DroneBody>(feet);
        self.motion = AirframeMotion {
            position: here.position.0,
            velocity: here.velocity.0,
            attitude: deck.attitude.0 * turn,
            rates: turn.inverse() * deck.rates.0,
        };
        self.airframe.stand_still();
    }
    pub fn snag(&mut self, foot: usize, newton: f64) {
        self.contact.snag(foot, newton);
    }
    pub fn plant_state(&self, at: WorldTime) -> PlantState {
        PlantState {
            at,
            position: self.motion.position,
            velocity: self.motion.velocity,
            attitude: self.motion.attitude,
            rates: self.motion.rates,
            specific_force: self.specific_force,
        }
    }

    /// Advances from `t` by `dt`; the deck moves from `deck[0]` to `deck[1]` (cubic in position). `water_z`
    /// is the water surface below the drone (NED, down, m). `motors` is called for each sub-step with its
    /// initial state and returns fractions of a rotor's maximum thrust; None: motors off.
    pub fn step(
        &mut self,
        t: WorldTime,
        dt: Span,
        deck: &[RigidState<Deck>; 2],
        water_z: f64,
        exchanges: u32,
        mut motors: impl FnMut(&PlantState) -> Option<[f64; MAX_ROTORS]>,
    ) -> Vec<StepReport> {
        let length = dt / i64::from(exchanges);
        (0..exchanges)
            .map(|k| {
                let at = t + length * i64::from(k);
                let command = motors(&self.plant_state(at));
                let fraction = |k: u32| f64::from(k) / f64::from(exchanges);
                let [from, to] = [fraction(k), fraction(k + 1)].map(|s| between(deck, dt.secs(), s));
                self.integrate(length.secs(), &from, &to, water_z, command.as_ref())
            })
            .collect()
    }

    fn integrate(
        &mut self,
        dt_s: f64,
        deck_start: &RigidState<Deck>,
        deck_end: &RigidState<Deck>,
        water_z: f64,
        command: Option<&[f64; MAX_ROTORS]>,
    ) -> StepReport {
        let mut report = StepReport::default();
        let count = (dt_s / SUB_STEP_S - 1e-9).ceil().max(1.0) as u32;
        let dt = dt_s / f64::from(count);
        let height = water_z - self.motion.position.z;
        let turn = deck_start.attitude.0;
        let over = OverDeck {
            turn,
            velocity: deck_start.velocity.0,
            place: turn.inverse_transform_vector(&(self.motion.position - deck_start.position.0)),
            reach: self.reach,
            half: self.deck_half,
            bodies: &self.bodies,
        };
        self.wind.step(dt_s, height, &self.motion.velocity, &over);
        let path = DeckPath::new(deck_start, deck_end, dt_s);
        let mut specific = Vector3::zeros();
        for k in 0..count {
            let span = path.span(f64::from(k) * dt, dt);
            let before = self.motion.velocity;
            self.sub_step(command, &span, dt, &mut report.impacts);
            self.rest_on_pad();
            self.acceleration = (self.motion.velocity - before) / dt;
            specific += self
                .motion
                .attitude
                .inverse_transform_vector(&(self.acceleration - Vector3::z() * GRAVITY));
        }
        self.specific_force = specific / f64::from(count);

        report.feet = self.contact.feet();
        report.other = self.contact.other();
        report.in_water = self.contact.soles().any(|s| self.motion.point(&s).z > water_z);
        report.armed = command.is_some();
        report
    }

    /// Whether the drone is on its pad and has not taken off.
    pub fn on_pad(&self) -> bool {
        self.pad.is_some()
    }
    /// Keeps the drone on its pad, level and at rest, until it rises; the pad then disappears.
    fn rest_on_pad(&mut self) {
        const LEFT_M: f64 = 0.5;
        let Some(pad) = self.pad else { return };
        let m = &mut self.motion;
        if m.position.z < pad - LEFT_M {
            self.pad = None;
        } else if m.position.z >= pad {
            let (_, _, yaw) = m.attitude.euler_angles();
            m.position.z = pad;
            m.velocity = Vector3::new(0.0, 0.0, m.velocity.z.min(0.0));
            m.attitude = yaw_rotation(yaw);
            m.rates = Vector3::zeros();
        }
    }

    fn sub_step(
        &mut self,
        command: Option<&[f64; MAX_ROTORS]>,
        deck: &DeckSpan,
        dt: f64,
        impacts: &mut Vec<Impact>,
    ) {
        self.airframe.spin(command, dt);
        let m = self.motion;
        let wind = self.wind.velocity();
        let distance = self.contact.distance(&m.position, deck);
        let surface = (distance < GROUND_EFFECT_M).then_some((&deck.centre, &deck.turn));
        let (force, moment) = self.airframe.loads(&m, &wind, surface);
        let (dv, dw) = self.airframe.accelerations(&m, &force, &moment, dt);

        let solved = if distance < CONTACT_MARGIN_M {
            self.contact.step(&m, &(dv * dt), &(dw * dt), deck, dt, impacts)
        } else {
            self.contact.away();
            None
        };
        self.motion = solved.unwrap_or_else(|| m.advanced(&dv, &dw, dt));
        self.angular_acceleration = (self.motion.rates - m.rates) / dt;
    }

    pub fn truth(&self) -> RigidState<DroneBody> {
        let m = &self.motion;
        RigidState {
            position: Point::from(m.position),
            velocity: Vector::from(m.velocity),
            acceleration: Vector::from(self.acceleration),
            attitude: Rotation::from(m.attitude),
            rates: Vector::from(m.rates),
            angular_acceleration: Vector::from(self.angular_acceleration),
        }
    }
    /// Wind velocity, NED, m/s.
    pub fn wind(&self) -> Vector3<f64> {
        self.wind.velocity()
    }
    pub fn mass_kg(&self) -> f64 {
        self.airframe.mass
    }
    /// Collective thrust without ground effect, N.
    pub fn thrust_n(&self) -> f64 {
        self.airframe.thrust() * 4.0 * self.airframe.rotor_max
    }
    /// Lowest points of the feet, body frame, m.
    pub fn soles(&self) -> [Vector3<f64>; 4] {
        let mut soles = [Vector3::zeros(); 4];
        for (s, v) in soles.iter_mut().zip(self.contact.soles()) {
            *s = v;
        }
        soles
    }
    /// Collective thrust for hovering in still air, as a fraction of the true maximum.
    pub fn hover_thrust(&self) -> f64 {
        self.airframe.hover()
    }
}

/// Motion over a tick: cubic Hermite in position, constant rotation rate.
struct DeckPath {
    a: [Vector3<f64>; 4],
    turn: UnitQuaternion<f64>,
    spin: Vector3<f64>,
    length: f64,
}

impl DeckPath {
    fn new(start: &RigidState<Deck>, end: &RigidState<Deck>, length: f64) -> Self {
        let p0 = start.position.0;
        let p1 = end.position.0;
        let v0 = start.velocity.0 * length;
        let v1 = end.velocity.0 * length;
        let turn = end.attitude.0 * start.attitude.0.inverse();
        DeckPath {
            a: [p0, v0, (p1 - p0) * 3.0 - v0 * 2.0 - v1, (p0 - p1) * 2.0 + v0 + v1],
            turn: start.attitude.0,
            spin: turn.scaled_axis() / length,
            length,
        }
    }
    fn position(&self, t: f64) -> Vector3<f64> {
        let s = t / self.length;
        self.a[0] + (self.a[1] + (self.a[2] + self.a[3] * s) * s) * s
    }
    fn span(&self, t: f64, dt: f64) -> DeckSpan {
        let centre = self.position(t);
        DeckSpan {
            centre,
            turn: UnitQuaternion::from_scaled_axis(self.spin * t) * self.turn,
            velocity: (self.position(t + dt) - centre) / dt,
            spin: self.spin,
        }
    }
}
