//! Process of the link to a real autopilot, in place of the simulated one. It passes bytes between link and node, and
//! publishes the node's output for predictor, mission, planner and pilot. The supervisor keeps its checkpoint and
//! republishes it to a restarted link. Reports of an AIS receiver and of the drone's own GNSS receiver arrive on
//! separate links and reach the node as frames without a sender. Metrics: uncertainty of the autopilot's clock (s),
//! rejected samples, resets of its clock, hover thrust, set-points sent, reopenings of the link, datagrams from
//! foreign senders, RTCM frames forwarded and dropped, frames by signature.

use std::{
    future::pending,
    sync::{Arc, Mutex},
    time::Duration,
};

use alight_shared::{
    bus::{Bus, Edge, Ports as _, RowStep},
    config,
    mavlink::{Signatures, Signing},
    metrics::{Metric, MetricName},
    msg::LinkCheckpoint,
    process::ProcessKind,
};
use alight_uav::{
    autopilot::{
        AutopilotIn, AutopilotLink, AutopilotLinkConfig, AutopilotOut, AutopilotPorts, MAX_FRAMES,
        ais::AisDecoder,
        message::{AUTOPILOT_COMPONENT, Address, MavlinkFrame, MavlinkMessage},
        receiver::ReceiverDecoder,
        wire::{Decoder, Encoder},
    },
    computer::Installed as _,
};
use tokio::time::{Interval, MissedTickBehavior, interval};
use tracing::info;

use crate::{
    config::{DroneComputerConfig, link_url::LinkUrl},
    exit::{CliError, Exit},
    io::{byte_link::ByteLink, mavlink_key, peer::Speaks, runtime, wakes::Wakes},
    process::{
        args::AutopilotArgs,
        run::{AwaitedEdge, NodeView, Process, ProcessEdge},
    },
};

/// Maximum time between steps without input.
const MAX_STEP_PERIOD: Duration = Duration::from_millis(10);

/// Filter that identifies the autopilot among UDP senders, and counts rejected signatures.
pub struct Speakers {
    signing: Option<Signing>,
    rejected: Arc<Mutex<Signatures>>,
}

impl Speakers {
    pub fn new(signing: Option<&Signing>) -> Speakers {
        // Signature times are not checked: an autopilot without GNSS learns the time from Alight's replies.
        Speakers {
            signing: signing.map(Signing::at_any_time),
            rejected: Arc::default(),
        }
    }
    /// Filter that accepts datagrams of the autopilot with this system id, or of any autopilot if it is 0. The first
    /// accepted sender becomes the autopilot.
    pub fn of_vehicle(&self, vehicle: u8) -> Speaks {
        let signing = self.signing.clone();
        let rejected = self.rejected.clone();
        Arc::new(move |datagram| {
            let mut decoder = Decoder::signed(signing.clone());
            decoder.push(datagram);
            let frames: Vec<_> = core::iter::from_fn(|| decoder.next_frame())
                .take(MAX_FRAMES)
                .collect();
            if let Ok(mut all) = rejected.lock() {
                let signatures = decoder.signatures();
                *all = all.plus(Signatures {
                    unchecked: 0,
                    ..signatures
                });
            }
            let from_autopilot = |from: Address| {
                from.component == AUTOPILOT_COMPONENT && (vehicle == 0 || vehicle == from.system)
            };
            frames.into_iter().any(|frame| from_autopilot(frame.from))
        })
    }
    pub fn rejected(&self) -> Signatures {
        self.rejected
            .lock()
            .map_or_else(|_| Signatures::default(), |all| *all)
    }
}

trait ReceiverBytes: Default {
    fn take(&mut self, bytes: &[u8]);
    fn next_message(&mut self) -> Option<MavlinkMessage>;
}

impl ReceiverBytes for AisDecoder {
    fn take(&mut self, bytes: &[u8]) {
        self.push(bytes);
    }
    fn next_message(&mut self) -> Option<MavlinkMessage> {
        self.next_report().map(MavlinkMessage::Ais)
    }
}

impl ReceiverBytes for ReceiverDecoder {
    fn take(&mut self, bytes: &[u8]) {
        self.push(bytes);
    }
    fn next_message(&mut self) -> Option<MavlinkMessage> {
        self.next_report().map(MavlinkMessage::RelativePlace)
    }
}

#[derive(Default)]
struct LinkedReceiver<D> {
    link: Option<ByteLink>,
    decoder: D,
}

