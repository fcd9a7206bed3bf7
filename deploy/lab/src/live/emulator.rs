//! `alight rehearse link`: layer-3 link with the faults of a profile between two network namespaces.
//!
//! An IP packet that one side sends into its TUN device leaves the other side's device when the profile permits.
//! [`alight_sim::radio`] draws the delay or loss of each packet from the seed.

use std::{
    io::BufRead,
    path::PathBuf,
    sync::{
        Arc,
        mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TryRecvError, channel, sync_channel},
    },
    time::Duration,
};

use alight_computer::{
    exit::{CliError, Doing, Exit},
    terminal,
};
use alight_shared::config::{self, Check, ConfigError, Keys};
use alight_sim::radio::{ChannelCounts, Direction};
use alight_transport::{clock::steady_ns, wake::end_requested};
use clap::{Args, builder::StringValueParser};
use serde::{Deserialize, Serialize};
use tun_rs::SyncDevice;

use crate::{
    args::offering,
    live::{
        config::LinkImpairment,
        impairment::Impaired,
        namespaces::{ADDRESSES, Namespaces},
        profile,
    },
};

/// Maximum number of packets between a device and the emulator; further packets are dropped.
const INBOX: usize = 1024;
const MAX_WAIT: Duration = Duration::from_millis(100);
const REPORT_PERIOD_NS: i64 = 1_000_000_000;

/// Link between two namespaces of this computer.
#[derive(Args, Debug)]
pub struct LinkArgs {
    /// Profile, or a TOML file
    #[arg(long, default_value = "clean", value_parser = offering(StringValueParser::new(), profile::names()))]
    pub profile: String,
    /// Seed of losses and delays
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Name used in the namespaces alight-NAME-vessel (10.77.0.1) and alight-NAME-drone (10.77.0.2)
    #[arg(long, default_value = "link")]
    pub name: String,
    /// Read all settings from a file, as `alight land` writes it
    #[arg(long, value_name = "FILE", hide = true)]
    pub config: Option<PathBuf>,
    /// Take orders from standard input, and end when it closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Emulation {
    pub name: String,
    pub link: LinkImpairment,
}

impl Check for Emulation {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.link.profile.check(&at.table("link").table("profile"))
    }
}

/// Report of the emulator on standard output, one JSON object per line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EmulatorReport {
    Packets(ChannelCounts, ChannelCounts),
}

/// Line on standard input: the mission has entered the state in which the profile's outage begins.
pub const OUTAGE: &str = "outage";

pub fn run(args: &LinkArgs) -> Result<Exit, CliError> {
    let emulation = match &args.config {
        Some(file) => config::load::<Emulation>(file)?,
        None => Emulation {
            name: args.name.clone(),
            link: LinkImpairment {
                epoch_ns: steady_ns(),
                seed: args.seed,
                outage: None,
                profile: profile::load(&args.profile)?,
            },
        },
    };
    let spaces = Namespaces::named(&emulation.name);
    if !args.supervised {
        spaces.remove();
    }
    spaces.make().map_err(|e| {
        CliError(format!(
            "network namespaces are not permitted here ({e}); run as root, or use the impairment inside \
             the processes (`alight land --link {} --emulate never`)",
            args.profile
        ))
    })?;
    let devices = match spaces.devices() {
        Ok(devices) => devices.map(Arc::new),
        Err(e) => {
            spaces.remove();
            return Err(e);
        }
    };
    if !args.supervised {
        terminal::line(format_args!(
            "vessel {} in {}, drone {} in {}; run a command there with: ip netns exec NAMESPACE COMMAND",
            ADDRESSES[0],
            spaces.space(0),
            ADDRESSES[1],
            spaces.space(1)
        ));
    }
    let ended = carry(&emulation, &devices, args.supervised);
    spaces.remove();
    ended
}

struct ReceivedPacket {
    side: usize,
    at_ns: i64,
    packet: Vec<u8>,
}

