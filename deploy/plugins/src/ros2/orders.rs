//! Orders of ROS services for this computer's mission, sent like those of `alight order` and answered by the
//! mission's state.

use alight_computer::{
    config::DroneComputerConfig,
    process::local_command::{answer, give},
};
use alight_shared::{
    admission::Retransmission,
    msg::{Command, CommandKind, MissionState},
    time::{Span, SteadyClock, Time},
    topics,
};

pub trait Caller {
    fn reply(self, taken: bool, message: &str);
}

/// Maximum lead of a request's stamp over this computer's clock.
const AHEAD: Span = Span::from_millis(1000);

/// Reason to reject a request sent at `sent_ns` by its client's clock: at `now_ns` it is too old, because its client
/// may have ended while the network delayed the request. An abort is accepted at any age.
pub fn is_late(kind: CommandKind, sent_ns: i64, now_ns: i64) -> Option<String> {
    let age = Span::from_nanos(now_ns.saturating_sub(sent_ns));
    let limit = topics::COMMAND.stale_after;
    if kind == CommandKind::Abort || (-AHEAD..=limit).contains(&age) {
        return None;
    }
    let age_s = age.secs();
    let limit_s = limit.secs();
    Some(format!(
        "not ordered: {age_s:.1} s old by its own stamp (limit {limit_s:.0} s): order again; set the clocks of both \
         computers if this persists"
    ))
}

const MAX_CALLERS: usize = 8;

struct UnderWay<C> {
    command: Retransmission<SteadyClock, Command>,
    callers: Vec<C>,
}

impl<C> UnderWay<C> {
    fn kind(&self) -> CommandKind {
        self.command.message.kind
    }
}

pub struct Orders<C> {
    under_way: Option<UnderWay<C>>,
}

impl<C> Default for Orders<C> {
    fn default() -> Self {
        Orders { under_way: None }
    }
}

const fn name(kind: CommandKind) -> &'static str {
    match kind {
        CommandKind::Land => "landing",
        CommandKind::Abort => "abort",
        CommandKind::Hold => "hold",
        CommandKind::TakeOff => "take-off",
        CommandKind::Ready => "ready",
        CommandKind::Station(_) => "station",
    }
}

