//! Reads the autopilot's parameters, origin and heights as the link does before a landing. Sends only heartbeats and
//! requests.

use alight_computer::{
    config::{DroneComputerConfig, link_url::LinkUrl},
    drone::autopilot::Speakers,
    io::{byte_link::ByteLink, mavlink_key, runtime},
};
use alight_shared::{
    admission::Periodic,
    mavlink::{self, MessageData as _, Signatures, dialect as m},
    time::{DroneClock, Span, Time},
};
use alight_transport::clock::steady_ns;
use alight_uav::{
    autopilot::{
        message::{
            AUTOPILOT_COMPONENT, Address, CommandLong, MavAutopilot, MavMessage as M, MavModeFlag, MavType,
            MavlinkMessage, ParameterValue, heartbeat, text, version,
        },
        modes::Firmware,
        parameters::Parameters,
        wire::{Decoder, Encoder},
    },
    pilot::Output,
};
use tokio::time::{Instant, timeout_at};

use crate::tools::check::facts::AutopilotReport;

const ROUND: std::time::Duration = std::time::Duration::from_millis(10);
/// Maximum number of reads of the link: 9 s, including 5 s of timeout for a parameter that is never reported.
const ROUNDS: u32 = 900;
/// Number of reads after which an autopilot without a heartbeat counts as absent: three typical heartbeat periods.
const ROUNDS_WITHOUT: u32 = 300;
/// Number of reads for other vehicles' heartbeats: one and a half typical heartbeat periods.
const ROUNDS_FOR_OTHERS: u32 = 150;
const HEARTBEAT: Span = Span::from_millis(1000);

/// Report on the autopilot; None without its heartbeat. `signatures` counts the frames by signature.
pub fn report(
    computer: &DroneComputerConfig,
    url: &LinkUrl,
    signatures: &mut Signatures,
) -> Option<AutopilotReport> {
    runtime::block_on(async { Ok(received(computer, url, signatures).await) }).ok()?
}

async fn received(
    computer: &DroneComputerConfig,
    url: &LinkUrl,
    signatures: &mut Signatures,
) -> Option<AutopilotReport> {
    let c = &computer.autopilot;
    // A faulty key file is a separate finding.
    let signing = mavlink_key::read("autopilot.signing_key", &c.signing_key).ok()?;
    let speakers = Speakers::new(signing.as_ref());
    let speaks = Some(speakers.of_vehicle(c.vehicle));
    let mut link = ByteLink::with_peer(url.clone(), speaks).await.ok()?;
    let (mut decoder, mut encoder) = (Decoder::signed(signing.clone()), Encoder::signed(signing));
    let mut inquiry = Inquiry::new(computer);
    for round in 0..ROUNDS {
        let round_ends = Instant::now() + ROUND;
        while timeout_at(round_ends, link.read(|bytes| decoder.push(bytes)))
            .await
            .is_ok()
        {}
        let now = Time::from_nanos(steady_ns());
        while let Some(frame) = decoder.next_frame() {
            inquiry.receive(frame.from, &frame.message, now);
        }
        let own = Address::new(inquiry.system(), c.component);
        for message in inquiry.messages(now) {
            if let Some(bytes) = encoder.frame(own, &message) {
                link.write(&bytes);
            }
        }
        if inquiry.is_done(round) {
            break;
        }
    }
    *signatures = decoder.signatures().plus(speakers.rejected());
    inquiry.report()
}

struct Inquiry<'a> {
    computer: &'a DroneComputerConfig,
    heartbeat: Periodic<DroneClock>,
    origin_due: Periodic<DroneClock>,
    time_due: Periodic<DroneClock>,
    /// Address and parameters of the autopilot, after its first heartbeat.
    found: Option<(Address, Parameters)>,
    report: AutopilotReport,
}

