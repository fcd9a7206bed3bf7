//! Operator's command from ashore, through the vessel to one drone, with a receipt.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    time::Duration,
};

use alight_computer::{
    certificates,
    exit::{CliError, Exit},
    process::{life::draw_boot, radio_port::key},
    terminal,
};
use alight_shared::{
    admission::Retransmission,
    config::{Check, Keys},
    msg::{
        Charge, CommandKind, CommandProgress, CommandReceipt, DECK_CLOSED, DeckGrant, DroneStatus, Header,
        OperatorCommand, message_version,
    },
    time::{Span, SteadyClock, Time, VesselClock},
    topics, wire,
};
use alight_transport::{
    radio::{Publication, Radio, RadioConfig, Urgency},
    wake::end_requested,
};
use alight_usv::deck::MAX_DRONES;
use serde_json::json;

use super::{CommandArgs, POLL_PERIOD};
use crate::status::{finding::FindingLevel, vessel::drone};

/// Timeout of a command from ashore, which opens a session and passes over two radio links.
const MAX_POLLS_ASHORE: u32 = 240;
/// Number of polls after which an order is sent without contact: 3 s. The vessel may receive even if it is not
/// received.
const MAX_POLLS_CONTACT: u32 = 60;
/// Number of polls after the first contact within which each of the vessel's drones reports: 1.5 s, three status
/// periods.
const POLLS_ALL_REPORT: u32 = 30;
/// Number of polls between a rejection's receipt and the status with its reason: 2 s, with statuses at 2 Hz.
const POLLS_REASON: u32 = 40;

fn time_of_poll(poll: u32) -> Time<SteadyClock> {
    Time::EPOCH + Span::from_secs(POLL_PERIOD.as_secs_f64()) * i64::from(poll)
}

struct Ashore {
    order: Retransmission<SteadyClock, OperatorCommand<VesselClock>>,
    asks_only: bool,
    /// A message of the vessel was received, so the session is open.
    contact: bool,
    receipt: Option<CommandProgress>,
    receipt_looks: u32,
    /// Number of the drone: named by the operator, or the vessel's only one; None if unknown.
    number: Option<u32>,
    drones: BTreeMap<u32, DroneStatus>,
    /// Drones, silent or not, for which the vessel reserves the deck or a place in the queue.
    reserved: BTreeSet<u32>,
    looks: u32,
    sent: u32,
}

