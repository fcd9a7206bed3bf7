//! The autopilot's parameters, origin and heights, read as the link does before a landing. It sends heartbeats and
//! requests, nothing else.

use alight_computer::config::DroneComputer;
use alight_computer::config::link_url::LinkUrl;
use alight_computer::drone::autopilot::Speakers;
use alight_computer::io::byte_link::ByteLink;
use alight_computer::io::{mavlink_key, runtime};
use alight_shared::admission::Periodic;
use alight_shared::mavlink::Signatures;
use alight_shared::time::{DroneClock, Span, Time};
use alight_transport::clock::steady_ns;
use alight_uav::autopilot::message::{
    AUTOPILOT_COMPONENT, Address, COMPANION_TYPE, CUSTOM_MODE, CommandLong, Heartbeat, Message, NO_AUTOPILOT,
    command, id,
};
use alight_uav::autopilot::modes::Firmware;
use alight_uav::autopilot::parameters::Parameters;
use alight_uav::autopilot::wire::{Decoder, Encoder};
use alight_uav::pilot::Output;
use tokio::time::{Instant, timeout_at};

use crate::tools::check::facts::AutopilotReport;

/// Time between two looks at the link.
const ROUND: std::time::Duration = std::time::Duration::from_millis(10);
/// The link is listened to so many times: 9 s, of which a parameter that is never reported takes 5.
const ROUNDS: u32 = 900;
/// Without an autopilot's heartbeat after so many it is not there: three of its usual periods.
const ROUNDS_WITHOUT: u32 = 300;
/// Another vehicle's heartbeat comes after so many: one of its usual periods and a half.
const ROUNDS_FOR_OTHERS: u32 = 150;
/// Period of our heartbeats.
const HEARTBEAT: Span = Span::from_millis(1000);

/// What the autopilot reports; None when no heartbeat of one came. Frames are counted by their signatures.
pub fn report(
    computer: &DroneComputer,
    url: &LinkUrl,
    signatures: &mut Signatures,
) -> Option<AutopilotReport> {
    runtime::block_on(async { Ok(received(computer, url, signatures).await) }).ok()?
}

async fn received(
    computer: &DroneComputer,
    url: &LinkUrl,
    signatures: &mut Signatures,
) -> Option<AutopilotReport> {
    let c = &computer.autopilot;
    // What is wrong with its file is a finding of its own.
    let signing = mavlink_key::read("autopilot.signing_key", &c.signing_key).ok()?;
    let speakers = Speakers::new(signing.as_ref());
    let speaks = Some(speakers.of_vehicle(c.vehicle));
    let mut link = ByteLink::with_peer(url.clone(), speaks).await.ok()?;
    let (mut decoder, mut encoder) = (Decoder::signed(signing.clone()), Encoder::signed(signing));
    let mut heartbeat = Periodic::<DroneClock>::default();
    let mut origin_due = Periodic::<DroneClock>::default();
    let mut found: Option<(Address, Parameters)> = None;
    let mut report = AutopilotReport::default();
    for round in 0..ROUNDS {
        let round_ends = Instant::now() + ROUND;
        while timeout_at(round_ends, link.read(|bytes| decoder.push(bytes)))
            .await
            .is_ok()
        {}
        let now = Time::from_nanos(steady_ns());
        while let Some(frame) = decoder.next_frame() {
            match (&frame.message, &mut found) {
                (Message::Heartbeat(h), None) if frame.from.component == AUTOPILOT_COMPONENT => {
                    found = Firmware::of(h.autopilot, h.vehicle)
                        .filter(|_| c.vehicle == 0 || c.vehicle == frame.from.system)
                        .map(|f| {
                            (
                                frame.from,
                                Parameters::new(f, computer.drone.pilot.output == Output::Attitude, now),
                            )
                        });
                }
                (Message::Heartbeat(h), Some((own, _)))
                    if c.vehicle == 0
                        && frame.from.component == AUTOPILOT_COMPONENT
                        && frame.from.system != own.system
                        && Firmware::of(h.autopilot, h.vehicle).is_some() =>
                {
                    report.several = Some([own.system, frame.from.system]);
                }
                (Message::Parameter { name, value, .. }, Some((from, p))) if *from == frame.from => {
                    p.received(name, *value);
                }
                (Message::Origin(origin), Some((from, _))) if *from == frame.from => {
                    report.origin = Some(*origin);
                }
                (Message::GnssHeights { sea_m, ellipsoid_m }, Some((from, _))) if *from == frame.from => {
                    report.geoid_m = (*ellipsoid_m != 0.0).then_some(ellipsoid_m - sea_m);
                }
                (_, _) => {}
            }
        }
        let own = Message::Heartbeat(Heartbeat {
            autopilot: NO_AUTOPILOT,
            vehicle: COMPANION_TYPE,
            base_mode: CUSTOM_MODE,
            custom_mode: 0,
        });
        let alive = heartbeat.is_due_spaced(now, HEARTBEAT).then_some(own);
        let request = found.as_mut().and_then(|(to, p)| p.ask(now, *to));
        let system = match (c.system, &found) {
            (0, Some((from, _))) => from.system,
            (0, None) => 1,
            (configured, _) => configured,
        };
        let asks = found
            .as_ref()
            .filter(|_| report.origin.is_none() && origin_due.is_due_spaced(now, HEARTBEAT));
        let wanted = asks.map(|(to, _)| {
            [id::GPS_RAW_INT, id::GPS_GLOBAL_ORIGIN].map(|message| {
                Message::Command(CommandLong::new(
                    *to,
                    command::REQUEST_MESSAGE,
                    [f64::from(message)],
                ))
            })
        });
        for message in alive.iter().chain(&request).chain(wanted.iter().flatten()) {
            if let Some(bytes) = encoder.frame(Address::new(system, c.component), message) {
                link.write(&bytes);
            }
        }
        let done = match &found {
            Some((_, p)) => {
                p.complete()
                    && (report.origin.is_some() || round >= ROUNDS_WITHOUT)
                    && (c.vehicle != 0 || round >= ROUNDS_FOR_OTHERS)
            }
            None => round >= ROUNDS_WITHOUT,
        };
        if done {
            break;
        }
    }
    *signatures = decoder.signatures().plus(speakers.rejected());
    found.map(|(_, p)| AutopilotReport {
        parameters: p.faults().collect(),
        ..report
    })
}
