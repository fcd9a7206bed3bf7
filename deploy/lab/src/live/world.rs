//! The simulated vehicles in real time: the vessel with its sensors, the drone with its autopilot, camera and
//! rangefinder. They communicate with other processes only as real vehicles would, and with their supervisor by lines
//! on standard output.

use std::{fmt, time::Duration};

use alight_computer::{
    exit::{CliError, Doing, Exit},
    io::mavlink_key,
    process::{
        args::ProcessArgs,
        lateness::{REAL_TIME_LIMIT_S, REMEDY},
        life::{Life, draw_boot, node_recorder},
        observer::Rejoined,
        scheduling,
    },
    record::flight::recorder::NodeRecorder,
    terminal,
};
use alight_shared::{
    config,
    metrics::MetricName,
    msg::{DeckForecast, MissionState, Seq, State},
    process::{ProcessKind, ProcessState},
    time::TrueTime,
};
use alight_sim::{
    autopilots::FirmwareSensors,
    chart::landing,
    harness::{
        outcome::{FALSE_STOP_M, Judge, Outcome, REST_S},
        physics::{Physics, TICK},
        trace::Trace,
    },
    sensors::DroneReadings,
};
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    memory::{Instance, Memory, Publisher, Subscriber},
};
use serde::{Deserialize, Serialize};

use crate::{
    chart,
    live::{
        args::WorldArgs,
        config::{AT_SEA, AutopilotKind, SimulatedWorld},
        detections::Detections,
        plant::{self, Plant},
        render_thread::RenderThread,
        serial_lines::{SensorLines, SerialLine},
        truth::TruthSample,
    },
};

const SECOND_NS: i64 = 1_000_000_000;

pub const SENSING: &str = "world: sensors send";
pub const CONTACT: &str = "world: first contact";
pub const GOES_ON: &str = "world: goes on without a landing";

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WorldReport {
    Landed(Box<Landed>),
    /// The trial ended because this computer did not keep up with it.
    TooSlow(TooSlow),
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TooSlow {
    pub behind_s: f64,
    /// Time since the start, negative in the warm-up, s.
    pub t_s: f64,
}

impl TooSlow {
    /// Report of a tick that is `late_s` late at `t_s`, if that has to end the simulation.
    fn of(late_s: f64, t_s: f64) -> Option<TooSlow> {
        if late_s > REAL_TIME_LIMIT_S {
            Some(TooSlow {
                behind_s: late_s,
                t_s,
            })
        } else {
            None
        }
    }
}

impl fmt::Display for TooSlow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "this computer was too slow: at {:.1} s the simulated world was {:.1} s behind real time: \
             the result is not valid; {REMEDY}",
            self.t_s, self.behind_s
        )
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Landed {
    pub outcome: Outcome,
    pub first_contact_s: Option<f64>,
    /// Time on the deck with motors on, s.
    pub motors_on_deck_s: f64,
    /// Maximum lateness of a tick of the simulated world from the order to land on, s.
    pub latest_tick_s: f64,
}

/// Runs until the trial is over or the process is asked to end. Metrics: maximum delay of a tick (s), ticks later
/// than one period, true time since the start (s), slices without a reply from the firmware.
pub fn run(args: &WorldArgs) -> Result<Exit, CliError> {
    let kind = args.autopilot;
    let args = &args.process;
    let mut world: SimulatedWorld = config::load(&args.config)?;
    if world.scenario.place.among.is_empty() {
        // The devices' bytes contain latitude and longitude.
        world.scenario.place.among = vec![AT_SEA];
    }
    if world.epoch_ns == 0 {
        // Starts at the next full second of the clock that vessel and drone also read.
        world.epoch_ns = (steady_ns() / SECOND_NS + 1) * SECOND_NS;
        world.scenario.sensors.clocks.epoch_s = world.epoch_ns as f64 * 1e-9;
    }
    let mut live = LiveWorld::open(&world, kind.unwrap_or(world.autopilot), args)?;
    scheduling::set_real_time_world();
    let mut is_over = false;
    while !is_over && !live.life.ended() {
        match live.await_tick() {
            Pace::Early => {}
            Pace::Due => is_over = live.tick(),
            Pace::EndRequested => is_over = true,
            Pace::TooSlow(too_slow) => {
                live.life.report_now();
                live.report_state();
                print(&WorldReport::TooSlow(too_slow))?;
                return Ok(Exit::TooSlow);
            }
        }
    }
    // No motion is due any more. Leaving the shared memory waits in a loop that yields; at real-time priority that
    // would occupy a processor.
    scheduling::leave_real_time();
    print(&live.report()?)?;
    Ok(Exit::Success)
}

