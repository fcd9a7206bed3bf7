//! What a person looks at: transforms, shapes, paths, states and figures at display rates.

use alight_bridge::BridgeOut;
use alight_shared::frames::{Deck, DroneBody, VesselBody};
use alight_shared::msg::{
    DeckForecast, DroneState, Motors, Plan, ReasonCode, SLOPE_STEP, SetPointKind, State,
};
use alight_shared::time::{DroneClock, Time, TrueTime};
use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::body::RigidState;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::PlannerOut;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{VesselIn, VesselOut};
use foxglove::Encode;
use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, Odometry, PointCloud, PoseInFrame, PosesInFrame, SceneUpdate,
    Timestamp, log,
};
use mcap::McapError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::record::cloud;
use crate::record::figures;
use crate::record::flat::Flat;
use crate::record::flat::Value;
use crate::record::flat::Value::{Number as N, Numbers as V, Text as T};
use crate::record::recorder::stamp;
use crate::record::scene;
use crate::record::scene::{frame, pose, quaternion, vector};
use crate::record::sink::{Channel, Opening, Sink};

/// Periods of what is shown, ms: paths and states, attitudes and positions (before the drone
/// appears there is little to see), shapes.
const SLOW_MS: i64 = 100;
const FAST_MS: i64 = 40;
const ALONE_MS: i64 = 200;
const SCENE_MS: i64 = 5_000;

/// A channel of figures.
struct Figures(Flat, Channel);

