use alight_shared::{
    msg::{Command, CommandKind, ComputerReport},
    time::{DroneClock, DroneTime},
};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory, Publisher},
    wake::end_requested,
};
use clap::Args;
use std::time::Duration;

use alight_computer::{
    config::DroneComputerConfig,
    exit::{CliError, Exit},
    io::wall::wall_ns,
    process::{
        observer::{Observer, Rejoined},
        supervisor::pause,
    },
    quantity::whole,
    situation::configured,
    subject::{Computer, Subject},
    terminal,
};

use crate::ros2::{
    diagnostics::Diagnostics,
    fixed,
    messages::{DiagnosticArray, Marker, PoseWithCovarianceStamped, RosOdometry, RosTime, TfMessage},
    names::{Distro, MAX_DOMAIN, RosNode},
    orders::{Caller, Orders, is_late},
    poses::Poses,
    session::{Request, RosConnection, RosSession, RosTopic},
};
use alight_people::status::Status;

/// Computer, and address of ROS.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight ros2\n\
ROS's side needs its router and RMW_IMPLEMENTATION=rmw_zenoh_cpp:\n  \
ros2 run rmw_zenoh_cpp rmw_zenohd\n  \
ros2 topic echo /alight/drone_1/odometry\n  \
alight ros2 --orders; ros2 service call /alight/drone_1/abort std_srvs/srv/Trigger\n\
With --orders everyone who reaches that router may give orders.\n\
Ctrl-C ends it; no flight waits for it. alight help view"
)]
pub struct Ros2Args {
    #[command(flatten)]
    subject: Subject,
    /// Zenoh router of ROS
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    connect: String,
    /// Without a router: endpoint that ROS's sessions connect to
    #[arg(long, value_name = "ENDPOINT", conflicts_with = "connect")]
    listen: Option<String>,
    /// ROS_DOMAIN_ID
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole::<u32>(0..=i64::from(MAX_DOMAIN)))]
    domain: u32,
    /// Distribution of ROS; humble: keys without type hashes
    #[arg(long, value_enum, value_name = "NAME", default_value_t)]
    distro: Distro,
    /// Namespace of the node, which is named drone_N or vessel_N
    #[arg(long, value_name = "NAME", default_value = "alight")]
    namespace: String,
    /// Prefix of the frame names, such as drone_1/
    #[arg(long, value_name = "PREFIX", default_value = "")]
    frame_prefix: String,
    /// Offer the services land and abort to every client that reaches the router
    #[arg(long)]
    orders: bool,
}

const ABSENT: &str = "not ordered: no process reports on this computer (systemctl status alight-drone)";
const UNKNOWN: &str = "not ordered: the configuration of these processes is not found; name it with --config";
const ENDS: &str = "not ordered: alight ros2 ends";
const PERIOD: Duration = Duration::from_millis(50);
const READ_AGAIN_NS: i64 = 1_000_000_000;
const DIAGNOSTICS_NS: i64 = 1_000_000_000;
/// Period of the fixed frames and the deck's shape, which bounds a late joiner's wait for them.
const FIXED_NS: i64 = DIAGNOSTICS_NS;
/// History depth of a topic of poses, as with ROS's own publishers, and of `/tf`.
const DEPTH: u32 = 10;
const TF_DEPTH: u32 = 100;
const MAX_PREFIX: usize = 64;

