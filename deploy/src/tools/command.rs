//! `alight command`: an operator's command to a mission, and its answer: on the drone's own computer
//! through shared memory, or from ashore through the vessel, with an operator's certificate. And on the vessel's
//! computer the crew's word on the deck.

use std::path::{Path, PathBuf};
use std::time::Duration;

use alight_shared::config::{self, Check, Keys};
use alight_shared::msg::{
    Command, CommandKind, DroneStatus, Header, MESSAGE_VERSION, MissionState, OperatorCommand, Reason, State, still_armed,
};
use alight_shared::time::{DroneClock, Time, VesselClock};
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
use crate::process::radio_keys::vessel_key;
use crate::process::supervisor::pause;
use crate::vessel::{deck_file, status_file};
use crate::{certificates, terminal};

/// The mission has this long to show that it took the command: its state comes at 50 Hz ...
const MAX_POLLS: u32 = 40;
/// ... looked at this often.
const POLL_PERIOD: Duration = Duration::from_millis(50);
/// From ashore it takes a session and two radios.
const MAX_POLLS_ASHORE: u32 = 240;
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
}

/// What the crew says of the deck.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum DeckWord {
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
            Order::Status | Order::Deck => None,
        }
    }
}

/// A command.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight command abort\n\
From ashore: alight command abort --vessel quic/192.168.7.1:7447 --keys keys/operator-1\n\
On the vessel: sudo -u alight alight command deck closed\n\
Exit codes: 0 the mission or the vessel took it, 1 it did not in time, 2 bad input or no mission answers."
)]
pub struct CommandArgs {
    /// What to command
    #[arg(value_enum)]
    pub order: Order,
    /// With `deck`: closed or open
    #[arg(value_enum, required_if_eq("order", "deck"))]
    pub deck: Option<DeckWord>,
    /// Configuration of the drone's computer, with `deck` of the vessel's (TOML) [default: /etc/alight/drone.toml or
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
        (Order::Land | Order::Abort | Order::Hold | Order::Status, Some(_)) => {
            return Err(CliError("closed and open belong to `alight command deck`".into()));
        }
        (_, None) => {}
    }
    match (&args.vessel, &args.keys) {
        (Some(endpoint), Some(keys)) => ashore(args, endpoint, keys),
        (_, _) => here(args),
    }
}

/// To the vessel's process on this computer.
fn deck(args: &CommandArgs, word: DeckWord) -> Result<Exit, CliError> {
    if args.vessel.is_some() || args.instance.is_some() {
        return Err(CliError(
            "the deck is closed and opened on the vessel's own computer: no --vessel, no --instance".into(),
        ));
    }
    let computer: VesselComputer = config::load(&args.config_or("/etc/alight/vessel.toml"))?;
    let order = match word {
        DeckWord::Closed => DeckOrder::Closed,
        DeckWord::Open => DeckOrder::Open,
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
            ) => DeckWord::Closed,
            // These close it beside an order.
            Some(Closure::Switch | Closure::Sensor) | None => DeckWord::Open,
        });
        !left.exists() && ordered == Some(word)
    });
    let closed = newest.as_ref().is_some_and(|s| s.deck.closed.is_some());
    if args.json {
        terminal::line(json!({ "taken": taken, "deck": newest.map(|s| s.deck) }));
    } else if taken {
        terminal::line(match word {
            DeckWord::Closed => "the deck is closed",
            DeckWord::Open if closed => {
                "the order is taken, but switch or sensor keep the deck closed: alight status"
            }
            DeckWord::Open => "the deck is open",
        });
    } else {
        terminal::line(
            "the vessel's process has not taken it, and will when it runs: systemctl status alight-vessel",
        );
    }
    Ok(Exit::of(taken && closed == (word == DeckWord::Closed)))
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
    let mut header = Header::new(
        computer.bridge.vessel_id,
        computer.bridge.drone_id,
        draw_boot(),
        0,
        computer.clock.now::<DroneClock>(),
    );
    let kind = args.order.kind();
    let given = header.at;
    // What a mission said before it was commanded is no answer.
    let is_met =
        |m: &MissionState| kind.is_none_or(|k| m.header.at >= given && k.is_met(m.state, m.waiting.code));
    let mut newest: Option<MissionState> = None;
    for poll in 0..MAX_POLLS {
        let now: Time<DroneClock> = computer.clock.now();
        newest = missions.newest(now.nanos()).or(newest);
        if newest.is_some_and(|m| is_met(&m)) && poll > 0 {
            break;
        }
        if let Some(kind) = kind
            && poll % REPEAT_POLLS == 0
        {
            // The time at which it was given stays: what the mission is told meanwhile is newer.
            header.sequence += 1;
            commands.send(&Command { header, kind });
        }
        if !memory.wait(POLL_PERIOD) {
            return Ok(Exit::Failed);
        }
    }
    let Some(mission) = newest else {
        return Err(CliError(format!(
            "no mission answers under the name {name}: alight status --instance {name} shows what runs"
        )));
    };
    let taken = is_met(&mission);
    if args.json {
        terminal::line(json!({ "taken": taken, "mission": mission }));
    } else {
        print_answer(mission.state, &mission.entered, &mission.waiting, taken);
    }
    Ok(Exit::of(taken))
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
    let received = vessel_key(args.vessel_id, topics::DRONES.name);
    let mut radio = Radio::open(&config, publications, vec![received])?;
    let kind = args.order.kind();
    let header: Header<VesselClock> = Header::new(args.vessel_id, args.drone, draw_boot(), 1, Time::EPOCH);
    let (mut newest, mut waited): (Option<DroneStatus>, u32) = (None, 0);
    let is_met = |w: &DroneStatus| kind.is_none_or(|k| k.is_met(w.state, w.waiting.code));
    while waited < MAX_POLLS_ASHORE && !end_requested() {
        // The session may not be there yet: the same command again is one command.
        if let Some(Ok(bytes)) = kind
            .filter(|_| waited.is_multiple_of(REPEAT_POLLS))
            .map(|kind| wire::encode(&OperatorCommand { header, kind }))
        {
            radio.send(0, bytes);
        }
        waited += 1;
        let status = radio
            .receive(POLL_PERIOD)
            .and_then(|received| wire::decode::<DroneStatus>(&received.bytes).ok())
            .filter(|w| w.header.version == MESSAGE_VERSION && w.header.drone == args.drone);
        newest = status.or(newest);
        if status.is_some_and(|w| is_met(&w)) {
            break;
        }
    }
    let Some(status) = newest else {
        return Err(CliError(format!(
            "{endpoint} relays no status of drone {}: does the vessel run, does it list {own} in radio.tls.peers, \
             and does it receive the drone (systemctl status alight-vessel)?",
            args.drone
        )));
    };
    let taken = is_met(&status);
    if args.json {
        terminal::line(json!({ "taken": taken, "drone": status }));
    } else {
        print_answer(status.state, &status.entered, &status.waiting, taken);
        terminal::line(format_args!("battery {:.0} %", 100.0 * status.battery));
        if let Some(for_s) = status.still_armed_s {
            terminal::line(format_args!("ALARM: drone {}: {}", args.drone, still_armed(for_s)));
        }
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
