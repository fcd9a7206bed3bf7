//! The vessel's node as a process: sensors in, zenoh out.

use std::time::Duration;

use alight_shared::config;
use alight_shared::msg::{DroneStatus, MAX_SOURCES, TimeRequest};
use alight_shared::seq::Seq;
use alight_shared::time::{DroneClock, Stamped};
use alight_shared::topics::{self, Topic};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::intake::Quantiles;
use alight_shared::transport::process::{ProcessKind, ProcessState};
use alight_shared::transport::radio::{Outlet, Radio, Urgency};
use alight_shared::transport::refusals::{self, Refusals};
use alight_shared::wire;
use alight_usv::{Commands, DeckKeeper, KINDS, SourceCounts, VesselIn, VesselNode};
use serde::Serialize;

use super::args::ProcessArgs;
use super::config::VesselComputer;
use super::flows::Flows;
use super::heard_drone::HeardDrone;
use super::interface::sensors::Sensors;
use super::link::{Impaired, STATUS, any_drone_status, any_operator_command, any_time_request, vessel_key};
use super::notify::Notify;
use super::process::Process;
use super::sensor_ward::SensorWard;
use super::vessel_word::Teller;
use crate::{End, Refused, say};

/// Without sensors the process wakes this often all the same.
const LONGEST: Duration = Duration::from_millis(10);
/// The outlets, in their order.
const ESTIMATE: usize = 0;
const WAVE: usize = 1;
const PREDICTION: usize = 2;
const TIME_REPLY: usize = 3;
const STATE: usize = 4;
const DECK: usize = 5;
const OPERATOR: usize = 6;
const DRONES: usize = 7;
/// While the link backs up, one in so many of the words about itself goes out.
const WORDS_ON_NARROW: u32 = 4;
/// With real sensors, time between two words about what became of their measurements, ns.
const COUNT_NS: i64 = 60_000_000_000;
/// Their topics, for who looks on; None is the process's own word.
const OUTLETS: [Option<&Topic>; 8] = [
    Some(&topics::ESTIMATE),
    Some(&topics::WAVE),
    Some(&topics::PREDICTION),
    Some(&topics::TIME_REPLY),
    None,
    Some(&topics::DECK),
    Some(&topics::OPERATOR),
    Some(&topics::DRONES),
];

/// The subscriptions, in their order; what drones say about themselves is the other.
const TIME_REQUESTS: usize = 0;
const COMMANDS: usize = 1;