impl Inquiry<'_> {
    fn new(computer: &DroneComputerConfig) -> Inquiry<'_> {
        Inquiry {
            computer,
            heartbeat: Periodic::default(),
            origin_due: Periodic::default(),
            time_due: Periodic::default(),
            found: None,
            report: AutopilotReport::default(),
        }
    }

    fn receive(&mut self, sender: Address, message: &MavlinkMessage, now: Time<DroneClock>) {
        let vehicle = self.computer.autopilot.vehicle;
        let MavlinkMessage::Common(message) = message else {
            return;
        };
        match (message, &mut self.found) {
            (M::HEARTBEAT(h), None) if sender.component == AUTOPILOT_COMPONENT => {
                let by_attitude = self.computer.drone.pilot.output == Output::Attitude;
                self.found = Firmware::of(h.autopilot, h.mavtype)
                    .filter(|_| vehicle == 0 || vehicle == sender.system)
                    .map(|f| (sender, Parameters::new(f, by_attitude, now)));
            }
            (M::HEARTBEAT(h), Some((own, _)))
                if vehicle == 0
                    && sender.component == AUTOPILOT_COMPONENT
                    && sender.system != own.system
                    && Firmware::of(h.autopilot, h.mavtype).is_some() =>
            {
                self.report.several = Some([own.system, sender.system]);
            }
            (M::PARAM_VALUE(d), Some((from, p))) if *from == sender => {
                let value = ParameterValue::read(d.param_value, d.param_type);
                p.received(&text(&d.param_id), value);
            }
            (M::AUTOPILOT_VERSION(d), Some((from, p))) if *from == sender => p.on_version(version(d)),
            (M::GPS_GLOBAL_ORIGIN(d), Some((from, _))) if *from == sender => {
                self.report.origin = Some(mavlink::place(d.latitude, d.longitude, d.altitude));
            }
            (M::TIMESYNC(d), Some((from, _))) if *from == sender => self.report.dates |= d.tc1 != 0,
            (M::GPS_RAW_INT(d), Some((from, _))) if *from == sender => {
                let geoid_m = (f64::from(d.alt_ellipsoid) - f64::from(d.alt)) * 1e-3;
                self.report.geoid_m = (d.alt_ellipsoid != 0).then_some(geoid_m);
            }
            (_, _) => {}
        }
    }

    /// System id to which requests are addressed: the configured one, otherwise the autopilot's.
    fn system(&self) -> u8 {
        match (self.computer.autopilot.system, &self.found) {
            (0, Some((from, _))) => from.system,
            (0, None) => 1,
            (configured, _) => configured,
        }
    }

    /// Messages that are due: heartbeat, parameter request, requests for origin, heights and time.
    fn messages(&mut self, now: Time<DroneClock>) -> Vec<MavlinkMessage> {
        let own = heartbeat(
            MavAutopilot::MAV_AUTOPILOT_INVALID,
            MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            0,
        );
        let alive = self.heartbeat.is_due_spaced(now, HEARTBEAT).then_some(own);
        let request = self.found.as_mut().and_then(|(to, p)| p.ask(now, *to));
        let mut messages: Vec<MavlinkMessage> = alive.into_iter().chain(request).collect();
        if let Some((to, _)) = &self.found
            && self.report.origin.is_none()
            && self.origin_due.is_due_spaced(now, HEARTBEAT)
        {
            let ids = [m::GPS_RAW_INT_DATA::ID, m::GPS_GLOBAL_ORIGIN_DATA::ID];
            messages.extend(ids.map(|id| CommandLong::request(*to, id).into()));
        }
        if self.found.is_some() && !self.report.dates && self.time_due.is_due_spaced(now, HEARTBEAT) {
            let request = m::TIMESYNC_DATA {
                ts1: now.nanos(),
                ..m::TIMESYNC_DATA::DEFAULT
            };
            messages.push(M::TIMESYNC(request).into());
        }
        messages
    }

    fn is_done(&self, round: u32) -> bool {
        match &self.found {
            Some((_, p)) => {
                p.complete()
                    && (self.report.origin.is_some() && self.report.dates || round >= ROUNDS_WITHOUT)
                    && (self.computer.autopilot.vehicle != 0 || round >= ROUNDS_FOR_OTHERS)
            }
            None => round >= ROUNDS_WITHOUT,
        }
    }

    fn report(self) -> Option<AutopilotReport> {
        let report = self.report;
        self.found.map(|(_, p)| AutopilotReport {
            parameters: p.faults().collect(),
            ..report
        })
    }
}
