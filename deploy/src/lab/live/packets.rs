//! What really goes over the emulated link: IP packets and their headers, by flow, and what of it is
//! each topic's.

use std::collections::{BTreeMap, VecDeque};

use alight_shared::topics;
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::radio::HEADER_BYTES;
use serde::{Deserialize, Serialize};

use crate::cells;
use crate::process::snapshot::Snapshot;
use crate::table::{Cell, Table};

/// Flows that are counted apart; packets of more flows are not counted.
const MAX_FLOWS: usize = 16;
/// Reports of the emulator over which rates are taken, one a second.
const KEPT: usize = 11;

/// Packets of one flow one way, as the TUN devices see them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FlowCount {
    /// 0: from the vessel to the drone; 1: back.
    pub way: u8,
    /// Number of the protocol: 6 TCP, 17 UDP.
    pub protocol: u8,
    /// The lower of its two ports, the one that is listened on.
    pub port: u16,
    /// IP packets.
    pub packets: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Of these the headers of IP and of UDP or TCP.
    pub header_bytes: u64,
}

/// Counts packets by flow.
#[derive(Default)]
pub struct Flows(BTreeMap<(u8, u8, u16), FlowCount>);

impl Flows {
    /// An IPv4 packet went `way`.
    pub fn count(&mut self, way: u8, packet: &[u8]) {
        let byte = |k: usize| packet.get(k).copied().unwrap_or(0);
        let ip = 4 * usize::from(byte(0) & 0x0f);
        let protocol = byte(9);
        let port = |k: usize| u16::from_be_bytes([byte(ip + k), byte(ip + k + 1)]);
        // A fragment that is not the first has no ports.
        let is_first = u16::from_be_bytes([byte(6), byte(7)]) & 0x1fff == 0;
        let (port, transport) = match (protocol, is_first) {
            (6, true) => (port(0).min(port(2)), 4 * usize::from(byte(ip + 12) >> 4)),
            (17, true) => (port(0).min(port(2)), 8),
            _ => (0, 0),
        };
        let key = (way, protocol, port);
        if self.0.len() >= MAX_FLOWS && !self.0.contains_key(&key) {
            return;
        }
        let flow = self.0.entry(key).or_insert(FlowCount {
            way,
            protocol,
            port,
            ..FlowCount::default()
        });
        flow.packets += 1;
        flow.bytes += packet.len() as u64;
        flow.header_bytes += (ip + transport).min(packet.len()) as u64;
    }
    /// So far.
    pub fn counts(&self) -> Vec<FlowCount> {
        self.0.values().copied().collect()
    }
}

/// What one topic takes of the air.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TopicRate {
    /// Who sends it.
    pub sender: String,
    /// The topic.
    pub topic: String,
    /// Messages per second.
    pub rate_hz: f64,
    /// Bytes per second of the messages themselves.
    pub payload_bytes_per_s: f64,
    /// Bytes per second on the air, IP headers included: its fraction by payload of what was measured.
    pub bytes_per_s: f64,
}

/// One flow in rates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlowRate {
    /// `udp port 7447 to the drone`.
    pub flow: String,
    /// Packets per second.
    pub packets_per_s: f64,
    /// Bytes per second, IP headers included.
    pub bytes_per_s: f64,
    /// Of these headers of IP and of UDP or TCP.
    pub header_bytes_per_s: f64,
}

/// The air over the last seconds of a landing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OnAir {
    /// Flow by flow.
    pub flows: Vec<FlowRate>,
    /// Topic by topic.
    pub topics: Vec<TopicRate>,
}

/// The emulator's counts of late.
#[derive(Default)]
pub struct Recent(VecDeque<(i64, Vec<FlowCount>)>);

