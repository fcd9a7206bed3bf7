//! Senders on a MAVLink link. One system and component is the vessel's for the lifetime of the process.

use alight_shared::mavlink::RawFrame;

const HEARTBEAT: u32 = 0;
pub(crate) const AUTOPILOT: u8 = 1;
/// `MAV_AUTOPILOT_INVALID`: a component that is not an autopilot.
const NO_AUTOPILOT: u8 = 8;
/// `MAV_TYPE` of surface vessels, and the type of components that state none.
const GENERIC: u8 = 0;
const ROVER: u8 = 10;
const BOAT: u8 = 11;
const SUBMARINE: u8 = 12;
/// `MAV_TYPE_ONBOARD_CONTROLLER`: any onboard computer.
const COMPUTER: u8 = 18;
/// Messages after which a sensor without heartbeats counts as the vessel's; autopilots send one a second.
const SILENT_HEARTBEAT: u64 = 100;
const MAX_RECEIVED: usize = 16;

#[derive(Clone, Copy, Debug, Default)]
struct Received {
    system: u32,
    component: u8,
    /// Type and autopilot in its heartbeat.
    kind: Option<(u8, u8)>,
    messages: u64,
    left_out: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kin {
    Boat,
    Unknown,
    Other,
}

impl Received {
    fn kin(&self) -> Kin {
        match self.kind {
            None | Some((COMPUTER, _)) => Kin::Unknown,
            Some((GENERIC | ROVER | BOAT | SUBMARINE, autopilot))
                if autopilot != NO_AUTOPILOT || self.component == AUTOPILOT =>
            {
                Kin::Boat
            }
            Some(_) => Kin::Other,
        }
    }
    fn name(&self) -> String {
        let kind = match self.kind.map(|(kind, _)| kind) {
            None => "without a heartbeat".into(),
            Some(1) => "an aeroplane".into(),
            Some(2 | 3 | 4 | 13 | 14 | 15 | 29 | 35) => "a multirotor".into(),
            Some(6) => "a ground station".into(),
            Some(BOAT) => "a boat".into(),
            Some(COMPUTER) => "a computer".into(),
            Some(other) => format!("of MAV_TYPE {other}"),
        };
        format!("system {} component {}, {kind}", self.system, self.component)
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Systems {
    /// System of the vessel in the configuration.
    configured: Option<u32>,
    own: Option<(u32, u8)>,
    received: Vec<Received>,
    beyond: u64,
}

impl Systems {
    pub(crate) fn new(configured: Option<u8>) -> Self {
        Systems {
            configured: configured.map(u32::from),
            ..Systems::default()
        }
    }
    pub(crate) fn own(&self) -> Option<u8> {
        let own = self.own.map(|(system, _)| system).or(self.configured);
        own.and_then(|system| u8::try_from(system).ok())
    }
    pub(crate) fn is_own(&mut self, raw: &RawFrame) -> bool {
        let id = (raw.system, raw.component);
        let at = self.received.iter().position(|h| (h.system, h.component) == id);
        let at = match at {
            Some(at) => at,
            None if self.received.len() < MAX_RECEIVED => {
                self.received.push(Received {
                    system: raw.system,
                    component: raw.component,
                    ..Received::default()
                });
                self.received.len() - 1
            }
            None => {
                self.beyond += 1;
                return false;
            }
        };
        let configured = self.configured;
        let Some(received) = self.received.get_mut(at) else {
            return false;
        };
        received.messages += 1;
        // Read by its bytes, because newer types are unknown to the dialect.
        if raw.id == HEARTBEAT {
            let byte = |at: usize| raw.payload.get(at).copied().unwrap_or(0);
            received.kind = Some((byte(4), byte(5)));
        }
        let may_be = match (configured, received.kin()) {
            (Some(system), _) if system != received.system => false,
            (Some(_), _) if received.component == AUTOPILOT => true,
            (_, Kin::Boat) => true,
            (_, Kin::Unknown) => received.messages > SILENT_HEARTBEAT,
            (Some(_), Kin::Other) | (None, Kin::Other) => false,
        };
        // A component selected without a heartbeat is dropped once it reports another type.
        if self.own == Some(id) && !may_be {
            self.own = None;
        }
        if self.own.is_none() && may_be {
            self.own = Some(id);
        }
        let own = self.own == Some(id);
        received.left_out += u64::from(!own);
        own
    }

    /// Remark on the selected and other senders.
    pub(crate) fn remark(&self) -> Option<(String, Option<&'static str>)> {
        let mut others: Vec<String> = self
            .received
            .iter()
            .filter(|h| h.left_out > 0 && Some((h.system, h.component)) != self.own)
            .map(|h| format!("{} ({} messages)", h.name(), h.left_out))
            .collect();
        if self.beyond > 0 {
            others.push(format!("more ({} messages)", self.beyond));
        }
        if others.is_empty() {
            return None;
        }
        let others = others.join("; ");
        Some(match self.own {
            Some((system, component)) => (
                format!("system {system} component {component} is the vessel's; left out: {others}"),
                None,
            ),
            None => (
                format!("no system on this link is identified as the vessel's; left out: {others}"),
                Some(
                    "its heartbeat must have the MAV_TYPE of a boat; or set its number: system = N at this source",
                ),
            ),
        })
    }
}
