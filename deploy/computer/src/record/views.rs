use core::marker::PhantomData;

use alight_shared::{
    msg::{
        AutopilotState, DeckForecast, DeckStage, DroneState, LinkState, MissionState, Motors, Plan,
        ReasonCode, SLOPE_STEP, SensorReadings, SetPoint, SetPointKind, State, VesselEstimate, WaveMode,
        WaveModel,
    },
    time::{Clock, DroneTime, Span, Time, WorldTime},
    vessel_model::{HEAVE, Mode, PITCH, ROLL},
};
use foxglove::{
    Encode,
    messages::{
        FrameTransform, FrameTransforms, Log, Odometry, PointCloud, Pose, PoseInFrame, PosesInFrame,
        Timestamp, log,
    },
};
use mcap::McapError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::record::{
    cloud,
    geometry::{frame, pose, quaternion, vector},
    messages::Message,
    schema,
    sink::{ChannelId, OpenChannels, TakeMessages},
};

/// Display periods, ms: paths and states; attitudes and positions near a drone; attitudes and positions without a
/// drone.
const SLOW_MS: i64 = 100;
const FAST_MS: i64 = 40;
const ALONE_MS: i64 = 200;

pub struct ViewTopic<M>(ChannelId, PhantomData<M>);

impl<M: Encode> ViewTopic<M> {
    pub fn open(opening: &mut impl OpenChannels, name: &str) -> Result<ViewTopic<M>, McapError> {
        let schema = M::get_schema().unwrap_or_else(|| foxglove::Schema::new("", "", &b""[..]));
        let channel = opening.protobuf(name, (&schema.name, &schema.data))?;
        Ok(ViewTopic(channel, PhantomData))
    }
    pub fn put(&self, sink: &mut impl TakeMessages, t: WorldTime, message: &M) {
        // A vector grows, so the encoding cannot run out of space.
        let _encoded = sink.message(self.0, stamp(t), |to| message.encode(to));
    }
}

pub fn stamp(t: WorldTime) -> u64 {
    u64::try_from(t.nanos()).unwrap_or_default()
}