/// Runs until told to end.
pub fn run(args: &ProcessArgs) -> Result<End, Refused> {
    let computer: VesselComputer = config::load(&args.config).map_err(|e| Refused(e.to_string()))?;
    let id = computer.vessel_id;
    let mut process = Process::start(ProcessKind::Vessel, args, computer.clock, |boot| {
        VesselNode::new(&computer.vessel, id, boot)
    })?;
    let mut sensors = Sensors::listen(&computer.sensors)
        .map_err(|e| Refused::because(format!("listening for sensors on {}", computer.sensors), e))?;
    let outlet = |name: &str, urgency| Outlet {
        key: vessel_key(id, name),
        urgency,
    };
    let outlets = vec![
        outlet(topics::ESTIMATE.name, Urgency::State),
        outlet(topics::WAVE.name, Urgency::Model),
        outlet(topics::PREDICTION.name, Urgency::Model),
        outlet(topics::TIME_REPLY.name, Urgency::State),
        outlet(STATUS, Urgency::Status),
        outlet(topics::DECK.name, Urgency::State),
        outlet(topics::OPERATOR.name, Urgency::State),
        outlet(topics::DRONES.name, Urgency::Status),
    ];
    refusals::listen();
    let mut radio = Radio::open(
        &computer.radio,
        outlets,
        vec![any_time_request(), any_operator_command(), any_drone_status()],
    )?;
    if let Some(to) = &computer.relay {
        radio.copy_to(ESTIMATE, to)?;
    }
    let mut said_after = Quantiles::default();
    let mut impaired: Impaired<TimeRequest<DroneClock>> = computer.heard();
    let mut words: Impaired<DroneStatus> = computer.heard();
    let mut drone = HeardDrone::new(id);
    let secured = !computer.radio.tls.authority.is_empty();
    let operators = computer
        .radio
        .tls
        .peers
        .iter()
        .any(|p| p.starts_with("operator-"));
    let mut commands = Commands::new(id, process.life.boot());
    let mut keeper = DeckKeeper::new(&computer.deck, id, process.life.boot());
    let mut undecoded = 0_u64;
    let mut teller = Teller::new(&computer);

    // The last to start: what refuses to start has left nothing behind.
    let mut ward = SensorWard::start(&computer, args, steady_ns())?;
    let mut notify = Notify::from_environment();
    notify.ready();
    let mut flows = Flows::of(&OUTLETS);
    let mut own_words = 0_u32;
    let mut told = Refusals::default();
    let mut last_ns = steady_ns();
    let mut next_count_ns = last_ns + COUNT_NS;
    while !process.ended() {
        let gap_s = (steady_ns() - last_ns) as f64 * 1e-9;
        last_ns = steady_ns();
        if !radio.outlives(gap_s) {
            radio.abandon();
            return Err(Refused(format!(
                "the vessel's process stood still for {gap_s:.1} s, longer than its radio session lasts: \
                 it ends so that its supervisor starts it anew"
            )));
        }
        let readings = sensors.read(LONGEST);
        while let Some(heard) = radio.receive(Duration::ZERO) {
            // What does not decode is nobody's request.
            match heard.subscription {
                TIME_REQUESTS => match wire::decode(&heard.bytes) {
                    Ok(request) => impaired.take(heard.at_ns, heard.bytes.len(), request),
                    Err(_) => undecoded += 1,
                },
                // Whoever reaches a radio without certificates could command.
                COMMANDS if !secured => undecoded += 1,
                COMMANDS => match wire::decode(&heard.bytes) {
                    Ok(said) => {
                        if commands.hear(process.now(), &said) {
                            say::line(format_args!(
                                "an operator tells drone {}: {:?}",
                                said.header.drone, said.kind
                            ));
                        }
                    }
                    Err(_) => undecoded += 1,
                },
                _ => match wire::decode(&heard.bytes) {
                    Ok(word) => words.take(heard.at_ns, heard.bytes.len(), word),
                    Err(_) => drone.refuse(),
                },
            }
        }
        let heard: Vec<(i64, DroneStatus)> = words.arrived(steady_ns());
        for (at_ns, word) in &heard {
            if let Some(line) = drone.hear(*at_ns, word) {
                say::line(line);
            }
        }
        teller.hear(&computer, &heard);
        let now = process.now();
        let had = keeper.holder();
        let grant = keeper.step(now, heard.iter().map(|(_, word)| word));
        tell(&mut radio, DECK, grant.as_ref());
        teller.granted(grant.as_ref());
        for command in commands.step(now, heard.iter().map(|(_, word)| word)) {
            tell(&mut radio, OPERATOR, Some(&command));
        }
        for (_, word) in heard.iter().filter(|_| operators) {
            tell(&mut radio, DRONES, Some(word));
        }
        if keeper.holder() != had {
            say::line(keeper.holder().map_or_else(
                || "the deck is nobody's".to_owned(),
                |id| format!("the deck is drone {id}'s"),
            ));
        }
        let time_requests = impaired
            .arrived(steady_ns())
            .into_iter()
            .map(|(at_ns, request)| Stamped::new(process.at(at_ns).min(now), request))
            .collect();
        let input = VesselIn {
            imu: readings.imu,
            gnss: readings.gnss,
            heading: readings.heading,
            attitude: readings.attitude,
            time_requests,
        };
        let out = process.step(now, &input, |_| true);
        teller.stepped(steady_ns(), &input, &out);
        tell(&mut radio, ESTIMATE, out.estimate.as_ref());
        if let Some(estimate) = &out.estimate {
            said_after.add((process.now() - estimate.header.at).secs());
        }
        tell(&mut radio, WAVE, out.wave.as_ref());
        tell(&mut radio, PREDICTION, out.prediction.as_ref());
        for reply in &out.time_replies {
            tell(&mut radio, TIME_REPLY, Some(reply));
        }
        let counts = radio.counts();
        let node = process.node().refused();
        let own = [
            sensors.refused() as f64,
            counts.sent_bytes as f64,
            counts.dropped as f64,
            (undecoded + commands.refused() + node.absurd + node.other_vessel + node.flood) as f64,
        ];
        process.life.figures = {
            let share = process.node().share();
            let after = [0.5, 0.99].map(|q| said_after.quantile(q));
            let heard = drone.figures(steady_ns());
            let refused = refusals::counted();
            if refused.last != told.last {
                let why = refused.last.map_or("nobody", |r| r.name());
                say::line(format_args!("refused: {why} ({} so far)", refused.count));
                told = refused;
            }
            let strangers = [
                refused.count as f64,
                refused.last.map_or(0.0, |r| f64::from(r as u8)),
            ];
            Seq::filled(
                own.into_iter()
                    .chain(heard)
                    .chain([share])
                    .chain(strangers)
                    .chain(after),
            )
        };
        let said = process.state(Vec::new, counts.unsent).map(|said| ProcessState {
            flows: flows.since(&radio, said.at_ns),
            ..said
        });
        for line in ward.tend(steady_ns()) {
            say::line(line);
        }
        if let Some(said) = &said {
            teller.tell(&computer, process.node(), said, keeper.holder(), &told, &ward);
        }
        notify.alive(steady_ns(), || {
            let words = drone.figures(steady_ns());
            format!(
                "{} messages sent, {} words of drones heard",
                counts.sent, words[0]
            )
        });
        if !computer.sensor.sources.is_empty() && steady_ns() >= next_count_ns {
            next_count_ns = steady_ns() + COUNT_NS;
            for (kind, name) in KINDS.iter().enumerate() {
                for source in 0..MAX_SOURCES {
                    let c = process.node().source(kind, source);
                    if c != SourceCounts::default() {
                        say::line(format_args!(
                            "{name} {source}: {} used, {} of them gated, {} out of order, {} refused, {} spare",
                            c.taken, c.gated, c.order, c.refused, c.spare
                        ));
                    }
                }
            }
        }
        // For people, and they can wait: over a link that is narrow, less often.
        own_words += u32::from(said.is_some());
        let due = process.node().share() > 0.5 || own_words.is_multiple_of(WORDS_ON_NARROW);
        tell(&mut radio, STATE, said.as_ref().filter(|_| due));
    }
    notify.stopping();
    Ok(End::Success)
}

fn tell<M: Serialize>(radio: &mut Radio, outlet: usize, message: Option<&M>) {
    // A message that does not encode is a message that is not sent: the receiver sees the gap.
    if let Some(Ok(bytes)) = message.map(wire::encode) {
        radio.send(outlet, bytes);
    }
}
