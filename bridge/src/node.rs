//! Bridge node: radio packets in, messages on the drone's clock out.

use std::collections::VecDeque;

use alight_shared::{
    admission::{Periodic, RejectionReason, Rejections, Sender, check_identity, command::counts_despite},
    bus::wiring,
    msg::{
        AutopilotState, Command, CommandKind, DeckForecast, DeckGrant, DroneState, DroneStatus,
        EstimateUpdate, Header, LinkState, Message, MissionState, OperatorCommand, RtcmFrames, TimeReply,
        TimeRequest, UpdateReceiver, VesselEstimate, VesselPrediction, VesselSurroundings, WaveModel,
        WaveUpdate,
    },
    node::Node,
    radio::RadioTopic,
    time::{DroneClock, DroneTime, Span, Stamped, Time, VesselClock, VesselTime},
    wire::{self, WireError},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{
    clock::{ClockOffset, Offset},
    config::BridgeConfig,
    link::LinkStatistics,
    order::{Boot, Boots, SequenceOrder},
    status::StatusReport,
};

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Packet {
    pub kind: RadioTopic,
    /// Owner of the key expression on which the packet arrived.
    pub sender: Sender,
    pub bytes: Vec<u8>,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct BridgeIn {
    /// Packets in order of arrival.
    pub packets: Vec<Stamped<DroneClock, Packet>>,
    pub mission: Option<MissionState>,
    pub drone: Option<DroneState>,
    pub forecast: Option<DeckForecast>,
    pub autopilot: Option<AutopilotState>,
}

/// Newest admitted message of each kind, on the drone's clock.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct BridgeOut {
    pub estimate: Option<VesselEstimate<DroneClock>>,
    pub wave: Option<WaveModel<DroneClock>>,
    pub prediction: Option<VesselPrediction<DroneClock>>,
    pub deck: Option<DeckGrant<DroneClock>>,
    pub surroundings: Option<VesselSurroundings<DroneClock>>,
    /// RTCM frames in order of arrival.
    pub rtcm: Vec<RtcmFrames<DroneClock>>,
    /// Commands in order of arrival.
    pub commands: Vec<Command>,
    pub link: Option<LinkState>,
    /// Time request for the vessel, to be sent at once.
    pub time_request: Option<TimeRequest<DroneClock>>,
    pub status: Option<DroneStatus>,
}

impl BridgeOut {
    /// Passes each encoded message for the vessel to `send`.
    pub fn broadcast(&self, mut send: impl FnMut(RadioTopic, Vec<u8>)) {
        RadioTopic::TimeRequest.encode_each(&self.time_request, &mut send);
        RadioTopic::Status.encode_each(&self.status, &mut send);
    }
}

wiring! {
    /// Messages that the bridge writes and reads, apart from radio packets.
    BridgePorts of Bridge: BridgeIn => BridgeOut {
        reads {
            newest mission: MissionState,
            newest drone: DroneState,
            newest forecast: DeckForecast,
            newest autopilot: AutopilotState,
        }
        edge { packets }
        writes {
            estimate: VesselEstimate<DroneClock>,
            wave: WaveModel<DroneClock>,
            prediction: VesselPrediction<DroneClock>,
            deck: DeckGrant<DroneClock>,
            surroundings: VesselSurroundings<DroneClock>,
            rtcm: RtcmFrames<DroneClock>,
            commands: Command,
            link: LinkState,
        }
        wakes {}
    }
}

const MAX_OPEN: usize = 16;

#[derive(Clone, Copy, Debug)]
struct Request {
    at: DroneTime,
    /// The current computer has replied to this request.
    answered: bool,
}

#[derive(Clone, Debug)]
pub struct Bridge {
    config: BridgeConfig,
    boot: u32,
    boots: Boots,
    /// Indexed by [`RadioTopic`].
    orders: [SequenceOrder; RadioTopic::ALL.len()],
    /// Newest time of validity in the current boot, on the vessel's clock.
    newest: Option<VesselTime>,
    newest_received: Option<(u32, VesselTime)>,
    updates: UpdateReceiver<VesselClock>,
    clock: ClockOffset,
    link: LinkStatistics,
    rejections: Rejections,
    open: VecDeque<Request>,
    next_request: Periodic<DroneClock>,
    requests: u32,
    next_link: Periodic<DroneClock>,
    links: u32,
    status: StatusReport,
}

impl Bridge {
    /// Bridge before its first message; `boot` is drawn at each start.
    pub fn new(config: &BridgeConfig, boot: u32) -> Self {
        Bridge {
            config: config.clone(),
            boot,
            boots: Boots::default(),
            orders: Default::default(),
            newest: None,
            newest_received: None,
            updates: UpdateReceiver::default(),
            clock: ClockOffset::new(&config.clock),
            link: LinkStatistics::new(config.loss_window_s),
            rejections: Rejections::default(),
            open: VecDeque::with_capacity(MAX_OPEN),
            next_request: Periodic::default(),
            requests: 0,
            next_link: Periodic::default(),
            links: 0,
            status: StatusReport::default(),
        }
    }
    /// Sets the time within which a landed drone disarms; after it, the status reports the drone as still armed.
    #[must_use]
    pub fn disarmed_within(mut self, disarm_s: f64) -> Self {
        self.status.disarm_s = disarm_s;
        self
    }

    pub fn rejections(&self) -> &Rejections {
        &self.rejections
    }
    /// Boot of a second computer that recently published as the vessel; its messages are not used.
    pub fn second_sender(&self, now: DroneTime) -> Option<u32> {
        self.boots.second(now)
    }
    pub fn offset(&self, now: DroneTime) -> Option<Offset> {
        self.clock.at(now)
    }

    fn packet(
        &mut self,
        arrival: DroneTime,
        packet: &Packet,
        out: &mut BridgeOut,
    ) -> Result<(), RejectionReason> {
        let kind = packet.kind;
        packet.sender.check(Sender::Vessel(self.config.vessel_id))?;
        match kind {
            RadioTopic::Estimate => {
                let m: EstimateUpdate<VesselClock> = decode(&packet.bytes)?;
                let admitted = self.admit(arrival, &m, kind, 0.0);
                if admitted == Err(RejectionReason::OutOfOrder) {
                    self.link.out_of_order(arrival);
                }
                let (at, advance) = admitted?;
                self.newest_received = Some((m.header.boot, m.header.at));
                self.clock.one_way(m.header.at, arrival);
                self.link.admitted(arrival, at, advance);
                if let Some(m) = self.updates.estimate(&m) {
                    out.estimate = Some(m.restamped(at));
                }
            }
            RadioTopic::Wave => {
                out.wave = self.waves(arrival, &decode(&packet.bytes)?)?.or(out.wave);
            }
            RadioTopic::Prediction => {
                let m: VesselPrediction<VesselClock> = decode(&packet.bytes)?;
                // The time of a prediction is that of its first stage, which may be one step ahead.
                let ahead = f64::from(m.step_s).clamp(0.0, 1.0);
                let (at, _) = self.admit(arrival, &m, kind, ahead)?;
                out.prediction = Some(m.restamped(at));
            }
            RadioTopic::TimeReply => {
                let m: TimeReply<VesselClock, DroneClock> = decode(&packet.bytes)?;
                self.time_reply(arrival, &m)?;
            }
            RadioTopic::Deck => {
                let m: DeckGrant<VesselClock> = decode(&packet.bytes)?;
                let (at, _) = self.admit(arrival, &m, kind, 0.0)?;
                out.deck = Some(m.restamped(at));
            }
            RadioTopic::Surroundings => {
                let m: VesselSurroundings<VesselClock> = decode(&packet.bytes)?;
                let (at, _) = self.admit(arrival, &m, kind, 0.0)?;
                out.surroundings = Some(m.restamped(at));
            }
            RadioTopic::Rtcm => {
                let m: RtcmFrames<VesselClock> = decode(&packet.bytes)?;
                let (at, _) = self.admit(arrival, &m, kind, 0.0)?;
                out.rtcm.push(m.restamped(at));
            }
            RadioTopic::Command => {
                let m: OperatorCommand<VesselClock> = decode(&packet.bytes)?;
                let at = match self.admit(arrival, &m, kind, 0.0) {
                    Ok((at, _)) => at,
                    Err(why) if counts_despite(m.kind, why) => {
                        self.orders[kind as usize].admit(m.header.sequence);
                        // An old command keeps its time, because the mission recognises repetitions by it.
                        let given = self.on_own_clock(arrival, &m.header).map(|(at, _)| at);
                        given.filter(|_| why == RejectionReason::Stale).unwrap_or(arrival)
                    }
                    // An abort is accepted from either vessel computer, as of its arrival: the computer's clock is unknown here.
                    Err(RejectionReason::Boot | RejectionReason::SecondSender)
                        if m.kind == CommandKind::Abort =>
                    {
                        arrival
                    }
                    Err(reason) => return Err(reason),
                };
                out.commands.push(m.restamped(at));
            }
            // Not for drones; the process has shown the vessel's reports.
            _ => return Err(RejectionReason::Malformed),
        }
        Ok(())
    }

    fn waves(
        &mut self,
        arrival: DroneTime,
        m: &WaveUpdate<VesselClock>,
    ) -> Result<Option<WaveModel<DroneClock>>, RejectionReason> {
        // Not admitted yet: the missing base, which a joining drone asks for, would then arrive out of order.
        if !self.updates.has_base(m) {
            return Ok(None);
        }
        let (at, _) = self.admit(arrival, m, RadioTopic::Wave, 0.0)?;
        Ok(self.updates.waves(m).map(|m| m.restamped(at)))
    }

    /// Checks a message, cheapest test first. Returns its time of validity on the drone's clock and the
    /// sequence numbers since its predecessor. Its time may be up to `ahead` seconds in the future.
    fn admit<M: Message<Clock = VesselClock>>(
        &mut self,
        arrival: DroneTime,
        message: &M,
        kind: RadioTopic,
        ahead: f64,
    ) -> Result<(DroneTime, u32), RejectionReason> {
        let header = message.header();
        check_identity(header, self.config.vessel_id, self.config.drone_id)?;
        message.check().map_err(|_| RejectionReason::OutOfRange)?;
        let restart = match self.boots.observe(arrival, header.boot) {
            Boot::Current => false,
            Boot::First => true,
            Boot::Second => return Err(RejectionReason::SecondSender),
            // After a restart, times continue from their former values. If the vessel's clock was set back,
            // the first reply to our request proves the new boot.
            Boot::Next if self.newest.is_some_and(|n| header.at > n) => true,
            Boot::Next | Boot::Other => return Err(RejectionReason::Boot),
        };
        let advance = if restart {
            1
        } else {
            let order = &self.orders[kind as usize];
            if kind == RadioTopic::Rtcm {
                order.advance_unordered(header.sequence)?
            } else {
                order.advance(header.sequence)?
            }
        };
        let (at, max_error_s) = self
            .on_own_clock(arrival, header)
            .ok_or(RejectionReason::NoClock)?;
        let slack = max_error_s + self.config.future_margin_s;
        let age = (arrival - at).secs();
        if age < -(slack + ahead) {
            return Err(RejectionReason::Future);
        }
        if age > kind.row().topic.stale_after.secs() {
            return Err(RejectionReason::Stale);
        }
        if restart {
            self.adopt(arrival, header.boot);
        }
        // Earliest possible time of sending.
        let sent = at - Span::from_secs(slack + ahead);
        self.boots.received(arrival, sent);
        self.newest = Some(self.newest.map_or(header.at, |n| n.max(header.at)));
        let order = &mut self.orders[kind as usize];
        if kind == RadioTopic::Rtcm {
            order.admit_unordered(header.sequence);
        } else {
            order.admit(header.sequence);
        }
        Ok((at, advance))
    }

    /// Time of a message on the drone's clock and the bound of its error, s; None without an offset.
    fn on_own_clock(&self, arrival: DroneTime, header: &Header<VesselClock>) -> Option<(DroneTime, f64)> {
        let offset = self.clock.at(arrival)?;
        let since = Span::from_secs(offset.offset_s).nanos();
        let at = Time::from_nanos(header.at.nanos().saturating_add(since));
        Some((at, offset.max_error_s))
    }

    fn adopt(&mut self, now: DroneTime, boot: u32) {
        self.boots.adopt(now, boot);
        self.begin_again();
    }

    fn begin_again(&mut self) {
        self.orders = Default::default();
        self.newest = None;
        self.link.reset();
    }

    fn time_reply(
        &mut self,
        t4: DroneTime,
        m: &TimeReply<VesselClock, DroneClock>,
    ) -> Result<(), RejectionReason> {
        let header: &Header<VesselClock> = &m.header;
        check_identity(header, self.config.vessel_id, self.config.drone_id)?;
        let asked = m.requested_at;
        let request = self.open.iter_mut().find(|r| r.at == asked);
        match self.boots.observe(t4, header.boot) {
            // A reply to a pending request is fresh: only the running computer can send it.
            meaning @ (Boot::Current | Boot::First | Boot::Next) => {
                let Some(request) = request.filter(|r| !r.answered) else {
                    return Err(RejectionReason::Unsolicited);
                };
                request.answered = true;
                if meaning != Boot::Current {
                    self.adopt(t4, header.boot);
                }
                if meaning == Boot::Next {
                    self.clock.reset();
                }
            }
            Boot::Other if request.is_some() && self.boots.returns(t4, header.boot, asked) => {
                self.begin_again();
                self.clock.reset();
            }
            // The request stays pending for the current computer.
            Boot::Other => return Err(RejectionReason::Boot),
            Boot::Second => return Err(RejectionReason::SecondSender),
        }
        self.boots.received(t4, asked);
        self.clock
            .exchange(asked, m.received_at, header.at, t4)
            .map_err(|_| RejectionReason::RoundTrip)?;
        Ok(())
    }

    fn time_request(&mut self, now: DroneTime) -> Option<TimeRequest<DroneClock>> {
        let period = Span::from_secs(1.0 / self.config.clock.request_rate_hz);
        if !self.next_request.is_due(now, period) {
            return None;
        }
        if self.open.len() == MAX_OPEN {
            self.open.pop_front();
        }
        self.open.push_back(Request {
            at: now,
            answered: false,
        });
        let header = Header::new(
            self.config.vessel_id,
            self.config.drone_id,
            self.boot,
            self.requests,
            now,
        );
        self.requests = self.requests.wrapping_add(1);
        let (newest_boot, newest_at) = self.newest_received.unwrap_or((0, Time::EPOCH));
        Some(TimeRequest {
            header,
            newest_at,
            newest_boot,
        })
    }

    fn link_state(&mut self, now: DroneTime) -> Option<LinkState> {
        let period = Span::from_secs(1.0 / self.config.link_rate_hz);
        if !self.next_link.is_due(now, period) {
            return None;
        }
        let offset = self.clock.at(now);
        let (loss, out_of_order) = self.link.loss(now);
        let (latency_p50_s, latency_p99_s) = self.link.latency_s();
        let header = Header::new(
            self.config.vessel_id,
            self.config.drone_id,
            self.boot,
            self.links,
            now,
        );
        self.links = self.links.wrapping_add(1);
        Some(LinkState {
            header,
            clock_offset_s: offset.map_or(0.0, |o| o.offset_s),
            clock_offset_sd_s: offset.map_or(f64::INFINITY, |o| o.sd_s),
            age_s: self.link.age_s(now),
            loss,
            out_of_order,
            latency_p50_s,
            latency_p99_s,
            rejected: self.rejections.total(),
            second_sender: self.boots.second(now),
        })
    }
}

impl Node for Bridge {
    type Clock = DroneClock;
    type In = BridgeIn;
    type Out = BridgeOut;

    fn step(&mut self, now: DroneTime, input: &BridgeIn) -> BridgeOut {
        let mut out = BridgeOut::default();
        for p in &input.packets {
            if let Err(reason) = self.packet(p.at.min(now), &p.value, &mut out) {
                self.rejections.count(reason);
            }
        }
        out.time_request = self.time_request(now);
        out.link = self.link_state(now);
        let status = &mut self.status;
        keep_newest(&mut status.mission, input.mission.as_ref());
        keep_newest(&mut status.drone, input.drone.as_ref());
        keep_newest(&mut status.forecast, input.forecast.as_ref());
        keep_newest(&mut status.autopilot, input.autopilot.as_ref());
        out.status = status.step(now, &self.config, self.boot);
        out
    }
}

/// Copies only new messages, because a forecast takes 10 kB.
fn keep_newest<T: Copy>(kept: &mut Option<T>, arrived: Option<&T>) {
    if let Some(arrived) = arrived {
        *kept = Some(*arrived);
    }
}

fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, RejectionReason> {
    wire::decode(bytes).map_err(|e| match e {
        WireError::Oversized { .. } => RejectionReason::Oversized,
        WireError::Malformed { .. } | WireError::Trailing { .. } | WireError::Encode { .. } => {
            RejectionReason::Malformed
        }
    })
}
