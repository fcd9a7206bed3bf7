//! `alight command`: an operator's command to a mission, and its answer: on the drone's own computer through
//! shared memory, or from ashore through the vessel, with an operator's certificate. On the vessel's computer
//! also the crew's order for the deck.

use std::path::{Path, PathBuf};
use std::time::Duration;

use alight_shared::config::{self, Check, Keys};
use alight_shared::msg::{
    Charge, Command, CommandKind, CommandProgress, CommandReceipt, DroneStatus, Header, MESSAGE_VERSION,
    MissionState, OperatorCommand, Reason, State, still_armed,
};
use alight_shared::time::{DroneClock, Time, VesselClock};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Instance, Memory, Publisher, Subscriber};
use alight_shared::transport::radio::{Publication, Radio, RadioConfig, Urgency};
use alight_shared::transport::wake::end_requested;
use alight_shared::{topics, wire};
use alight_usv::deck::{Closure, DeckOrder};
use clap::{Args, ValueEnum};
use serde_json::json;

use crate::config::{DroneComputer, VesselComputer};
use crate::exit::{CliError, Exit};
use crate::process::instance::is_running;
use crate::process::life::draw_boot;
use crate::process::local_command::LocalCommand;
use crate::process::radio_keys::vessel_key;
use crate::process::supervisor::pause;
use crate::vessel::{deck_file, status_file};
use crate::{certificates, terminal};

/// What shows whether a command was taken is looked at this often.
const POLL_PERIOD: Duration = Duration::from_millis(50);
/// From ashore it takes a session and two radios.
const MAX_POLLS_ASHORE: u32 = 240;
/// The session is awaited for so long, 3 s, before an order is sent all the same: a vessel that is not received may
/// receive.
const MAX_POLLS_CONTACT: u32 = 60;
/// The vessel's status comes twice a second.
const MAX_POLLS_DECK: u32 = 120;
/// A command that shows no effect is repeated after so many looks.
const REPEAT_POLLS: u32 = 10;

/// An operator's command.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum Order {
    /// Land on the vessel.
    Land,
    /// Stop landing, climb and hold; always wins.
    Abort,
    /// Hold where you are.
    Hold,
    /// Say how the mission stands; commands nothing.
    Status,
    /// On the vessel: close the deck or open it.
    Deck,
    /// On the vessel: course and speed are kept for a while (`--for`).
    Steady,
    /// On the vessel: she turns or may turn, until `steady` is ordered.
    Turning,
}

/// Order of the crew for the deck.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum CrewOrder {
    /// Nobody descends; a descent that is still high is broken off.
    Closed,
    /// It is free, but for drones that report from it.
    Open,
}

impl Order {
    /// What is commanded, if anything.
    const fn kind(self) -> Option<CommandKind> {
        match self {
            Order::Land => Some(CommandKind::Land),
            Order::Abort => Some(CommandKind::Abort),
            Order::Hold => Some(CommandKind::Hold),
            Order::Status | Order::Deck | Order::Steady | Order::Turning => None,
        }
    }
}

/// A command.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight command abort\n\
From ashore: alight command abort --vessel quic/192.168.7.1:7447 --keys keys/operator-1\n\
On the vessel: sudo -u alight alight command deck closed\n\
               sudo -u alight alight command steady --for 60\n\
Exit codes: 0 the mission or the vessel took it, 1 it did not in time, 2 bad input or no mission answers."
)]
pub struct CommandArgs {
    /// What to command
    #[arg(value_enum)]
    pub order: Order,
    /// With `deck`: closed or open
    #[arg(value_enum, required_if_eq("order", "deck"))]
    pub deck: Option<CrewOrder>,
    /// With `steady`: for so long, s; 0: nothing is stated any more
    #[arg(long = "for", value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u32).range(0..=3600))]
    pub for_s: u32,
    /// Configuration of the drone's computer, with `deck`, `steady` and `turning` of the vessel's (TOML) [default: /etc/alight/drone.toml or
    /// /etc/alight/vessel.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Name of the set of processes [default: the configuration's]
    #[arg(long)]
    pub instance: Option<String>,
    /// From ashore: endpoint of the vessel, such as quic/192.168.7.1:7447
    #[arg(long, value_name = "ENDPOINT", requires = "keys")]
    pub vessel: Option<String>,
    /// From ashore: directory with an operator's certificate, as `alight keys operator` makes it
    #[arg(long, value_name = "DIR", requires = "vessel")]
    pub keys: Option<PathBuf>,
    /// From ashore: number of the vessel
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub vessel_id: u32,
    /// From ashore: number of the drone
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub drone: u32,
    /// One JSON object instead of lines
    #[arg(long)]
    pub json: bool,
}