impl<C: Caller> Orders<C> {
    /// Handles an order at `now_ns` of the steady clock. A repeated order waits for the reply to the order in
    /// progress. An abort replaces any other order, and nothing replaces an abort.
    pub fn take(&mut self, kind: CommandKind, caller: C, computer: &DroneComputerConfig, now_ns: i64) {
        match &mut self.under_way {
            Some(same) if same.kind() == kind && same.callers.len() < MAX_CALLERS => {
                same.callers.push(caller);
            }
            Some(other) if other.kind() == kind || kind != CommandKind::Abort => {
                caller.reply(
                    false,
                    &format!("not ordered: an order ({}) is under way", name(other.kind())),
                );
            }
            Some(_) | None => {
                self.answer(false, "an abort replaced this order");
                self.under_way = Some(UnderWay {
                    command: give(computer, kind, Time::from_nanos(now_ns)),
                    callers: vec![caller],
                });
            }
        }
    }
    /// Answers the clients when the mission's newest state shows that it accepted the order, or after the time limit.
    /// Returns the command to send to the mission.
    pub fn poll(&mut self, drone: u32, mission: Option<&MissionState>, now_ns: i64) -> Option<Command> {
        let under_way = self.under_way.as_mut()?;
        let now = Time::from_nanos(now_ns);
        let taken = mission.and_then(|m| under_way.command.answered(m));
        if taken.is_none() && !under_way.command.is_over(now) {
            return under_way.command.due(now);
        }
        let taken = taken == Some(true);
        let text = mission.map_or_else(
            || format!("no mission answers on the computer of drone {drone}"),
            |m| answer(drone, m, taken).join("; "),
        );
        self.answer(taken, &text);
        None
    }
    pub fn answer(&mut self, taken: bool, text: &str) {
        let callers = self.under_way.take().map(|u| u.callers);
        for c in callers.into_iter().flatten() {
            c.reply(taken, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Header, State};
    use std::{cell::RefCell, rc::Rc};

    type Answers = Rc<RefCell<Vec<(&'static str, bool, String)>>>;
    struct Known(&'static str, Answers);
    impl Caller for Known {
        fn reply(self, taken: bool, message: &str) {
            self.1.borrow_mut().push((self.0, taken, message.into()));
        }
    }

    const NOW: i64 = 10_000_000_000;

    fn shows(ns: i64, state: State) -> MissionState {
        MissionState {
            header: Header::new(1, 1, 7, 1, Time::from_nanos(ns)),
            state,
            ..MissionState::default()
        }
    }
    fn given(all: &[(CommandKind, &'static str)]) -> (Orders<Known>, Answers) {
        let mut orders = Orders::default();
        let answers = Answers::default();
        for (kind, who) in all {
            orders.take(
                *kind,
                Known(who, Rc::clone(&answers)),
                &DroneComputerConfig::default(),
                NOW,
            );
        }
        (orders, answers)
    }

    #[test]
    fn ros_abort_by_what_the_mission_shows() {
        let (mut orders, answers) = given(&[(CommandKind::Abort, "a"), (CommandKind::Abort, "b")]);
        // The mission had aborted by itself, which does not answer the order.
        let before = shows(NOW + 1, State::GaveUp);
        let sent = orders.poll(1, Some(&before), NOW).unwrap();
        assert_eq!(sent.kind, CommandKind::Abort);
        assert_eq!(orders.poll(1, Some(&before), NOW + 1_000_000), None);
        assert!(answers.borrow().is_empty());
        let after = MissionState {
            abort: Some([sent.header.boot, sent.header.sequence]),
            ..shows(NOW + 2_000_000, State::GaveUp)
        };
        assert_eq!(orders.poll(1, Some(&after), NOW + 2_000_000), None);
        let answers = answers.borrow();
        assert_eq!(answers.len(), 2);
        assert!(
            answers
                .iter()
                .all(|(_, taken, text)| *taken && text.starts_with("drone 1: Gave up")),
            "{answers:?}"
        );
    }

    #[test]
    fn ros_order_that_is_not_taken() {
        let (mut orders, answers) = given(&[(CommandKind::Land, "a")]);
        let late = NOW + 3_000_000_000;
        let idle = shows(late, State::GaveUp);
        assert_eq!(orders.poll(1, Some(&idle), late), None);
        let (mut silent, none) = given(&[(CommandKind::Land, "a")]);
        assert_eq!(silent.poll(1, None, late), None);
        let text = |answers: &Answers| answers.borrow()[0].clone();
        assert!(text(&answers).2.contains("did not accept the command"));
        assert!(!text(&answers).1 && !text(&none).1);
        assert!(text(&none).2.starts_with("no mission answers"));
    }

    #[test]
    fn ros_abort_before_other_orders() {
        let (mut orders, answers) = given(&[
            (CommandKind::Land, "land"),
            (CommandKind::Abort, "abort"),
            (CommandKind::Land, "late"),
        ]);
        let sent = orders.poll(1, None, NOW);
        assert_eq!(sent.map(|c| c.kind), Some(CommandKind::Abort));
        let rejected: Vec<_> = answers
            .borrow()
            .iter()
            .map(|(who, taken, _)| (*who, *taken))
            .collect();
        assert_eq!(rejected, [("land", false), ("late", false)]);
    }

    #[test]
    fn ros_request_held_back_by_the_network() {
        let late = |kind, age_s: f64| is_late(kind, NOW - (age_s * 1e9) as i64, NOW);
        assert_eq!(
            [late(CommandKind::Land, 4.9), late(CommandKind::Land, -0.9)],
            [None, None]
        );
        let text = late(CommandKind::Land, 7.2).unwrap();
        assert!(text.starts_with("not ordered: 7.2 s old"), "{text}");
        assert!(late(CommandKind::Land, -1.1).is_some());
        // The earliest possible stamp does not overflow.
        assert!(is_late(CommandKind::Land, i64::MIN, NOW).is_some());
        assert_eq!(late(CommandKind::Abort, 600.0), None);
    }

    #[test]
    fn ros_callers_at_most() {
        let (_, answers) = given(&[(CommandKind::Abort, "a"); MAX_CALLERS + 1]);
        assert_eq!(answers.borrow().len(), 1);
        assert!(answers.borrow()[0].2.contains("abort"));
    }
}
