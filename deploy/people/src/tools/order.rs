//! `alight order`: sends an operator's command to a mission and prints the reply. On the drone's own computer the
//! command goes through shared memory; from ashore it goes through the vessel, with an operator's certificate
//! ([`ashore`]). On the vessel's computer it also gives the crew's orders for the deck. Every reply names its drone.

mod ashore;
mod beacon;
mod station;

use std::{ffi::OsString, path::PathBuf, time::Duration};

use alight_computer::{
    config::VesselComputerConfig,
    exit::{CliError, Exit},
    process::{
        instance::is_running,
        local_command::{answer, give},
    },
    quantity::{SECOND, WrittenTime, speed_mps, whole},
    subject::{commanded_drone, commanded_vessel},
    terminal::{self, WIDTH},
    vessel::crew::OrderOnItsWay,
};
use alight_shared::{
    msg::{Command, CommandKind, DeckOrder, DroneContact, MissionState, SilentDrone, VesselStatus},
    time::{DroneClock, SteadyClock, Time},
};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory, Publisher, Subscriber},
};
use clap::{Args, Command as Clap, ValueEnum};
use serde_json::json;

const POLL_PERIOD: Duration = Duration::from_millis(50);

pub(super) const STEADY_S: u32 = 60;

const MAX_LASTING_S: u32 = 3600;

#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum OrderArg {
    /// Land on the vessel.
    Land,
    /// Stop landing, climb and hold; always wins.
    Abort,
    /// Hold the present position.
    Hold,
    /// Take off from the deck, climb and hold (drone.mission.takeoff); with sorties_max, fly unattended cycles.
    Takeoff,
    /// Unattended cycles: ready for the next sortie.
    Ready,
    /// Keep a position next to the vessel for a while (--height, --ahead, --right, --for).
    Station,
    /// Show the mission's state; commands nothing.
    Status,
    /// Give the position of a silent vessel: latitude and longitude, deg.
    DeckAt,
    /// On the vessel: close the deck or open it.
    Deck,
    /// On the vessel: announce a steady course and speed for a while (`--for`).
    Steady,
    /// On the vessel: announce a turn, until `steady` is ordered.
    Turning,
}

#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum CrewOrderArg {
    /// No drone may descend; a drone that is still high aborts its descent.
    Closed,
    /// Drones may land, unless a drone reports from the deck.
    Open,
    /// The crew is clear of the drone of `--drone`, which may take off: within two minutes, or until `closed` with
    /// `--standing`.
    Takeoff,
}

impl OrderArg {
    fn takes(self, field: &str) -> bool {
        let is_at = self == OrderArg::DeckAt;
        let is_crews = matches!(self, OrderArg::Deck | OrderArg::Steady | OrderArg::Turning);
        match field {
            "order" => false,
            "values" => is_at || self == OrderArg::Deck,
            "standing" => self == OrderArg::Deck,
            "lasting" => is_at || matches!(self, OrderArg::Steady | OrderArg::Station),
            "course" | "speed" | "error" => is_at,
            "height" | "ahead" | "right" => self == OrderArg::Station,
            "vessel" | "keys" | "vessel_id" => !is_crews,
            "drone" => !is_crews || self == OrderArg::Deck,
            _ => true,
        }
    }
}

/// Help for the order that follows `alight order` on a command line, with the flags that it uses; None without an
/// order.
pub fn help(command: &Clap, typed: &[OsString]) -> Option<String> {
    let mut orders = typed.iter().skip(2).filter_map(|t| t.to_str());
    let order = orders.find_map(|t| OrderArg::from_str(t, false).ok());
    let order = order.filter(|_| command.get_name() == "order")?;
    let value = order.to_possible_value()?;
    let values = if order.takes("values") { " VALUE..." } else { "" };
    let help = command
        .clone()
        .about(value.get_help().cloned().unwrap_or_default())
        .override_usage(format!("alight order {}{values} [OPTIONS]", value.get_name()))
        .mut_args(|a| {
            let is_hidden = a.is_hide_set() || !order.takes(a.get_id().as_str());
            a.hide(is_hidden)
        });
    Some(help.max_term_width(WIDTH).render_help().to_string())
}

