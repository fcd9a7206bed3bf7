//! Modes, failsafe on set-point loss, position control and land detector. They use the autopilot's own
//! estimate and the nominal airframe.

mod position_control;

use std::collections::{BTreeMap, VecDeque};

use alight_shared::{
    frames::yaw_rotation,
    geometry::{DroneGeometry, GRAVITY},
    msg::{AutopilotMode, LandedState},
    time::{Span, WorldTime},
};
use alight_uav::autopilot::modes::Firmware;
use nalgebra::{UnitQuaternion, Vector3};

use super::{
    attitude::{AttitudeSetPoint, RateLoop, rate_set_point},
    estimator::{Estimate, SimulatedErrors},
    failsafe::ALT_HOLD,
    mixer::Mixer,
    modes::{mode_number, own_mission},
    own_mission::OwnFlight,
    reference::{FlightReference, PositionReference},
    shaping::InputShaping,
    spool::{PULSE_OFF_US, Spool},
};
use crate::physics::drone::{AutopilotConfig, MAX_ROTORS, PlantState, RotorFrame};

/// Maximum interval between set-points of a stream, which PX4 requires before OFFBOARD.
const OFFBOARD_GAP: Span = Span::from_millis(500);
/// Minimum duration of that stream.
const OFFBOARD_STREAM: Span = Span::from_millis(800);

/// Validity of a landing target.
const TARGET_STALE: Span = Span::from_millis(1000);
/// Duration of the evidence after which PX4 assumes ground contact, s.
const GROUND_CONTACT_S: f64 = 0.35;
/// Maximum speed of the hold point towards a landing target, m/s, reached at a distance of 1 m.
const GUIDED_MPS: f64 = 2.0;

#[derive(Clone, Copy, Debug)]
struct Received {
    newest: FlightReference,
    at: WorldTime,
    /// Start of the current stream, whose intervals do not exceed [`OFFBOARD_GAP`].
    since: WorldTime,
}

/// Delay of PX4's controllers. The Commander publishes `vehicle_control_mode` at 2 Hz, and immediately when
/// the vehicle's status (arming, mode) changes. After a change of the set-point type, the controllers
/// therefore switch up to 0.5 s late. Measured with PX4 main of March 2026. ArduCopter has no such delay.
#[derive(Clone, Copy, Debug)]
struct ControlMode {
    /// Whether position control is active; None before the first publication.
    positions: Option<bool>,
    due: WorldTime,
}

const CONTROL_MODE: Span = Span::from_millis(500);

impl ControlMode {
    /// Whether position control is active at `now`; `positions` is true if the current set-points are positions.
    fn at(&mut self, now: WorldTime, positions: bool) -> bool {
        while now >= self.due {
            self.due += CONTROL_MODE;
            self.positions = Some(positions);
        }
        // A mode starts with its first set-point type.
        *self.positions.get_or_insert(positions)
    }
}

#[derive(Clone, Debug)]
pub(super) struct SimulatedFlight {
    config: AutopilotConfig,
    rate_loop: RateLoop,
    chosen: u32,
    /// Active mode: the commanded mode, or a failsafe's.
    mode: u32,
    armed: bool,
    landed: LandedState,
    received: Option<Received>,
    control_mode: ControlMode,
    track: Option<PositionReference>,
    /// Number of outer periods so far.
    period: u32,
    /// Hold position, used without a usable set-point and in modes other than OFFBOARD.
    hold: PositionReference,
    /// Destination of the return mode.
    pub(super) home: Vector3<f64>,
    /// Height above home at which a return ends in a hover, m; None: it lands.
    returns_to_m: Option<f64>,
    /// Landing target, and its time of arrival.
    guided: Option<(Vector3<f64>, WorldTime)>,
    integral: Vector3<f64>,
    hover_thrust: f64,
    still_s: f64,
    /// Duration of the evidence of ground contact, s.
    touches_s: f64,
    target: AttitudeSetPoint,
    /// Attitude targets within the dead time, with the times at which they take effect.
    delayed: VecDeque<(WorldTime, AttitudeSetPoint)>,
    in_force: AttitudeSetPoint,
    shaping: InputShaping,
    spool: Spool,
    pub(super) own: OwnFlight,
}