impl Recent {
    /// Counts as they were reported at `at_ns`.
    pub fn observe(&mut self, at_ns: i64, counts: Vec<FlowCount>) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back((at_ns, counts));
    }
    /// In rates, with the topics as the processes say they send them over `port`.
    pub fn on_air(&self, snapshot: &Snapshot, port: u16) -> Option<OnAir> {
        let ((from_ns, before), (until_ns, now)) = (self.0.front()?, self.0.back()?);
        let span_s = until_ns.saturating_sub(*from_ns) as f64 * 1e-9;
        if span_s <= 0.0 {
            return None;
        }
        let mut ways = [0.0_f64; 2];
        let mut flows = Vec::new();
        for flow in now {
            let same = |b: &&FlowCount| (b.way, b.protocol, b.port) == (flow.way, flow.protocol, flow.port);
            let then = before.iter().find(same).copied().unwrap_or_default();
            let rate = |now: u64, then: u64| now.saturating_sub(then) as f64 / span_s;
            let bytes_per_s = rate(flow.bytes, then.bytes);
            // Others are no part of the radio, such as a plain relay's.
            if let (Some(way), true) = (ways.get_mut(usize::from(flow.way)), flow.port == port) {
                *way += bytes_per_s;
            }
            let protocol = match flow.protocol {
                6 => "tcp".into(),
                17 => "udp".into(),
                other => format!("protocol {other}"),
            };
            let to = if flow.way == 0 { "drone" } else { "vessel" };
            flows.push(FlowRate {
                flow: format!("{protocol} port {} to the {to}", flow.port),
                packets_per_s: rate(flow.packets, then.packets),
                bytes_per_s,
                header_bytes_per_s: rate(flow.header_bytes, then.header_bytes),
            });
        }
        let mut topics = Vec::new();
        for (kind, measured) in [ProcessKind::Vessel, ProcessKind::Bridge].into_iter().zip(ways) {
            let sent: Vec<(String, f64, f64)> = snapshot
                .processes
                .get(&kind)
                .into_iter()
                .flat_map(|p| p.flows.iter())
                .map(|f| {
                    let name = topics::ALL.get(f.topic as usize).map_or("status", |t| t.name);
                    let headers = f64::from(f.rate_hz) * HEADER_BYTES as f64;
                    let payload = (f64::from(f.bytes_per_s) - headers).max(0.0);
                    (name.to_string(), f64::from(f.rate_hz), payload)
                })
                .collect();
            let all: f64 = sent.iter().map(|s| s.2).sum();
            for (topic, rate_hz, payload_bytes_per_s) in sent {
                topics.push(TopicRate {
                    sender: kind.name().into(),
                    topic,
                    rate_hz,
                    payload_bytes_per_s,
                    bytes_per_s: measured * payload_bytes_per_s / all.max(1.0),
                });
            }
        }
        Some(OnAir { flows, topics })
    }
}

impl OnAir {
    /// For people.
    pub fn text(&self) -> String {
        let mut flows = Table::new(
            1..,
            [
                "on the air, counted at the devices",
                "packets/s",
                "bytes/s",
                "of headers",
            ],
        );
        for f in &self.flows {
            let rates = [
                (f.packets_per_s, 1),
                (f.bytes_per_s, 0),
                (f.header_bytes_per_s, 0),
            ];
            let rates = rates.map(|(rate, digits)| Cell::number(rate, digits));
            flows.row(core::iter::once(Cell::from(&f.flow)).chain(rates));
        }
        let mut topics = Table::new(
            2..,
            [
                "sender",
                "topic",
                "Hz",
                "payload bytes/s",
                "bytes/s with IP headers",
            ],
        );
        for t in &self.topics {
            topics.row(cells![
                t.sender,
                t.topic,
                format_args!("{:.1}", t.rate_hz),
                format_args!("{:.0}", t.payload_bytes_per_s),
                format_args!("{:.0}", t.bytes_per_s),
            ]);
        }
        let total: f64 = self.topics.iter().map(|t| t.bytes_per_s).sum();
        topics.row(cells!["all", "", "", "", format_args!("{total:.0}")]);
        format!("{}{}", flows.text(), topics.text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(protocol: u8, payload: usize) -> Vec<u8> {
        let mut p = vec![0_u8; 20];
        (p[0], p[9]) = (0x45, protocol);
        p.extend(50_000_u16.to_be_bytes());
        p.extend(7447_u16.to_be_bytes());
        p.extend(if protocol == 6 {
            vec![
                0, 0, 0, 0, 0, 0, 0, 0, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
            ]
        } else {
            vec![0; 4]
        });
        p.extend(vec![0; payload]);
        p
    }

    #[test]
    fn flows_by_packet_header_and_their_rates() {
        let mut flows = Flows::default();
        let mut recent = Recent::default();
        for second in 0..20_i64 {
            for _ in 0..10 {
                flows.count(0, &packet(17, 300));
                flows.count(1, &packet(6, 100));
            }
            recent.observe(second * 1_000_000_000, flows.counts());
        }
        flows.count(0, &[]);
        let air = recent.on_air(&Snapshot::default(), 7447).unwrap();
        let (udp, tcp) = (&air.flows[0], &air.flows[1]);
        assert_eq!(
            (udp.flow.as_str(), tcp.flow.as_str()),
            ("udp port 7447 to the drone", "tcp port 7447 to the vessel")
        );
        // 20 of IP and 8 of UDP; 20 of IP and 32 of TCP with time stamps.
        assert!((udp.bytes_per_s - 3280.0).abs() < 1e-6 && (udp.header_bytes_per_s - 280.0).abs() < 1e-6);
        assert!((tcp.bytes_per_s - 1520.0).abs() < 1e-6 && (tcp.header_bytes_per_s - 520.0).abs() < 1e-6);
    }
}
