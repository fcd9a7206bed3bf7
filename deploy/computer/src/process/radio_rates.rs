//! Radio rates of a process, by topic, over the last seconds.

use std::collections::VecDeque;

use alight_shared::{
    msg::Seq,
    process::{MAX_FLOWS, RadioFlow},
    topics::{self, Topic},
};
use alight_transport::radio::{Flow, Radio};

/// Number of counter samples: five seconds at 2 Hz.
const WINDOW: usize = 10;

pub struct RadioRates {
    topics: Vec<u32>,
    samples: VecDeque<(i64, Vec<Flow>)>,
}

impl RadioRates {
    /// Rates of these topics, without the process's own report.
    pub fn of(publications: &[&Topic]) -> RadioRates {
        let index = |topic: &Topic| topics::ALL.iter().position(|t| t.name == topic.name);
        let number = |i: Option<usize>| i.and_then(|i| u32::try_from(i).ok()).unwrap_or(u32::MAX);
        RadioRates {
            topics: publications.iter().map(|topic| number(index(topic))).collect(),
            samples: VecDeque::new(),
        }
    }
    pub fn since(&mut self, radio: &Radio, now_ns: i64) -> Seq<RadioFlow, MAX_FLOWS> {
        self.update(radio.flows().to_vec(), now_ns)
    }
    fn update(&mut self, flows: Vec<Flow>, now_ns: i64) -> Seq<RadioFlow, MAX_FLOWS> {
        if self.samples.len() == WINDOW {
            self.samples.pop_front();
        }
        self.samples.push_back((now_ns, flows.clone()));
        let Some((then_ns, before)) = self.samples.front() else {
            return Seq::new();
        };
        let span_s = now_ns.saturating_sub(*then_ns).max(1) as f64 * 1e-9;
        let rate = |now: u64, then: u64| (now.saturating_sub(then) as f64 / span_s) as f32;
        Seq::filled(
            self.topics
                .iter()
                .zip(flows.iter().zip(before))
                .map(|(topic, (now, then))| RadioFlow {
                    topic: *topic,
                    rate_hz: rate(now.messages, then.messages),
                    bytes_per_s: rate(now.bytes, then.bytes),
                }),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radio_rates_over_five_seconds() {
        let mut flows = RadioRates::of(&[&topics::ESTIMATE, &topics::VESSEL_PROCESS]);
        let mut last = Seq::new();
        for k in 0..40_u64 {
            let count = |n| Flow {
                messages: n,
                bytes: 100 * n,
            };
            // 30 messages per second for ten seconds, then 10.
            let sent = if k < 20 { 15 * k } else { 300 + 5 * (k - 20) };
            last = flows.update(vec![count(sent), count(0)], k as i64 * 500_000_000);
        }
        assert_eq!((last[0].topic as usize, last[1].topic), (0, u32::MAX));
        assert!((last[0].rate_hz - 10.0).abs() < 1e-3 && (last[0].bytes_per_s - 1000.0).abs() < 0.1);
        assert_eq!(last[1].rate_hz, 0.0);
    }
}
