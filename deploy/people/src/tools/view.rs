use alight_shared::msg::ComputerReport;
use std::{net::SocketAddr, sync::atomic::Ordering, time::Duration};

use alight_computer::{
    config::{
        DroneComputerConfig, VesselComputerConfig,
        view::{FOXGLOVE, ViewConfig},
    },
    exit::{CliError, Doing, Exit},
    io::wall::wall_ns,
    playback::{Bodies, Viewer},
    process::{
        args::page_address,
        facts::Facts,
        life::{Life, draw_boot, end_with_supervisor},
        local_command::give,
        observer::Rejoined,
        supervisor::pause,
    },
    subject::{Computer, Subject},
    terminal,
};
use alight_shared::{
    admission::Retransmission,
    msg::{Command, CommandKind, MissionState, State},
    process::{ProcessKind, ProcessState},
    time::{Span, SteadyClock, Time, TrueTime},
};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory, Publisher},
    wake::end_requested,
};
use clap::Args;

use crate::{
    status::Status,
    tools::{flights, view_vessel},
    view::{
        camera::CameraFeed,
        memory_observer::MemoryObserver,
        server::{PageOrder, Served},
        view_observer::ViewObserver,
    },
};

/// Computer to show, and the addresses to serve.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight view\n\
Then open http://127.0.0.1:7450 in a browser on this computer. For a phone on\n\
board name an address of this computer's network (or view.listen), where\n\
everybody sees it: alight view --listen 192.168.7.1:7450\n\
Foxglove: alight view --foxglove, then Open connection, Foxglove WebSocket,\n\
ws://127.0.0.1:8765.\n\
Ctrl-C ends it; no flight waits for it."
)]
pub struct ViewCommand {
    #[command(flatten)]
    subject: Subject,
    /// Address of the page [default: view.listen of the configuration, 127.0.0.1:7450]
    #[arg(long, value_name = "ADDR:PORT")]
    pub listen: Option<SocketAddr>,
    /// Serve the topics of a recording to Foxglove [default: view.foxglove; without a value: 127.0.0.1:8765]
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, value_parser = page_address)]
    pub foxglove: Option<Option<SocketAddr>>,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// Polling period, ns; the display periods of recordings are multiples of it.
const POLL_PERIOD_NS: i64 = 20_000_000;
/// Polling period when only the page is served.
const PAGE_PERIOD: Duration = Duration::from_millis(100);
/// Pause before processes with this name are looked up again.
const ABSENT_PAUSE: Duration = Duration::from_millis(500);

/// Addresses to serve; the flags take precedence over the configuration.
fn served(view: &ViewConfig, name: &str) -> Result<Served, CliError> {
    let address = |text: &str| {
        text.parse::<SocketAddr>()
            .doing(format_args!("the address {text}"))
    };
    Ok(Served {
        page: address(&view.listen)?,
        foxglove: match view.foxglove.as_str() {
            "" => None,
            text => Some(address(text)?),
        },
        name: name.into(),
        may_order: view.abort,
    })
}

/// Starts the view of a simulated flight.
pub fn start_viewer(
    view: &ViewConfig,
    name: &str,
    known: ComputerReport,
    bodies: Bodies,
) -> Result<Box<dyn Viewer>, CliError> {
    let observer = ViewObserver::start(served(view, name)?, known, &bodies, true)?;
    Ok(Box::new(observer))
}

pub fn run(args: &ViewCommand) -> Result<Exit, CliError> {
    // The first call installs the signal handler.
    let stop_requested = end_with_supervisor(args.supervised);
    if end_requested() {
        return Ok(Exit::Success);
    }
    let over = |mut view: ViewConfig| {
        view.listen = args.listen.map_or(view.listen, |a| a.to_string());
        if let Some(address) = args.foxglove {
            view.foxglove = address.map_or_else(|| FOXGLOVE.into(), |a| a.to_string());
        }
        view
    };
    let ends = || end_requested() || stop_requested.load(Ordering::Relaxed);
    let subject = args.subject.fixed()?;
    match subject.computer()? {
        Computer::Vessel(v) => vessel(&v, &over(v.view.clone()), &ends),
        Computer::Drone(d) => {
            let view = over(d.view.clone());
            drone(*d, &subject, &view, &ends)
        }
    }
}

