//! Radio path between vessel and drone in a live landing: the loopback interface with an impairment inside the
//! processes, or a link emulator between two network namespaces.

use std::path::PathBuf;

use alight_computer::{
    certificates,
    exit::{CliError, Doing},
    process::{
        instance::OwnedInstance,
        snapshot::time,
        supervisor::{Supervisor, arguments},
    },
};
use alight_shared::{msg::State, process::ProcessKind};
use alight_sim::{
    harness::storm::{Fault, FaultKind, Moment},
    radio::ChannelCounts,
};
use alight_transport::{radio::TlsConfig, statistics::Quantiles};
use serde::{Deserialize, Serialize};

use crate::{
    live::{
        args::{Emulate, LandArgs},
        config::{AutopilotKind, LinkImpairment, free_port, write},
        emulator::{Emulation, EmulatorReport, OUTAGE},
        namespaces::{ADDRESSES, OwnSpaces},
        profile,
    },
    scene::Scene,
};

const PORT: u16 = 7447;

/// Number of ages skipped at the start (five seconds), before clocks and session are synchronised.
const WARM_UP_AGES: usize = 50;

pub struct RadioPath {
    spaces: Option<OwnSpaces>,
    emulator: Option<PathBuf>,
    outage: Option<Fault>,
    pub impairment: Option<LinkImpairment>,
    pub listen: String,
    pub dial: String,
    pub tls: [TlsConfig; 2],
}

