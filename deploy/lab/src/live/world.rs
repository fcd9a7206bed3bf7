//! The simulated vehicles in real time: the vessel with its sensors, the drone with its autopilot,
//! camera and rangefinder. Speaks to the other processes only as real ones would, and to its
//! supervisor by lines on standard output.

use std::fmt;
use std::time::Duration;

use alight_computer::exit::{CliError, Doing, Exit};
use alight_computer::io::mavlink_key;
use alight_computer::process::life::{Life, draw_boot, node_recorder};
use alight_computer::process::observer::Rejoined;
use alight_computer::process::scheduling;
use alight_computer::terminal;
use alight_shared::bus::Writer as _;
use alight_shared::config;
use alight_shared::metrics::MetricName;
use alight_shared::msg::{DeckForecast, Header, MissionState, SensorReadings, Seq};
use alight_shared::process::{ProcessKind, ProcessState};
use alight_shared::time::{Time, TrueTime, VesselClock};
use alight_sim::autopilots::FirmwareSensors;
use alight_sim::harness::outcome::{FALSE_STOP_M, Judge, Outcome};
use alight_sim::harness::physics::{Physics, TICK};
use alight_sim::harness::trace::Trace;
use alight_sim::sensors::DroneReadings;
use alight_transport::clock::{ProcessClock, steady_ns};
use alight_transport::memory::{Instance, Memory, Publisher, Subscriber};
use alight_usv::sensors::Readings;
use serde::{Deserialize, Serialize};

use crate::chart;
use crate::live::args::WorldArgs;
use crate::live::boat::BoatLink;
use crate::live::config::SimulatedWorld;
use crate::live::detections::Detections;
use crate::live::plant::{self, Plant};
use crate::live::render_thread::RenderThread;
use crate::live::serial_lines::SensorLines;
use crate::live::truth::Truth;

/// A second, ns.
const SECOND_NS: i64 = 1_000_000_000;

/// The line that reports the first measurement on the vessel's serial lines.
pub const SENSING: &str = "world: sensors send";
/// The line that reports the first contact.
pub const CONTACT: &str = "world: first contact";

/// What the world reports to its supervisor in the end, as one JSON object.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WorldReport {
    /// How it ended, judged from the truth.
    Landed(Box<Landed>),
    /// It ended because this computer did not keep up with it.
    TooSlow(TooSlow),
}

/// The simulated world fell behind real time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TooSlow {
    /// By so much, s.
    pub behind_s: f64,
    /// So long after the start, negative in the warm-up, s.
    pub t_s: f64,
}

impl TooSlow {
    /// Further behind than this, s, every link of the system has timed out: an autopilot waits for set-points for 0.5 to 1 s.
    const BEHIND_S: f64 = 1.0;

    /// Whether a tick that is `late_s` late at `t_s` ends the world. What is made up for in the warm-up, as where a firmware
    /// connects, harms nobody.
    fn of(late_s: f64, t_s: f64) -> Option<TooSlow> {
        let commanded = t_s + late_s >= 0.0;
        (commanded && late_s > Self::BEHIND_S).then_some(TooSlow {
            behind_s: late_s,
            t_s,
        })
    }
}

impl fmt::Display for TooSlow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "this computer was too slow: at {:.1} s the simulated world was {:.1} s behind real time, and what was \
             seen counts for nothing; end other work on this computer, or take a faster one",
            self.t_s, self.behind_s
        )
    }
}

/// An outcome and what the report beside it takes from the truth.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Landed {
    /// The outcome.
    pub outcome: Outcome,
    /// First contact, time since the start, s.
    pub first_contact_s: Option<f64>,
    /// Time on the deck with motors on, s.
    pub motors_on_deck_s: f64,
    /// The most that a tick of the simulated world was late, s.
    pub latest_tick_s: f64,
}