impl CommandArgs {
    fn kind(&self) -> Result<Option<CommandKind>, CliError> {
        Ok(match self.order {
            OrderArg::Land => Some(CommandKind::Land),
            OrderArg::Abort => Some(CommandKind::Abort),
            OrderArg::Hold => Some(CommandKind::Hold),
            OrderArg::Takeoff => Some(CommandKind::TakeOff),
            OrderArg::Ready => Some(CommandKind::Ready),
            OrderArg::Station => Some(CommandKind::Station(station::ordered(self)?)),
            OrderArg::Status | OrderArg::DeckAt | OrderArg::Deck | OrderArg::Steady | OrderArg::Turning => {
                None
            }
        })
    }
    /// Duration from `--for` as a whole multiple of `unit`, which is also the unit of a plain number; without
    /// `--for`, `usual`.
    fn lasting(&self, unit: (&str, f64), limit: u32, usual: u32) -> Result<u32, CliError> {
        let given = self.lasting.map_or(Ok(usual), |t| t.whole(unit, &(0..=limit)));
        given.map_err(|e| CliError::because("--for", e))
    }
}

#[derive(Args, Debug)]
#[command(after_help = "On the computer it is for, as the user that runs Alight:\n  \
sudo -u alight alight order abort\n  \
sudo -u alight alight order deck open --drone 2\n\
From ashore: alight order abort --drone 2 --vessel quic/192.168.7.1:7447 --keys DIR\n\
A simulated landing: alight order abort --instance sim\n\
Exit codes: 0 taken, 1 rejected or not taken in time, 2 bad input or no answer.")]
pub struct CommandArgs {
    /// Order; `alight help order` explains each
    #[arg(value_enum)]
    pub order: OrderArg,
    /// deck: closed, open, takeoff; deck-at: latitude, longitude
    ///
    /// Positions are in deg: alight order deck-at 59.3456 18.1234 --error 10.
    #[arg(value_name = "VALUE", num_args = 0..=2, allow_negative_numbers = true)]
    pub values: Vec<String>,
    /// deck takeoff: clear all take-offs until closed
    ///
    /// Clears every take-off of that drone until the deck is closed or a take-off is stopped on the deck, not only
    /// those within two minutes.
    #[arg(long)]
    pub standing: bool,
    /// steady, deck-at: s [60, 300]; station: min [10]
    ///
    /// A unit may follow: 90s, 5min. `steady` with 0 withdraws the course.
    #[arg(long = "for", value_name = "TIME")]
    pub lasting: Option<WrittenTime>,
    /// Position of a station
    #[command(flatten)]
    pub station: station::StationArgs,
    /// deck-at: the vessel's course, deg from north
    #[arg(long, value_name = "DEG", requires = "speed")]
    pub course: Option<f64>,
    /// deck-at: speed, m/s [default: stationary]
    ///
    /// A unit may follow: 5kn.
    #[arg(long, value_name = "M/S", value_parser = speed_mps)]
    pub speed: Option<f64>,
    /// deck-at: position's standard deviation, m
    ///
    /// 1 to 1000 m, each axis.
    #[arg(long, value_name = "M", default_value_t = 10.0)]
    pub error: f64,
    /// Configuration of the computer (TOML)
    ///
    /// The vessel's for `deck`, `steady` and `turning`, otherwise the drone's [default: /etc/alight/vessel.toml or
    /// /etc/alight/drone.toml; without the latter, that of a landing that runs here].
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set of processes [default: the configuration's]
    #[arg(long, value_name = "NAME")]
    pub instance: Option<String>,
    /// Ashore: the vessel, such as quic/192.168.7.1:7447
    #[arg(long, value_name = "ENDPOINT", requires = "keys")]
    pub vessel: Option<String>,
    /// Ashore: directory of an operator's certificate
    ///
    /// `alight keys operator` makes it.
    #[arg(long, value_name = "DIR", requires = "vessel")]
    pub keys: Option<PathBuf>,
    /// Ashore: number of the vessel
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub vessel_id: u32,
    /// Drone; for deck open: a drone clear of the deck
    ///
    /// From ashore it is required if the vessel receives several drones, and saves time if it receives only one. With
    /// `deck open` the crew has checked that this drone is neither on the deck nor above it.
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=u32::MAX.into()))]
    pub drone: Option<u32>,
    /// Print one JSON object instead of lines
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &CommandArgs) -> Result<Exit, CliError> {
    let clears = args.order == OrderArg::Deck && args.values == ["takeoff"];
    if args.standing && !clears {
        return Err(CliError(
            "--standing is only for alight order deck takeoff --drone N".into(),
        ));
    }
    station::check(args)?;
    let has_values = matches!(args.order, OrderArg::Deck | OrderArg::DeckAt);
    if !has_values && !args.values.is_empty() {
        return Err(CliError(format!(
            "{}: closed, open and takeoff are for `alight order deck`, positions for `alight order deck-at`",
            args.values.join(" ")
        )));
    }
    match args.order {
        OrderArg::Deck => return deck(args, crew_order(&args.values)?),
        OrderArg::DeckAt => return beacon::run(args),
        OrderArg::Steady => {
            return course(
                args,
                DeckOrder::Steady(args.lasting(SECOND, MAX_LASTING_S, STEADY_S)?),
            );
        }
        OrderArg::Turning => return course(args, DeckOrder::Turning),
        OrderArg::Land
        | OrderArg::Abort
        | OrderArg::Hold
        | OrderArg::Takeoff
        | OrderArg::Ready
        | OrderArg::Station
        | OrderArg::Status => {}
    }
    match (&args.vessel, &args.keys) {
        (Some(endpoint), Some(keys)) => ashore::run(args, endpoint, keys),
        (_, _) => here(args),
    }
}