impl<D: ReceiverBytes> LinkedReceiver<D> {
    /// Opens the link at `at`; an empty address opens none.
    async fn at(
        address: &str,
        url: fn(&str) -> Result<LinkUrl, String>,
    ) -> Result<LinkedReceiver<D>, CliError> {
        let link = match address {
            "" => None,
            some => Some(ByteLink::of_several(url(some).map_err(CliError)?, None).await?),
        };
        Ok(LinkedReceiver {
            link,
            ..LinkedReceiver::default()
        })
    }
    /// Waits for bytes; never returns without a receiver.
    async fn read(&mut self) {
        match &mut self.link {
            Some(link) => link.read(|bytes| self.decoder.take(bytes)).await,
            None => pending().await,
        }
    }
    fn write(&mut self, bytes: &[u8]) {
        if let Some(link) = &mut self.link {
            link.write(bytes);
        }
    }
    /// Next report, as a frame without a sender.
    fn next_frame(&mut self) -> Option<MavlinkFrame> {
        let message = self.decoder.next_message()?;
        let from = Address::new(0, 0);
        Some(MavlinkFrame { from, message })
    }
    fn last_error(&mut self) -> Option<String> {
        self.link.as_mut()?.last_error()
    }
    fn unsent(&self) -> u64 {
        self.link.as_ref().map_or(0, ByteLink::unsent)
    }
}

struct Receivers {
    ais: LinkedReceiver<AisDecoder>,
    /// The drone's own GNSS receiver; the vessel's receiver is its moving base.
    gnss: LinkedReceiver<ReceiverDecoder>,
}

impl Receivers {
    async fn of(c: &AutopilotLinkConfig) -> Result<Receivers, CliError> {
        Ok(Receivers {
            ais: LinkedReceiver::at(&c.ais, LinkUrl::of_sentences).await?,
            gnss: LinkedReceiver::at(&c.receiver, LinkUrl::of_receiver).await?,
        })
    }
    /// Waits for bytes of any receiver; never returns without one.
    async fn read(&mut self) {
        tokio::select! {
            () = self.ais.read() => {}
            () = self.gnss.read() => {}
        }
    }
    fn next_frame(&mut self) -> Option<MavlinkFrame> {
        self.gnss.next_frame().or_else(|| self.ais.next_frame())
    }
    fn last_errors(&mut self) -> [Option<String>; 2] {
        [self.ais.last_error(), self.gnss.last_error()]
    }
}

pub fn run(args: &AutopilotArgs) -> Result<Exit, CliError> {
    runtime::block_on(fly(args))
}

async fn fly(args: &AutopilotArgs) -> Result<Exit, CliError> {
    let computer: DroneComputerConfig = config::load(&args.process.config)?;
    let name = args.connect.as_ref().unwrap_or(&computer.autopilot.connect);
    let url = LinkUrl::of_autopilot(name).map_err(CliError)?;
    let mut edge = MavlinkEdge::open(&computer.autopilot, url.clone()).await?;
    let of = (Some(computer.instance.as_str()), computer.clock);
    let make = |boot| Ok(AutopilotLink::installed(&computer.nodes(), boot));
    let process = Process::start(ProcessKind::Autopilot, &args.process, of, make)?;
    info!("autopilot: {url}");
    process.run_awaiting(&mut edge).await
}

struct MavlinkEdge {
    link: ByteLink,
    receivers: Receivers,
    signing: Option<Signing>,
    speakers: Speakers,
    decoder: Decoder,
    encoder: Encoder,
    steps: Interval,
    received: Vec<MavlinkFrame>,
    /// More frames may be waiting than one step accepts.
    more: bool,
}

impl MavlinkEdge {
    async fn open(config: &AutopilotLinkConfig, url: LinkUrl) -> Result<MavlinkEdge, CliError> {
        let signing = mavlink_key::read("autopilot.signing_key", &config.signing_key)?;
        let speakers = Speakers::new(signing.as_ref());
        let speaks = speakers.of_vehicle(config.vehicle);
        let mut steps = interval(MAX_STEP_PERIOD);
        steps.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Ok(MavlinkEdge {
            link: ByteLink::with_peer(url, Some(speaks)).await?,
            receivers: Receivers::of(config).await?,
            decoder: Decoder::signed(signing.clone()),
            encoder: Encoder::signed(signing.clone()),
            signing,
            speakers,
            steps,
            received: Vec::new(),
            more: false,
        })
    }
}