pub fn timestamp(t: WorldTime) -> Timestamp {
    let ns = stamp(t);
    let seconds = u32::try_from(ns / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new_checked(seconds, (ns % 1_000_000_000) as u32).unwrap_or(Timestamp::MAX)
}

pub fn due(t: WorldTime, period_ms: i64) -> bool {
    t.nanos() % (period_ms * 1_000_000) == 0
}

pub fn transform(
    t: WorldTime,
    parent: &str,
    child: &str,
    at: [f64; 3],
    turned: &UnitQuaternion<f64>,
) -> FrameTransform {
    FrameTransform {
        timestamp: Some(timestamp(t)),
        parent_frame_id: parent.into(),
        child_frame_id: child.into(),
        translation: Some(vector(at)),
        rotation: Some(quaternion(turned)),
    }
}

/// Limits a rate to one message per period, independent of a time grid.
struct Throttle {
    last: WorldTime,
}

impl Throttle {
    const NEW: Throttle = Throttle { last: Time::EPOCH };
    fn passes(&mut self, t: WorldTime) -> bool {
        let passes = (t - self.last).nanos() >= SLOW_MS * 1_000_000;
        if passes {
            self.last = t;
        }
        passes
    }
}

pub struct Views {
    pub transforms: ViewTopic<FrameTransforms>,
    forecast_path: ViewTopic<PosesInFrame>,
    forecast_points: ViewTopic<PointCloud>,
    plan_path: ViewTopic<PosesInFrame>,
    plan_points: ViewTopic<PointCloud>,
    log: ViewTopic<Log>,
    tag: ViewTopic<PoseInFrame>,
    vessel_place: ViewTopic<Odometry>,
    drone_odometry: ViewTopic<Odometry>,
    estimate: ViewTopic<schema::VesselEstimate>,
    wave: ViewTopic<schema::WaveModel>,
    imu: ViewTopic<schema::Imu>,
    gnss: ViewTopic<schema::Gnss>,
    heading: ViewTopic<schema::Heading>,
    uvdar: ViewTopic<schema::Uvdar>,
    range: ViewTopic<schema::Range>,
    link: ViewTopic<schema::Link>,
    forecast: ViewTopic<schema::Forecast>,
    mission: ViewTopic<schema::Mission>,
    solver: ViewTopic<schema::Solver>,
    autopilot: ViewTopic<schema::Autopilot>,
    set_point: ViewTopic<schema::SetPoint>,
    /// The vessel's own computer is a source, so the state that a drone receives from it is not shown again.
    has_vessel: bool,
    /// True position of the drone in the vessel's NED, if known.
    pub true_drone: Option<[f64; 3]>,
    drone: Option<DroneState>,
    shown_state: Option<(State, ReasonCode)>,
    plan_at: Option<DroneTime>,
    plans: Throttle,
    estimates: Throttle,
    forecasts: Throttle,
}

impl Views {
    pub fn new(o: &mut impl OpenChannels) -> Result<Views, McapError> {
        Ok(Views {
            transforms: ViewTopic::open(o, "/tf")?,
            forecast_path: ViewTopic::open(o, "/deck/forecast/path")?,
            forecast_points: ViewTopic::open(o, "/points/forecast")?,
            plan_path: ViewTopic::open(o, "/plan/path")?,
            plan_points: ViewTopic::open(o, "/points/plan")?,
            log: ViewTopic::open(o, "/log")?,
            tag: ViewTopic::open(o, "/sensor/tag")?,
            vessel_place: ViewTopic::open(o, "/vessel/odometry")?,
            drone_odometry: ViewTopic::open(o, "/drone/odometry")?,
            estimate: ViewTopic::open(o, "/vessel/estimate")?,
            wave: ViewTopic::open(o, "/vessel/wave")?,
            imu: ViewTopic::open(o, "/sensor/imu")?,
            gnss: ViewTopic::open(o, "/sensor/gnss")?,
            heading: ViewTopic::open(o, "/sensor/heading")?,
            uvdar: ViewTopic::open(o, "/sensor/uvdar")?,
            range: ViewTopic::open(o, "/sensor/range")?,
            link: ViewTopic::open(o, "/link")?,
            forecast: ViewTopic::open(o, "/deck/forecast")?,
            mission: ViewTopic::open(o, "/mission")?,
            solver: ViewTopic::open(o, "/plan")?,
            autopilot: ViewTopic::open(o, "/drone/autopilot")?,
            set_point: ViewTopic::open(o, "/pilot/set_point")?,
            has_vessel: false,
            true_drone: None,
            drone: None,
            shown_state: None,
            plan_at: None,
            plans: Throttle::NEW,
            estimates: Throttle::NEW,
            forecasts: Throttle::NEW,
        })
    }

    /// Whether attitudes and positions are due; the period is longer before the drone appears.
    pub fn fast(&self, t: WorldTime) -> bool {
        due(
            t,
            if self.true_drone.is_some() {
                FAST_MS
            } else {
                ALONE_MS
            },
        )
    }

    /// Shows a message at `t`, except the odometry of a received vessel, whose origin is a position of the vessel.
    pub fn message(&mut self, sink: &mut impl TakeMessages, t: WorldTime, message: &Message<'_>) {
        match *message {
            Message::Sensors(m) => self.sensors(sink, t, m),
            Message::OwnEstimate(m) => {
                self.has_vessel = true;
                if self.estimates.passes(t) {
                    self.estimate(sink, t, m);
                    self.vessel_odometry(sink, t, m);
                }
            }
            Message::OwnWave(m) => self.wave.put(sink, t, &wave(m)),
            Message::Estimate(m) => {
                if !self.has_vessel && self.estimates.passes(t) {
                    self.estimate(sink, t, m);
                }
            }
            Message::Wave(m) => {
                if !self.has_vessel {
                    self.wave.put(sink, t, &wave(m));
                }
            }
            Message::Deck(_) => {}
            Message::Link(m) => self.link(sink, t, m),
            Message::Tag(tag) => {
                let [w, x, y, z] = tag.attitude;
                let q = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
                let view = PoseInFrame {
                    timestamp: Some(timestamp(t)),
                    frame_id: frame::CAMERA.into(),
                    pose: Some(pose(tag.position, &q)),
                };
                self.tag.put(sink, t, &view);
            }
            Message::Uvdar(fix) => {
                let view = schema::Uvdar {
                    position_m: fix.position,
                    variance_m2: fix.variance,
                };
                self.uvdar.put(sink, t, &view);
            }
            Message::Range(range) => {
                let view = schema::Range {
                    range_m: range.range_m,
                    variance_m2: range.variance,
                };
                self.range.put(sink, t, &view);
            }
            Message::Forecast(m) => self.forecast(sink, t, m),
            Message::Drone(m) => {
                self.drone = Some(*m);
                if self.fast(t) {
                    self.odometry(sink, t, m);
                }
            }
            Message::Command(m) => self.line(sink, t, log::Level::Info, format!("command: {:?}", m.kind)),
            Message::Autopilot(m) => self.autopilot(sink, t, m),
            Message::Mission(m) => self.mission(sink, t, m),
            Message::Plan(now, m) => self.plan(sink, t, now, m),
            Message::FlownPlan(m) => self.plan_at = Some(m.header.at),
            Message::SetPoint(now, m) => self.set_point(sink, t, now, m),
            Message::Touchdown(touchdown) => {
                let text = format!(
                    "touchdown confirmed, contact suspected {:.2} s before",
                    (touchdown.header.at - touchdown.suspected_at).secs()
                );
                self.line(sink, t, log::Level::Info, text);
            }
        }
    }

    fn sensors(&mut self, sink: &mut impl TakeMessages, t: WorldTime, m: &SensorReadings) {
        if let (true, Some(imu)) = (self.fast(t), m.imu.last()) {
            let view = schema::Imu {
                gyro_radps: imu.gyro,
                accelerometer_mps2: imu.accelerometer,
            };
            self.imu.put(sink, t, &view);
        }
        for fix in m.gnss.iter() {
            let view = schema::Gnss {
                position_m: fix.position,
                velocity_mps: fix.velocity,
                position_sd_m: fix.position_sd,
                velocity_sd_mps: fix.velocity_sd,
            };
            self.gnss.put(sink, t, &view);
        }
        for fix in m.heading.iter() {
            let view = schema::Heading {
                heading_deg: fix.heading.to_degrees(),
                heading_sd_deg: fix.heading_sd.to_degrees(),
            };
            self.heading.put(sink, t, &view);
        }
    }

    fn estimate<C: Clock>(&self, sink: &mut impl TakeMessages, t: WorldTime, e: &VesselEstimate<C>) {
        let dot = e.eta_dot.map(f64::from);
        let [variance, variance_dot] = variances(e);
        let [_, _, _, roll, pitch, yaw] = e.eta;
        let view = schema::VesselEstimate {
            eta: e.eta,
            eta_dot: dot,
            eta_ddot: e.eta_ddot.map(f64::from),
            variance_eta: variance,
            variance_eta_dot: variance_dot,
            roll_deg: roll.to_degrees(),
            pitch_deg: pitch.to_degrees(),
            yaw_deg: yaw.to_degrees(),
        };
        self.estimate.put(sink, t, &view);
    }

    fn vessel_odometry<C: Clock>(&self, sink: &mut impl TakeMessages, t: WorldTime, e: &VesselEstimate<C>) {
        let dot = e.eta_dot.map(f64::from);
        let [variance, variance_dot] = variances(e);
        let [x, y, z, roll, pitch, yaw] = e.eta;
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let velocity = q.inverse() * Vector3::new(dot[0], dot[1], dot[2]);
        let odometry = Odometry {
            timestamp: Some(timestamp(t)),
            frame_id: frame::NED.into(),
            body_frame_id: frame::VESSEL.into(),
            pose: Some(pose([x, y, z], &q)),
            linear_velocity: Some(vector(velocity.into())),
            angular_velocity: None,
            pose_covariance: diagonal(variance),
            velocity_covariance: diagonal(variance_dot),
            metadata: Vec::new(),
        };
        self.vessel_place.put(sink, t, &odometry);
    }

    fn link(&self, sink: &mut impl TakeMessages, t: WorldTime, l: &LinkState) {
        let view = schema::Link {
            clock_offset_s: l.clock_offset_s,
            clock_offset_sd_s: l.clock_offset_sd_s,
            age_s: l.age_s,
            loss: l.loss,
            out_of_order: l.out_of_order,
            latency_p50_s: l.latency_p50_s,
            latency_p99_s: l.latency_p99_s,
            rejected: l.rejected,
        };
        self.link.put(sink, t, &view);
    }

    fn forecast(&mut self, sink: &mut impl TakeMessages, t: WorldTime, f: &DeckForecast) {
        // A throttle, not a time grid, because the forecast comes on the predictor's ticks.
        if !self.forecasts.passes(t) {
            return;
        }
        let poses = f
            .stages
            .iter()
            .step_by(2)
            .map(|s| stage_pose(s.position, s.euler));
        let path = path(t, poses);
        self.forecast_points
            .put(sink, t, &cloud::forecast(timestamp(t), &path.poses));
        self.forecast_path.put(sink, t, &path);
        self.forecast.put(sink, t, &forecast(f));
    }

    fn odometry(&self, sink: &mut impl TakeMessages, t: WorldTime, d: &DroneState) {
        let square = |sd: [f64; 3]| sd.map(|s| s * s);
        let [a, b, c] = square(d.position_sd);
        let [e, f, g] = square(d.euler_sd);
        let [h, i, j] = square(d.velocity_sd);
        let q = d.attitude();
        let odometry = Odometry {
            timestamp: Some(timestamp(t)),
            frame_id: frame::DRONE_NED.into(),
            body_frame_id: frame::DRONE.into(),
            pose: Some(pose(d.position, &q)),
            linear_velocity: Some(vector((q.inverse() * d.velocity()).into())),
            angular_velocity: Some(vector(d.rates)),
            pose_covariance: diagonal([a, b, c, e, f, g]),
            velocity_covariance: diagonal([h, i, j, 0.0, 0.0, 0.0]),
            metadata: Vec::new(),
        };
        self.drone_odometry.put(sink, t, &odometry);
        // Forecast and plan are in the drone's own NED frame, which is placed so that the odometry matches the drone.
        if let Some(at) = self.true_drone {
            let offset = Vector3::from(at) - d.position();
            let still = UnitQuaternion::identity();
            let transforms = vec![transform(t, frame::NED, frame::DRONE_NED, offset.into(), &still)];
            self.transforms.put(sink, t, &FrameTransforms { transforms });
        }
    }

    fn autopilot(&self, sink: &mut impl TakeMessages, t: WorldTime, a: &AutopilotState) {
        let view = schema::Autopilot {
            mode: format!("{:?}", a.mode),
            armed: a.armed,
            battery: a.battery,
            battery_v: a.battery_v,
            battery_a: a.battery_a,
            set_points_lost: a.set_points_lost,
            thrust: a.thrust,
            hover_thrust: a.hover_thrust,
            shadow_apart_deg: a.shadow.map(|s| s.apart_rad.to_degrees()),
            shadow_apart_mps: a.shadow.map(|s| s.apart_mps),
        };
        self.autopilot.put(sink, t, &view);
    }

    /// Shows the mission's state, with a log line when state or reason changes.
    fn mission(&mut self, sink: &mut impl TakeMessages, t: WorldTime, m: &MissionState) {
        let now = Some((m.state, m.waiting.code));
        let entered = self.shown_state.map(|s| s.0) != Some(m.state);
        if entered || self.shown_state != now || due(t, SLOW_MS) {
            let because = m.entered.to_string();
            let waiting = m.waiting.to_string();
            if entered {
                let level = if m.state == State::GaveUp {
                    log::Level::Error
                } else if m.state.is_setback() {
                    log::Level::Warning
                } else {
                    log::Level::Info
                };
                self.line(sink, t, level, format!("{}: {because}", m.state.name()));
            } else if self.shown_state != now && m.waiting.code != ReasonCode::None {
                let text = format!("{} waits: {waiting}", m.state.name());
                self.line(sink, t, log::Level::Debug, text);
            }
            let wind = self.drone.and_then(|d| d.wind);
            let view = schema::Mission {
                state: m.state.name().into(),
                entered_because: because,
                waiting_because: waiting,
                state_number: m.state as u32,
                attempts: m.attempts,
                height_m: m.height_m,
                descent_mps: m.descent_mps,
                wind_north_mps: wind.map(|[north, _]| north),
                wind_east_mps: wind.map(|[_, east]| east),
                wind_speed_mps: wind.map(|[north, east]| north.hypot(east)),
                wind_sd_mps: self.drone.and_then(|d| d.wind_sd_mps),
            };
            self.mission.put(sink, t, &view);
        }
        self.shown_state = now;
    }

    fn line(&self, sink: &mut impl TakeMessages, t: WorldTime, level: log::Level, message: String) {
        let line = Log {
            timestamp: Some(timestamp(t)),
            level: level.into(),
            message,
            name: "mission".into(),
            ..Log::default()
        };
        self.log.put(sink, t, &line);
    }

    fn plan(&mut self, sink: &mut impl TakeMessages, t: WorldTime, now: DroneTime, plan: &Plan) {
        if !self.plans.passes(t) {
            return;
        }
        self.solver.put(sink, t, &solver(plan, now));
        let poses = plan
            .stages
            .iter()
            .step_by(2)
            .map(|s| stage_pose(s.position, s.euler));
        let path = path(t, poses);
        self.plan_points
            .put(sink, t, &cloud::plan(timestamp(t), &path.poses));
        self.plan_path.put(sink, t, &path);
    }

    fn set_point(&self, sink: &mut impl TakeMessages, t: WorldTime, now: DroneTime, s: &SetPoint) {
        if !self.fast(t) {
            return;
        }
        let (roll, pitch, yaw) = s.attitude().euler_angles();
        let view = schema::SetPoint {
            kind: match s.kind {
                SetPointKind::None => "none",
                SetPointKind::Trajectory => "trajectory",
                SetPointKind::Attitude => "attitude",
            }
            .into(),
            motors: match s.motors {
                Motors::Run => "run",
                Motors::Stop => "stop",
            }
            .into(),
            position_m: s.position,
            velocity_mps: s.velocity,
            acceleration_mps2: s.acceleration,
            roll_deg: roll.to_degrees(),
            pitch_deg: pitch.to_degrees(),
            yaw_deg: yaw.to_degrees(),
            thrust: s.thrust,
            plan_age_s: self.plan_at.map(|at| (now - at).secs()),
        };
        self.set_point.put(sink, t, &view);
    }
}

/// Variances of the degrees of freedom and of their rates.
fn variances<C: Clock>(e: &VesselEstimate<C>) -> [[f64; 6]; 2] {
    [0, 2].map(|k: usize| core::array::from_fn(|d| e.covariance(d)[k]))
}

fn wave<C: Clock>(w: &WaveModel<C>) -> schema::WaveModel {
    let of = |f: fn(&WaveMode) -> f32| w.modes.iter().map(|c| f64::from(f(c))).collect();
    let size = |dof: usize| w.modes.iter().map(|m| Mode::from(m).shape[dof].norm()).collect();
    schema::WaveModel {
        significant_height_m: f64::from(w.significant_height_m),
        confidence: f64::from(w.confidence),
        omega_radps: of(|m| m.pole[1]),
        decay_1ps: of(|m| -m.pole[0]),
        heave_m: size(HEAVE),
        tilt_north_rad: size(ROLL),
        tilt_east_rad: size(PITCH),
        apparent_slopes: w.slopes.iter().map(|s| f64::from(*s) * SLOPE_STEP).collect(),
    }
}

fn forecast(f: &DeckForecast) -> schema::Forecast {
    let now = f.stages.first();
    let ahead = f.at(f.header.at + Span::from_secs(1.0));
    let of = |stage: Option<&DeckStage>, sd: fn(&DeckStage) -> [f64; 3]| {
        stage.map_or_else(Vec::new, |s| sd(s).to_vec())
    };
    schema::Forecast {
        source: format!("{:?}", f.source),
        radio_age_s: f.radio_age_s,
        vision_age_s: f.vision_age_s,
        tag_age_s: f.tag_age_s,
        wave_confidence: f.wave_confidence,
        position_sd_m: of(now, |s| s.position_sd),
        euler_sd_rad: of(now, |s| s.euler_sd),
        ahead_1s_position_sd_m: of(ahead.as_ref(), |s| s.position_sd),
        ahead_1s_heave_m: ahead.as_ref().map(|s| -s.position[2]),
        ahead_1s_roll_deg: ahead.as_ref().map(|s| s.euler[0].to_degrees()),
        ahead_1s_pitch_deg: ahead.as_ref().map(|s| s.euler[1].to_degrees()),
        predicted_slopes: f
            .predicted_slopes
            .iter()
            .map(|[n, e]| f64::from(*n).hypot(f64::from(*e)) * SLOPE_STEP)
            .collect(),
    }
}

fn solver(plan: &Plan, now: DroneTime) -> schema::Solver {
    schema::Solver {
        solve: format!("{:?}", plan.solve),
        iterations: plan.iterations,
        touchdown_in_s: plan.touchdown_at.map(|at| (at - now).secs()),
        alignment: plan.alignment,
        stages: plan.stages.len() as u32,
    }
}

fn stage_pose(position: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Pose {
    pose(position, &UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn path(t: WorldTime, poses: impl Iterator<Item = Pose>) -> PosesInFrame {
    PosesInFrame {
        timestamp: Some(timestamp(t)),
        frame_id: frame::DRONE_NED.into(),
        poses: poses.collect(),
    }
}

/// Row-major 6 x 6 matrix with these variances on its diagonal.
fn diagonal(variances: [f64; 6]) -> Vec<f64> {
    let mut m = vec![0.0; 36];
    for (i, v) in variances.iter().enumerate() {
        m[7 * i] = *v;
    }
    m
}