fn crew_order(values: &[String]) -> Result<CrewOrderArg, CliError> {
    let order = match values {
        [value] => CrewOrderArg::from_str(value, false).ok(),
        [] | [_, _, ..] => None,
    };
    order.ok_or_else(|| CliError("alight order deck: closed, open or takeoff has to follow".into()))
}
/// Configuration of the vessel's computer on which this command runs; errors call the order `what`.
fn on_board(args: &CommandArgs, what: &str) -> Result<VesselComputerConfig, CliError> {
    if args.vessel.is_some() {
        return Err(CliError(format!(
            "{what} on the vessel's own computer: remove --vessel"
        )));
    }
    commanded_vessel(args.config.as_deref(), args.instance.as_deref())
}

/// Gives an order to the vessel's process on this computer; returns the status that confirms it, None if it was not
/// accepted.
fn order_aboard(args: &CommandArgs, what: &str, order: DeckOrder) -> Result<Option<VesselStatus>, CliError> {
    let computer = on_board(args, what)?;
    let memory = join(&computer.instance, "alight-vessel", NAMED)?;
    Ok(OrderOnItsWay::give(&memory, &computer, order)?.wait(&memory))
}

/// Shared memory of the instance `name`, which the systemd `unit` runs; `other` advises how to name another instance.
fn join(name: &str, unit: &str, other: &str) -> Result<Memory, CliError> {
    let instance = Instance::new(name)?;
    if !is_running(&instance) {
        return Err(CliError(format!(
            "no running {} computer found (instance \"{name}\"): systemctl status {unit}, or {other}",
            unit.trim_start_matches("alight-")
        )));
    }
    Ok(Memory::join(&instance, "command")?)
}

const NAMED: &str = "name its configuration with --config, or a landing's with --instance";
const NOT_TAKEN: &str =
    "the vessel's process has not taken the order: check systemctl status alight-vessel, and order it again";