impl CommandArgs {
    fn config_or(&self, shipped: &str) -> PathBuf {
        self.config.clone().unwrap_or_else(|| shipped.into())
    }
}

/// Commands, waits for the mission's answer and shows it.
pub fn run(args: &CommandArgs) -> Result<Exit, CliError> {
    match (args.order, args.deck) {
        (Order::Deck, Some(word)) => return deck(args, word),
        (Order::Steady, None) => return course(args, DeckOrder::Steady(args.for_s)),
        (Order::Turning, None) => return course(args, DeckOrder::Turning),
        (
            Order::Land | Order::Abort | Order::Hold | Order::Status | Order::Steady | Order::Turning,
            Some(_),
        ) => {
            return Err(CliError("closed and open belong to `alight command deck`".into()));
        }
        (_, None) => {}
    }
    match (&args.vessel, &args.keys) {
        (Some(endpoint), Some(keys)) => ashore(args, endpoint, keys),
        (_, _) => here(args),
    }
}

/// The computer of the vessel, on which `what` is done.
fn on_board(args: &CommandArgs, what: &str) -> Result<VesselComputer, CliError> {
    if args.vessel.is_some() || args.instance.is_some() {
        return Err(CliError(format!(
            "{what} on the vessel's own computer: no --vessel, no --instance"
        )));
    }
    Ok(config::load(&args.config_or("/etc/alight/vessel.toml"))?)
}

/// What the helm intends, to the vessel's process on this computer.
fn course(args: &CommandArgs, order: DeckOrder) -> Result<Exit, CliError> {
    let computer = on_board(args, "the course is stated")?;
    let left = deck_file::leave(&computer, order).map_err(CliError)?;
    let taken = (0..MAX_POLLS_DECK).any(|_| {
        pause(POLL_PERIOD);
        !left.exists()
    });
    // A promise that is taken up later would be a wrong one.
    let withdrawn = !taken && std::fs::remove_file(&left).is_ok();
    let newest = status_file::read(&computer).and_then(Result::ok);
    if args.json {
        terminal::line(json!({ "taken": taken, "withdrawn": withdrawn, "deck": newest.map(|s| s.deck) }));
    } else if !taken {
        terminal::line(
            "the vessel's process has not taken it, and it is withdrawn: systemctl status alight-vessel",
        );
    } else {
        let stated = match order {
            DeckOrder::Steady(0) => "nothing is stated of the course",
            DeckOrder::Steady(_) => "course and speed are kept; a turn at the helm's switch counts more",
            DeckOrder::Turning | DeckOrder::Closed | DeckOrder::Open => "no drone descends while she turns",
        };
        terminal::line(stated);
    }
    Ok(Exit::of(taken))
}

/// To the vessel's process on this computer.
fn deck(args: &CommandArgs, word: CrewOrder) -> Result<Exit, CliError> {
    let computer = on_board(args, "the deck is closed and opened")?;
    let order = match word {
        CrewOrder::Closed => DeckOrder::Closed,
        CrewOrder::Open => DeckOrder::Open,
    };
    let left = deck_file::leave(&computer, order).map_err(CliError)?;
    let mut newest = None;
    let taken = (0..MAX_POLLS_DECK).any(|_| {
        pause(POLL_PERIOD);
        newest = status_file::read(&computer).and_then(Result::ok);
        let ordered = newest.as_ref().map(|s| match s.deck.closed {
            Some(
                Closure::Crew
                | Closure::CheckpointDamaged
                | Closure::CheckpointMissing
                | Closure::CheckpointUnwritable,
            ) => CrewOrder::Closed,
            // These close it beside an order.
            Some(Closure::Switch | Closure::Sensor) | None => CrewOrder::Open,
        });
        !left.exists() && ordered == Some(word)
    });
    let closed = newest.as_ref().is_some_and(|s| s.deck.closed.is_some());
    if args.json {
        terminal::line(json!({ "taken": taken, "deck": newest.map(|s| s.deck) }));
    } else if taken {
        terminal::line(match word {
            CrewOrder::Closed => "the deck is closed",
            CrewOrder::Open if closed => {
                "the order is taken, but switch or sensor keep the deck closed: alight status"
            }
            CrewOrder::Open => "the deck is open",
        });
    } else {
        terminal::line(
            "the vessel's process has not taken it, and will when it runs: systemctl status alight-vessel",
        );
    }
    Ok(Exit::of(taken && closed == (word == CrewOrder::Closed)))
}

