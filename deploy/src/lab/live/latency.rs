//! `alight latency`: how long one hop takes, of both middlewares and of plain sockets beside them,
//! all in one run with the same message at the same rate.
//!
//! Every receiver is a thread that sleeps until something comes, as the processes do. The middlewares
//! go through the same code as the processes (`alight_shared::transport`).

use std::net::UdpSocket;
use std::os::unix::net::UnixDatagram;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use alight_shared::msg::{Header, VesselEstimate};
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Memory, Services};
use alight_shared::transport::radio::{Publication, Radio, RadioConfig, TlsConfig, Urgency};
use alight_shared::transport::wake;
use alight_shared::wire;
use clap::Args;
use serde_json::json;

use crate::exit::{CliError, Doing, Exit};
use crate::lab::live::times::Times;
use crate::process::instance::OwnedInstance;
use crate::process::snapshot::time;
use crate::table::{Cell, Table};
use crate::{cells, terminal};

/// Messages a second.
const RATE_HZ: u32 = 100;
/// Messages before the count begins, while sessions open.
const WARM_UP_MESSAGES: u32 = 100;
/// Longest wait of a receiver without a look at whether to end.
const MAX_WAIT: Duration = Duration::from_millis(50);

/// Latency of one hop.
#[derive(Args, Debug)]
pub struct LatencyArgs {
    /// How long to measure, s
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// The message: the vessel's estimate, stamped with the steady clock when it is sent.
type Message = VesselEstimate<DroneClock>;

fn message(sequence: u32) -> Message {
    VesselEstimate {
        header: Header::new(1, 0, 1, sequence, Time::from_nanos(steady_ns())),
        ..Message::default()
    }
}

/// Takes note of a message that came just now.
fn note(times: &mut Times, message: &Message) {
    if message.header.sequence >= WARM_UP_MESSAGES {
        times.add_ns(steady_ns() - message.header.at.nanos());
    }
}

/// Something that carries the message: how to send it, and the thread that receives it.
struct Hop {
    name: &'static str,
    send: Box<dyn FnMut(&Message)>,
    receiver: std::thread::JoinHandle<Times>,
}

/// A socket's receiving end: reads until told to end.
fn read(
    end: Arc<AtomicBool>,
    mut receive: impl FnMut(&mut [u8]) -> std::io::Result<usize> + Send + 'static,
) -> std::thread::JoinHandle<Times> {
    std::thread::spawn(move || {
        let (mut times, mut buffer) = (Times::default(), [0_u8; wire::MAX_WIRE_BYTES]);
        while !end.load(Ordering::Relaxed) {
            if let Ok(length) = receive(&mut buffer)
                && let Ok(message) = wire::decode(buffer.get(..length).unwrap_or_default())
            {
                note(&mut times, &message);
            }
        }
        times
    })
}

fn unix(end: &Arc<AtomicBool>) -> Result<Hop, CliError> {
    let doing = "making a pair of Unix sockets";
    let (from, to) = UnixDatagram::pair().doing(doing)?;
    to.set_read_timeout(Some(MAX_WAIT)).doing(doing)?;
    Ok(Hop {
        name: "Unix datagram socket",
        send: Box::new(move |m| {
            if let Ok(bytes) = wire::encode(m) {
                let _lost = from.send(&bytes);
            }
        }),
        receiver: read(Arc::clone(end), move |buffer| to.recv(buffer)),
    })
}

fn udp(end: &Arc<AtomicBool>) -> Result<Hop, CliError> {
    let doing = "making UDP sockets";
    let to = UdpSocket::bind("127.0.0.1:0").doing(doing)?;
    let from = UdpSocket::bind("127.0.0.1:0").doing(doing)?;
    from.connect(to.local_addr().doing(doing)?).doing(doing)?;
    to.set_read_timeout(Some(MAX_WAIT)).doing(doing)?;
    Ok(Hop {
        name: "plain UDP",
        send: Box::new(move |m| {
            if let Ok(bytes) = wire::encode(m) {
                let _lost = from.send(&bytes);
            }
        }),
        receiver: read(Arc::clone(end), move |buffer| to.recv(buffer)),
    })
}

fn zenoh(end: &Arc<AtomicBool>, name: &'static str, transport: &str) -> Result<Hop, CliError> {
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr());
    let endpoint = format!("{transport}/{}", port.doing("looking for a free port")?);
    let listen = RadioConfig::listening(&endpoint, TlsConfig::default());
    let dial = RadioConfig::dialling(endpoint, TlsConfig::default());
    let publication = Publication::new("alight/latency", Urgency::State);
    let mut from = Radio::open(&listen, vec![publication], Vec::new())?;
    let mut to = Radio::open(&dial, Vec::new(), vec!["alight/latency".into()])?;
    let end = Arc::clone(end);
    let receiver = std::thread::spawn(move || {
        let mut times = Times::default();
        while !end.load(Ordering::Relaxed) {
            to.watch(0.0);
            if let Some(received) = to.receive(MAX_WAIT)
                && let Ok(message) = wire::decode(&received.bytes)
            {
                note(&mut times, &message);
            }
        }
        times
    });
    Ok(Hop {
        name,
        send: Box::new(move |m| {
            if let Ok(bytes) = wire::encode(m) {
                from.send(0, bytes);
            }
        }),
        receiver,
    })
}