impl SimulatedFlight {
    /// Configures the mixer for a frame other than a quadrotor (PX4: CA_AIRFRAME and rotor geometry,
    /// ArduCopter: FRAME_CLASS).
    pub(super) fn set_frame(&mut self, drone: &DroneGeometry, frame: RotorFrame) {
        let mixer = self.rate_loop.mixer;
        self.rate_loop = RateLoop::new(drone, frame);
        self.rate_loop.mixer = mixer;
    }
    /// Armed drone that holds position in the air in a manual mode, with a hover thrust estimate converged to
    /// `hover_thrust`. PX4 publishes its control mode from the time `control_mode`.
    pub(super) fn new(
        config: &AutopilotConfig,
        drone: &DroneGeometry,
        estimate: &Estimate,
        hover_thrust: f64,
        control_mode: WorldTime,
    ) -> SimulatedFlight {
        let yaw = estimate.attitude.euler_angles().2;
        let mode = mode_number(config.firmware, AutopilotMode::Other);
        let still = Vector3::zeros();
        let target = AttitudeSetPoint {
            attitude: yaw_rotation(yaw),
            yaw_rate: 0.0,
            rates: still,
            thrust: hover_thrust,
        };
        SimulatedFlight {
            config: config.with_gains_of_firmware(),
            rate_loop: RateLoop::new(drone, RotorFrame::QuadX),
            chosen: mode,
            mode,
            armed: true,
            landed: LandedState::InAir,
            received: None,
            control_mode: ControlMode {
                positions: None,
                due: control_mode,
            },
            track: None,
            period: 0,
            hold: PositionReference {
                position: estimate.position,
                velocity: still,
                acceleration: still,
                yaw,
                yaw_rate: 0.0,
            },
            home: estimate.position,
            returns_to_m: None,
            guided: None,
            integral: still,
            hover_thrust,
            still_s: 0.0,
            touches_s: 0.0,
            target,
            delayed: VecDeque::new(),
            in_force: target,
            shaping: InputShaping::at(estimate.attitude),
            spool: Spool::RUNNING,
            own: OwnFlight::default(),
        }
    }

    pub(super) fn firmware(&self) -> Firmware {
        self.config.firmware
    }
    pub(super) fn chosen(&self) -> u32 {
        self.chosen
    }
    pub(super) fn mode(&self) -> u32 {
        self.mode
    }
    pub(super) fn armed(&self) -> bool {
        self.armed
    }
    pub(super) fn landed(&self) -> LandedState {
        self.landed
    }
    /// Commanded collective thrust; zero until ArduCopter's motors have spun up.
    pub(super) fn thrust(&self) -> f64 {
        if self.armed && self.spool.gives_thrust() {
            self.target.thrust
        } else {
            0.0
        }
    }
    pub(super) fn frame(&self) -> RotorFrame {
        self.rate_loop.frame
    }
    /// Mean pulse width of the motor outputs, us.
    pub(super) fn pulse_us(&self) -> f64 {
        if self.armed {
            self.spool.pulse_us(self.thrust())
        } else {
            PULSE_OFF_US
        }
    }
    /// ArduCopter reports the requested thrust before tilt compensation.
    pub(super) fn reported_thrust(&self) -> f64 {
        self.thrust() * self.tilt_compensation(&self.target.attitude)
    }
    pub(super) fn wanted(&self) -> UnitQuaternion<f64> {
        self.target.attitude
    }
    pub(super) fn hover_thrust(&self) -> f64 {
        self.hover_thrust
    }
    pub(super) fn hold_at(&mut self, position: Vector3<f64>) {
        self.hold.position = position;
    }
    pub(super) fn guide(&mut self, target: Vector3<f64>, now: WorldTime) {
        self.guided = Some((target, now));
    }
    /// Whether the newest set-point is an attitude.
    pub(super) fn follows_attitudes(&self) -> bool {
        let newest = self.received.map(|r| r.newest);
        matches!(newest, Some(FlightReference::Attitude(_)))
    }
    fn kind(&self) -> AutopilotMode {
        self.firmware().mode(self.mode)
    }

