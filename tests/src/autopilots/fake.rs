//! An autopilot at protocol level: it speaks MAVLink bytes and behaves as PX4 and ArduCopter do (modes,
//! denials, requested rates, loss of set-points, forced disarm). It flies a point mass with an attitude lag
//! above a heaving deck, or what [`FakeAutopilot::fly_plant`] gives it.

use std::collections::{BTreeMap, VecDeque};

use alight_shared::frames::Datum;
use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_uav::autopilot::message::{
    ARMED, Address, AttitudeReport, CUSTOM_MODE, CommandLong, CommandResult, DistanceReport, Frame,
    Heartbeat, ImuReport, Message, OdometryReport, PositionReport, VelocityFrame, command, id,
};
use alight_uav::autopilot::modes::{Firmware, px4_mode};
use alight_uav::autopilot::wire::{Decoder, encode};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::physics::drone::Mixer;

/// Lag of the attitude loop, s.
const LAG_S: f64 = 0.2;
/// Hover thrust, fraction of the greatest.
pub const HOVER: f64 = 0.45;
/// Feet below the centre of mass, m.
pub const FEET_M: f64 = 0.3;
/// PX4 wants set-points this often before OFFBOARD ...
const OFFBOARD_HZ: f64 = 2.0;
/// ... for so long, s.
const OFFBOARD_S: f64 = 1.0;
/// Time until it notices a loss of set-points, without a parameter for it, s.
const DEFAULT_LOSS_S: f64 = 1.0;
/// Least output of a running motor.
const IDLE: f64 = 0.05;
/// PX4's parameters that are integers.
const INTEGERS: [&str; 2] = ["COM_OBL_RC_ACT", "MC_AIRMODE"];

/// What it is commanded to fly.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    /// Position, velocity, acceleration, heading.
    Place([Vector3<f64>; 3], f64),
    Attitude(UnitQuaternion<f64>, f64),
}

/// The autopilot; what a test changes is public.
#[derive(Default)]
pub struct FakeAutopilot {
    /// The firmware that it behaves as.
    pub firmware: Firmware,
    /// Its address.
    pub address: Address,
    /// Its clock is the true time less this, s.
    pub booted_s: f64,
    /// The mode that a person chose; the one in force may be a failsafe's.
    pub chosen: u32,
    /// The mode in force.
    pub mode: u32,
    /// Motors may turn.
    pub armed: bool,
    /// NED, m.
    pub position: Vector3<f64>,
    /// NED, m/s.
    pub velocity: Vector3<f64>,
    /// NED from body.
    pub attitude: UnitQuaternion<f64>,
    /// Thrust, fraction of the greatest.
    pub thrust: f64,
    /// Deck's height now (NED z, m) and its velocity.
    pub deck: [f64; 2],
    /// It stands on the deck.
    pub on_deck: bool,
    /// Charge, 0 to 1.
    pub battery: f64,
    /// Its parameters; it does not answer for others.
    pub parameters: BTreeMap<&'static str, f64>,
    /// Jumps of its estimate.
    pub resets: u8,
    /// Fault: sends nothing.
    pub silent: bool,
    /// Fault: answers every command with this instead of obeying.
    pub answer: Option<CommandResult>,
    /// Fault: answers no TIMESYNC.
    pub no_timesync: bool,
    /// Fault: does not report its origin.
    pub no_origin: bool,
    /// Every command that came, with its time.
    pub commands: Vec<(f64, CommandLong)>,
    /// Times at which set-points came.
    pub set_points: VecDeque<f64>,
    /// Attitude set-points that came.
    pub attitudes: u32,
    /// Where a person holds it; None: where it is.
    pub manual_hold_position: Option<Vector3<f64>>,
    /// Hover thrust, fraction of the greatest.
    pub hover: f64,
    /// Flown by a plant, not as a point mass; its rangefinder is the plant's.
    pub external: bool,
    /// Where its NED begins.
    pub origin: Datum,
    rates: Vector3<f64>,
    force: Vector3<f64>,
    target: Option<Target>,
    /// Where its set-points were lost, and it holds.
    lost_at: Option<Vector3<f64>>,
    /// The mode reported last in CURRENT_MODE, and when.
    reported_mode: Option<(f64, u32)>,
    streams: BTreeMap<u32, f64>,
    due: BTreeMap<u32, f64>,
    now_s: f64,
    decoder: Decoder,
    sequence: u8,
}