impl RadioPath {
    /// Path according to the flags; `epoch_ns` is the profile's time zero on the steady clock.
    pub fn of(
        scene: &Scene,
        args: &LandArgs,
        owned: &OwnedInstance,
        epoch_ns: i64,
    ) -> Result<RadioPath, CliError> {
        let profile = match args.link.as_str() {
            "scenario" => scene.scenario.radio.clone(),
            name => profile::load(name)?,
        };
        let firmware = args.flown_by() != AutopilotKind::Internal;
        let spaces = match args.emulate {
            Emulate::Always if firmware => {
                return Err(CliError(
                    "--emulate always: a firmware on this computer cannot reach the drone's namespace; leave it out"
                        .into(),
                ));
            }
            Emulate::Auto if firmware => None,
            Emulate::Always => Some(OwnSpaces::make(&args.instance)?),
            Emulate::Auto if args.link != "scenario" && args.link != "clean" => {
                let made = OwnSpaces::make(&args.instance);
                if let Err(e) = &made {
                    alight_computer::terminal::note(
                        true,
                        format_args!(
                            "network namespaces are not permitted here ({e}): the link {} is emulated inside the \
                         processes",
                            args.link
                        ),
                    );
                }
                made.ok()
            }
            Emulate::Auto | Emulate::Never => None,
        };
        let tls = certificates(scene, args, owned)?;
        let mut faults = scene.scenario.faults.iter();
        let outage = faults.find(|f| f.kind == FaultKind::RadioLost).copied();
        let link = LinkImpairment {
            epoch_ns,
            seed: args.seed,
            outage,
            profile,
        };
        let address = |host: &str, port: u16| format!("{}/{host}:{port}", args.transport);
        Ok(if spaces.is_some() {
            let emulation = Emulation {
                name: args.instance.clone(),
                link,
            };
            RadioPath {
                spaces,
                emulator: Some(write(owned, "link.toml", &emulation)?),
                outage,
                impairment: None,
                // Listens on every address of the namespace, because the network device may appear after the process
                // starts.
                listen: address("0.0.0.0", PORT),
                dial: address(ADDRESSES[0], PORT),
                tls,
            }
        } else {
            let nothing = args.link == "clean" && outage.is_none();
            let endpoint = address("127.0.0.1", free_port()?);
            RadioPath {
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
    pub fn start(&self, supervisor: &mut Supervisor) -> Result<(), CliError> {
        let Some(config) = &self.emulator else {
            return Ok(());
        };
        let mut command = arguments(ProcessKind::Link, config);
        command.insert(0, "rehearse".into());
        supervisor.start(ProcessKind::Link, command, Vec::new())
    }
    /// Command prefix with which a process enters its computer's namespace. The simulated vehicles use the vessel's
    /// network, as its sensors do.
    pub fn enter(&self, kind: ProcessKind) -> Vec<String> {
        use ProcessKind::{Autopilot, Link, Sensors, Vessel, World};
        // The cable to the simulated autopilot is not part of the radio; it ends in the world's namespace.
        let side = usize::from(!matches!(kind, Vessel | Sensors | World | Link | Autopilot));
        self.spaces.as_ref().map_or_else(Vec::new, |s| s.enter(side))
    }
}

/// Certificates of vessel and drone: those of the directory in the flags, otherwise newly created.
fn certificates(scene: &Scene, args: &LandArgs, owned: &OwnedInstance) -> Result<[TlsConfig; 2], CliError> {
    if args.transport != "quic" {
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
            if directory.exists() {
                std::fs::remove_dir_all(&directory)
                    .doing(format_args!("removing {}", directory.display()))?;
            }
            certificates::init(&directory, 1)?;
            let hosts = ["127.0.0.1", ADDRESSES[0], ADDRESSES[1]].map(String::from);
            for (kind, number) in sides {
                certificates::issue(&directory, kind, number, &hosts, 1)?;
            }
            directory
        }
    };
    let [vessel, drone] = sides.map(|(kind, number)| certificates::common_name(kind, number));
    Ok([
        certificates::files(&directory.join(&vessel), vec![drone.clone()])?,
        certificates::files(&directory.join(&drone), vec![vessel])?,
    ])
}

#[derive(Default)]
pub struct RadioWatch {
    packets: Option<[ChannelCounts; 2]>,
    ages: Quantiles,
    received: usize,
    outage_announced: bool,
}

impl RadioWatch {
    /// Handles the processes' output lines and the age of the vessel's newest state; starts the emulator's outage
    /// when the mission enters the outage's state.
    pub fn observe(
        &mut self,
        air: &RadioPath,
        lines: &[String],
        ages_s: &[f64],
        state: Option<State>,
        supervisor: &mut Supervisor,
    ) {
        for line in lines {
            if let Ok(EmulatorReport::Packets(to_drone, to_vessel)) = serde_json::from_str(line) {
                self.packets = Some([to_drone, to_vessel]);
            }
        }
        for age_s in ages_s.iter().filter(|a| a.is_finite()) {
            self.received += 1;
            if self.received > WARM_UP_AGES {
                self.ages.add(*age_s);
            }
        }
        let entered = |o: Fault| state.is_some_and(|s| o.moment == Moment::In(s));
        if !self.outage_announced && air.outage.is_some_and(entered) {
            self.outage_announced = true;
            supervisor.write_line(ProcessKind::Link, OUTAGE);
        }
    }
    /// Metrics at the end, `seconds` after the profile's time zero.
    pub fn report(&self, seconds: f64) -> RadioReport {
        let way = |c: ChannelCounts| WayReport {
            packets: c.sent,
            bytes_per_s: c.sent_bytes as f64 / seconds.max(1.0),
            lost: c.lost as f64 / c.sent.max(1) as f64,
            overflowed: c.overflowed,
        };
        let age = |q: f64| {
            if self.received > WARM_UP_AGES {
                self.ages.quantile(q)
            } else {
                0.0
            }
        };
        RadioReport {
            age_p50_s: age(0.5),
            age_p95_s: age(0.95),
            age_max_s: age(1.0),
            emulated: self.packets.map(|ways| ways.map(way)),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RadioReport {
    /// Median age of the vessel's newest state at the drone, sampled at 10 Hz, s.
    pub age_p50_s: f64,
    /// 95th percentile of this age, s.
    pub age_p95_s: f64,
    pub age_max_s: f64,
    /// Counters of the emulator: to the drone, to the vessel.
    pub emulated: Option<[WayReport; 2]>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WayReport {
    pub packets: u64,
    /// Rate including IP headers.
    pub bytes_per_s: f64,
    pub lost: f64,
    /// Packets that a full queue rejected.
    pub overflowed: u64,
}

impl RadioReport {
    pub fn text(&self) -> String {
        let mut out = format!(
            "  age of the vessel's newest state at the drone: {} (p50), {} (p95), {} (max)\n",
            time(self.age_p50_s),
            time(self.age_p95_s),
            time(self.age_max_s)
        );
        for (way, c) in ["drone", "vessel"].iter().zip(self.emulated.iter().flatten()) {
            out.push_str(&format!(
                "  radio to the {way}: {} packets, {:.2} kB/s with IP headers, {:.1} % lost, {} beyond its \
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