/// Through the shared memory of the drone's computer.
fn here(args: &CommandArgs) -> Result<Exit, CliError> {
    let computer: DroneComputer = config::load(&args.config_or("/etc/alight/drone.toml"))?;
    let name = args.instance.as_ref().unwrap_or(&computer.instance);
    let instance = Instance::new(name)?;
    if !is_running(&instance) {
        return Err(CliError(format!(
            "no mission runs under the name {name}: systemctl status alight-drone"
        )));
    }
    let memory = Memory::join(&instance, "command")?;
    let mut missions: Subscriber<MissionState> = memory.subscriber()?;
    let mut commands: Publisher<Command> = memory.publisher()?;
    let mut command = LocalCommand::new(&computer, args.order.kind(), steady_ns());
    let mut newest: Option<MissionState> = None;
    while !command.is_over(steady_ns()) {
        let now: Time<DroneClock> = computer.clock.now();
        newest = missions.newest(now.nanos()).or(newest);
        if newest.is_some_and(|m| command.is_met(&m)) {
            break;
        }
        commands.send_any(command.due(steady_ns()).as_ref());
        if !memory.wait(POLL_PERIOD) {
            return Ok(Exit::Failed);
        }
    }
    let Some(mission) = newest else {
        return Err(CliError(format!(
            "no mission answers under the name {name}: alight status --instance {name} shows what runs"
        )));
    };
    let taken = command.is_met(&mission);
    if args.json {
        terminal::line(json!({ "taken": taken, "mission": mission }));
    } else {
        print_answer(mission.state, &mission.entered, &mission.waiting, taken);
    }
    Ok(Exit::of(taken))
}

/// What the terminal ashore knows of its order.
struct Ashore {
    order: OperatorCommand<VesselClock>,
    /// Nothing is commanded.
    asks_only: bool,
    /// Something of the vessel came: the session is open.
    contact: bool,
    /// What the vessel reports of this order.
    receipt: Option<CommandProgress>,
    drone: Option<DroneStatus>,
    sent: u32,
}

impl Ashore {
    /// A receipt of this order; those of others, and of former ones, say nothing about it.
    fn receive_receipt(&mut self, r: &CommandReceipt) {
        let h = &self.order.header;
        let own =
            r.operator == [h.boot, h.sequence] && r.header.drone == h.drone && r.header.vessel == h.vessel;
        if r.header.version == MESSAGE_VERSION && own {
            self.receipt = Some(r.progress);
        }
    }
    fn receive_status(&mut self, status: DroneStatus) {
        if status.header.version == MESSAGE_VERSION && status.header.drone == self.order.header.drone {
            self.drone = Some(status);
        }
    }
    /// Whether to send the order at this look. Before the session is open it would be lost; a vessel that is never
    /// received may yet receive.
    fn is_due(&mut self, poll: u32) -> bool {
        let open = self.contact || poll >= MAX_POLLS_CONTACT;
        let due = !self.asks_only && open && poll.is_multiple_of(REPEAT_POLLS);
        self.sent += u32::from(due);
        due
    }
    fn is_answered(&self) -> bool {
        match self.receipt {
            None => self.asks_only && self.drone.is_some(),
            Some(CommandProgress::Pending) => false,
            Some(
                CommandProgress::Taken
                | CommandProgress::GivenUp
                | CommandProgress::Forbidden
                | CommandProgress::Replaced
                | CommandProgress::Unknown,
            ) => true,
        }
    }
    fn is_taken(&self) -> bool {
        self.receipt == Some(CommandProgress::Taken) || self.asks_only && self.drone.is_some()
    }
    /// What became of the order, for a person.
    fn outcome(&self) -> &'static str {
        let abort = self.order.kind == CommandKind::Abort;
        match self.receipt {
            _ if self.asks_only => "",
            Some(CommandProgress::Taken) => "the drone has taken the command",
            Some(CommandProgress::Pending) if abort => {
                "the vessel has the abort, and the drone has not acknowledged it:\nit STAYS PENDING, and is \
                 repeated until the drone does"
            }
            Some(CommandProgress::Pending) => {
                "the vessel has the command, and the drone has not taken it:\nthe vessel gives it up 10 s after \
                 it came"
            }
            Some(CommandProgress::GivenUp) => "the drone did not take the command, and the vessel gave it up",
            Some(CommandProgress::Forbidden) => {
                "the vessel did not pass it on: an abort is pending or has just\nbeen given; look, then command again"
            }
            Some(CommandProgress::Replaced) => "a newer command for this drone has replaced it",
            Some(CommandProgress::Unknown) => {
                "the vessel was started anew and does not know what became of it:\nlook at the drone, then \
                 command again"
            }
            None if self.sent == 0 => "the command was NOT SENT",
            None if abort => {
                "RECEIPT UNCONFIRMED: whether the vessel has the abort is not known.\nIf it has, it stays \
                 pending; if not, nothing repeats it:\ncommand it again, or take the drone over by remote control"
            }
            None => {
                "RECEIPT UNCONFIRMED: whether the vessel has the command is not known;\nit may yet act for 10 s: \
                 abort if it must not"
            }
        }
    }
}

