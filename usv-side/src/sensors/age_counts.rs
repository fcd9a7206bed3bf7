//! Ages of measurements at arrival, for reports: the estimator rejects old ones without stating a reason.

use alight_shared::time::{Time, VesselClock};

use super::Remark;

/// Window in which the earliest measurement tells the delay of a line, s; smallest delay, s, and growth, s/s, that are
/// reported.
const WINDOW_S: f64 = 5.0;
const DELAYED_S: f64 = 0.1;
const GROWING: f64 = 1e-3;

/// Number of late measurements among the newest 32 above which the cause is not a single delay.
const OFTEN: u32 = 8;

/// Ages of one kind of measurement of a source.
#[derive(Clone, Copy, Debug)]
pub(super) struct AgeCounts {
    kind: &'static str,
    /// Maximum age that an estimator with default settings accepts, s.
    max_s: f64,
    count: u64,
    late: u64,
    /// Age of the newest late measurement, s.
    age_s: f64,
    /// Bit mask of the newest measurements; set if late.
    lately: u32,
}

impl AgeCounts {
    pub(super) fn new(kind: &'static str, max_s: f64) -> Self {
        AgeCounts {
            kind,
            max_s,
            count: 0,
            late: 0,
            age_s: 0.0,
            lately: 0,
        }
    }
    pub(super) fn take(&mut self, age_s: f64) {
        let is_late = age_s > self.max_s;
        self.count += 1;
        self.late += u64::from(is_late);
        self.lately = (self.lately << 1) | u32::from(is_late);
        if is_late {
            self.age_s = age_s;
        }
    }
    /// Remark on late measurements; None if there are none.
    pub(super) fn remark(&self) -> Option<Remark> {
        if self.late == 0 {
            return None;
        }
        let text = format!(
            "{}: {} of {} arrived more than {} s after their time, the newest of them {:.1} s: too old (vessel.{}.max_age_s)",
            self.kind, self.late, self.count, self.max_s, self.age_s, self.kind
        );
        Some(if self.lately.count_ones() >= OFTEN {
            Remark::fault(
                text,
                "let the source send everything of one time at once: fewer sentences, a faster line",
            )
        } else {
            Remark::fine(text)
        })
    }
}

/// Delay of a source's line beyond its usual one: the smallest age of a window.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LineDelay {
    /// Start of the window, and smallest age since then, s.
    window: Option<(Time<VesselClock>, f64)>,
    /// Delay in the newest complete window, s, and its growth, s/s.
    delay_s: f64,
    growth: f64,
}

impl LineDelay {
    /// Adds the age of a measurement beyond the latency, s.
    pub(super) fn take(&mut self, now: Time<VesselClock>, age_s: f64) {
        let (begun, smallest_s) = self.window.unwrap_or((now, age_s));
        let smallest_s = smallest_s.min(age_s);
        let for_s = (now - begun).secs();
        self.window = Some((begun, smallest_s));
        if for_s >= WINDOW_S {
            self.growth = (smallest_s - self.delay_s) / for_s;
            self.delay_s = smallest_s;
            self.window = None;
        }
    }
    /// Delay, s; zero if it is small.
    pub(super) fn delay_s(&self) -> f64 {
        if self.delay_s >= DELAYED_S {
            self.delay_s
        } else {
            0.0
        }
    }
    pub(super) fn remark(&self) -> Option<Remark> {
        let delay_s = self.delay_s();
        if delay_s == 0.0 {
            return None;
        }
        let cause = if self.growth > GROWING {
            let growth_ms = 1e3 * self.growth;
            format!("its line is full: {growth_ms:.0} ms later each second; {delay_s:.1} s old")
        } else {
            format!("its line delays all measurements: {delay_s:.1} s old")
        };
        Some(Remark::fault(
            cause,
            "send fewer sentences or raise the baud rate; on a network, look for what congests it",
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn age_of_every_second_measurement() {
        let mut d = AgeCounts::new("gnss", 0.6);
        (0..32).for_each(|_| d.take(0.2));
        assert_eq!(d.remark(), None);
        d.take(0.7);
        assert!(d.remark().is_some_and(|r| r.remedy.is_none()), "once");
        (0..32).for_each(|k| d.take(if k % 2 == 0 { 0.1 } else { 1.0 }));
        let remark = d.remark().unwrap();
        assert!(remark.remedy.is_some());
        assert!(
            remark.text.starts_with(
                "gnss: 17 of 65 arrived more than 0.6 s after their time, the newest of them 1.0 s"
            ),
            "{remark:?}"
        );
        (0..32).for_each(|_| d.take(0.2));
        assert!(d.remark().is_some_and(|r| r.remedy.is_none()), "it is over");
    }
}
