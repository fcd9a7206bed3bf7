//! Missed deadlines: steps later than the readers of their output can tolerate.

use alight_shared::{
    metrics::{Metric, MetricName},
    process::{ProcessKind, ProcessState},
};

use super::snapshot::time;

/// Window, ns; late steps are reported for one to two windows.
const WINDOW_NS: i64 = 60_000_000_000;

#[derive(Clone, Copy, Debug)]
pub struct Lateness {
    limit_s: f64,
    last_ns: Option<i64>,
    turned_ns: i64,
    /// Maximum excess of a period between steps over the limit, s, and number of such steps, in this window and the
    /// previous one.
    windows: [(f64, u64); 2],
}

impl Lateness {
    pub fn of(kind: ProcessKind, now_ns: i64) -> Lateness {
        Lateness {
            limit_s: kind.awaited().map_or(f64::INFINITY, |t| t.stale_after.secs()),
            last_ns: None,
            turned_ns: now_ns,
            windows: [(0.0, 0); 2],
        }
    }
    pub fn step(&mut self, now_ns: i64) {
        if now_ns - self.turned_ns >= WINDOW_NS {
            self.turned_ns = now_ns;
            self.windows = [(0.0, 0), self.windows[0]];
        }
        let since_s = self.last_ns.map_or(0.0, |last| (now_ns - last) as f64 * 1e-9);
        if since_s > self.limit_s {
            let (longest, count) = &mut self.windows[0];
            (*longest, *count) = (longest.max(since_s), *count + 1);
        }
        self.last_ns = Some(now_ns);
    }
    /// Metrics of late steps; empty if there was none.
    pub fn metrics(&self) -> Vec<Metric> {
        let [(a, m), (b, n)] = self.windows;
        if m + n == 0 {
            return Vec::new();
        }
        vec![
            MetricName::LongestStep.seconds(a.max(b)),
            MetricName::LateSteps.count(m + n),
        ]
    }
}

/// Lateness at which a simulation in real time is stopped, s: every link of the system has timed out by then; an
/// autopilot waits 0.5 to 1 s for set-points.
pub const REAL_TIME_LIMIT_S: f64 = 1.0;

pub const REMEDY: &str = "end other work on this computer, or take a faster one";

/// Message about processes with late steps, the one with the largest overrun relative to its deadline first.
pub fn finding<'a>(processes: impl IntoIterator<Item = &'a ProcessState>) -> Option<String> {
    let late = |p: &&ProcessState| p.count(MetricName::LateSteps) > 0;
    let permitted = |p: &'a ProcessState| Some((p, p.kind.awaited()?.stale_after.secs()));
    let mut all: Vec<_> = processes.into_iter().filter(late).filter_map(permitted).collect();
    let fraction = |(p, limit_s): &(&ProcessState, f64)| p.seconds(MetricName::LongestStep) / limit_s;
    let worst = (0..all.len()).max_by(|a, b| fraction(&all[*a]).total_cmp(&fraction(&all[*b])))?;
    let (p, limit_s) = all.remove(worst);
    let others: Vec<&str> = all.iter().map(|(p, _)| p.kind.name()).collect();
    let cause = if others.is_empty() {
        String::new()
    } else {
        format!("; so did {}", others.join(", "))
    };
    Some(format!(
        "{} missed its deadline (steps late in the last two minutes: {}): up to {} between two steps, {} is permitted{cause}",
        p.kind.name(),
        p.count(MetricName::LateSteps),
        time(p.seconds(MetricName::LongestStep)),
        time(limit_s)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_steps_for_two_minutes() {
        let ns = |s: f64| (s * 1e9) as i64;
        let mut l = Lateness::of(ProcessKind::Pilot, 0);
        for k in 0..100 {
            l.step(ns(0.01 * f64::from(k)));
        }
        assert!(l.metrics().is_empty());
        l.step(ns(1.4));
        let state = |l: &Lateness| ProcessState {
            kind: ProcessKind::Pilot,
            metrics: alight_shared::msg::Seq::filled(l.metrics()),
            ..ProcessState::default()
        };
        let pilot = state(&l);
        let mut mission = state(&l);
        let text = finding([&pilot]).unwrap();
        assert!(
            text.contains("pilot missed its deadline") && text.contains("two minutes: 1)"),
            "{text}"
        );
        // The mission has the same delay of 0.41 s, but a longer deadline.
        mission.kind = ProcessKind::Mission;
        let both = finding([&mission, &pilot]).unwrap();
        assert_eq!(both, format!("{text}; so did mission"));
        for k in 0..14_000 {
            l.step(ns(1.4 + 0.01 * f64::from(k)));
        }
        assert_eq!(finding([&state(&l)]), None);
    }
}