fn read(side: usize, device: Arc<SyncDevice>, sender: SyncSender<ReceivedPacket>) {
    let mut buffer = [0_u8; 65_536];
    while let Ok(length) = device.recv(&mut buffer) {
        let packet = buffer.get(..length).unwrap_or_default().to_vec();
        // Ignores the kernel's own IPv6 packets.
        let is_ours = packet.first().is_some_and(|b| b >> 4 == 4);
        let at_ns = steady_ns();
        if is_ours && sender.try_send(ReceivedPacket { side, at_ns, packet }).is_err() && end_requested() {
            return;
        }
    }
}

/// Receives orders for outages on standard input; the channel breaks when the input closes.
fn listen(outages: Sender<()>) {
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        if line == OUTAGE && outages.send(()).is_err() {
            return;
        }
    }
}

fn carry(emulation: &Emulation, devices: &[Arc<SyncDevice>; 2], supervised: bool) -> Result<Exit, CliError> {
    let (sender, inbox) = sync_channel(INBOX);
    for (side, device) in devices.iter().enumerate() {
        let device = Arc::clone(device);
        let sender = sender.clone();
        std::thread::spawn(move || read(side, device, sender));
    }
    let outages = supervised.then(|| {
        let (sender, outages) = channel();
        std::thread::spawn(move || listen(sender));
        outages
    });
    let mut ways = [Direction::ToDrone, Direction::ToVessel].map(|way| Impaired::new(&emulation.link, way));
    let mut next_report_ns = steady_ns() + REPORT_PERIOD_NS;
    while !end_requested() {
        let Some(out) = turn(&mut ways, &inbox, outages.as_ref()) else {
            break;
        };
        for (side, packet) in out {
            // A device whose other side is not up yet rejects the packet, which is lost.
            if let Some(device) = devices.get(side) {
                let _lost = device.send(&packet);
            }
        }
        if steady_ns() >= next_report_ns {
            next_report_ns += REPORT_PERIOD_NS;
            if supervised {
                report_counts(&ways)?;
            }
        }
    }
    report_counts(&ways)?;
    Ok(Exit::Success)
}

fn report_counts([to_drone, to_vessel]: &[Impaired<Vec<u8>>; 2]) -> Result<(), CliError> {
    let packets = EmulatorReport::Packets(to_drone.counts(), to_vessel.counts());
    terminal::line(serde_json::to_string(&packets).doing("writing the counts")?);
    Ok(())
}

/// Waits until a packet arrives or is due. Returns the due packets, each with its side; None at the end.
fn turn(
    ways: &mut [Impaired<Vec<u8>>; 2],
    inbox: &Receiver<ReceivedPacket>,
    outages: Option<&Receiver<()>>,
) -> Option<Vec<(usize, Vec<u8>)>> {
    let now_ns = steady_ns();
    let idle = ways.iter().map(|way| way.idle(now_ns, MAX_WAIT)).min();
    match inbox.recv_timeout(idle.unwrap_or(MAX_WAIT)) {
        Ok(first) => {
            for received in std::iter::once(first).chain(inbox.try_iter().take(INBOX)) {
                if let Some(way) = ways.get_mut(received.side) {
                    way.take(received.at_ns, received.packet.len(), received.packet);
                }
            }
        }
        Err(RecvTimeoutError::Timeout) => {}
        Err(RecvTimeoutError::Disconnected) => return None,
    }
    match outages.map(Receiver::try_recv) {
        Some(Ok(())) => ways.iter().for_each(|way| way.begin_outage(steady_ns())),
        None | Some(Err(TryRecvError::Empty)) => {}
        Some(Err(TryRecvError::Disconnected)) => return None,
    }
    let now_ns = steady_ns();
    let mut due = Vec::new();
    for (side, way) in ways.iter_mut().enumerate() {
        let packets = way.arrived(now_ns).into_iter();
        due.extend(packets.map(|(_, packet)| (1 - side, packet)));
    }
    Some(due)
}