/// Through the vessel, over the secured radio.
fn ashore(args: &CommandArgs, endpoint: &str, keys: &Path) -> Result<Exit, CliError> {
    let own = certificates::read_certificate(&keys.join("certificate.pem"))?
        .certificate
        .name;
    let vessel = certificates::common_name("vessel", args.vessel_id);
    let config = RadioConfig::dialling(endpoint, certificates::files(keys, vec![vessel])?);
    config.check(&Keys::ROOT)?;
    let key = format!("alight/{own}/{}", topics::OPERATOR.name);
    let publications = vec![Publication::new(key, Urgency::State)];
    // The grants come whether or not a drone is received.
    let received = [&topics::DRONES, &topics::RECEIPTS, &topics::DECK];
    let received = received.map(|topic| vessel_key(args.vessel_id, topic.name));
    let mut radio = Radio::open(&config, publications, received.into())?;
    let kind = args.order.kind();
    let mut ashore = Ashore {
        order: OperatorCommand {
            header: Header::new(args.vessel_id, args.drone, draw_boot(), 1, Time::EPOCH),
            kind: kind.unwrap_or_default(),
        },
        asks_only: kind.is_none(),
        contact: false,
        receipt: None,
        drone: None,
        sent: 0,
    };
    for poll in 0..MAX_POLLS_ASHORE {
        if end_requested() || ashore.is_answered() {
            break;
        }
        // The same command again is one command.
        if let Some(Ok(bytes)) = ashore.is_due(poll).then(|| wire::encode(&ashore.order)) {
            radio.send(0, bytes);
        }
        // What has come until now, and what comes within the period.
        let mut next = radio.receive(POLL_PERIOD);
        while let Some(packet) = next {
            ashore.contact = true;
            match packet.subscription {
                0 => wire::decode(&packet.bytes)
                    .into_iter()
                    .for_each(|s| ashore.receive_status(s)),
                1 => wire::decode(&packet.bytes)
                    .into_iter()
                    .for_each(|r| ashore.receive_receipt(&r)),
                _ => {}
            }
            next = radio.receive(Duration::ZERO);
        }
    }
    report_ashore(args, (endpoint, &own), &ashore)
}

fn report_ashore(
    args: &CommandArgs,
    (endpoint, own): (&str, &str),
    ashore: &Ashore,
) -> Result<Exit, CliError> {
    if ashore.drone.is_none() && ashore.receipt.is_none() {
        let reason = format!(
            "{endpoint} relays no status of drone {}: does the vessel run, does it list {own} in radio.tls.peers, \
             and does it receive the drone (systemctl status alight-vessel)?",
            args.drone
        );
        let outcome = ashore.outcome();
        return Err(CliError(if outcome.is_empty() {
            reason
        } else {
            format!("{outcome}\n{reason}")
        }));
    }
    let taken = ashore.is_taken();
    if args.json {
        terminal::line(json!({ "taken": taken, "receipt": ashore.receipt, "drone": ashore.drone }));
        return Ok(Exit::of(taken));
    }
    match &ashore.drone {
        Some(status) => {
            terminal::line(format_args!("{}: {}", status.state.name(), status.entered));
            terminal::line(format_args!("waiting: {}", status.waiting));
            terminal::line(format_args!("battery {}", Charge(status.battery)));
            if let Some(for_s) = status.still_armed_s {
                terminal::line(format_args!(
                    "ALARM: drone {}: {}",
                    args.drone,
                    still_armed(for_s)
                ));
            }
        }
        None => terminal::line(format_args!("the vessel receives no drone {}", args.drone)),
    }
    if !ashore.asks_only {
        terminal::line(ashore.outcome());
    }
    Ok(Exit::of(taken))
}