fn print(report: &WorldReport) -> Result<(), CliError> {
    terminal::line(serde_json::to_string(report).doing("writing the outcome")?);
    Ok(())
}

fn open_plant(world: &SimulatedWorld, kind: AutopilotKind, physics: &Physics) -> Result<Plant, CliError> {
    let scenario = &world.scenario;
    let firmware = &world.firmware;
    let navigation = &scenario.drone.navigation;
    let datum = physics.place().unwrap_or_default();
    let sensors = FirmwareSensors::new(firmware, navigation, datum, physics.streams());
    let station = world.ground_station.as_deref();
    let signing = mavlink_key::read("signing_key", &world.signing_key)?;
    Plant::open(kind, &world.mavlink, station, signing, firmware, sensors)
}

enum Pace {
    Early,
    Due,
    EndRequested,
    TooSlow(TooSlow),
}

struct LiveWorld<'a> {
    world: &'a SimulatedWorld,
    truth: Option<NodeRecorder>,
    life: Life,
    clock: ProcessClock,
    sensors: SensorLines,
    sensing: bool,
    camera: Option<RenderThread>,
    receiver: Option<SerialLine>,
    corrections: Vec<u8>,
    drone: Rejoined<DroneSide>,
    plant: Plant,
    physics: Physics,
    latest_s: f64,
    late_ticks: u32,
    landing: LandingWatch,
}