/// Runs until the trial is over or it is told to end. Its figures: the most that a tick was late
/// (s), ticks later than one period, true time since the start (s), slices that a firmware left
/// unanswered.
pub fn run(args: &WorldArgs) -> Result<Exit, CliError> {
    let (kind, args) = (args.autopilot, &args.process);
    let mut world: SimulatedWorld = config::load(&args.config)?;
    if world.epoch_ns == 0 {
        // At the next full second of the clock that vessel and drone read, too.
        world.epoch_ns = (steady_ns() / SECOND_NS + 1) * SECOND_NS;
        world.scenario.sensors.clocks.epoch_s = world.epoch_ns as f64 * 1e-9;
    }
    let mut physics = Physics::new(&world.scenario, world.seed).doing("setting up the simulated world")?;
    let mut plant = {
        let (scenario, firmware) = (&world.scenario, &world.firmware);
        let (navigation, datum) = (&scenario.drone.navigation, physics.place().unwrap_or_default());
        let sensors = FirmwareSensors::new(firmware, navigation, datum, physics.streams());
        let kind = kind.unwrap_or(world.autopilot);
        let station = world.ground_station.as_deref();
        let signing = mavlink_key::read("signing_key", &world.signing_key)?;
        Plant::open(kind, &world.mavlink, station, signing, firmware, sensors)?
    };
    // Vehicles with devices of their own are there before the drone's computer is.
    let mut drone = Rejoined::of(&world.instance)?;
    if world.devices.is_none() {
        drone.join(|instance| DroneSide::join(instance, &world))?;
    }
    let mut camera = match &world.devices {
        Some(devices) => Some(RenderThread::into_pipe(devices, &world.scenario, world.seed)?),
        None => None,
    };
    let mut sensors = VesselSide::of(&world)?;
    let mut boat = world.helm.as_deref().map(BoatLink::open).transpose()?;
    let (mut forecast, mut ages): (Option<DeckForecast>, Option<[f64; 2]>) = (None, None);
    let mut life = Life::begin(ProcessKind::World, draw_boot(), args.supervised);
    let clock = ProcessClock {
        epoch_ns: world.epoch_ns,
        ..ProcessClock::default()
    };
    let deck = &world.scenario.deck;
    let half_deck = [deck.length_m / 2.0, deck.width_m / 2.0];
    let mut judge = Judge::default();
    let mut phase = MissionState::default();
    let (mut latest_s, mut late_ticks) = (0.0_f64, 0_u32);
    let mut history = History::new(world.plot.is_some());
    let mut stays_until_s: Option<f64> = None;
    let (mut touched, mut motors_on_deck_s) = (false, 0.0);

    let mut truth = match &args.flight {
        Some(directory) if world.truth => Some(node_recorder(
            directory,
            ProcessKind::World.name(),
            life.boot(),
            &args.config,
        )?),
        Some(_) | None => None,
    };

    scheduling::set_real_time_world();
    while !life.ended() {
        drone.poll(|instance| DroneSide::join(instance, &world));
        let memory = drone.ports.as_ref().map(|c| &c.memory);
        // The truth at `t` is made and measured when the computer's clock reads `t`.
        let early = physics.now() - clock.now::<TrueTime>();
        if early.nanos() > 0 {
            let wait = Duration::from_nanos(early.nanos().unsigned_abs());
            if !plant::wait(memory, wait.min(Duration::from_millis(100))) {
                break;
            }
            continue;
        }
        let late_s = -early.secs();
        latest_s = latest_s.max(late_s);
        late_ticks += u32::from(late_s > TICK.secs());
        if let Some(too_slow) = TooSlow::of(late_s, physics.time_since_start().secs()) {
            terminal::line(
                serde_json::to_string(&WorldReport::TooSlow(too_slow)).doing("writing the outcome")?,
            );
            return Ok(Exit::TooSlow);
        }
        let before = steady_ns();

        plant.place(&mut physics);
        if let Some(recorder) = &mut truth {
            let truth = Truth::of(&physics.vessel(), physics.drone_in_wind(0).as_ref());
            recorder.step(before, physics.now().nanos(), &truth, &());
        }
        let measured_at = physics.vessel_now();
        sensors.send(measured_at, &physics.vessel_readings());
        boat.iter_mut().for_each(|boat| boat.step(&mut physics));
        if let Some(readings) = physics.drone_readings(0) {
            let readings = match &world.devices {
                None => readings,
                // Beside the camera the rangefinder alone, which the autopilot reports; a firmware's plant has none.
                Some(_) if plant.take_ranges(&readings.ranges) => DroneReadings {
                    shots: readings.shots,
                    ..DroneReadings::default()
                },
                Some(_) => DroneReadings {
                    shots: readings.shots,
                    ranges: readings.ranges,
                    ..DroneReadings::default()
                },
            };
            if let Some(computer) = &mut drone.ports {
                computer.detections.publish(&readings);
            }
            let own = drone.ports.as_mut().and_then(|c| c.render_thread.as_mut());
            if let Some(render_thread) = camera.as_mut().or(own) {
                render_thread.take(&readings.shots);
            }
        }
        let drone_ns = physics.drone_now(0).nanos();
        life.stepped(Some((steady_ns() - before) as f64 * 1e-9));
        plant.advance(&mut physics, drone.ports.as_ref().map(|c| &c.memory), &clock);

        if let Some(computer) = &mut drone.ports {
            phase = computer.mission.newest(drone_ns).unwrap_or(phase);
            forecast = computer.forecasts.newest(drone_ns).or(forecast);
        }
        let unanswered = plant.late();
        let t_s = physics.time_since_start().secs();
        let own = drone.ports.as_ref().and_then(|c| c.render_thread.as_ref());
        let lost = camera.as_ref().or(own).map_or(0, RenderThread::lost);
        life.metrics = Seq::filled([
            MetricName::LatestTick.seconds(latest_s),
            MetricName::LateTicks.count(late_ticks),
            MetricName::TimeSinceStart.seconds(t_s),
            MetricName::SlicesUnanswered.count(unanswered),
            MetricName::ImagesDropped.count(lost),
        ]);
        history.update(&physics, t_s);
        let seen = physics.observation(0, &phase);
        if stays_until_s.is_none() && t_s > 0.0 && judge.observe(&seen, half_deck) {
            stays_until_s = Some(t_s + world.scenario.stay_s);
        }
        if judge.first_contact_s().is_some() {
            if !touched {
                terminal::line(CONTACT);
            }
            touched = true;
            let on_deck = seen.feet_height_m() < FALSE_STOP_M && seen.horizontal_m < deck.length_m;
            motors_on_deck_s += if on_deck && seen.motors_on {
                TICK.secs()
            } else {
                0.0
            };
            ages = ages.or(forecast.map(|f| [f.radio_age_s, f.vision_age_s]));
        }
        if stays_until_s.is_some_and(|until| t_s >= until) {
            break;
        }
        if let Some(computer) = &mut drone.ports {
            let inputs = || vec![computer.mission.statistics().state(drone_ns)];
            if let Some(said) = life.state(inputs, computer.detections.unsent()) {
                computer.state.send(&said);
            }
        }
    }
    // Nothing moves any more: what leaves the shared memory waits by yielding, which at a real-time priority holds a processor.
    scheduling::leave_real_time();
    let sim_time_s = physics.now().secs();
    let mut outcome = judge.outcome(world.seed, &world.sea, &world.planner, sim_time_s);
    [outcome.radio_age_s, outcome.vision_age_s] =
        [0, 1].map(|i: usize| ages.and_then(|a| a.get(i).copied()).filter(|a| a.is_finite()));
    outcome.digest = format!("{:016x}", physics.digest());
    outcome.wall_time_s = clock.now::<TrueTime>().secs();
    if let (Some(path), Some(mut trace)) = (&world.plot, history.trace) {
        trace.touchdown_s = judge.first_contact_s();
        chart::landing::write(&trace, &chart::landing::title(&outcome), path)?;
    }
    let report = WorldReport::Landed(Box::new(Landed {
        outcome,
        first_contact_s: judge.first_contact_s(),
        motors_on_deck_s,
        latest_tick_s: latest_s,
    }));
    let report = serde_json::to_string(&report).doing("writing the outcome")?;
    terminal::line(report);
    Ok(Exit::Success)
}

