//! Observers: a ground station on the autopilot's other link, and an operator at another terminal.

use std::{
    net::{SocketAddr, UdpSocket},
    process::Child,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use alight_uav::autopilot::{
    message::{Address, COMPANION_COMPONENT, MavAutopilot, MavMessage, MavType, MavlinkMessage, text},
    wire::Decoder,
};

use crate::common::{errors, printed, run, started};

pub struct GroundStation {
    pub address: SocketAddr,
    ends: Arc<AtomicBool>,
    thread: JoinHandle<Vec<(Address, MavlinkMessage)>>,
}

impl GroundStation {
    pub fn listen() -> GroundStation {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
        let address = socket.local_addr().expect("an address");
        socket
            .set_read_timeout(Some(Duration::from_millis(50)))
            .expect("a timeout");
        let ends = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&ends);
        let thread = std::thread::spawn(move || {
            let mut decoder = Decoder::default();
            let mut kept = Vec::new();
            let mut buffer = [0; 2048];
            while !ended.load(Ordering::Relaxed) {
                if let Ok(n) = socket.recv(&mut buffer) {
                    decoder.push(&buffer[..n]);
                }
                while let Some(frame) = decoder.next_frame() {
                    if frame.from.component == COMPANION_COMPONENT {
                        kept.push((frame.from, frame.message));
                    }
                }
            }
            kept
        });
        GroundStation {
            address,
            ends,
            thread,
        }
    }
    /// Asserts that the companion's messages are those that a ground station shows of a landing.
    pub fn assert_landing(self) {
        self.ends.store(true, Ordering::Relaxed);
        let kept = self.thread.join().expect("no panic");
        let of_vehicle: Vec<&MavlinkMessage> = kept
            .iter()
            .filter(|(a, _)| a.system == 3)
            .map(|(_, m)| m)
            .collect();
        let heartbeats = of_vehicle.iter().filter(|m| match m {
            MavlinkMessage::Common(MavMessage::HEARTBEAT(h)) => {
                h.mavtype == MavType::MAV_TYPE_ONBOARD_CONTROLLER
                    && h.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID
            }
            _ => false,
        });
        assert!(heartbeats.count() > 10);
        let texts: Vec<&str> = of_vehicle
            .iter()
            .filter_map(|m| match m {
                MavlinkMessage::Text { text, .. } => Some(text.as_str()),
                _ => None,
            })
            .collect();
        for state in [
            "Get altitude: landing commanded",
            "Descent: the descent is permitted",
            "Landed: touchdown",
        ] {
            assert!(texts.contains(&state), "{state}: {texts:?}");
        }
        for name in ["deck_m", "link_age_s"] {
            let of_name = |m: &&&MavlinkMessage| matches!(m, MavlinkMessage::Common(MavMessage::NAMED_VALUE_FLOAT(d)) if text(&d.name) == name);
            assert!(of_vehicle.iter().filter(of_name).count() > 10, "{name}");
        }
    }
}

pub fn watch(instance: &str) -> Child {
    started(format!("status --watch --instance {instance}"))
}

/// Asserts that the watch has printed a line for each change and ended with the landing, with the exit code of the
/// last status.
pub fn assert_watched(watch: Child) {
    let out = watch.wait_with_output().expect("ends");
    let text = printed(&out);
    let ended = matches!(out.status.code(), Some(0..=2));
    assert!(
        ended && !errors(&out).contains("alight: "),
        "{text}{}",
        errors(&out)
    );
    let lines: Vec<&str> = text.lines().collect();
    assert!((4..200).contains(&lines.len()), "{text}");
    assert!(lines.iter().any(|l| l.contains(": Descent since")), "{text}");
    assert!(!text.contains('\x1b'), "{text}");
}

/// Asserts that the page fits, and that the full report has the tables of processes, topics and radio.
pub fn assert_status_shown(instance: &str) {
    let page = printed(&run(format!("status --instance {instance}")));
    let fits = page.lines().count() <= 20 && page.lines().all(|l| l.chars().count() <= 80);
    assert!(fits && page.contains("mission "), "{page}");
    // On the page, warnings of a busy computer take the place of the last lines.
    let all = printed(&run(format!("status --all --instance {instance}")));
    assert!(
        all.contains("processes")
            && all.contains("step p99")
            && all.contains("read at p50")
            && all.contains("bytes/s"),
        "{all}"
    );
}