fn shared_memory(end: &Arc<AtomicBool>, owned: &OwnedInstance, memory: &Memory) -> Result<Hop, CliError> {
    let mut publisher = memory.publisher::<Message>()?;
    let (instance, end) = (owned.instance().clone(), Arc::clone(end));
    let receiver = std::thread::spawn(move || {
        let mut times = Times::default();
        let ended = wake::follow(&instance, "receiver", MAX_WAIT, |came: Vec<Message>| {
            came.iter().for_each(|message| note(&mut times, message));
            !end.load(Ordering::Relaxed)
        });
        if let Err(e) = ended {
            eprintln!("alight: the hop through shared memory: {e}");
        }
        times
    });
    Ok(Hop {
        name: "iceoryx2, wait set",
        send: Box::new(move |m| publisher.send(m)),
        receiver,
    })
}

/// Measures and shows the table.
pub fn run(args: &LatencyArgs) -> Result<Exit, CliError> {
    let owned = OwnedInstance::take(&format!("latency-{}", std::process::id()))?;
    let memory = Memory::join(owned.instance(), "sender")?;
    let services = Services::create(&memory)?;
    let end = Arc::new(AtomicBool::new(false));
    let mut hops = vec![
        shared_memory(&end, &owned, &memory)?,
        unix(&end)?,
        udp(&end)?,
        zenoh(&end, "zenoh over UDP", "udp")?,
        zenoh(&end, "zenoh over TCP", "tcp")?,
    ];
    let count = args.seconds * RATE_HZ;
    for sequence in 0..count + WARM_UP_MESSAGES {
        if !memory.wait(Duration::from_secs(1) / RATE_HZ) {
            end.store(true, Ordering::Relaxed);
            return Ok(Exit::Failed);
        }
        for hop in &mut hops {
            (hop.send)(&message(sequence));
        }
    }
    // What is under way has this long to come.
    let _stop_requested = memory.wait(2 * MAX_WAIT);
    end.store(true, Ordering::Relaxed);
    let mut rows = Vec::new();
    let mut table = Table::new(1.., ["hop", "received %", "p50", "p99", "max"]);
    for hop in hops {
        let times = hop.receiver.join().unwrap_or_default();
        let [p50, p99, max] = [0.5, 0.99, 1.0].map(|q| times.quantile(q));
        let received = Cell::number(100.0 * times.count as f64 / f64::from(count), 1);
        table.row(cells![hop.name, received, time(p50), time(p99), time(max)]);
        rows.push(
            json!({ "hop": hop.name, "received": times.count, "p50_s": p50, "p99_s": p99, "max_s": max }),
        );
    }
    drop(services);
    if args.json {
        terminal::line(json!({ "rate_hz": RATE_HZ, "sent": count, "hops": rows }));
    } else {
        terminal::line(format_args!(
            "one hop of the vessel's estimate (246 B) at {RATE_HZ} Hz, {} s, one after the other\n\n{}",
            args.seconds,
            table.text()
        ));
    }
    Ok(Exit::Success)
}