/// Simulated sensors in the place of the vessel's, towards its process.
struct SensorPublisher {
    readings: Publisher<SensorReadings>,
    header: Header<VesselClock>,
}

impl SensorPublisher {
    /// Publishes what there is. A vessel's process that is not there misses it, as it would at sea.
    fn send(&mut self, now: Time<VesselClock>, readings: &Readings) {
        self.header.at = now;
        self.readings.send_each(&readings.messages(&mut self.header));
    }
}

/// The vessel's computer as its simulated sensors reach it.
enum VesselSide {
    /// By the bytes that each sends; the first were reported.
    Lines(SensorLines, bool),
    /// Through its memory, once it runs.
    Memory(Box<Rejoined<(Memory, SensorPublisher)>>),
}

impl VesselSide {
    fn of(world: &SimulatedWorld) -> Result<VesselSide, CliError> {
        Ok(if world.sensors.is_empty() {
            VesselSide::Memory(Box::new(Rejoined::of(&world.vessel_instance)?))
        } else {
            VesselSide::Lines(SensorLines::of(&world.sensors, &world.scenario)?, false)
        })
    }
    fn send(&mut self, now: Time<VesselClock>, readings: &Readings) {
        match self {
            VesselSide::Lines(lines, reported) => {
                lines.send(readings);
                if !*reported && !readings.is_empty() {
                    *reported = true;
                    terminal::line(SENSING);
                }
            }
            VesselSide::Memory(side) => {
                side.poll(|instance| {
                    let memory = Memory::join(instance, "world")?;
                    let publisher = SensorPublisher {
                        readings: memory.publisher()?,
                        header: Header::new(0, 0, draw_boot(), 0, Time::EPOCH),
                    };
                    Ok((memory, publisher))
                });
                if let Some((_, publisher)) = &mut side.ports {
                    publisher.send(now, readings);
                }
            }
        }
    }
}

/// The drone's memory as the simulated vehicle uses it.
struct DroneSide {
    memory: Memory,
    detections: Detections,
    mission: Subscriber<MissionState>,
    forecasts: Subscriber<DeckForecast>,
    state: Publisher<ProcessState>,
    /// The simulated camera, where images are rendered.
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

/// What a picture of the landing is drawn from.
struct History {
    trace: Option<Trace>,
    next_s: f64,
}

impl History {
    /// Time between points, s.
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
