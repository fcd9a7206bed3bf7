//! Tables of the processes' reports: resource use, ages of inputs, radio.

use alight_shared::{
    process::{InputState, ProcessKind},
    topics::{self, Topic},
};

use crate::{
    cells,
    process::snapshot::{Snapshot, time},
    table::{Cell, Table},
};

impl Snapshot {
    pub fn usage(&self, now_ns: i64) -> String {
        let heads = [
            "process", "pid", "CPU %", "MB", "steps", "step p50", "step p99", "up",
        ];
        let mut table = Table::new(1.., heads);
        for (kind, p) in &self.processes {
            let up_s = (p.at_ns - p.began_ns) as f64 * 1e-9;
            let old_s = (now_ns - p.at_ns) as f64 * 1e-9;
            let by_radio = *kind == ProcessKind::Vessel && self.processes.contains_key(&ProcessKind::Bridge);
            let silent = old_s > topics::process_reports(by_radio).stale_after.secs();
            table.row(cells![
                kind.name(),
                p.pid,
                Cell::number(100.0 * p.cpu_s / up_s, 1),
                Cell::number(p.resident_bytes as f64 / 1e6, 1),
                p.steps,
                time(p.step_p50_s),
                time(p.step_p99_s),
                Cell::from(time(up_s)).note(if silent { "silent" } else { "" }),
            ]);
        }
        table.text()
    }

    /// Delay from a measurement on the vessel to the set-point, by stage: age of each message when read, duration of
    /// each step.
    pub fn stages(&self) -> String {
        const STAGES: [(ProcessKind, &Topic); 6] = [
            (ProcessKind::Predictor, &topics::BRIDGE_ESTIMATE),
            (ProcessKind::Predictor, &topics::DRONE_STATE),
            (ProcessKind::Mission, &topics::FORECAST),
            (ProcessKind::Planner, &topics::FORECAST),
            (ProcessKind::Pilot, &topics::PLAN),
            (ProcessKind::World, &topics::SET_POINT),
        ];
        let mut table = Table::new(1.., ["age when read", "p50", "p99"]);
        for (reader, topic) in STAGES {
            let inputs = self.processes.get(&reader).map(|p| p.inputs);
            let is_it = |i: &&InputState| topic_name(i.topic) == Some(topic.name);
            if let Some(i) = inputs.as_ref().and_then(|inputs| inputs.iter().find(is_it)) {
                let name = format!("{} at the {}", topic.name, reader.name());
                table.row(cells![name, time(i.read_age_p50_s), time(i.read_age_p99_s)]);
            }
        }
        if let Some(p) = self.processes.get(&ProcessKind::Planner) {
            let name = "(a step of the planner takes)";
            table.row(cells![name, time(p.step_p50_s), time(p.step_p99_s)]);
        }
        table.text()
    }

    pub fn radio(&self) -> String {
        let mut table = Table::new(2.., ["sender", "over the radio", "Hz", "bytes/s"]);
        let mut total = 0.0;
        for p in self.processes.values() {
            for f in p.flows.iter() {
                total += f64::from(f.bytes_per_s);
                let rates = [(f.rate_hz, 1), (f.bytes_per_s, 0)];
                let [hz, bytes] = rates.map(|(rate, digits)| Cell::number(f64::from(rate), digits));
                table.row(cells![
                    p.kind.name(),
                    topic_name(f.topic).unwrap_or(topics::VESSEL_PROCESS.name),
                    hz,
                    bytes
                ]);
            }
        }
        let note = "computed: 48 bytes of headers a message";
        table.row(cells!["all", "", "", Cell::number(total, 0).note(note)]);
        table.text()
    }

    pub fn topics(&self) -> String {
        let heads = [
            "reader",
            "topic",
            "messages",
            "Hz",
            "missed",
            "age",
            "read at p50",
            "p99",
        ];
        let mut table = Table::new(2.., heads);
        for p in self.processes.values() {
            let up_s = ((p.at_ns - p.began_ns) as f64 * 1e-9).max(1e-3);
            for i in p.inputs.iter() {
                table.row(cells![
                    p.kind.name(),
                    topic_name(i.topic).unwrap_or("?"),
                    i.received,
                    Cell::number(i.received as f64 / up_s, 1),
                    i.missed,
                    time(i.age_s),
                    time(i.read_age_p50_s),
                    time(i.read_age_p99_s),
                ]);
            }
        }
        table.text()
    }
}

fn topic_name(number: u32) -> Option<&'static str> {
    topics::ALL.get(number as usize).map(|t| t.name)
}
