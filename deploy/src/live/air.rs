//! What lies between vessel and drone in a live landing: the loopback interface with an impairment
//! inside the processes, or a link emulator between two network namespaces.

use std::path::PathBuf;

use alight_shared::msg::State;
use alight_shared::transport::intake::Quantiles;
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::radio::TlsConfig;
use alight_sim::radio::ChannelCounts;
use alight_sim::scenario::StateOutage;
use serde::{Deserialize, Serialize};

use super::args::{Emulate, LandArgs};
use super::config::LinkImpairment;
use super::display::time;
use super::emulator::{Emulation, LinkWord, Order};
use super::instance::Owned;
use super::keys;
use super::land::{free_port, write};
use super::namespaces::{ADDRESSES, OwnSpaces};
use super::profile;
use super::supervisor::Supervisor;
use crate::Refused;
use crate::scene::Scene;

/// The vessel's port in its own namespace, zenoh's usual one.
const PORT: u16 = 7447;

/// The link as it is arranged before the processes start.
pub struct Air {
    spaces: Option<OwnSpaces>,
    emulator: Option<PathBuf>,
    outage: Option<StateOutage>,
    /// What the processes do to what they receive.
    pub impairment: Option<LinkImpairment>,
    /// Where the vessel listens.
    pub listen: String,
    /// What the drone dials.
    pub dial: String,
    /// Certificates of vessel and drone.
    pub tls: [TlsConfig; 2],
}

impl Air {
    /// As the flags say; `epoch_ns` is the profile's time zero on the steady clock.
    pub fn of(scene: &Scene, args: &LandArgs, owned: &Owned, epoch_ns: i64) -> Result<Air, Refused> {
        let profile = match args.link.as_str() {
            "scenario" => scene.scenario.radio.clone(),
            name => profile::load(name)?,
        };
        let spaces = match args.emulate {
            Emulate::Always => Some(OwnSpaces::make(&args.instance)?),
            Emulate::Auto if args.link != "scenario" && args.link != "clean" => {
                let made = OwnSpaces::make(&args.instance);
                if let Err(e) = &made {
                    eprintln!(
                        "network namespaces are not permitted here ({e}): the link {} is emulated inside the \
                         processes",
                        args.link
                    );
                }
                made.ok()
            }
            Emulate::Auto | Emulate::Never => None,
        };
        let tls = certificates(scene, args, owned)?;
        let outage = scene.scenario.radio_outage;
        let link = LinkImpairment {
            seed: args.seed,
            outage,
            profile,
        };
        let address = |host: &str, port: u16| format!("{}/{host}:{port}", args.transport);
        Ok(if spaces.is_some() {
            let emulation = Emulation {
                name: args.instance.clone(),
                epoch_ns,
                link,
            };
            Air {
                spaces,
                emulator: Some(write(owned, "link.toml", &emulation)?),
                outage,
                impairment: None,
                // Every address of the namespace: its device may come later than the process.
                listen: address("0.0.0.0", PORT),
                dial: address(ADDRESSES[0], PORT),
                tls,
            }
        } else {
            let nothing = args.link == "clean" && outage.is_none();
            let endpoint = address("127.0.0.1", free_port()?);
            Air {
                spaces: None,
                emulator: None,
                outage,
                impairment: (!nothing).then_some(link),
                listen: endpoint.clone(),
                dial: endpoint,
                tls,
            }
        })
    }
    /// Starts the emulator, if there is one.
    pub fn start(&self, supervisor: &mut Supervisor) -> Result<(), Refused> {
        match &self.emulator {
            Some(config) => supervisor.start(ProcessKind::Link, config.clone(), Vec::new()),
            None => Ok(()),
        }
    }
    /// What to put before a process's command: the way into its computer's namespace. The simulated
    /// vehicles are on the vessel's network, where its sensors are.
    pub fn enter(&self, kind: ProcessKind) -> Vec<String> {
        let side = match kind {
            ProcessKind::Vessel | ProcessKind::World | ProcessKind::Link => 0,
            ProcessKind::Bridge
            | ProcessKind::Predictor
            | ProcessKind::Mission
            | ProcessKind::Planner
            | ProcessKind::Pilot => 1,
        };
        self.spaces.as_ref().map_or_else(Vec::new, |s| s.enter(side))
    }
}