fn vessel(
    computer: &VesselComputerConfig,
    view: &ViewConfig,
    ends: &dyn Fn() -> bool,
) -> Result<Exit, CliError> {
    if !view.foxglove.is_empty() {
        return Err(CliError(
            "the vessel has nothing for Foxglove: serve it on the drone's computer (--foxglove, view.foxglove)".into(),
        ));
    }
    let served = served(view, "vessel")?;
    let server = crate::view::server::Server::start(served)?;
    server.lines().iter().for_each(terminal::line);
    let mut look = view_vessel::VesselObserver::new(computer, view.abort)?;
    while !ends() {
        server.show(look.picture(steady_ns()));
        look.carry_out(server.order());
        pause(PAGE_PERIOD);
    }
    Ok(Exit::Success)
}

fn drone(
    mut computer: DroneComputerConfig,
    subject: &Subject,
    view: &ViewConfig,
    ends: &dyn Fn() -> bool,
) -> Result<Exit, CliError> {
    let bodies: Bodies = Some((computer.drone.deck, computer.drone.airframe));
    let served = served(view, &computer.instance)?;
    let is_live = served.foxglove.is_some();
    let mut configured = Facts::drone(&computer).report;
    let mut observer = ViewObserver::start(served, configured, &bodies, false)?;
    observer.server.lines().iter().for_each(terminal::line);
    let mut joined: Rejoined<Ports> = Rejoined::of(&computer.instance)?;
    let wall_ns = wall_offset_ns();
    while !ends() {
        let mut is_new = false;
        let runs = joined.poll(|instance| {
            is_new = true;
            Ports::join(instance)
        });
        let Some(ports) = joined.ports.as_mut().filter(|_| runs) else {
            observer.show_nothing(
                Time::from_nanos(steady_ns() + wall_ns),
                Status::absent(&configured),
            );
            reject(observer.server.order());
            pause(ABSENT_PAUSE);
            continue;
        };
        if is_new {
            // Processes started since then may have another number and another clock.
            if let Ok(Computer::Drone(newest)) = subject.computer() {
                computer = *newest;
                configured = Facts::drone(&computer).report;
            }
            observer.board.situation.known = configured;
            observer.reset(Span::from_nanos(wall_ns));
            observer.board.earlier = flights::earlier(&computer.recorder.directory);
            observer.board.order.label = view.abort.then_some("ABORT");
        }
        ports.poll(&computer, &mut observer, wall_ns);
        let wait = if is_live {
            let next = POLL_PERIOD_NS - (steady_ns() + wall_ns).rem_euclid(POLL_PERIOD_NS);
            Duration::from_nanos(next.unsigned_abs())
        } else {
            PAGE_PERIOD
        };
        if !ports.memory.wait(wait) {
            break;
        }
    }
    if observer.board.is_simulated() {
        // The world's last report gives the reason for the end.
        if let Some(ports) = joined.ports.as_mut() {
            ports.poll(&computer, &mut observer, wall_ns);
        }
        observer.end("the simulation has ended");
        pause(ABSENT_PAUSE);
    }
    Ok(Exit::Success)
}

fn reject(order: Option<PageOrder>) {
    if let Some(order) = order {
        let _gone = order.reply.send(Err("no mission runs".into()));
    }
}

struct Ports {
    memory: Memory,
    feed: MemoryObserver<Memory>,
    camera: CameraFeed,
    commands: Publisher<Command>,
    reports: Publisher<ProcessState>,
    life: Life,
    abort: Option<(Retransmission<SteadyClock, Command>, PageOrder)>,
}

impl Ports {
    fn join(instance: &Instance) -> Result<Ports, CliError> {
        let memory = Memory::join(instance, ProcessKind::View.name())?;
        Ok(Ports {
            feed: MemoryObserver::join(&memory)?,
            camera: CameraFeed::default(),
            commands: memory.publisher()?,
            reports: memory.publisher()?,
            life: Life::begin(ProcessKind::View, draw_boot(), false),
            abort: None,
            memory,
        })
    }
    /// Shows new messages of the processes, and carries out the page's order.
    fn poll(&mut self, computer: &DroneComputerConfig, observer: &mut ViewObserver, wall_ns: i64) {
        let now_ns = steady_ns();
        let grid_ns = (now_ns + wall_ns) / POLL_PERIOD_NS * POLL_PERIOD_NS;
        let (t, now): (Time<TrueTime>, _) = (Time::from_nanos(grid_ns), computer.clock.now());
        self.camera.poll(&self.memory, t, now, observer);
        let mission = self.feed.poll(t, now, observer);
        self.life.stepped(Some((steady_ns() - now_ns) as f64 * 1e-9));
        if let Some(answer) = self.order(computer, observer.server.order(), mission.as_ref()) {
            observer.board.order.answer = answer;
        }
        if let Some(report) = self.life.state(Vec::new, 0) {
            self.reports.send(&report);
        }
    }