    /// Changes the mode; false if denied. PX4 denies OFFBOARD without a stream of set-points.
    pub(super) fn choose(&mut self, mode: u32, estimate: &Estimate, now: WorldTime) -> bool {
        let offboard = self.firmware().mode(mode) == AutopilotMode::Offboard;
        let streamed = |r: Received| now - r.at <= OFFBOARD_GAP && now - r.since >= OFFBOARD_STREAM;
        if offboard && self.firmware() == Firmware::Px4 && !self.received.is_some_and(streamed) {
            return false;
        }
        if offboard && self.firmware() == Firmware::ArduCopter {
            self.received = None;
        }
        if mode == own_mission(self.firmware()) && mode != self.mode && self.own.is_complete() {
            self.own.begin_again();
        }
        self.chosen = mode;
        self.enter(mode, estimate);
        true
    }
    pub(super) fn arm(&mut self, armed: bool, estimate: &Estimate) {
        if armed && !self.armed {
            self.hold_here(estimate);
            // The motors start at idle.
            self.target.thrust = 0.0;
            self.in_force = self.target;
            if self.firmware() == Firmware::ArduCopter {
                self.spool = Spool::begun();
            }
        }
        self.armed = armed;
        if !armed {
            if self.firmware() == Firmware::ArduCopter {
                self.own.begin_again();
            }
            self.landed = LandedState::OnGround;
            self.rate_loop.reset();
            self.integral = Vector3::zeros();
        }
    }

    /// An attitude set-point takes effect immediately unless position control is active.
    pub(super) fn take(&mut self, newest: FlightReference, now: WorldTime, estimate: &Estimate) {
        let before = self.received.filter(|r| now - r.at <= OFFBOARD_GAP);
        self.received = Some(Received {
            newest,
            at: now,
            since: before.map_or(now, |r| r.since),
        });
        let alone = self.firmware() == Firmware::ArduCopter || self.control_mode.positions == Some(false);
        if let FlightReference::Attitude(target) = newest
            && alone
            && self.kind() == AutopilotMode::Offboard
            && self.spool.gives_thrust()
        {
            self.follow_attitude(&target, estimate);
        }
    }
    fn follow_attitude(&mut self, target: &AttitudeSetPoint, estimate: &Estimate) {
        self.hold_here(estimate);
        self.target = *target;
        if self.firmware() == Firmware::ArduCopter {
            self.target.thrust = (target.thrust / self.tilt_compensation(&target.attitude)).min(1.0);
        }
    }
    /// Divisor by which ArduCopter increases the thrust of a tilted drone (ATC_ANGLE_BOOST).
    fn tilt_compensation(&self, attitude: &UnitQuaternion<f64>) -> f64 {
        match self.firmware() {
            Firmware::Px4 => 1.0,
            Firmware::ArduCopter => (attitude * Vector3::z()).z.clamp(0.1, 1.0),
        }
    }

    fn enter(&mut self, mode: u32, estimate: &Estimate) {
        if mode != self.mode {
            self.mode = mode;
            self.control_mode.positions = None;
            self.hold_here(estimate);
        }
    }
    fn hold_here(&mut self, estimate: &Estimate) {
        // Stopping point: v² / (2 a).
        let v = estimate.velocity;
        let [across, along] = self.config.stop_mps2;
        let sideways = v.xy() * (v.xy().norm() / (2.0 * across));
        let down = v.z * v.z.abs() / (2.0 * along);
        self.hold = PositionReference {
            position: estimate.position + Vector3::new(sideways.x, sideways.y, down),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            yaw: estimate.attitude.euler_angles().2,
            yaw_rate: 0.0,
        };
    }