fn course(args: &CommandArgs, order: DeckOrder) -> Result<Exit, CliError> {
    if let Some(drone) = args.drone {
        return Err(CliError(format!(
            "--drone {drone}: the course is the same for every drone; remove the flag"
        )));
    }
    let newest = order_aboard(args, "the course is stated", order)?;
    if args.json {
        terminal::line(json!({ "taken": newest.is_some(), "order": order, "deck": newest.map(|s| s.deck) }));
    } else {
        terminal::line(newest.map_or(NOT_TAKEN, |_| stated(order)));
    }
    Ok(Exit::of(newest.is_some()))
}

fn stated(order: DeckOrder) -> &'static str {
    match order {
        DeckOrder::Steady(0) => "no course is stated",
        DeckOrder::Steady(_) => {
            "course and speed are stated as steady; a turn at the helm's switch takes precedence"
        }
        DeckOrder::Turning
        | DeckOrder::Closed
        | DeckOrder::Open
        | DeckOrder::Clear(_)
        | DeckOrder::TakeOff(_)
        | DeckOrder::TakeOffStanding(_) => "no drone descends while the vessel turns",
    }
}

fn deck(args: &CommandArgs, ordered: CrewOrderArg) -> Result<Exit, CliError> {
    let order = match (ordered, args.drone) {
        (CrewOrderArg::Closed, None) => DeckOrder::Closed,
        (CrewOrderArg::Open, None) => DeckOrder::Open,
        (CrewOrderArg::Open, Some(drone)) => DeckOrder::Clear(drone),
        (CrewOrderArg::Takeoff, Some(drone)) if args.standing => DeckOrder::TakeOffStanding(drone),
        (CrewOrderArg::Takeoff, Some(drone)) => DeckOrder::TakeOff(drone),
        (CrewOrderArg::Takeoff, None) => {
            return Err(CliError(
                "the take-off needs a drone: alight order deck takeoff --drone N".into(),
            ));
        }
        (CrewOrderArg::Closed, Some(drone)) => {
            return Err(CliError(format!(
                "--drone {drone}: the deck is closed for every drone"
            )));
        }
    };
    let newest = order_aboard(args, "orders for the deck are given", order)?;
    let closed = newest.as_ref().is_some_and(|s| s.deck.closed.is_some());
    if args.json {
        terminal::line(json!({ "taken": newest.is_some(), "deck": newest.map(|s| s.deck) }));
    } else if newest.is_some() {
        terminal::line(match ordered {
            CrewOrderArg::Closed => "the deck is closed",
            CrewOrderArg::Open if closed => {
                "the order is taken, but a switch or sensor keeps the deck closed: see alight status"
            }
            CrewOrderArg::Open => "the deck is open",
            CrewOrderArg::Takeoff if closed => {
                "the order is taken, but the deck is closed: alight order deck open"
            }
            CrewOrderArg::Takeoff => cleared(newest.as_ref(), args.drone, args.standing),
        });
        let silent_drones = newest.iter().flat_map(|s| s.deck.silent_drones.iter());
        for drone in silent_drones.filter(|_| ordered == CrewOrderArg::Open) {
            terminal::line(kept_by(drone));
        }
    } else {
        terminal::line(NOT_TAKEN);
    }
    Ok(Exit::of(
        newest.is_some() && closed == (ordered == CrewOrderArg::Closed),
    ))
}

/// Text for the crew about a take-off clearance: an ordered take-off may be waiting only for this clearance.
fn cleared(newest: Option<&VesselStatus>, drone: Option<u32>, standing: bool) -> &'static str {
    let ordered = |d: &DroneContact| Some(d.status.header.drone) == drone && d.status.state.is_take_off();
    let is_ordered = newest.is_some_and(|s| s.drones.iter().any(ordered));
    match (is_ordered, standing) {
        (true, _) => {
            "the deck is cleared: keep away NOW, the drone's take-off is ordered and its motors start in 5 s"
        }
        (false, true) => {
            "the deck is cleared until it is closed: keep away from the drone NOW, its motors start whenever it is ready, \
             5 s after it reports so"
        }
        (false, false) => {
            "the deck is cleared for two minutes: keep away from the drone NOW, its motors start 5 s after any order to \
             take off"
        }
    }
}