impl Figures {
    fn open(opening: &mut Opening, topic: &str, flat: Flat) -> Result<Figures, McapError> {
        let channel = opening.protobuf(topic, (&flat.full_name(), &flat.descriptor_set()))?;
        Ok(Figures(flat, channel))
    }
    fn put(&self, sink: &mut Sink, t: Time<TrueTime>, values: &[Value<'_>]) {
        let Ok(()) = sink.message(self.1, stamp(t), |to| {
            self.0.encode(to, values);
            Ok::<(), core::convert::Infallible>(())
        });
    }
}

/// Points for viewers that do not draw a scene.
struct Clouds {
    deck: Channel,
    drone: Channel,
    forecast: Channel,
    plan: Channel,
}

impl Clouds {
    fn open(o: &mut Opening) -> Result<Clouds, McapError> {
        Ok(Clouds {
            deck: well_known::<PointCloud>(o, "/points/deck")?,
            drone: well_known::<PointCloud>(o, "/points/drone")?,
            forecast: well_known::<PointCloud>(o, "/points/forecast")?,
            plan: well_known::<PointCloud>(o, "/points/plan")?,
        })
    }
}

fn well_known<M: Encode>(opening: &mut Opening, topic: &str) -> Result<Channel, McapError> {
    let schema = M::get_schema().unwrap_or_else(|| foxglove::Schema::new("", "", &b""[..]));
    opening.protobuf(topic, (&schema.name, &schema.data))
}

fn put<M: Encode>(sink: &mut Sink, channel: Channel, t: Time<TrueTime>, message: &M) {
    // A vector grows: the encoding cannot fail for lack of room.
    let _encoded = sink.message(channel, stamp(t), |to| message.encode(to));
}

fn timestamp(t: Time<TrueTime>) -> Timestamp {
    let ns = stamp(t);
    let seconds = u32::try_from(ns / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new_checked(seconds, (ns % 1_000_000_000) as u32).unwrap_or(Timestamp::MAX)
}

fn due(t: Time<TrueTime>, period_ms: i64) -> bool {
    t.nanos() % (period_ms * 1_000_000) == 0
}

/// Channels, and what was shown last.
pub struct Show {
    scenario: Scenario,
    transforms: Channel,
    scene: Channel,
    forecast_path: Channel,
    plan_path: Channel,
    clouds: Clouds,
    log: Channel,
    tag: Channel,
    vessel_odometry: Channel,
    drone_odometry: Channel,
    truth: Figures,
    estimate: Figures,
    wave: Figures,
    imu: Figures,
    gnss: Figures,
    heading: Figures,
    uvdar: Figures,
    range: Figures,
    link: Figures,
    forecast: Figures,
    mission: Figures,
    solver: Figures,
    autopilot: Figures,
    set_point: Figures,
    /// The true drone at this tick.
    drone: Option<[f64; 3]>,
    shown_state: Option<(State, ReasonCode)>,
    plan_at: Option<Time<DroneClock>>,
    plan_shown: Time<TrueTime>,
    estimate_shown: Time<TrueTime>,
    forecast_shown: Time<TrueTime>,
}

impl Show {
    /// Opens all channels.
    pub fn new(opening: &mut Opening, scenario: &Scenario) -> Result<Show, McapError> {
        let o = opening;
        Ok(Show {
            scenario: scenario.clone(),
            transforms: well_known::<FrameTransforms>(o, "/tf")?,
            scene: well_known::<SceneUpdate>(o, "/scene")?,
            forecast_path: well_known::<PosesInFrame>(o, "/deck/forecast/path")?,
            plan_path: well_known::<PosesInFrame>(o, "/plan/path")?,
            clouds: Clouds::open(o)?,
            log: well_known::<Log>(o, "/log")?,
            tag: well_known::<PoseInFrame>(o, "/sensor/tag")?,
            vessel_odometry: well_known::<Odometry>(o, "/vessel/odometry")?,
            drone_odometry: well_known::<Odometry>(o, "/drone/odometry")?,
            truth: Figures::open(o, "/truth", figures::TRUTH)?,
            estimate: Figures::open(o, "/vessel/estimate", figures::VESSEL_ESTIMATE)?,
            wave: Figures::open(o, "/vessel/wave", figures::WAVE)?,
            imu: Figures::open(o, "/sensor/imu", figures::IMU)?,
            gnss: Figures::open(o, "/sensor/gnss", figures::GNSS)?,
            heading: Figures::open(o, "/sensor/heading", figures::HEADING)?,
            uvdar: Figures::open(o, "/sensor/uvdar", figures::UVDAR)?,
            range: Figures::open(o, "/sensor/range", figures::RANGE)?,
            link: Figures::open(o, "/link", figures::LINK)?,
            forecast: Figures::open(o, "/deck/forecast", figures::FORECAST)?,
            mission: Figures::open(o, "/mission", figures::MISSION)?,
            solver: Figures::open(o, "/plan", figures::SOLVER)?,
            autopilot: Figures::open(o, "/drone/autopilot", figures::AUTOPILOT)?,
            set_point: Figures::open(o, "/pilot/set_point", figures::SET_POINT)?,
            drone: None,
            shown_state: None,
            plan_at: None,
            plan_shown: Time::EPOCH,
            estimate_shown: Time::EPOCH,
            forecast_shown: Time::EPOCH,
        })
    }

    /// Transforms, shapes and the relation of drone and deck.
    pub fn truth(
        &mut self,
        sink: &mut Sink,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&RigidState<DroneBody>>,
    ) {
        let appeared = self.drone.is_none() && drone.is_some();
        self.drone = drone.map(|d| d.position.0.into());
        if due(t, SCENE_MS) || appeared {
            put(sink, self.scene, t, &scene::scene(timestamp(t), &self.scenario));
            let now = timestamp(t);
            put(sink, self.clouds.deck, t, &cloud::deck(now, &self.scenario.deck));
            if drone.is_some() {
                put(sink, self.clouds.drone, t, &cloud::drone(now, &self.scenario));
            }
        }
        if !self.fast(t) {
            return;
        }
        let deck: RigidState<Deck> = vessel.at(self.scenario.deck.centre());
        let north_east_down = UnitQuaternion::new_normalize(Quaternion::new(0.0, 1.0, 1.0, 0.0));
        let still = UnitQuaternion::identity();
        let mut transforms = vec![
            self.transform(t, frame::WORLD, frame::NED, [0.0; 3], &north_east_down),
            self.transform(
                t,
                frame::NED,
                frame::VESSEL,
                vessel.position.0.into(),
                &vessel.attitude.0,
            ),
            self.transform(t, frame::VESSEL, frame::DECK, self.scenario.deck.centre_m, &still),
        ];
        if let Some(d) = drone {
            // The camera looks down, the top of its image is forward.
            let down = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), core::f64::consts::FRAC_PI_2);
            let camera = self.scenario.airframe.camera_m;
            transforms.push(self.transform(t, frame::NED, frame::DRONE, d.position.0.into(), &d.attitude.0));
            transforms.push(self.transform(t, frame::DRONE, frame::CAMERA, camera, &down));
            self.relation(sink, t, &deck, d);
        }
        put(sink, self.transforms, t, &FrameTransforms { transforms });
    }

    /// Time for attitudes and positions?
    fn fast(&self, t: Time<TrueTime>) -> bool {
        due(t, if self.drone.is_some() { FAST_MS } else { ALONE_MS })
    }