impl Ashore {
    /// State before the first message; without `kind` only the state is requested.
    fn new(header: Header<VesselClock>, kind: Option<CommandKind>, number: Option<u32>) -> Ashore {
        let asks_only = kind.is_none();
        let kind = kind.unwrap_or_default();
        let order = OperatorCommand { header, kind };
        Ashore {
            order: Retransmission::new(order, time_of_poll(0), topics::ASHORE_RETRIES),
            asks_only,
            contact: false,
            receipt: None,
            receipt_looks: 0,
            number,
            drones: BTreeMap::new(),
            reserved: BTreeSet::new(),
            looks: 0,
            sent: 0,
        }
    }
    /// Handles a receipt of this order; ignores receipts of other and earlier orders.
    fn receive_receipt(&mut self, r: &CommandReceipt) {
        let h = &self.order.message.header;
        let own = r.operator == [h.boot, h.sequence]
            && Some(r.header.drone) == self.number
            && r.header.vessel == h.vessel;
        if r.header.version == message_version() && own {
            if self.receipt != Some(r.progress) {
                self.receipt_looks = self.looks;
            }
            self.receipt = Some(r.progress);
        }
    }
    fn receive_status(&mut self, status: DroneStatus) {
        let drone = status.header.drone;
        let room = self.drones.len() < MAX_DRONES || self.drones.contains_key(&drone);
        if status.header.version == message_version() && room {
            self.drones.insert(drone, status);
        }
    }
    fn receive_grant(&mut self, grant: &DeckGrant<VesselClock>) {
        if grant.header.version == message_version() {
            let named = |n: &u32| *n != 0 && *n != DECK_CLOSED;
            self.reserved = grant
                .places
                .into_iter()
                .chain([grant.owner])
                .filter(named)
                .collect();
        }
    }
    fn drone(&self) -> Option<&DroneStatus> {
        self.drones.get(&self.number?)
    }
    /// Selects the vessel's only drone if none was named, once every drone has had time to report.
    fn choose(&mut self) -> Result<(), CliError> {
        self.looks += u32::from(self.contact);
        if self.number.is_some() || self.looks < POLLS_ALL_REPORT {
            return Ok(());
        }
        let known: BTreeSet<u32> = self.drones.keys().chain(&self.reserved).copied().collect();
        match known.len() {
            0 => {}
            1 => self.name(known.first().copied()),
            _ => {
                let state = |id: &u32| match self.drones.get(id) {
                    Some(s) => format!("  --drone {id}   {}", s.state.because(&s.entered)),
                    None => format!("  --drone {id}   silent; the deck is reserved for it"),
                };
                let list: Vec<String> = known.iter().map(state).collect();
                return Err(CliError(format!(
                    "nothing is commanded: the vessel knows {} drones; name one of them:\n{}",
                    list.len(),
                    list.join("\n")
                )));
            }
        }
        Ok(())
    }
    fn name(&mut self, number: Option<u32>) {
        self.number = number;
        self.order.message.header.drone = number.unwrap_or_default();
    }
    /// Order to send at this poll. It waits for the session, because it would be lost before; the wait is limited,
    /// because the vessel may receive even if it is not received.
    fn due(&mut self, poll: u32) -> Option<OperatorCommand<VesselClock>> {
        let open = self.contact || poll >= MAX_POLLS_CONTACT;
        if self.number.is_none() || self.asks_only || !open {
            return None;
        }
        let due = self.order.due(time_of_poll(poll));
        self.sent += u32::from(due.is_some());
        due
    }
    fn is_answered(&self) -> bool {
        match self.receipt {
            None => self.asks_only && self.drone().is_some(),
            Some(CommandProgress::Pending) => false,
            Some(CommandProgress::GivenUp) => {
                self.has_reason() || self.looks >= self.receipt_looks + POLLS_REASON
            }
            Some(
                CommandProgress::Taken
                | CommandProgress::Forbidden
                | CommandProgress::Replaced
                | CommandProgress::Unknown,
            ) => true,
        }
    }
    /// Whether the drone's newest status contains the reason for rejecting the order.
    fn has_reason(&self) -> bool {
        match self.order.message.kind {
            CommandKind::Hold | CommandKind::Ready | CommandKind::Station(_) => {
                self.drone().is_some_and(|status| status.rejected.is_some())
            }
            CommandKind::Land | CommandKind::TakeOff | CommandKind::Abort => true,
        }
    }
    fn is_taken(&self) -> bool {
        self.receipt == Some(CommandProgress::Taken) || self.asks_only && self.drone().is_some()
    }
    fn lines(&self, number: u32) -> Vec<String> {
        let mut lines = match self.drone() {
            Some(status) => {
                let state = status.state.because(&status.entered);
                let mut lines = vec![
                    format!("drone {number}: {state}"),
                    format!("waiting: {}", status.waits()),
                    format!("battery {}", Charge(status.battery)),
                ];
                let finding = drone(status);
                if finding.level > FindingLevel::Fine {
                    lines.push(format!("ALARM: {} -> {}", finding.found, finding.remedy));
                }
                lines
            }
            None => vec![format!("the vessel receives no drone {number}")],
        };
        if !self.asks_only {
            lines.push(format!("drone {number}: {}", self.outcome()));
        }
        lines
    }
    fn outcome(&self) -> &'static str {
        let abort = self.order.message.kind == CommandKind::Abort;
        match self.receipt {
            _ if self.asks_only => "",
            Some(CommandProgress::Taken) => "the drone has taken the command",
            Some(CommandProgress::Pending) if abort => {
                "the vessel has the abort, and the drone has not acknowledged it:\nit STAYS PENDING, and is \
                 repeated until the drone does"
            }
            Some(CommandProgress::Pending) => {
                "the vessel has the command, and the drone has not taken it:\nthe vessel gives up 10 s after \
                 receiving it"
            }
            Some(CommandProgress::GivenUp) => {
                "the drone did not accept the command, and the vessel does not repeat it"
            }
            Some(CommandProgress::Forbidden) => {
                "the vessel did not pass it on: an abort is pending or has just\nbeen given; look at the drone, then command again"
            }
            Some(CommandProgress::Replaced) => "a newer command for this drone has replaced it",
            Some(CommandProgress::Unknown) => {
                "the vessel's process has restarted and does not know the result:\nlook at the drone, then \
                 command again"
            }
            None if self.sent == 0 => "the command was NOT SENT",
            None if abort => {
                "RECEIPT UNCONFIRMED: whether the vessel has the abort is not known.\nIf it has, it stays \
                 pending; if not, nothing repeats it:\ncommand it again, or take manual control"
            }
            None => {
                "RECEIPT UNCONFIRMED: whether the vessel has the command is not known;\nit may still take effect within 10 s: \
                 abort to prevent that"
            }
        }
    }
}