/// PX4's position mode: a person flies.
pub const PX4_POSITION: u32 = px4_mode(3, 0);
/// PX4's hold.
pub const PX4_HOLD: u32 = px4_mode(4, 3);
/// PX4's return.
pub const PX4_RETURN: u32 = px4_mode(4, 5);
/// PX4's landing.
pub const PX4_LAND: u32 = px4_mode(4, 6);
/// PX4's OFFBOARD.
pub const PX4_OFFBOARD: u32 = px4_mode(6, 0);

impl FakeAutopilot {
    /// In a person's mode and armed, `height_m` above its origin.
    pub fn new(firmware: Firmware, height_m: f64) -> FakeAutopilot {
        let mode = FakeAutopilot::manual_mode(firmware);
        FakeAutopilot {
            firmware,
            address: Address::new(3, 1),
            booted_s: 977.25,
            chosen: mode,
            mode,
            armed: true,
            position: Vector3::new(0.0, 0.0, -height_m),
            thrust: HOVER,
            battery: 0.9,
            parameters: FakeAutopilot::parameters(firmware),
            hover: HOVER,
            force: Vector3::new(0.0, 0.0, -GRAVITY),
            // What an onboard link sends without being asked.
            streams: BTreeMap::from([(id::HEARTBEAT, 1.0)]),
            ..FakeAutopilot::default()
        }
    }
    /// Parameters as a landing needs them.
    fn parameters(firmware: Firmware) -> BTreeMap<&'static str, f64> {
        BTreeMap::from_iter(match firmware {
            Firmware::Px4 => [
                ("COM_OF_LOSS_T", 0.5),
                ("COM_OBL_RC_ACT", 5.0),
                ("MPC_ACC_UP_MAX", 8.0),
                ("MC_AIRMODE", 0.0),
            ]
            .to_vec(),
            Firmware::ArduCopter => [
                ("GUID_TIMEOUT", 0.5),
                ("GUID_OPTIONS", 8.0),
                ("ATC_THR_MIX_MIN", 0.1),
                ("FS_THR_ENABLE", 1.0),
                ("FS_GCS_ENABLE", 0.0),
            ]
            .to_vec(),
        })
    }
    /// Without set-points for this long PX4 holds, ArduCopter brakes, s.
    fn loss_s(&self) -> f64 {
        let name = match self.firmware {
            Firmware::Px4 => "COM_OF_LOSS_T",
            Firmware::ArduCopter => "GUID_TIMEOUT",
        };
        self.parameters.get(name).copied().unwrap_or(DEFAULT_LOSS_S)
    }
    /// A mode in which a person flies.
    pub fn manual_mode(firmware: Firmware) -> u32 {
        match firmware {
            Firmware::Px4 => PX4_POSITION,
            Firmware::ArduCopter => 5,
        }
    }
    /// The mode that takes set-points.
    pub fn offboard_mode(firmware: Firmware) -> u32 {
        match firmware {
            Firmware::Px4 => PX4_OFFBOARD,
            Firmware::ArduCopter => 4,
        }
    }
    /// A person moves the switch. True when the mode was entered.
    pub fn choose(&mut self, mode: u32) -> bool {
        if self.firmware == Firmware::Px4 && mode == PX4_OFFBOARD && !self.is_streamed() {
            return false;
        }
        self.chosen = mode;
        self.mode = mode;
        (self.target, self.lost_at) = (None, None);
        true
    }
    /// Set-points came above 2 Hz for a second.
    fn is_streamed(&self) -> bool {
        let recent: Vec<f64> = self
            .set_points
            .iter()
            .copied()
            .filter(|t| self.now_s - t <= OFFBOARD_S)
            .chain([self.now_s])
            .collect();
        let since = recent.first().is_some_and(|t| self.now_s - t > 0.8 * OFFBOARD_S);
        since && recent.windows(2).all(|w| w[1] - w[0] <= 1.0 / OFFBOARD_HZ)
    }
    /// It was switched off and on again in the air.
    pub fn restart(&mut self) {
        self.booted_s = self.now_s;
        self.streams = BTreeMap::from([(id::HEARTBEAT, 1.0)]);
        self.due.clear();
    }
    /// Its own time, us.
    pub fn time_us(&self) -> u64 {
        ((self.now_s - self.booted_s) * 1e6) as u64
    }
    fn in_offboard(&self) -> bool {
        self.mode == FakeAutopilot::offboard_mode(self.firmware)
    }

    /// Moves on to `t_s` with the bytes that came; gives the bytes that it sends.
    pub fn step(&mut self, t_s: f64, bytes: &[Vec<u8>]) -> Vec<Vec<u8>> {
        let dt = t_s - self.now_s;
        self.now_s = t_s;
        let mut replies = Vec::new();
        for b in bytes {
            self.decoder.push(b);
        }
        while let Some(Frame { message, .. }) = self.decoder.next_frame() {
            self.receive(&message, &mut replies);
        }
        self.failsafe();
        if (0.0..0.1).contains(&dt) && !self.external {
            self.fly(dt);
        }
        self.stream(&mut replies);
        if self.silent {
            return Vec::new();
        }
        replies
            .iter()
            .filter_map(|m| {
                self.sequence = self.sequence.wrapping_add(1);
                encode(self.address, self.sequence, m)
            })
            .collect()
    }

    fn receive(&mut self, message: &Message, replies: &mut Vec<Message>) {
        match message {
            Message::Timesync {
                remote_ns: 0,
                local_ns,
            } if !self.no_timesync => {
                let ns = ((self.now_s - self.booted_s) * 1e9) as i64;
                replies.push(Message::Timesync {
                    remote_ns: ns,
                    local_ns: *local_ns,
                });
            }
            Message::Command(c) if c.to == self.address => {
                self.commands.push((self.now_s, *c));
                if c.command == command::REQUEST_MESSAGE && !self.no_origin {
                    replies.push(Message::Origin(self.origin));
                }
                let result = self.answer.unwrap_or_else(|| self.apply(c));
                replies.push(Message::CommandAck {
                    command: c.command,
                    result,
                });
            }
            Message::ParameterRequest { to, name } if *to == self.address => {
                let integer = INTEGERS.contains(&name.as_str());
                replies.extend(self.parameters.get(name.as_str()).map(|v| Message::Parameter {
                    name: name.clone(),
                    value: self.firmware.parameter_value(*v, integer),
                }));
            }
            Message::Position(p) if p.to == self.address => {
                self.count_set_point();
                let [x, v, a] = [p.position, p.velocity, p.acceleration].map(Vector3::from);
                self.target = Some(Target::Place([x, v, a], p.yaw));
            }
            Message::AttitudeThrust(a) if a.to == self.address => {
                self.count_set_point();
                self.attitudes += 1;
                let [w, x, y, z] = a.attitude;
                let q = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                // PX4 drops the rates. ArduCopter 4.6 and 4.7 lead the attitude by them, but turn them by it
                // once too often.
                let ahead = match (self.firmware, a.rates) {
                    (Firmware::ArduCopter, Some(r)) => q * Vector3::from(r) * LAG_S,
                    (Firmware::ArduCopter, None) | (Firmware::Px4, _) => Vector3::zeros(),
                };
                let q = q * UnitQuaternion::from_scaled_axis(ahead);
                self.target = Some(Target::Attitude(q, a.thrust));
            }
            _ => {}
        }
    }
    fn count_set_point(&mut self) {
        self.set_points.push_back(self.now_s);
        if self.set_points.len() > 10_000 {
            self.set_points.pop_front();
        }
    }

    fn apply(&mut self, c: &CommandLong) -> CommandResult {
        let p = c.parameters;
        match c.command {
            command::MESSAGE_INTERVAL => {
                match (self.firmware, p[0] as u32) {
                    (Firmware::Px4, id::SCALED_IMU) => return CommandResult::Failed,
                    (Firmware::ArduCopter, id::ODOMETRY) => return CommandResult::Denied,
                    // Its heartbeats keep their own rate although it accepts.
                    (Firmware::Px4, id::HEARTBEAT) => return CommandResult::Accepted,
                    (Firmware::Px4 | Firmware::ArduCopter, _) => {}
                }
                self.streams.insert(p[0] as u32, 1e6 / p[1]);
                CommandResult::Accepted
            }
            command::ARM_DISARM => {
                let forced = (p[1] - command::FORCE).abs() < 0.5;
                if p[0] > 0.5 {
                    self.armed = true;
                } else if forced || self.on_deck {
                    self.armed = false;
                } else {
                    return CommandResult::Denied;
                }
                CommandResult::Accepted
            }
            command::SET_MODE => {
                let custom = match self.firmware {
                    Firmware::Px4 => px4_mode(p[1] as u32, p[2] as u32),
                    Firmware::ArduCopter => p[1] as u32,
                };
                if self.choose(custom) {
                    CommandResult::Accepted
                } else {
                    CommandResult::Denied
                }
            }
            command::REQUEST_MESSAGE => CommandResult::Accepted,
            _ => CommandResult::Unsupported,
        }
    }

    /// Set-point loss: PX4 goes to its hold and comes back with the stream; ArduCopter stays.
    fn failsafe(&mut self) {
        let lost = self
            .set_points
            .back()
            .is_none_or(|t| self.now_s - t > self.loss_s());
        if self.chosen == FakeAutopilot::offboard_mode(self.firmware) {
            if lost {
                self.target = None;
                self.lost_at.get_or_insert(self.position);
            } else {
                self.lost_at = None;
            }
            if self.firmware == Firmware::Px4 {
                self.mode = if lost { PX4_HOLD } else { PX4_OFFBOARD };
            }
        }
    }

    /// ArduCopter divides the thrust of a tilted drone by this, and reports it as before.
    fn tilt_compensation(&self, q: &UnitQuaternion<f64>) -> f64 {
        match self.firmware {
            Firmware::Px4 => 1.0,
            Firmware::ArduCopter => (q * Vector3::z()).z.clamp(0.1, 1.0),
        }
    }
    /// Attitude and thrust that its loops want now.
    pub fn wanted(&self) -> (UnitQuaternion<f64>, f64) {
        let heading = self.attitude.euler_angles().2;
        let ([p, v, a], yaw) = match self.target.filter(|_| self.in_offboard()) {
            Some(Target::Attitude(q, thrust)) => return (q, thrust / self.tilt_compensation(&q)),
            Some(Target::Place(place, yaw)) => (place, yaw),
            None => {
                let place = self.lost_at.or(self.manual_hold_position);
                let place = place.unwrap_or(self.position);
                ([place, Vector3::zeros(), Vector3::zeros()], heading)
            }
        };
        let apart = (p - self.position).map(|e| e.clamp(-3.0, 3.0));
        let a = a + apart * 2.0 + (v - self.velocity) * 3.0;
        // Tilt towards the acceleration, in heading axes.
        let (sin, cos) = yaw.sin_cos();
        let (ahead, right) = (a.x * cos + a.y * sin, a.y * cos - a.x * sin);
        let tilt = UnitQuaternion::from_euler_angles(
            (right / GRAVITY).clamp(-0.4, 0.4),
            (-ahead / GRAVITY).clamp(-0.4, 0.4),
            yaw,
        );
        (tilt, self.hover * (1.0 - a.z / GRAVITY).clamp(0.2, 1.8))
    }

    /// From now on it flies a plant, whose motion it takes for its own estimate, not its point mass.
    pub fn fly_plant(&mut self) {
        let g = DroneGeometry::default();
        (self.external, self.hover) = (true, g.mass_kg * GRAVITY / g.max_thrust_n);
    }
    /// The plant's motion: position and velocity (its NED, m, m/s), attitude, body rates (rad/s), specific
    /// force (body, m/s²).
    pub fn set_motion(
        &mut self,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        attitude: UnitQuaternion<f64>,
        rates: Vector3<f64>,
        force: Vector3<f64>,
    ) {
        (self.position, self.velocity, self.attitude) = (position, velocity, attitude);
        (self.rates, self.force) = (rates, force);
        self.thrust = if self.armed { self.wanted().1 } else { 0.0 };
    }

    /// Rotor outputs for what its loops want: attitude and rate loop, and a mixer.
    pub fn motors(&self) -> [f64; 4] {
        if !self.armed {
            return [0.0; 4];
        }
        let g = DroneGeometry::default();
        let (wanted, thrust) = self.wanted();
        let error = (self.attitude.inverse() * wanted).scaled_axis();
        let turn = Vector3::new(5.0 * error.x, 5.0 * error.y, (2.0 * error.z).clamp(-1.0, 1.0)) - self.rates;
        let moment = turn
            .component_mul(&Vector3::new(18.0, 18.0, 6.0))
            .component_mul(&Vector3::from(g.inertia_kgm2));
        let layout = [
            [1.0, 1.0, 1.0],
            [-1.0, -1.0, 1.0],
            [1.0, -1.0, -1.0],
            [-1.0, 1.0, -1.0],
        ];
        let side = g.arm_m / 2.0_f64.sqrt();
        let tilt = layout.map(|[x, y, _]: [f64; 3]| (x * moment.y - y * moment.x) / side / g.max_thrust_n);
        let turn = layout.map(|[_, _, sense]| sense * moment.z / g.moment_per_force_m / g.max_thrust_n);
        self.mixer().mix(thrust, &tilt, &turn).out.map(|u| u.max(IDLE))
    }
    /// The firmware's mixer, as its parameters set it.
    fn mixer(&self) -> Mixer {
        let parameter = |name| self.parameters.get(name).copied().unwrap_or(0.0);
        match self.firmware {
            Firmware::Px4 => Mixer::Px4 {
                airmode: parameter("MC_AIRMODE") > 0.0,
            },
            Firmware::ArduCopter => Mixer::ArduCopter {
                hover: self.hover,
                mix: parameter("ATC_THR_MIX_MIN"),
            },
        }
    }

    fn fly(&mut self, dt: f64) {
        let g = Vector3::z() * GRAVITY;
        let (wanted, thrust) = self.wanted();
        let step = UnitQuaternion::from_scaled_axis(
            (self.attitude.inverse() * wanted).scaled_axis() * (dt / LAG_S).min(1.0),
        );
        self.attitude *= step;
        let goal = if self.armed { thrust } else { 0.0 };
        self.thrust += (goal - self.thrust) * (dt / 0.05).min(1.0);
        let lift = self.attitude * -Vector3::z() * (self.thrust / self.hover * GRAVITY);
        let mut acceleration = lift + g;
        self.on_deck =
            self.position.z + FEET_M >= self.deck[0] - 1e-3 && self.velocity.z >= self.deck[1] - 0.3;
        if self.on_deck && acceleration.z > 0.0 {
            let carried = Vector3::new(0.0, 0.0, self.deck[1]);
            acceleration = Vector3::zeros();
            self.velocity = carried;
            self.position.z = self.deck[0] - FEET_M;
            self.attitude = UnitQuaternion::identity();
        }
        self.velocity += acceleration * dt;
        self.position += self.velocity * dt;
        self.force = self.attitude.inverse() * (acceleration - g);
    }

    fn stream(&mut self, replies: &mut Vec<Message>) {
        let due: Vec<u32> = self
            .streams
            .iter()
            .filter(|(id, _)| self.due.get(id).is_none_or(|t| self.now_s >= *t - 1e-9))
            .map(|(id, _)| *id)
            .collect();
        for id in due {
            let period = 1.0 / self.streams[&id];
            let last = self.due.get(&id).copied().unwrap_or(self.now_s);
            self.due.insert(id, (last + period).max(self.now_s));
            if id == id::CURRENT_MODE {
                // When it changes, and with the vehicle's state twice a second.
                let recent = |(at, mode)| mode == self.mode && self.now_s - at < 0.5;
                if self.reported_mode.is_some_and(recent) {
                    continue;
                }
                self.reported_mode = Some((self.now_s, self.mode));
            }
            replies.extend(self.report(id));
        }
    }

    fn report(&self, which: u32) -> Option<Message> {
        let time_us = self.time_us();
        let time_ms = (time_us / 1000) as u32;
        let q = self.attitude;
        let attitude = [q.w, q.i, q.j, q.k];
        Some(match which {
            id::HEARTBEAT => Message::Heartbeat(Heartbeat {
                autopilot: match self.firmware {
                    Firmware::Px4 => 12,
                    Firmware::ArduCopter => 3,
                },
                vehicle: 2,
                base_mode: CUSTOM_MODE | if self.armed { ARMED } else { 0 },
                custom_mode: self.mode,
            }),
            id::CURRENT_MODE => Message::Mode {
                custom_mode: self.mode,
            },
            id::ODOMETRY => Message::Odometry(OdometryReport {
                time_us,
                position: self.position.into(),
                attitude,
                velocity: (q.inverse() * self.velocity).into(),
                frame: VelocityFrame::Body,
                rates: self.rates.into(),
                variances: None,
                resets: self.resets,
            }),
            id::LOCAL_POSITION_NED => Message::LocalPosition(PositionReport {
                time_ms,
                position: self.position.into(),
                velocity: self.velocity.into(),
            }),
            id::ATTITUDE_QUATERNION => Message::Attitude(AttitudeReport {
                time_ms,
                attitude,
                rates: self.rates.into(),
            }),
            id::HIGHRES_IMU | id::SCALED_IMU => Message::Imu(ImuReport {
                time_us,
                accelerometer: self.force.into(),
                gyro: [0.0; 3],
            }),
            id::DISTANCE_SENSOR if self.external => return None,
            id::DISTANCE_SENSOR => Message::Distance(DistanceReport {
                time_ms,
                range_m: self.deck[0] - self.position.z - 0.08,
                limits_m: [0.1, 12.0],
                variance: None,
            }),
            id::EXTENDED_SYS_STATE => Message::Landed {
                // On a heaving deck its land detector does not detect the landing.
                state: if self.armed { 2 } else { 1 },
            },
            id::BATTERY_STATUS => Message::Battery {
                number: 0,
                remaining: Some(self.battery),
            },
            id::ATTITUDE_TARGET => Message::AttitudeTargetThrust {
                thrust: self.thrust * self.tilt_compensation(&self.attitude),
            },
            _ => return None,
        })
    }
}
