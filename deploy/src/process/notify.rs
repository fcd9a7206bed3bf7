//! What a service tells its manager (systemd): that it is ready, that it is alive, what it does; nothing
//! where no manager asked for it (sd_notify(3)).

use sd_notify::NotifyState;

/// Time between two signs of life, ns: several within any watchdog's timeout.
const ALIVE_PERIOD_NS: i64 = 500_000_000;
/// Longest line of status, characters.
const MAX_STATUS: usize = 200;

/// The way to the service's manager.
#[derive(Default)]
pub struct Notify {
    ready: bool,
    next_ns: i64,
}

impl Notify {
    fn send(states: &[NotifyState<'_>]) {
        // A manager that does not listen has nothing to miss.
        let _unheard = sd_notify::notify(states);
    }
    /// Everything is there; said once.
    pub fn ready(&mut self) {
        if !std::mem::replace(&mut self.ready, true) {
            Notify::send(&[NotifyState::Ready]);
        }
    }
    /// Whether a sign of life is due; the next is after its period.
    fn is_due(&mut self, now_ns: i64) -> bool {
        let due = now_ns >= self.next_ns;
        if due {
            self.next_ns = now_ns + ALIVE_PERIOD_NS;
        }
        due
    }
    /// The loop goes round; what it does, in one line.
    pub fn alive(&mut self, now_ns: i64, status: impl FnOnce() -> String) {
        if std::env::var_os("NOTIFY_SOCKET").is_none() || !self.is_due(now_ns) {
            return;
        }
        let plain = |c: char| if c.is_control() { ' ' } else { c };
        let line: String = status().chars().map(plain).take(MAX_STATUS).collect();
        Notify::send(&[NotifyState::Watchdog, NotifyState::Status(&line)]);
    }
    /// It ends because it was told to.
    pub fn stopping(&self) {
        Notify::send(&[NotifyState::Stopping]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn service_reports_life_no_more_often_than_its_period() {
        let mut notify = Notify::default();
        let due = (0..10).filter(|k| notify.is_due(k * ALIVE_PERIOD_NS / 5));
        assert_eq!(due.collect::<Vec<_>>(), [0, 5]);
    }
}