fn print_answer(state: State, entered: &Reason, waiting: &Reason, taken: bool) {
    terminal::line(format_args!("{}: {entered}", state.name()));
    terminal::line(format_args!("waiting: {waiting}"));
    if !taken {
        terminal::line("the mission did not take the command");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::ReasonCode;

    fn ordered(kind: CommandKind) -> Ashore {
        Ashore {
            order: OperatorCommand {
                header: Header::new(1, 3, 5, 1, Time::EPOCH),
                kind,
            },
            asks_only: false,
            contact: false,
            receipt: None,
            drone: None,
            sent: 0,
        }
    }
    fn receipt(operator: [u32; 2], drone: u32, progress: CommandProgress) -> CommandReceipt {
        CommandReceipt {
            header: Header::new(1, drone, 9, 1, Time::EPOCH),
            operator,
            kind: CommandKind::Abort,
            progress,
        }
    }

    #[test]
    fn command_with_a_coincident_status() {
        let mut terminal = ordered(CommandKind::Abort);
        // It gave up before, as it would after the abort.
        let given_up = DroneStatus {
            header: Header::new(1, 3, 7, 1, Time::EPOCH),
            state: State::GaveUp,
            waiting: Reason::plain(ReasonCode::NotCommanded),
            ..DroneStatus::default()
        };
        terminal.receive_status(given_up);
        assert!(!terminal.is_answered() && !terminal.is_taken());
        // Nor are the receipts of other orders an answer.
        for (operator, drone) in [([6, 1], 3), ([5, 2], 3), ([5, 1], 4)] {
            terminal.receive_receipt(&receipt(operator, drone, CommandProgress::Taken));
        }
        assert_eq!(terminal.receipt, None);
        terminal.receive_receipt(&receipt([5, 1], 3, CommandProgress::Pending));
        assert!(!terminal.is_answered());
        terminal.receive_receipt(&receipt([5, 1], 3, CommandProgress::Taken));
        assert!(terminal.is_answered() && terminal.is_taken());
    }

    #[test]
    fn command_before_the_session_is_open() {
        let mut terminal = ordered(CommandKind::Land);
        let early = (0..MAX_POLLS_CONTACT).filter(|k| terminal.is_due(*k)).count();
        assert_eq!((early, terminal.sent), (0, 0));
        assert_eq!(terminal.outcome(), "the command was NOT SENT");
        // A vessel that is not received is tried all the same.
        assert!((MAX_POLLS_CONTACT..MAX_POLLS_ASHORE).any(|k| terminal.is_due(k)));
        let mut terminal = ordered(CommandKind::Land);
        terminal.contact = true;
        let sent = (0..MAX_POLLS_CONTACT).filter(|k| terminal.is_due(*k)).count();
        assert_eq!(sent as u32, MAX_POLLS_CONTACT / REPEAT_POLLS);
    }

    #[test]
    fn command_abort_without_answer() {
        let mut terminal = ordered(CommandKind::Abort);
        terminal.sent = 1;
        assert!(terminal.outcome().starts_with("RECEIPT UNCONFIRMED"));
        assert!(terminal.outcome().contains("stays pending; if not"));
        terminal.receipt = Some(CommandProgress::Pending);
        assert!(terminal.outcome().contains("STAYS PENDING"));
        terminal.order.kind = CommandKind::Land;
        assert!(terminal.outcome().contains("gives it up"));
    }

    #[test]
    fn command_outcome_width() {
        let progress = [
            None,
            Some(CommandProgress::Pending),
            Some(CommandProgress::Taken),
            Some(CommandProgress::GivenUp),
            Some(CommandProgress::Forbidden),
            Some(CommandProgress::Replaced),
            Some(CommandProgress::Unknown),
        ];
        for kind in [CommandKind::Abort, CommandKind::Land, CommandKind::Hold] {
            for receipt in progress {
                let terminal = Ashore {
                    receipt,
                    sent: 1,
                    ..ordered(kind)
                };
                let text = terminal.outcome();
                assert!(
                    !text.is_empty() && text.lines().all(|l| l.chars().count() <= 80),
                    "{text}"
                );
            }
        }
    }
}