pub fn run(args: &CommandArgs, endpoint: &str, keys: &Path) -> Result<Exit, CliError> {
    let own = certificates::read_certificate(&keys.join("certificate.pem"))?
        .certificate
        .name;
    let vessel = certificates::common_name("vessel", args.vessel_id);
    let config = RadioConfig::dialling(endpoint, certificates::files(keys, vec![vessel])?);
    config.check(&Keys::ROOT)?;
    let order = format!("alight/{own}/{}", topics::OPERATOR.name);
    let publications = vec![Publication::new(order, Urgency::Order).of(&topics::OPERATOR)];
    // Deck messages arrive even if the vessel receives no drone.
    let received = [&topics::DRONES, &topics::RECEIPTS, &topics::DECK];
    let received = received.map(|topic| key("vessel", args.vessel_id, topic.name));
    let mut radio = Radio::open(&config, publications, Vec::from(received))?;
    let drone = args.drone.unwrap_or_default();
    let header = Header::new(args.vessel_id, drone, draw_boot(), 1, Time::EPOCH);
    let mut ashore = Ashore::new(header, args.kind()?, args.drone);
    for poll in 0..MAX_POLLS_ASHORE {
        if end_requested() || ashore.is_answered() {
            break;
        }
        ashore.choose()?;
        // Repetitions of a command count once.
        if let Some(Ok(bytes)) = ashore.due(poll).map(|order| wire::encode(&order)) {
            radio.send(0, bytes);
        }
        let mut next = radio.receive(POLL_PERIOD);
        while let Some(packet) = next {
            ashore.contact = true;
            match packet.subscription {
                0 => wire::decode(&packet.bytes)
                    .into_iter()
                    .for_each(|s| ashore.receive_status(s)),
                1 => wire::decode(&packet.bytes)
                    .into_iter()
                    .for_each(|r| ashore.receive_receipt(&r)),
                _ => wire::decode(&packet.bytes)
                    .into_iter()
                    .for_each(|g| ashore.receive_grant(&g)),
            }
            next = radio.receive(Duration::ZERO);
        }
    }
    report_ashore(args, (endpoint, own.as_str()), &ashore)
}