pub fn run(args: &Ros2Args) -> Result<Exit, CliError> {
    if end_requested() {
        return Ok(Exit::Success);
    }
    if args.frame_prefix.len() > MAX_PREFIX {
        return Err(CliError(format!(
            "--frame-prefix: {MAX_PREFIX} characters at most"
        )));
    }
    let subject = if args.orders {
        args.subject.ordered()?
    } else {
        args.subject.fixed()?
    };
    let mut look = ComputerObserver::at(subject)?;
    let node = RosNode::new(args.domain, &args.namespace, name(&look.computer), args.distro)?;
    let place = match &args.listen {
        Some(here) => RosConnection::Here(here.clone()),
        None => RosConnection::Router(args.connect.clone()),
    };
    let mut diagnostics = Diagnostics::of(node.name());
    let mut session = RosSession::of(node.clone(), place);
    let to_diagnostics: RosTopic<DiagnosticArray> = session.topic("/diagnostics".into(), DEPTH);
    let mut drone = match &look.computer {
        Computer::Drone(_) => Some(Drone::of(&node, args, &mut session)),
        Computer::Vessel(_) => None,
    };
    let mut judged_ns = i64::MIN;
    while !end_requested() {
        if let Some(line) = session.poll(steady_ns()) {
            terminal::line(line);
        }
        let snapshot = look.poll()?;
        if let Some(drone) = &mut drone {
            match snapshot {
                Some((Computer::Drone(computer), ports)) => drone.step(computer, ports, &mut session),
                Some((Computer::Vessel(_), _)) | None => drone.reject(&session, ABSENT),
            }
        }
        if steady_ns().saturating_sub(judged_ns) >= DIAGNOSTICS_NS {
            judged_ns = steady_ns();
            let all = diagnostics.array(&look.status(), RosTime::from_nanos(wall_ns()));
            session.publish(&to_diagnostics, &all);
        }
        pause(PERIOD);
    }
    if let Some(drone) = &mut drone {
        drone.reject(&session, ENDS);
    }
    Ok(Exit::Success)
}

fn name(computer: &Computer) -> String {
    match computer {
        Computer::Vessel(v) => format!("vessel_{}", v.vessel_id),
        Computer::Drone(d) => format!("drone_{}", d.bridge.drone_id),
    }
}

struct Ports {
    observer: Observer,
    commands: Publisher<Command>,
    is_configured: bool,
    /// Whether the configuration was found, so that orders carry the right drone number.
    is_known: bool,
    /// Dropped last, because the ports above are in this memory.
    _memory: Memory,
}

impl Ports {
    fn join(instance: &Instance) -> Result<Ports, CliError> {
        let memory = Memory::join(instance, "ros2")?;
        Ok(Ports {
            observer: Observer::join(&memory)?,
            commands: memory.publisher()?,
            is_configured: false,
            is_known: false,
            _memory: memory,
        })
    }
}

struct ComputerObserver {
    subject: Subject,
    computer: Computer,
    configured: ComputerReport,
    joined: Rejoined<Ports>,
    runs: bool,
    /// Reason why the configuration cannot be read, and the time at which it is read again, ns.
    unread: Option<(String, i64)>,
}

impl ComputerObserver {
    fn at(subject: Subject) -> Result<ComputerObserver, CliError> {
        let computer = subject.computer()?;
        Ok(ComputerObserver {
            configured: configured(&computer),
            joined: Rejoined::of(computer.instance())?,
            runs: false,
            unread: None,
            subject,
            computer,
        })
    }
    fn poll(&mut self) -> Result<Option<(&Computer, &mut Ports)>, CliError> {
        self.runs = self.joined.poll(Ports::join);
        let Some(ports) = self.joined.ports.as_mut().filter(|_| self.runs) else {
            return Ok(None);
        };
        ports.observer.poll();
        if ports.observer.snapshot.processes.is_empty() {
            return Ok(None);
        }
        let waits = self
            .unread
            .as_ref()
            .is_some_and(|(_, at_ns)| steady_ns() < *at_ns);
        if !ports.is_configured && !waits {
            // Each landing writes a separate configuration before its processes begin, which names their clock.
            match self.subject.computer() {
                Ok(newest) => {
                    let was = name(&self.computer);
                    let is = name(&newest);
                    if was != is {
                        return Err(CliError(format!(
                            "the configuration is now {is}'s, but this node is {was}: restart it"
                        )));
                    }
                    self.configured = configured(&newest);
                    self.computer = newest;
                    self.unread = None;
                    ports.is_configured = true;
                    ports.is_known = self.subject.is_configured();
                }
                Err(CliError(why)) => {
                    if self.unread.as_ref().is_none_or(|(before, _)| *before != why) {
                        terminal::line(format!(
                            "{why}\nThe configuration read before is kept, and only aborts are passed on, until it can be read."
                        ));
                    }
                    self.unread = Some((why, steady_ns() + READ_AGAIN_NS));
                }
            }
        }
        Ok(Some((&self.computer, ports)))
    }
    fn status(&self) -> Status {
        let ports = self.joined.ports.as_ref().filter(|_| self.runs);
        Status::look(ports.map(|p| &p.observer.snapshot), &self.configured)
    }
}

