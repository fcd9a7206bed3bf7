//! Retransmission of an order until its receiver acknowledges it.

use crate::{
    msg::{Command, MissionState},
    time::{Clock, Time},
    topics::Retries,
};

/// Order in transmission, timed by the sender's clock `S`. Its repetitions are recognised by their original time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retransmission<S: Clock, M> {
    /// The order.
    pub message: M,
    retries: Retries,
    due: Time<S>,
    end: Time<S>,
}

impl<S: Clock, M: Copy> Retransmission<S, M> {
    /// Order given at `now`: sent at once and then at each period of `retries` until its timeout.
    pub fn new(message: M, now: Time<S>, retries: Retries) -> Self {
        Retransmission {
            message,
            retries,
            due: now,
            end: now + retries.timeout,
        }
    }
    /// The order, when it is due for transmission.
    pub fn due(&mut self, now: Time<S>) -> Option<M> {
        let due = now >= self.due && !self.is_over(now);
        if due {
            self.due = now + self.retries.period;
        }
        due.then_some(self.message)
    }
    /// Whether retransmission has timed out.
    pub fn is_over(&self, now: Time<S>) -> bool {
        now > self.end
    }
}

impl<S: Clock> Retransmission<S, Command> {
    /// Whether the mission has accepted or rejected the command, by its state; None: not acknowledged yet.
    pub fn answered(&self, mission: &MissionState) -> Option<bool> {
        let Command { header, kind } = &self.message;
        mission
            .echo()
            .answers(*kind, |echo| echo == [header.boot, header.sequence])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::{DroneTime, Span};

    #[test]
    fn repetitions_until_the_timeout() {
        let at = |ms: i64| DroneTime::from_nanos(ms * 1_000_000);
        let [period, timeout] = [500, 1900].map(Span::from_millis);
        let mut r = Retransmission::new(7, at(1000), Retries { period, timeout });
        let sent: Vec<i64> = (1000..5000)
            .step_by(50)
            .filter(|ms| r.due(at(*ms)) == Some(7))
            .collect();
        assert_eq!(sent, [1000, 1500, 2000, 2500]);
        assert!(!r.is_over(at(2900)) && r.is_over(at(2901)));
    }
}