    /// `levels`: without an estimate of the position, a mode that needs one levels the drone.
    pub(super) fn outer(
        &mut self,
        estimate: &Estimate,
        now: WorldTime,
        parameters: &BTreeMap<&'static str, f64>,
        levels: bool,
        dt: f64,
    ) {
        let parameter = |name| parameters.get(name).copied().unwrap_or(0.0);
        self.rate_loop.mixer = match self.firmware() {
            Firmware::Px4 => Mixer::Px4 {
                airmode: parameter("MC_AIRMODE") > 0.0,
            },
            Firmware::ArduCopter => Mixer::ArduCopter {
                hover: self.hover_thrust,
                mix: parameter("ATC_THR_MIX_MIN"),
            },
        };
        self.returns_to_m = match self.firmware() {
            Firmware::Px4 if parameter("RTL_LAND_DELAY") < 0.0 => Some(self.config.return_height_m),
            Firmware::Px4 => None,
            Firmware::ArduCopter => {
                let height_m = 0.01 * parameter("RTL_ALT_FINAL") + parameter("RTL_ALT_FINAL_M");
                if height_m > 0.0 { Some(height_m) } else { None }
            }
        };
        if !self.armed {
            return;
        }
        let timeout_s = match self.firmware() {
            Firmware::Px4 => parameter("COM_OF_LOSS_T"),
            Firmware::ArduCopter => parameter("GUID_TIMEOUT"),
        };
        let received = self.received.filter(|r| (now - r.at).secs() <= timeout_s);
        if self.firmware() == Firmware::ArduCopter && self.spool_up(received.map(|r| r.newest), estimate, dt)
        {
            // ArduCopter's landing mode ends on the ground with motors at idle.
            if self.spool.gives_thrust() {
                self.detect_landing(estimate, dt);
            }
            return;
        }
        self.lose_set_points(received.is_some(), parameter("COM_OBL_RC_ACT"), estimate);
        self.estimate_hover(estimate, dt);
        let offboard = self.kind() == AutopilotMode::Offboard;
        match received.filter(|_| offboard).map(|r| r.newest) {
            Some(newest) => self.offboard(newest, estimate, now, dt),
            None => {
                self.move_hold(estimate, now, dt);
                let hold = self.hold;
                self.target = self.follow(&hold, estimate, dt);
                if self.touches_ground(estimate, dt) {
                    self.integral = Vector3::zeros();
                    self.target = AttitudeSetPoint {
                        attitude: yaw_rotation(hold.yaw),
                        yaw_rate: 0.0,
                        rates: Vector3::zeros(),
                        thrust: self.config.min_thrust,
                    };
                }
                // Without attitude set-points ArduCopter levels the drone and commands no climb.
                if levels || self.mode == ALT_HOLD || offboard && self.follows_attitudes() {
                    self.target.attitude = yaw_rotation(hold.yaw);
                }
            }
        }
        self.detect_landing(estimate, dt);
    }

    /// ArduCopter's motors on the ground: off, spinning up when a set-point requests thrust, otherwise idle.
    /// Returns true while no control loop drives the rotors.
    fn spool_up(&mut self, newest: Option<FlightReference>, estimate: &Estimate, dt: f64) -> bool {
        let stands = self.landed == LandedState::OnGround;
        let wants = match (self.kind(), newest) {
            (AutopilotMode::Offboard, Some(FlightReference::Attitude(target))) => target.thrust > 0.0,
            // `is_disarmed_or_landed`: a position set-point does not start a take-off.
            (AutopilotMode::Offboard, Some(FlightReference::Track(_)) | None) => !stands,
            (AutopilotMode::Hold | AutopilotMode::Land | AutopilotMode::Return, _) => !stands,
            (AutopilotMode::Other, _) => true,
        };
        self.spool.step(wants, dt);
        // `make_safe_ground_handling`.
        let idles = stands && !wants || !self.spool.gives_thrust();
        if idles {
            self.hold_here(estimate);
            self.target.thrust = 0.0;
            self.rate_loop.reset();
            self.integral = Vector3::zeros();
        }
        idles
    }

    /// Follows a set-point. PX4's position control notices a change of the set-point type with a delay: until
    /// it notices that it is inactive, it and the attitude set-points write targets alternately; until it
    /// notices that it is active, the last attitude persists.
    fn offboard(&mut self, newest: FlightReference, estimate: &Estimate, now: WorldTime, dt: f64) {
        self.hold_here(estimate);
        self.period = self.period.wrapping_add(1);
        let sent = matches!(newest, FlightReference::Track(_));
        let known = match self.firmware() {
            Firmware::Px4 => self.control_mode.at(now, sent),
            Firmware::ArduCopter => sent,
        };
        if !known {
            self.integral = Vector3::zeros();
        }
        match newest {
            FlightReference::Track(track) => {
                self.track = Some(track);
                if known {
                    self.target = self.follow(&track, estimate, dt);
                }
            }
            FlightReference::Attitude(target) => match self.track {
                Some(track) if known && self.period.is_multiple_of(2) => {
                    self.target = self.follow(&track, estimate, dt);
                }
                Some(_) | None => self.follow_attitude(&target, estimate),
            },
        }
    }