struct Drone {
    poses: Poses,
    orders: Orders<Request>,
    odometry: RosTopic<RosOdometry>,
    deck_odometry: RosTopic<RosOdometry>,
    deck_pose: RosTopic<PoseWithCovarianceStamped>,
    transforms: RosTopic<TfMessage>,
    frame_prefix: String,
    fixed: RosTopic<TfMessage>,
    marker: RosTopic<Marker>,
    fixed_ns: i64,
}

impl Drone {
    fn of(node: &RosNode, args: &Ros2Args, session: &mut RosSession) -> Drone {
        if args.orders {
            session.service(node.private("land"), CommandKind::Land);
            session.service(node.private("abort"), CommandKind::Abort);
        }
        Drone {
            poses: Poses::new(&args.frame_prefix),
            orders: Orders::default(),
            odometry: session.topic(node.private("odometry"), DEPTH),
            deck_odometry: session.topic(node.private("deck/odometry"), DEPTH),
            deck_pose: session.topic(node.private("deck/pose"), DEPTH),
            transforms: session.topic("/tf".into(), TF_DEPTH),
            frame_prefix: args.frame_prefix.clone(),
            fixed: session.topic("/tf_static".into(), TF_DEPTH),
            marker: session.topic(node.private("deck/marker"), DEPTH),
            fixed_ns: i64::MIN,
        }
    }
    /// Rejects every order because there is no mission.
    fn reject(&mut self, session: &RosSession, why: &str) {
        self.orders.answer(false, why);
        while let Some(request) = session.request() {
            request.reply(false, why);
        }
    }
    fn step(&mut self, computer: &DroneComputerConfig, ports: &mut Ports, session: &mut RosSession) {
        while let Some(request) = session.request() {
            if let Some(why) = is_late(request.kind, request.sent_ns, wall_ns()) {
                request.reply(false, &why);
                continue;
            }
            // Without the configuration a landing might be ordered from the wrong drone, so it is rejected; an abort
            // is still sent.
            if !ports.is_known && request.kind != CommandKind::Abort {
                request.reply(false, UNKNOWN);
                continue;
            }
            self.orders.take(request.kind, request, computer, steady_ns());
        }
        let snapshot = &ports.observer.snapshot;
        let mission = snapshot.mission.fresh(steady_ns());
        let due = self.orders.poll(computer.bridge.drone_id, mission, steady_ns());
        ports.commands.send_any(due.as_ref());
        // Offset of the drone's clock from the system clock, which may be set at any time.
        let ahead_ns = wall_ns() - computer.clock.now::<DroneClock>().nanos();
        let stamp = |at: DroneTime| at.nanos().saturating_add(ahead_ns);
        let new = self.poses.newer(snapshot, stamp);
        if let Some(drone) = &new.drone {
            session.publish(&self.odometry, drone);
        }
        if let (Some(deck), Some(pose)) = (&new.deck, new.deck_pose()) {
            session.publish(&self.deck_odometry, deck);
            session.publish(&self.deck_pose, &pose);
        }
        if let Some(transforms) = new.transforms() {
            session.publish(&self.transforms, &transforms);
        }
        // Without the configuration the shapes would not be those of this drone and deck.
        if ports.is_known && steady_ns().saturating_sub(self.fixed_ns) >= FIXED_NS {
            self.fixed_ns = steady_ns();
            let prefix = &self.frame_prefix;
            let body = &computer.drone;
            let stamp = RosTime::from_nanos(wall_ns());
            let frames = fixed::transforms(prefix, stamp, &body.airframe, &body.deck);
            session.publish(&self.fixed, &frames);
            session.publish(&self.marker, &fixed::marker(prefix, &body.deck));
        }
    }
}