    fn transform(
        &self,
        t: Time<TrueTime>,
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

    fn relation(
        &self,
        sink: &mut Sink,
        t: Time<TrueTime>,
        deck: &RigidState<Deck>,
        drone: &RigidState<DroneBody>,
    ) {
        let (offset, speed) = (drone.position - deck.position, drone.velocity.0 - deck.velocity.0);
        let up = (deck.attitude.inverse() * offset).0;
        let tilt = deck.attitude.down().dot(&drone.attitude.down());
        let (d, q) = (
            deck.euler().map(f64::to_degrees),
            drone.euler().map(f64::to_degrees),
        );
        let values = [
            N(-deck.position.0.z),
            N(d.x),
            N(d.y),
            N(d.z),
            V(deck.velocity.0.as_slice()),
            N(q.x),
            N(q.y),
            N(q.z),
            V(drone.velocity.0.as_slice()),
            N(offset.0.xy().norm()),
            N(-up.z - self.scenario.airframe.feet_below_m),
            N(speed.norm()),
            N(tilt.clamp(-1.0, 1.0).acos().to_degrees()),
        ];
        self.truth.put(sink, t, &values);
    }

    /// The vessel's sensors and its broadcast.
    pub fn vessel(&mut self, sink: &mut Sink, t: Time<TrueTime>, i: &VesselIn, o: &VesselOut) {
        if let (true, Some(imu)) = (self.fast(t), i.imu.last()) {
            self.imu.put(sink, t, &[V(&imu.gyro), V(&imu.accelerometer)]);
        }
        for fix in &i.gnss {
            let values = [&fix.position, &fix.velocity, &fix.position_sd, &fix.velocity_sd];
            self.gnss.put(sink, t, &values.map(|v| V(v)));
        }
        for fix in &i.heading {
            let values = [fix.heading, fix.heading_sd].map(|v| N(v.to_degrees()));
            self.heading.put(sink, t, &values);
        }
        if let Some(e) = &o.estimate
            && (t - self.estimate_shown).nanos() >= SLOW_MS * 1_000_000
        {
            self.estimate_shown = t;
            let (dot, ddot) = (e.eta_dot.map(f64::from), e.eta_ddot.map(f64::from));
            let variance = e.covariance.map(|b| f64::from(b[0]));
            let variance_dot = e.covariance.map(|b| f64::from(b[2]));
            let [roll, pitch, yaw] = [e.eta[3], e.eta[4], e.eta[5]];
            let values = [
                V(&e.eta),
                V(&dot),
                V(&ddot),
                V(&variance),
                V(&variance_dot),
                N(roll.to_degrees()),
                N(pitch.to_degrees()),
                N(yaw.to_degrees()),
            ];
            self.estimate.put(sink, t, &values);
            let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let velocity = q.inverse() * Vector3::new(dot[0], dot[1], dot[2]);
            let odometry = Odometry {
                timestamp: Some(timestamp(t)),
                frame_id: frame::NED.into(),
                body_frame_id: frame::VESSEL.into(),
                pose: Some(pose([e.eta[0], e.eta[1], e.eta[2]], &q)),
                linear_velocity: Some(vector(velocity.into())),
                angular_velocity: None,
                pose_covariance: diagonal(variance),
                velocity_covariance: diagonal(variance_dot),
                metadata: Vec::new(),
            };
            put(sink, self.vessel_odometry, t, &odometry);
        }
        if let Some(w) = &o.wave {
            let of = |f: fn(&alight_shared::msg::WaveComponent) -> f32| -> Vec<f64> {
                w.components.iter().map(|c| f64::from(f(c))).collect()
            };
            let slopes: Vec<f64> = w.slopes.iter().map(|s| f64::from(*s) * SLOPE_STEP).collect();
            let values = [
                N(f64::from(w.significant_height_m)),
                N(f64::from(w.confidence)),
                N(f64::from(w.wave_following_deficit)),
                V(&of(|c| c.omega)),
                V(&of(|c| c.direction)),
                V(&of(|c| c.omega_encounter)),
                V(&slopes),
            ];
            self.wave.put(sink, t, &values);
        }
    }

    /// The link.
    pub fn bridge(&mut self, sink: &mut Sink, t: Time<TrueTime>, o: &BridgeOut) {
        let Some(l) = &o.link else { return };
        let values = [
            l.clock_offset_s,
            l.clock_offset_sd_s,
            l.age_s,
            l.loss,
            l.out_of_order,
            l.latency_p50_s,
            l.latency_p99_s,
            f64::from(l.rejected),
        ];
        self.link.put(sink, t, &values.map(N));
    }

    /// The drone's sensors and the forecast.
    pub fn predictor(&mut self, sink: &mut Sink, t: Time<TrueTime>, i: &PredictorIn, o: &PredictorOut) {
        for tag in &i.tags {
            let [w, x, y, z] = tag.attitude;
            let q = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
            let seen = PoseInFrame {
                timestamp: Some(timestamp(t)),
                frame_id: frame::CAMERA.into(),
                pose: Some(pose(tag.position, &q)),
            };
            put(sink, self.tag, t, &seen);
        }
        for fix in &i.uvdar {
            self.uvdar.put(sink, t, &[V(&fix.position), V(&fix.variance)]);
        }
        if let Some(range) = i.ranges.last() {
            self.range.put(sink, t, &[N(range.range_m), N(range.variance)]);
        }
        if let (true, Some(d)) = (self.fast(t), &i.drone) {
            self.odometry(sink, t, d);
        }
        // Not on a grid of its own: the forecast comes on the predictor's ticks, not on ours.
        if let Some(f) = &o.forecast
            && (t - self.forecast_shown).nanos() >= SLOW_MS * 1_000_000
        {
            self.forecast_shown = t;
            self.forecast(sink, t, f);
        }
    }

    fn odometry(&self, sink: &mut Sink, t: Time<TrueTime>, d: &DroneState) {
        let square = |sd: [f64; 3]| sd.map(|s| s * s);
        let ([a, b, c], [e, f, g]) = (square(d.position_sd), square(d.euler_sd));
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
        put(sink, self.drone_odometry, t, &odometry);
        // Forecast and plan live in the drone's own NED: lay it so that the odometry meets the
        // drone.
        if let Some(at) = self.drone {
            let offset = Vector3::from(at) - d.position();
            let still = UnitQuaternion::identity();
            let transforms = vec![self.transform(t, frame::NED, frame::DRONE_NED, offset.into(), &still)];
            put(sink, self.transforms, t, &FrameTransforms { transforms });
        }
    }

    fn forecast(&self, sink: &mut Sink, t: Time<TrueTime>, f: &DeckForecast) {
        let poses = f.stages.iter().step_by(2).map(|s| {
            let [r, p, y] = s.euler;
            pose(s.position, &UnitQuaternion::from_euler_angles(r, p, y))
        });
        let path = path(t, poses);
        put(
            sink,
            self.clouds.forecast,
            t,
            &cloud::forecast(timestamp(t), &path.poses),
        );
        put(sink, self.forecast_path, t, &path);
        let source = format!("{:?}", f.source);
        let predicted_slopes: Vec<f64> = f
            .predicted_slopes
            .iter()
            .map(|s| f64::from(*s) * SLOPE_STEP)
            .collect();
        let none = [f64::NAN; 3];
        let now = f.stages.first();
        let ahead = f.at(f.header.at + alight_shared::time::Span::from_secs(1.0));
        let ahead_is = |g: fn(&alight_shared::msg::DeckStage) -> f64| ahead.as_ref().map_or(f64::NAN, g);
        let values = [
            T(&source),
            N(f.radio_age_s),
            N(f.vision_age_s),
            N(f.tag_age_s),
            N(f.wave_confidence),
            N(f.wave_following_deficit),
            V(now.map_or(&none, |s| &s.position_sd)),
            V(now.map_or(&none, |s| &s.euler_sd)),
            V(ahead.as_ref().map_or(&none, |s| &s.position_sd)),
            N(ahead_is(|s| -s.position[2])),
            N(ahead_is(|s| s.euler[0].to_degrees())),
            N(ahead_is(|s| s.euler[1].to_degrees())),
            V(&predicted_slopes),
        ];
        self.forecast.put(sink, t, &values);
    }

    /// The mission's state, and a line of log when state or reason change.
    pub fn mission(&mut self, sink: &mut Sink, t: Time<TrueTime>, i: &MissionIn, o: &MissionOut) {
        if let Some(c) = &i.command {
            self.line(sink, t, log::Level::Info, format!("command: {:?}", c.kind));
        }
        if let Some(a) = &i.autopilot {
            let mode = format!("{:?}", a.mode);
            let values = [
                T(&mode),
                N(f64::from(u8::from(a.armed))),
                N(a.battery),
                N(a.thrust),
                N(a.hover_thrust),
            ];
            self.autopilot.put(sink, t, &values);
        }
        let Some(m) = &o.state else { return };
        let now = Some((m.state, m.waiting.code));
        let entered = self.shown_state.map(|s| s.0) != Some(m.state);
        if entered || self.shown_state != now || due(t, SLOW_MS) {
            let (because, waiting) = (m.entered.to_string(), m.waiting.to_string());
            let values = [
                T(m.state.name()),
                T(&because),
                T(&waiting),
                N(m.state as u8 as f64),
                N(f64::from(m.attempts)),
                N(m.height_m),
                N(m.descent_mps),
            ];
            self.mission.put(sink, t, &values);
            if entered {
                let level = match m.state {
                    State::Hold => log::Level::Warning,
                    State::GaveUp => log::Level::Error,
                    State::Idle
                    | State::GetAltitude
                    | State::Approach
                    | State::Tracking
                    | State::TrackingStable
                    | State::Descent
                    | State::Flare
                    | State::Landed => log::Level::Info,
                };
                self.line(sink, t, level, format!("{}: {because}", m.state.name()));
            } else if self.shown_state != now && m.waiting.code != ReasonCode::None {
                let text = format!("{} waits: {waiting}", m.state.name());
                self.line(sink, t, log::Level::Debug, text);
            }
        }
        self.shown_state = now;
    }

    fn line(&self, sink: &mut Sink, t: Time<TrueTime>, level: log::Level, message: String) {
        let line = Log {
            timestamp: Some(timestamp(t)),
            level: level.into(),
            message,
            name: "mission".into(),
            ..Log::default()
        };
        put(sink, self.log, t, &line);
    }

    /// The plan and how it was found.
    pub fn planner(&mut self, sink: &mut Sink, t: Time<TrueTime>, now: Time<DroneClock>, o: &PlannerOut) {
        let Some(plan) = &o.plan else { return };
        let since = (t - self.plan_shown).nanos();
        if since < SLOW_MS * 1_000_000 {
            return;
        }
        self.plan_shown = t;
        let solve = format!("{:?}", plan.solve);
        let touchdown = plan.touchdown_at.map_or(f64::NAN, |at| (at - now).secs());
        let values = [
            T(&solve),
            N(f64::from(plan.iterations)),
            N(touchdown),
            N(plan.alignment),
            N(plan.stages.len() as f64),
        ];
        self.solver.put(sink, t, &values);
        self.show_plan(sink, t, plan);
    }

    fn show_plan(&self, sink: &mut Sink, t: Time<TrueTime>, plan: &Plan) {
        let poses = plan.stages.iter().step_by(2).map(|s| {
            let [r, p, y] = s.euler;
            pose(s.position, &UnitQuaternion::from_euler_angles(r, p, y))
        });
        let path = path(t, poses);
        put(sink, self.clouds.plan, t, &cloud::plan(timestamp(t), &path.poses));
        put(sink, self.plan_path, t, &path);
    }

    /// What the autopilot is asked for.
    pub fn pilot(
        &mut self,
        sink: &mut Sink,
        t: Time<TrueTime>,
        now: Time<DroneClock>,
        i: &PilotIn,
        o: &PilotOut,
    ) {
        if let Some(plan) = &i.plan {
            self.plan_at = Some(plan.header.at);
        }
        if let Some(touchdown) = &o.touchdown {
            let text = format!(
                "touchdown confirmed, contact suspected {:.2} s before",
                (touchdown.header.at - touchdown.suspected_at).secs()
            );
            self.line(sink, t, log::Level::Info, text);
        }
        let (true, Some(s)) = (self.fast(t), &o.set_point) else {
            return;
        };
        let kind = match s.kind {
            SetPointKind::None => "none",
            SetPointKind::Trajectory => "trajectory",
            SetPointKind::Attitude => "attitude",
        };
        let motors = match s.motors {
            Motors::Run => "run",
            Motors::Stop => "stop",
        };
        let (roll, pitch, yaw) = s.attitude().euler_angles();
        let values = [
            T(kind),
            T(motors),
            V(&s.position),
            V(&s.velocity),
            V(&s.acceleration),
            N(roll.to_degrees()),
            N(pitch.to_degrees()),
            N(yaw.to_degrees()),
            N(s.thrust),
            N(self.plan_at.map_or(f64::NAN, |at| (now - at).secs())),
        ];
        self.set_point.put(sink, t, &values);
    }
}

fn path(t: Time<TrueTime>, poses: impl Iterator<Item = foxglove::messages::Pose>) -> PosesInFrame {
    PosesInFrame {
        timestamp: Some(timestamp(t)),
        frame_id: frame::DRONE_NED.into(),
        poses: poses.collect(),
    }
}

/// Row-major 6 x 6 with these variances on its diagonal.
fn diagonal(variances: [f64; 6]) -> Vec<f64> {
    let mut m = vec![0.0; 36];
    for (i, v) in variances.iter().enumerate() {
        m[7 * i] = *v;
    }
    m
}