fn report_ashore(
    args: &CommandArgs,
    (endpoint, own): (&str, &str),
    ashore: &Ashore,
) -> Result<Exit, CliError> {
    if ashore.drone().is_none() && ashore.receipt.is_none() {
        let who = ashore.number.map_or_else(
            || "any drone, and none was named (--drone)".to_owned(),
            |n| format!("drone {n}"),
        );
        let reason = format!(
            "{endpoint} relays no status of {who}: does the vessel run, does it list {own} in radio.tls.peers, \
             and does it receive the drone (systemctl status alight-vessel)?"
        );
        let outcome = ashore.outcome();
        return Err(CliError(if outcome.is_empty() {
            reason
        } else {
            format!("{outcome}\n{reason}")
        }));
    }
    let taken = ashore.is_taken();
    let number = ashore.number.unwrap_or_default();
    if args.json {
        let (receipt, drone) = (ashore.receipt, ashore.drone());
        terminal::line(json!({ "taken": taken, "number": number, "receipt": receipt, "drone": drone }));
        return Ok(Exit::of(taken));
    }
    for line in ashore.lines(number) {
        terminal::line(line);
    }
    Ok(Exit::of(taken))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Reason, ReasonCode, State};

    fn ordered(kind: CommandKind) -> Ashore {
        Ashore::new(Header::new(1, 3, 5, 1, Time::EPOCH), Some(kind), Some(3))
    }
    fn receipt(operator: [u32; 2], drone: u32, progress: CommandProgress) -> CommandReceipt {
        CommandReceipt {
            header: Header::new(1, drone, 9, 1, Time::EPOCH),
            operator,
            kind: CommandKind::Abort,
            progress,
        }
    }

    #[test]
    fn command_with_a_coincident_status() {
        let mut terminal = ordered(CommandKind::Abort);
        // A second abort after an earlier one leaves the drone's state unchanged.
        let given_up = DroneStatus {
            header: Header::new(1, 3, 7, 1, Time::EPOCH),
            state: State::GaveUp,
            waiting: Reason::plain(ReasonCode::NotCommanded),
            ..DroneStatus::default()
        };
        terminal.receive_status(given_up);
        assert!(!terminal.is_answered() && !terminal.is_taken());
        // Receipts of other orders are not replies.
        for (operator, drone) in [([6, 1], 3), ([5, 2], 3), ([5, 1], 4)] {
            terminal.receive_receipt(&receipt(operator, drone, CommandProgress::Taken));
        }
        assert_eq!(terminal.receipt, None);
        terminal.receive_receipt(&receipt([5, 1], 3, CommandProgress::Pending));
        assert!(!terminal.is_answered());
        terminal.receive_receipt(&receipt([5, 1], 3, CommandProgress::Taken));
        assert!(terminal.is_answered() && terminal.is_taken());
    }

    #[test]
    fn command_before_the_session_is_open() {
        let mut terminal = ordered(CommandKind::Land);
        let early = (0..MAX_POLLS_CONTACT).filter_map(|k| terminal.due(k)).count();
        assert_eq!((early, terminal.sent), (0, 0));
        assert_eq!(terminal.outcome(), "the command was NOT SENT");
        // An order is sent even if the vessel is not received.
        assert!((MAX_POLLS_CONTACT..MAX_POLLS_ASHORE).any(|k| terminal.due(k).is_some()));
        let mut terminal = ordered(CommandKind::Land);
        terminal.contact = true;
        let sent = (0..MAX_POLLS_CONTACT).filter_map(|k| terminal.due(k)).count();
        assert_eq!(sent, 6, "each half second for three");
    }

    /// Terminal without a named drone, after `looks` polls of a vessel that receives these drones.
    fn unnamed(drones: &[u32], looks: u32) -> (Ashore, Result<(), CliError>) {
        let mut terminal = ordered(CommandKind::Land);
        terminal.contact = true;
        terminal.name(None);
        for &drone in drones {
            terminal.receive_status(DroneStatus {
                header: Header::new(1, drone, 7, 1, Time::EPOCH),
                state: State::Tracking,
                ..DroneStatus::default()
            });
        }
        let chosen = (0..looks).try_for_each(|_| terminal.choose());
        (terminal, chosen)
    }

    #[test]
    fn command_without_a_named_drone() {
        let (mut one, chosen) = unnamed(&[2], POLLS_ALL_REPORT - 1);
        assert!(
            chosen.is_ok() && one.due(0).is_none(),
            "another may be about to report"
        );
        one.choose().unwrap();
        assert!(one.due(0).is_some_and(|order| order.header.drone == 2));
        assert!(one.lines(2).iter().any(|l| l.starts_with("drone 2: Tracking")));
        assert!(one.lines(2).last().unwrap().starts_with("drone 2: "));
        // Several drones: none is commanded, and the reply lists them.
        let (mut several, chosen) = unnamed(&[2, 3], POLLS_ALL_REPORT);
        let why = chosen.unwrap_err().0;
        assert!(
            why.contains("--drone 2   Tracking") && why.contains("--drone 3"),
            "{why}"
        );
        assert!((0..MAX_POLLS_ASHORE).all(|k| several.due(k).is_none()));
        let (mut none, chosen) = unnamed(&[], MAX_POLLS_ASHORE);
        assert!(chosen.is_ok() && (0..MAX_POLLS_ASHORE).all(|k| none.due(k).is_none()));
    }

    #[test]
    fn command_to_a_silent_drone_that_has_the_deck() {
        let grant = |owner, first| {
            let mut grant = DeckGrant {
                header: Header::new(1, 0, 9, 1, Time::EPOCH),
                owner,
                ..DeckGrant::default()
            };
            grant.places[0] = first;
            grant
        };
        let after = |drones: &[u32], grant: DeckGrant<VesselClock>| {
            let (mut terminal, _) = unnamed(drones, 0);
            terminal.receive_grant(&grant);
            let chosen = (0..POLLS_ALL_REPORT).try_for_each(|_| terminal.choose());
            chosen.map(|()| terminal.number)
        };
        assert_eq!(after(&[], grant(2, 0)).unwrap(), Some(2));
        assert_eq!(after(&[2], grant(2, 2)).unwrap(), Some(2));
        assert_eq!(after(&[], grant(DECK_CLOSED, 0)).unwrap(), None);
        let why = after(&[3], grant(2, 3)).unwrap_err().0;
        assert!(
            why.contains("--drone 2   silent") && why.contains("--drone 3   Tracking"),
            "{why}"
        );
    }

    #[test]
    fn reason_of_a_rejected_order() {
        let rejected = || {
            let mut terminal = ordered(CommandKind::Ready);
            terminal.contact = true;
            terminal.receive_receipt(&receipt([5, 1], 3, CommandProgress::GivenUp));
            terminal
        };
        let mut terminal = rejected();
        let status = |why: Option<ReasonCode>| DroneStatus {
            header: Header::new(1, 3, 7, 1, Time::EPOCH),
            rejected: why.map(Reason::plain),
            ..DroneStatus::default()
        };
        terminal.receive_status(status(None));
        assert!(!terminal.is_answered());
        terminal.receive_status(status(Some(ReasonCode::NotOnDeck)));
        assert!(terminal.is_answered() && !terminal.is_taken());
        let mut silent = rejected();
        assert!((0..POLLS_REASON).all(|_| silent.choose().is_ok()) && silent.is_answered());
    }

    #[test]
    fn command_abort_without_answer() {
        let mut terminal = ordered(CommandKind::Abort);
        terminal.sent = 1;
        assert!(terminal.outcome().starts_with("RECEIPT UNCONFIRMED"));
        assert!(terminal.outcome().contains("stays pending; if not"));
        terminal.receipt = Some(CommandProgress::Pending);
        assert!(terminal.outcome().contains("STAYS PENDING"));
        terminal.order.message.kind = CommandKind::Land;
        assert!(terminal.outcome().contains("the vessel gives up"));
    }

    #[test]
    fn command_outcome_width() {
        let progress = [
            None,
            Some(CommandProgress::Pending),
            Some(CommandProgress::Taken),
            Some(CommandProgress::GivenUp),
            Some(CommandProgress::Forbidden),
            Some(CommandProgress::Replaced),
            Some(CommandProgress::Unknown),
        ];
        for kind in [CommandKind::Abort, CommandKind::Land, CommandKind::Hold] {
            for receipt in progress {
                let terminal = Ashore {
                    receipt,
                    sent: 1,
                    ..ordered(kind)
                };
                let text = terminal.outcome();
                assert!(
                    !text.is_empty() && text.lines().all(|l| l.chars().count() <= 80),
                    "{text}"
                );
            }
        }
    }
}