    /// Executes the page's order, an abort, like `alight order abort` on this computer, and replies with its
    /// result.
    fn order(
        &mut self,
        computer: &DroneComputerConfig,
        given: Option<PageOrder>,
        mission: Option<&MissionState>,
    ) -> Option<String> {
        let now = Time::from_nanos(steady_ns());
        if let Some(order) = given {
            match self.abort {
                _ if !order.name.is_empty() => drop(order.reply.send(Err("this page can only abort".into()))),
                None => self.abort = Some((give(computer, CommandKind::Abort, now), order)),
                Some(_) => drop(order.reply.send(Err("an abort is under way".into()))),
            }
        }
        let (command, _) = self.abort.as_mut()?;
        self.commands.send_any(command.due(now).as_ref());
        let taken = mission.filter(|m| command.answered(m) == Some(true));
        let answer = match taken {
            Some(m) => {
                let stands = matches!(m.state, State::Idle | State::Landed);
                let nothing = if stands { ", nothing to stop" } else { "" };
                Ok(format!("abort taken: {}{nothing}", m.state.named(&m.entered)))
            }
            None if command.is_over(now) => {
                Err("ABORT NOT TAKEN: the mission does not confirm it; take manual control".to_owned())
            }
            None => return None,
        };
        let (_, order) = self.abort.take()?;
        let text = answer.clone().unwrap_or_else(|e| e);
        let _gone = order.reply.send(answer);
        Some(text)
    }
}

/// Time of day minus the steady clock, ns; messages for Foxglove carry the time of day.
fn wall_offset_ns() -> i64 {
    wall_ns() - steady_ns()
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_computer::process::instance::OwnedInstance;
    use alight_shared::{msg::Header, time::DroneClock};
    use alight_transport::memory::{Services, Subscriber};

    fn published(at: Time<DroneClock>, state: State) -> MissionState {
        MissionState {
            header: Header::new(1, 1, 7, 1, at),
            state,
            ..MissionState::default()
        }
    }

    fn page_order(reply: tokio::sync::oneshot::Sender<Result<String, String>>) -> PageOrder {
        PageOrder {
            name: String::new(),
            reply,
        }
    }

    #[test]
    fn view_of_shared_memory_and_its_abort() {
        let name = format!("test-view-{}", std::process::id());
        let owned = OwnedInstance::take(&name).unwrap();
        let memory = Memory::join(owned.instance(), "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let mut missions: Publisher<MissionState> = memory.publisher().unwrap();
        let mut commands: Subscriber<Command> = memory.subscriber().unwrap();
        let computer = DroneComputerConfig {
            instance: name,
            ..DroneComputerConfig::default()
        };
        let mut joined = Ports::join(owned.instance()).unwrap();
        let view = ViewConfig {
            listen: "127.0.0.1:0".into(),
            ..ViewConfig::default()
        };
        let served = served(&view, "test").unwrap();
        let mut observer = ViewObserver::start(served, ComputerReport::default(), &None, false).unwrap();
        let mut show = |joined: &mut Ports, state, abort| {
            let now = computer.clock.now();
            missions.send(&MissionState {
                abort,
                ..published(now, state)
            });
            let mission = joined
                .feed
                .poll(Time::from_nanos(now.nanos()), now, &mut observer);
            let picture = observer.board.picture(Time::from_nanos(now.nanos()));
            (mission, picture.status.state.map(|s| s.name))
        };
        let (descends, shown) = show(&mut joined, State::Descent, None);
        assert_eq!(shown.as_deref(), Some("Descent"));

        let (reply, mut answer) = tokio::sync::oneshot::channel();
        let given = joined.order(&computer, Some(page_order(reply)), descends.as_ref());
        assert_eq!(given, None);
        let sent = commands.newest(0).unwrap();
        assert_eq!(sent.kind, CommandKind::Abort);
        assert!(answer.try_recv().is_err(), "answered before the mission did");
        let (reply, mut second) = tokio::sync::oneshot::channel();
        assert_eq!(joined.order(&computer, Some(page_order(reply)), None), None);
        assert!(second.try_recv().unwrap().is_err(), "two at a time");
        let echo = Some([sent.header.boot, sent.header.sequence]);
        let (gave_up, _) = show(&mut joined, State::GaveUp, echo);
        let text = joined.order(&computer, None, gave_up.as_ref());
        assert_eq!(text.as_deref(), Some("abort taken: Gave up"));
        assert_eq!(answer.try_recv().unwrap(), Ok("abort taken: Gave up".into()));
        drop((missions, commands, joined, services, memory));
    }
}