impl<'a> LiveWorld<'a> {
    fn open(
        world: &'a SimulatedWorld,
        kind: AutopilotKind,
        args: &ProcessArgs,
    ) -> Result<LiveWorld<'a>, CliError> {
        let physics = Physics::new(&world.scenario, world.seed).doing("setting up the simulated world")?;
        let plant = open_plant(world, kind, &physics)?;
        // Vehicles with their own devices run before the drone's computer does.
        let mut drone = Rejoined::of(&world.instance)?;
        if world.devices.is_none() {
            drone.join(|instance| DroneSide::join(instance, world))?;
        }
        let camera = match &world.devices {
            Some(devices) => Some(RenderThread::into_pipe(devices, &world.scenario, world.seed)?),
            None => None,
        };
        let sensors = SensorLines::of(&world.sensors, &world.scenario, physics.vessel_clock())?;
        let receiver = world.receiver.as_deref().map(|path| {
            let line = SerialLine::at(path);
            line.doing(format_args!("making the serial line {}", path.display()))
        });
        let life = Life::begin(ProcessKind::World, draw_boot(), args.supervised);
        let truth = match &args.flight {
            Some(directory) if world.truth => Some(node_recorder(
                directory,
                ProcessKind::World.name(),
                life.boot(),
                &args.config,
            )?),
            Some(_) | None => None,
        };
        Ok(LiveWorld {
            world,
            truth,
            life,
            clock: ProcessClock {
                epoch_ns: world.epoch_ns,
                ..ProcessClock::default()
            },
            sensors,
            sensing: false,
            camera,
            receiver: receiver.transpose()?,
            corrections: Vec::new(),
            drone,
            plant,
            physics,
            latest_s: 0.0,
            late_ticks: 0,
            landing: LandingWatch::new(world.plot.is_some()),
        })
    }

    /// Joins the drone's computer if it has started, and waits for the next tick, at most 0.1 s.
    fn await_tick(&mut self) -> Pace {
        let world = self.world;
        self.drone.poll(|instance| DroneSide::join(instance, world));
        // The truth at `t` is simulated and measured when the computer's clock reads `t`.
        let early = self.physics.now() - self.clock.now::<TrueTime>();
        if early.nanos() > 0 {
            let memory = self.drone.ports.as_ref().map(|c| &c.memory);
            let wait = Duration::from_nanos(early.nanos().unsigned_abs());
            return if plant::wait(memory, wait.min(Duration::from_millis(100))) {
                Pace::Early
            } else {
                Pace::EndRequested
            };
        }
        let late_s = -early.secs();
        let t_s = self.physics.time_since_start().secs();
        self.late_ticks += u32::from(late_s > TICK.secs());
        // Lateness in the warm-up, such as while a firmware connects, has no effect.
        if t_s + late_s < 0.0 {
            return Pace::Due;
        }
        self.latest_s = self.latest_s.max(late_s);
        TooSlow::of(late_s, t_s).map_or(Pace::Due, Pace::TooSlow)
    }

    /// Makes one tick: measures, advances and judges; true when the trial is over.
    fn tick(&mut self) -> bool {
        let before = steady_ns();
        self.plant.place(&mut self.physics);
        if let Some(recorder) = &mut self.truth {
            let truth = TruthSample::of(&self.physics.vessel(), self.physics.drone_in_wind(0).as_ref());
            recorder.step(before, self.physics.now().nanos(), &truth, &());
        }
        self.measure();
        let drone_ns = self.physics.drone_now(0).nanos();
        self.life.stepped(Some((steady_ns() - before) as f64 * 1e-9));
        let memory = self.drone.ports.as_ref().map(|c| &c.memory);
        self.plant.advance(&mut self.physics, memory, &self.clock);
        if let Some(computer) = &mut self.drone.ports {
            self.landing.receive(computer, drone_ns);
        }
        if self.landing.observe(&self.physics, self.world) {
            return true;
        }
        self.report_state();
        false
    }

    fn report_state(&mut self) {
        self.update_metrics();
        let drone_ns = self.physics.drone_now(0).nanos();
        if let Some(computer) = &mut self.drone.ports {
            let inputs = || vec![computer.mission.statistics().state(drone_ns)];
            if let Some(published) = self.life.state(inputs, computer.detections.unsent()) {
                computer.state.send(&published);
            }
        }
    }

    fn measure(&mut self) {
        let measured = self.physics.vessel_readings();
        self.sensors.send(&measured, &self.physics.vessel_rtcm());
        if !core::mem::replace(&mut self.sensing, true) {
            terminal::line(SENSING);
        }
        self.physics.receive_rtcm(0, &self.corrections);
        let Some(mut readings) = self.physics.drone_readings(0) else {
            return;
        };
        if let Some(line) = &mut self.receiver {
            // A broken line stays silent, and the drone's computer reports the silence.
            self.corrections = line.exchange(&readings.receiver).unwrap_or_default();
        }
        self.plant.take(&mut readings, &self.physics.drone_clock(0));
        if self.world.devices.is_some() {
            // Only camera shots are sent, and ranges, because a firmware's plant has no rangefinder.
            readings = DroneReadings {
                shots: readings.shots,
                ranges: readings.ranges,
                ..DroneReadings::default()
            };
        }
        if let Some(computer) = &mut self.drone.ports {
            computer.detections.publish(&readings);
        }
        let own = self.drone.ports.as_mut().and_then(|c| c.render_thread.as_mut());
        if let Some(render_thread) = self.camera.as_mut().or(own) {
            render_thread.take(&readings.shots);
        }
    }

    fn update_metrics(&mut self) {
        let own = self.drone.ports.as_ref().and_then(|c| c.render_thread.as_ref());
        let lost = self.camera.as_ref().or(own).map_or(0, RenderThread::lost);
        self.life.metrics = Seq::filled([
            MetricName::LatestTick.seconds(self.latest_s),
            MetricName::LateTicks.count(self.late_ticks),
            MetricName::TimeSinceStart.seconds(self.physics.time_since_start().secs()),
            MetricName::SlicesUnanswered.count(self.plant.late()),
            MetricName::ImagesDropped.count(lost),
        ]);
    }

    /// Outcome judged from the truth; also draws the plot of the landing.
    fn report(&mut self) -> Result<WorldReport, CliError> {
        let world = self.world;
        let landing = &mut self.landing;
        let sim_time_s = self.physics.now().secs();
        let mut outcome = landing
            .judge
            .outcome(world.seed, &world.sea, &world.planner, sim_time_s);
        [outcome.radio_age_s, outcome.vision_age_s] = [0, 1].map(|i: usize| {
            let age_s = landing.ages.and_then(|a| a.get(i).copied());
            age_s.filter(|a| a.is_finite())
        });
        outcome.digest = format!("{:016x}", self.physics.digest());
        outcome.wall_time_s = self.clock.now::<TrueTime>().secs();
        let first_contact_s = landing.judge.first_contact_s();
        if let (Some(path), Some(mut trace)) = (&world.plot, landing.history.trace.take()) {
            trace.touchdown_s = first_contact_s;
            chart::landing(&trace, &landing::title(&outcome), path)?;
        }
        Ok(WorldReport::Landed(Box::new(Landed {
            outcome,
            first_contact_s,
            motors_on_deck_s: landing.motors_on_deck_s,
            latest_tick_s: self.latest_s,
        })))
    }
}