    /// Reacts to set-point loss after COM_OF_LOSS_T: PX4 enters the mode configured by COM_OBL_RC_ACT and
    /// returns to OFFBOARD when set-points resume; ArduCopter stays in GUIDED and stops.
    fn lose_set_points(&mut self, some: bool, action: f64, estimate: &Estimate) {
        let offboard = self.firmware().mode(self.chosen) == AutopilotMode::Offboard;
        if !offboard || self.firmware() == Firmware::ArduCopter {
            return;
        }
        let mode = match (some, action as u32) {
            (true, _) => self.chosen,
            (false, 3) => mode_number(Firmware::Px4, AutopilotMode::Return),
            (false, 4) => mode_number(Firmware::Px4, AutopilotMode::Land),
            (false, 5) => mode_number(Firmware::Px4, AutopilotMode::Hold),
            (false, _) => mode_number(Firmware::Px4, AutopilotMode::Other),
        };
        self.enter(mode, estimate);
    }

    fn move_hold(&mut self, estimate: &Estimate, now: WorldTime, dt: f64) {
        self.hold.velocity = Vector3::zeros();
        match self.kind() {
            AutopilotMode::Other if self.flies_own_mission() => self.fly_own_mission(estimate, dt),
            AutopilotMode::Offboard | AutopilotMode::Other | AutopilotMode::Hold => {}
            AutopilotMode::Land => {
                self.towards_target(now, dt);
                self.sink(estimate, dt);
            }
            AutopilotMode::Return => {
                let away = self.home.xy() - estimate.position.xy();
                let up = -self.config.return_height_m;
                if away.norm() < 1.0 {
                    let above_home = self.home.z - estimate.position.z;
                    if self.returns_to_m.is_none_or(|height_m| above_home > height_m) {
                        self.sink(estimate, dt);
                    }
                } else if estimate.position.z > up + 1.0 {
                    self.hold.position.z = self.hold.position.z.max(up) - 2.0 * dt;
                    self.hold.velocity.z = -2.0;
                } else {
                    let speed = away.normalize() * away.norm().min(5.0);
                    self.hold.velocity = Vector3::new(speed.x, speed.y, 0.0);
                    self.hold.position += self.hold.velocity * dt;
                }
            }
        }
    }
    pub(super) fn flies_own_mission(&self) -> bool {
        self.mode == own_mission(self.firmware())
    }
    fn fly_own_mission(&mut self, estimate: &Estimate, dt: f64) {
        let firmware = self.firmware();
        let at = &mut self.hold.position;
        self.hold.velocity = self.own.fly(firmware, at, &estimate.position, dt);
        if self.own.is_complete() && firmware == Firmware::Px4 {
            let hold = mode_number(firmware, AutopilotMode::Hold);
            self.chosen = hold;
            self.enter(hold, estimate);
        }
    }
    /// Precision landing: moves the hold point towards a fresh landing target at a speed proportional to the distance.
    fn towards_target(&mut self, now: WorldTime, dt: f64) {
        let Some((target, _)) = self.guided.filter(|(_, at)| now - *at <= TARGET_STALE) else {
            return;
        };
        let away = target.xy() - self.hold.position.xy();
        let speed = away * (GUIDED_MPS / away.norm().max(1.0));
        self.hold.velocity = Vector3::new(speed.x, speed.y, 0.0);
        self.hold.position += self.hold.velocity * dt;
    }
    fn sink(&mut self, estimate: &Estimate, dt: f64) {
        self.hold.velocity.z = self.config.land_mps;
        // The hold point leads by at most 1 m, which lets ground contact unload the rotors.
        self.hold.position.z =
            (self.hold.position.z + self.config.land_mps * dt).min(estimate.position.z + 1.0);
    }