/// The certificates of vessel and drone: those named, else some made for this landing alone.
fn certificates(scene: &Scene, args: &LandArgs, owned: &Owned) -> Result<[TlsConfig; 2], Refused> {
    if args.transport != "tls" {
        return Ok([TlsConfig::default(), TlsConfig::default()]);
    }
    let sides = [
        ("vessel", scene.nodes.bridge.vessel_id),
        ("drone", scene.nodes.bridge.drone_id),
    ];
    let directory = match &args.certificates {
        Some(directory) => directory.clone(),
        None => {
            let directory = owned.file("keys");
            keys::init(&directory, 1)?;
            let hosts = ["127.0.0.1", ADDRESSES[0], ADDRESSES[1]].map(String::from);
            for (kind, number) in sides {
                keys::issue(&directory, kind, number, &hosts, 1)?;
            }
            directory
        }
    };
    let [vessel, drone] = sides.map(|(kind, number)| keys::common_name(kind, number));
    Ok([
        keys::files(&directory.join(&vessel), vec![drone.clone()])?,
        keys::files(&directory.join(&drone), vec![vessel])?,
    ])
}

/// What is seen of the link while it is flown.
#[derive(Default)]
pub struct Watch {
    packets: Option<[ChannelCounts; 2]>,
    ages: Quantiles,
    told: bool,
}

impl Watch {
    /// Takes in what the emulator said, and the age of the vessel's newest state; tells the emulator
    /// when the outage begins.
    pub fn look(
        &mut self,
        air: &Air,
        said: &[String],
        ages_s: &[f64],
        state: Option<State>,
        supervisor: &mut Supervisor,
    ) {
        let counts = |line: &String| match serde_json::from_str(line) {
            Ok(LinkWord::Packets(to_drone, to_vessel)) => Some([to_drone, to_vessel]),
            Err(_) => None,
        };
        self.packets = said.iter().rev().find_map(counts).or(self.packets);
        ages_s
            .iter()
            .filter(|a| a.is_finite())
            .for_each(|a| self.ages.add(*a));
        if !self.told && air.outage.is_some_and(|o| Some(o.state) == state) {
            self.told = true;
            supervisor.tell(ProcessKind::Link, Order::Outage.line());
        }
    }
    /// The figures at the end, `seconds` after the profile's time zero.
    pub fn report(&self, seconds: f64) -> RadioReport {
        let way = |c: ChannelCounts| WayReport {
            packets: c.sent,
            bytes_per_s: c.sent_bytes as f64 / seconds.max(1.0),
            lost: c.lost as f64 / c.sent.max(1) as f64,
            overflowed: c.overflowed,
        };
        RadioReport {
            age_p50_s: self.ages.quantile(0.5),
            age_p95_s: self.ages.quantile(0.95),
            emulated: self.packets.map(|ways| ways.map(way)),
        }
    }
}

/// The link of a live landing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RadioReport {
    /// Age of the vessel's newest state at the drone, looked at ten times a second: median, s.
    pub age_p50_s: f64,
    /// 95th percentile of the same, s.
    pub age_p95_s: f64,
    /// What the emulator counted: to the drone, to the vessel.
    pub emulated: Option<[WayReport; 2]>,
}

/// One direction of the emulated link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WayReport {
    /// IP packets.
    pub packets: u64,
    /// Bytes per second, IP headers included.
    pub bytes_per_s: f64,
    /// Share that was lost on the way.
    pub lost: f64,
    /// Packets that a full queue refused.
    pub overflowed: u64,
}

impl RadioReport {
    /// In words.
    pub fn text(&self) -> String {
        let mut out = format!(
            "  age of the vessel's newest state at the drone: {} (p50), {} (p95)\n",
            time(self.age_p50_s),
            time(self.age_p95_s)
        );
        for (way, c) in ["drone", "vessel"].iter().zip(self.emulated.iter().flatten()) {
            out.push_str(&format!(
                "  radio to the {way}: {} packets, {:.2} kB/s with IP headers, {:.1} % lost, {} too many for its \
                 rate\n",
                c.packets,
                c.bytes_per_s / 1e3,
                100.0 * c.lost,
                c.overflowed
            ));
        }
        out
    }
}