impl Edge<AutopilotLink> for MavlinkEdge {
    fn read(&mut self, input: &mut AutopilotIn) {
        input.received = core::mem::take(&mut self.received);
        if let (Some(signing), Some(before)) = (&self.signing, &input.checkpoint) {
            signing.recall(&before.signing);
        }
        self.steps.reset();
    }
    fn write<B: Bus>(
        &mut self,
        input: &AutopilotIn,
        out: &mut AutopilotOut,
        ports: &mut AutopilotPorts<B>,
    ) -> bool {
        // Set-points must not wait, so the autopilot's link comes first.
        let frames = out
            .messages
            .iter()
            .filter_map(|m| self.encoder.frame(out.from, m));
        for bytes in frames {
            self.link.write(&bytes);
        }
        for frame in &out.rtcm {
            self.receivers.gnss.write(frame);
        }
        // Signatures are part of the frames, which the node does not process.
        let own = out.checkpoint;
        let signing = self.signing.as_ref().map(Signing::times).unwrap_or_default();
        out.checkpoint = own.map(|own| LinkCheckpoint { signing, ..own });
        ports.write(out);
        out.checkpoint = own;
        !input.received.is_empty()
    }
}

impl ProcessEdge<AutopilotLink> for MavlinkEdge {
    fn stepped(&mut self, _at: &NodeView<'_, AutopilotLink>, step: &RowStep<AutopilotLink>) {
        let error = self.link.last_error();
        let others = self.receivers.last_errors();
        for text in step.out.texts.iter().chain(&error).chain(others.iter().flatten()) {
            info!("autopilot: {text}");
        }
    }
    fn metrics(&mut self, at: &NodeView<'_, AutopilotLink>) -> Vec<Metric> {
        let of_node = at.node.metrics(at.now);
        let own = [
            MetricName::ClockUncertainty.seconds(of_node.clock_uncertainty_s),
            MetricName::SamplesRejected.count(of_node.rejected),
            MetricName::ClockRestarts.count(of_node.restarts),
            MetricName::HoverThrust.fraction(of_node.hover_thrust),
            MetricName::SetPointsSent.count(of_node.set_points),
            MetricName::LinkReopened.count(self.link.opened()),
            MetricName::PacketsDropped.count(self.link.foreign()),
            MetricName::RtcmPassedOn.count(of_node.rtcm_passed_on),
            MetricName::RtcmDropped.count(of_node.rtcm_dropped),
        ];
        let signatures = self.decoder.signatures().plus(self.speakers.rejected());
        own.into_iter().chain(mavlink_key::metrics(signatures)).collect()
    }
    fn unsent(&self) -> u64 {
        self.link.unsent() + self.receivers.gnss.unsent()
    }
}

impl AwaitedEdge<AutopilotLink> for MavlinkEdge {
    async fn arrival(&mut self, wakes: &Wakes) -> Result<bool, CliError> {
        let decoder = &mut self.decoder;
        let receivers = &mut self.receivers;
        let mut due = self.more;
        if !due {
            tokio::select! {
                () = self.link.read(|bytes| decoder.push(bytes)) => {}
                () = receivers.read() => {}
                woken = wakes.woken() => {
                    woken?;
                    due = true;
                }
                _ = self.steps.tick() => due = true,
            }
        }
        let frames = core::iter::from_fn(|| decoder.next_frame().or_else(|| receivers.next_frame()));
        self.received = frames.take(MAX_FRAMES).collect();
        self.more = self.received.len() == MAX_FRAMES;
        // Bytes without a complete frame do not make a step due.
        Ok(due || !self.received.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_uav::autopilot::message::{COMPANION_COMPONENT, CommandLong};

    #[test]
    fn datagram_that_makes_its_sender_the_peer() {
        let of = |signing: Option<&Signing>, system, component| {
            let address = Address::new(system, component);
            let mut encoder = Encoder::signed(signing.cloned());
            encoder
                .frame(address, &CommandLong::request(Address::default(), 0).into())
                .unwrap()
        };
        let from = |system, component| of(None, system, component);
        let autopilot = from(3, AUTOPILOT_COMPONENT);
        let unsigned = Speakers::new(None);
        let any = unsigned.of_vehicle(0);
        assert!(any(&autopilot) && unsigned.of_vehicle(3)(&autopilot));
        assert!(!unsigned.of_vehicle(4)(&autopilot), "another system");
        assert!(!any(&from(255, 190)), "a ground station");
        assert!(!any(&from(3, COMPANION_COMPONENT)), "another companion");
        let mut damaged = autopilot.clone();
        damaged[12] ^= 1;
        assert!(!any(&damaged) && !any(b"") && !any(b"GET / HTTP/1.1"));
        assert_eq!(unsigned.rejected(), Signatures::default());
        let [ours, other] = [[1; 32], [2; 32]].map(Signing::new);
        let signed = |by| of(Some(by), 3, AUTOPILOT_COMPONENT);
        let speakers = Speakers::new(Some(&ours));
        let speaks = speakers.of_vehicle(3);
        assert!(speaks(&signed(&ours)) && !speaks(&autopilot) && !speaks(&signed(&other)));
        let rejected = speakers.rejected();
        assert_eq!((rejected.unsigned, rejected.other_key), (1, 1));
    }
}