    /// Estimates the hover thrust from the lift at the current thrust, `T_h = T g / f_lift`, smoothed (PX4's
    /// hover thrust estimator with a fixed gain). Paused on the ground and during shocks.
    fn estimate_hover(&mut self, e: &Estimate, dt: f64) {
        let lift = -e.specific_force.z;
        if self.landed == LandedState::OnGround
            || !(0.5 * GRAVITY..1.5 * GRAVITY).contains(&lift)
            || self.target.thrust < 0.5 * self.hover_thrust
        {
            return;
        }
        let sample = self.target.thrust * GRAVITY / lift;
        let k = dt / self.config.hover_thrust_s;
        self.hover_thrust = (self.hover_thrust + k * (sample - self.hover_thrust)).clamp(0.1, 0.9);
    }

    /// PX4's ground contact in a commanded descent, after which position control commands level attitude and minimum
    /// thrust (`MulticopterLandDetector`, `MulticopterPositionControl`). In a hold PX4 corrects its position on the deck.
    fn touches_ground(&mut self, e: &Estimate, dt: f64) -> bool {
        let descends = self.firmware() == Firmware::Px4 && self.hold.velocity.z > 0.0;
        let least = self.config.min_thrust;
        let low = self.target.thrust <= least + 0.6 * (self.hover_thrust - least);
        let still = e.velocity.z.abs() < 0.25 && e.velocity.xy().norm() < 1.5;
        self.touches_s = if descends && low && still {
            self.touches_s + dt
        } else {
            0.0
        };
        self.touches_s >= GROUND_CONTACT_S
    }

    /// PX4's land detector, simplified: disarmed, or low thrust and low speed for 1 s. The landing mode then disarms.
    fn detect_landing(&mut self, e: &Estimate, dt: f64) {
        let quiet = self.target.thrust < 0.6 * self.hover_thrust
            && e.velocity.z.abs() < 0.25
            && e.velocity.xy().norm() < 0.5
            && e.rates.norm() < 0.35;
        self.still_s = if quiet { self.still_s + dt } else { 0.0 };
        // ArduCopter stays landed until the throttle exceeds half the hover throttle (`get_non_takeoff_throttle`).
        let stays = self.firmware() == Firmware::ArduCopter
            && self.landed == LandedState::OnGround
            && self.target.thrust <= 0.5 * self.hover_thrust;
        self.landed = if !self.armed || stays || self.still_s >= 1.0 {
            LandedState::OnGround
        } else {
            LandedState::InAir
        };
        let by_itself = matches!(self.kind(), AutopilotMode::Land | AutopilotMode::Return);
        if by_itself && self.still_s >= 2.0 {
            self.arm(false, e);
        }
    }

    /// One step of the inner loops over `dt`; None if the motors are stopped. They use the true state plus
    /// the last estimate's errors, which hardly change within an outer period.
    pub(super) fn inner(
        &mut self,
        errors: &SimulatedErrors,
        truth: &PlantState,
        dt: f64,
    ) -> Option<[f64; MAX_ROTORS]> {
        let is = errors.attitude * truth.attitude;
        if !self.armed {
            self.delayed.clear();
            self.shaping = InputShaping::at(is);
            return None;
        }
        let target = self.active_target(truth.at);
        if !self.spool.gives_thrust() {
            self.shaping = InputShaping::at(is);
            return self.spool.turns().then_some([0.0; MAX_ROTORS]);
        }
        let c = &self.config;
        let wanted = match self.firmware() {
            // PX4 ignores the rate set-point.
            Firmware::Px4 => rate_set_point(c, &target, &is),
            Firmware::ArduCopter => {
                let tc = c.attitude_lag_s();
                self.shaping.step(&target, &is, tc, c.max_yaw_rate_rps, dt)
            }
        };
        let rates = truth.rates + errors.rates;
        Some(
            self.rate_loop
                .step(&self.config, &wanted, &rates, target.thrust, dt),
        )
    }

    /// Newest target whose dead time has passed.
    fn active_target(&mut self, now: WorldTime) -> AttitudeSetPoint {
        let dead = Span::from_secs(self.config.dead_time_s);
        if dead <= Span::ZERO {
            return self.target;
        }
        self.delayed.push_back((now + dead, self.target));
        while let Some(&(at, target)) = self.delayed.front()
            && at <= now
        {
            self.delayed.pop_front();
            self.in_force = target;
        }
        self.in_force
    }
}