/// Text about a silent drone for which the opened deck stays reserved, and how to release the deck.
fn kept_by(silent_drone: &SilentDrone) -> String {
    format!(
        "{silent_drone};\norder it again in {:.0} s, or once it is neither on the deck nor above it:\nalight order deck \
         open --drone {}",
        silent_drone.remaining_s.ceil(),
        silent_drone.drone
    )
}

fn here(args: &CommandArgs) -> Result<Exit, CliError> {
    let is_abort = args.order == OrderArg::Abort;
    let computer = commanded_drone(args.config.as_deref(), args.instance.as_deref(), is_abort)?;
    let own = computer.bridge.drone_id;
    if let Some(drone) = args.drone.filter(|drone| *drone != own) {
        return Err(CliError(format!(
            "--drone {drone}: this computer is drone {own}'s; to command another, go through the vessel (--vessel, --keys)"
        )));
    }
    let name = args.instance.as_ref().unwrap_or(&computer.instance);
    let memory = join(name, "alight-drone", "name a landing's with --instance")?;
    let mut missions: Subscriber<MissionState> = memory.subscriber()?;
    let mut commands: Publisher<Command> = memory.publisher()?;
    let (kind, now) = (args.kind()?, || Time::<SteadyClock>::from_nanos(steady_ns()));
    let mut command = give(&computer, kind.unwrap_or_default(), now());
    let mut newest: Option<MissionState> = None;
    while !command.is_over(now()) {
        let at: Time<DroneClock> = computer.clock.now();
        newest = missions.newest(at.nanos()).or(newest);
        if newest.is_some_and(|m| kind.is_none() || command.answered(&m).is_some()) {
            break;
        }
        if kind.is_some() {
            commands.send_any(command.due(now()).as_ref());
        }
        if !memory.wait(POLL_PERIOD) {
            return Ok(Exit::Failed);
        }
    }
    let Some(mission) = newest else {
        return Err(CliError(format!(
            "no mission answers (instance \"{name}\"): alight status --instance {name} lists the processes"
        )));
    };
    let taken = kind.is_none() || command.answered(&mission) == Some(true);
    if args.json {
        terminal::line(json!({ "taken": taken, "number": own, "mission": mission }));
    } else {
        for line in answer(own, &mission, taken) {
            terminal::line(line);
        }
    }
    Ok(Exit::of(taken))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Seq, State};

    #[test]
    fn warning_by_the_state_of_a_cleared_drone() {
        let warns = |state| {
            let mut contact = DroneContact::default();
            (contact.status.header.drone, contact.status.state) = (3, state);
            let status = VesselStatus {
                drones: Seq::filled([contact]),
                ..VesselStatus::default()
            };
            [Some(3), Some(2)].map(|drone| cleared(Some(&status), drone, false).contains("in 5 s"))
        };
        assert_eq!(warns(State::Preparing), [true, false]);
        assert_eq!(warns(State::Idle), [false, false]);
    }

    #[test]
    fn drone_named_in_every_answer() {
        let lines = answer(3, &MissionState::default(), false);
        assert!(lines[0].starts_with("drone 3: Idle"), "{lines:?}");
        assert!(lines[2].contains("drone 3"), "{lines:?}");
        let silent_drone = SilentDrone {
            drone: 3,
            silent_s: 4.0,
            remaining_s: 56.0,
        };
        let text = kept_by(&silent_drone);
        assert!(
            text.contains("drone 3 is silent for 4 s") && text.contains("again in 56 s"),
            "{text}"
        );
    }
}