/// Truth about the landing, with the newest messages of the drone's computer.
struct LandingWatch {
    judge: Judge,
    mission: MissionState,
    forecast: Option<DeckForecast>,
    /// Ages of radio and vision in the forecast at first contact, s.
    ages: Option<[f64; 2]>,
    history: History,
    /// Time since the start at which the stay on the deck ends, s.
    stays_until_s: Option<f64>,
    flies_on: bool,
    touched: bool,
    motors_on_deck_s: f64,
}

impl LandingWatch {
    fn new(plotted: bool) -> LandingWatch {
        LandingWatch {
            judge: Judge::default(),
            mission: MissionState::default(),
            forecast: None,
            ages: None,
            history: History::new(plotted),
            stays_until_s: None,
            flies_on: false,
            touched: false,
            motors_on_deck_s: 0.0,
        }
    }
    fn receive(&mut self, computer: &mut DroneSide, drone_ns: i64) {
        self.mission = computer.mission.newest(drone_ns).unwrap_or(self.mission);
        self.forecast = computer.forecasts.newest(drone_ns).or(self.forecast);
    }
    /// Judges a tick; true when the trial and the time on the deck are over. After an abort or a takeover a drone flies on
    /// until it stands or `goes_on_s` have passed, and the verdict stays.
    fn observe(&mut self, physics: &Physics, world: &SimulatedWorld) -> bool {
        let t_s = physics.time_since_start().secs();
        self.history.update(physics, t_s);
        let scenario = &world.scenario;
        let deck = &scenario.deck;
        let half_deck = [deck.length_m / 2.0, deck.width_m / 2.0];
        let observed = physics.observation(0, &self.mission);
        if self.stays_until_s.is_none() && t_s > 0.0 && self.judge.observe(&observed, half_deck) {
            let ended_by_person = self.mission.abort.is_some() || self.mission.state == State::Idle;
            self.flies_on = ended_by_person && observed.motors_on && world.goes_on_s > 0.0;
            let stay_s = if self.flies_on {
                world.goes_on_s
            } else {
                scenario.stay_s
            };
            self.stays_until_s = Some(t_s + stay_s);
            if self.flies_on {
                terminal::line(GOES_ON);
            }
        }
        if self.flies_on && (observed.in_water || !observed.motors_on) {
            self.flies_on = false;
            self.stays_until_s = Some(t_s + REST_S);
        }
        if self.judge.first_contact_s().is_some() {
            if !self.touched {
                terminal::line(CONTACT);
            }
            self.touched = true;
            let on_deck = observed.feet_height_m() < FALSE_STOP_M && observed.horizontal_m < deck.length_m;
            self.motors_on_deck_s += if on_deck && observed.motors_on {
                TICK.secs()
            } else {
                0.0
            };
            let ages = self.forecast.map(|f| [f.radio_age_s, f.vision_age_s]);
            self.ages = self.ages.or(ages);
        }
        self.stays_until_s.is_some_and(|until| t_s >= until)
    }
}

struct DroneSide {
    memory: Memory,
    detections: Detections,
    mission: Subscriber<MissionState>,
    forecasts: Subscriber<DeckForecast>,
    state: Publisher<ProcessState>,
    render_thread: Option<RenderThread>,
}

impl DroneSide {
    fn join(instance: &Instance, world: &SimulatedWorld) -> Result<DroneSide, CliError> {
        let memory = Memory::join(instance, "world")?;
        Ok(DroneSide {
            detections: Detections::join(&memory)?,
            mission: memory.subscriber()?,
            forecasts: memory.subscriber()?,
            state: memory.publisher()?,
            render_thread: match world.devices {
                Some(_) => None,
                None => RenderThread::of(instance, &world.scenario, world.seed)?,
            },
            memory,
        })
    }
}

struct History {
    trace: Option<Trace>,
    next_s: f64,
}

impl History {
    const STEP_S: f64 = 0.05;

    fn new(kept: bool) -> History {
        let trace = kept.then(|| Trace {
            step_s: Self::STEP_S,
            ..Trace::default()
        });
        History { trace, next_s: 0.0 }
    }
    fn update(&mut self, physics: &Physics, t_s: f64) {
        let Some(trace) = &mut self.trace else { return };
        if t_s >= self.next_s {
            self.next_s += Self::STEP_S;
            trace.points.push(physics.trace_point(0));
        }
    }
}
