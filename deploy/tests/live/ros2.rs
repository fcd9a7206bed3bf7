//! ROS 2 node next to a landing of all processes, received by a plain Zenoh session through a router that starts
//! after the node, as rmw_zenohd may.

use std::{
    io::{BufRead, BufReader},
    net::TcpListener,
    process::{Child, Stdio},
    sync::mpsc::{Receiver, channel},
    time::{Duration, SystemTime},
};

use byteorder::LittleEndian;
use cdr_encoding::from_bytes;
use serde::de::DeserializeOwned;
use zenoh::{Wait, sample::Sample};

use crate::{
    common::{alight, instance, scratch, signal},
    landing::{land, status_when},
};

type Header = ((i32, u32), String);
/// Position and quaternion (x, y, z, w), with covariance.
type Pose = ([f64; 7], [[f64; 6]; 6]);
/// Velocity and rates, with covariance.
type Twist = ([f64; 6], [[f64; 6]; 6]);
type Odometry = (Header, String, Pose, Twist);
/// Level, name, message, hardware, values.
type DiagnosticRow = (u8, String, String, String, Vec<(String, String)>);
type Diagnostics = (Header, Vec<DiagnosticRow>);
type Response = (bool, String);

const TRIGGER: &str = "std_srvs::srv::dds_::Trigger_/*";
/// Request of `Trigger`, whose one byte has no meaning (pyzeros 0.1.0: `Trigger.Request().serialize()`).
const REQUEST: [u8; 5] = [0, 1, 0, 0, 0];

/// Scenario in which the drone hovers for 60 s before the landing is commanded.
const HOVER: &str = "[start]\nhover_s = 60.0\n";

pub fn free_tcp_port() -> u16 {
    let socket = TcpListener::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("an address").port()
}

const TIMEOUT: Duration = Duration::from_secs(120);

/// `alight ros2` and its output; SIGTERM ends it with exit code 0.
struct Node(Child, Receiver<String>);

impl Node {
    fn start(instance: &str, port: u16) -> Node {
        let arguments =
            format!("ros2 --orders --instance {instance} --connect tcp/127.0.0.1:{port} --domain 7");
        let mut child = alight(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .expect("starts");
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        let (to, printed) = channel();
        std::thread::spawn(move || lines.map_while(Result::ok).try_for_each(|line| to.send(line)));
        Node(child, printed)
    }
    fn prints(&self, what: &str) {
        let line = self.1.recv_timeout(TIMEOUT).expect("a line");
        assert!(line.contains(what), "{line}");
    }
    fn end(mut self) {
        signal(u64::from(self.0.id()), "-TERM");
        assert!(self.0.wait().expect("ends").success());
    }
}

fn session(mode: &str, list: &str, port: u16) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", format!("{mode:?}")),
        (list, format!("[\"tcp/127.0.0.1:{port}\"]")),
        ("scouting/multicast/enabled", "false".into()),
    ] {
        config.insert_json5(key, &value).expect("a setting");
    }
    zenoh::open(config).wait().expect("a session")
}

fn received(session: &zenoh::Session, keys: &str) -> Receiver<Sample> {
    let (to, from) = channel();
    session
        .declare_subscriber(keys)
        .callback(move |sample| drop(to.send(sample)))
        .background()
        .wait()
        .expect("subscribed");
    from
}

fn decoded<T: DeserializeOwned>(bytes: &[u8]) -> T {
    assert_eq!(bytes[..4], [0, 1, 0, 0], "not CDR, little endian");
    let (value, length) = from_bytes::<T, LittleEndian>(&bytes[4..]).expect("decoded");
    assert_eq!(length + 4, bytes.len());
    value
}

fn message<T: DeserializeOwned>(from: &Receiver<Sample>, wanted: impl Fn(&T) -> bool) -> T {
    loop {
        let sample = from.recv_timeout(TIMEOUT).expect("a message");
        assert_eq!(sample.attachment().expect("an attachment").len(), 33);
        let value = decoded(&sample.payload().to_bytes());
        if wanted(&value) {
            return value;
        }
    }
}

fn call(session: &zenoh::Session, key: &str, attachment: &[u8]) -> Result<(Response, Vec<u8>), String> {
    let replies = session
        .get(key)
        .payload(REQUEST.to_vec())
        .attachment(attachment.to_vec())
        .timeout(TIMEOUT)
        .wait()
        .expect("asked");
    let reply = replies.recv_timeout(TIMEOUT).expect("in time").expect("a reply");
    match reply.result() {
        Ok(sample) => {
            let attachment = sample.attachment().expect("an attachment").to_bytes();
            Ok((decoded(&sample.payload().to_bytes()), attachment.into_owned()))
        }
        Err(e) => Err(String::from_utf8_lossy(&e.payload().to_bytes()).into_owned()),
    }
}

/// Queries ROS's graph until it has `all` entities.
fn tokens(session: &zenoh::Session, all: usize) -> Vec<String> {
    for _ in 0..600 {
        let replies = session.liveliness().get("@ros2_lv/7/**").wait().expect("asked");
        let found: Vec<String> = replies
            .iter()
            .filter_map(|r| r.into_result().ok())
            .map(|s| s.key_expr().as_str().to_owned())
            .collect();
        if found.len() == all {
            return found;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    panic!("not {all} entities");
}

/// Asserts that poses of drone and deck, and findings, carry about the same time.
fn assert_published(client: &zenoh::Session, name: &str) {
    let topic = |topic: &str| {
        received(
            client,
            &format!("{name}/{topic}/nav_msgs::msg::dds_::Odometry_/*"),
        )
    };
    let (header, child, (pose, covariance), _): Odometry = message(&topic("odometry"), |_| true);
    assert_eq!((header.1.as_str(), child.as_str()), ("map", "base_link"));
    let norm: f64 = pose[3..].iter().map(|q| q * q).sum();
    assert!((norm - 1.0).abs() < 1e-6 && covariance[0][0] > 0.0, "{pose:?}");
    let deck: Odometry = message(&topic("deck/odometry"), |_| true);
    assert_eq!(deck.1, "deck");
    let key = "7/tf_static/tf2_msgs::msg::dds_::TFMessage_/*";
    let fixed: Vec<(Header, String, [f64; 7])> = message(&received(client, key), |_| true);
    let children: Vec<&str> = fixed.iter().map(|t| t.1.as_str()).collect();
    assert_eq!(children, ["camera_optical", "vessel"]);

    let key = "7/diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/*";
    let summary = |(_, all): &Diagnostics| all[0].1 == "drone_1: summary" && all[0].2.contains("Idle");
    let (judged, _): Diagnostics = message(&received(client, key), summary);
    // Time of the system clock, not since the start of the computer or landing.
    assert!((judged.0.0 - header.0.0).abs() < 100, "{judged:?} {header:?}");
}

fn attachment(age: Duration) -> Vec<u8> {
    let sent = SystemTime::now() - age;
    let since = sent.duration_since(SystemTime::UNIX_EPOCH).expect("after 1970");
    let mut all: Vec<u8> = (0..33).collect();
    all[8..16].copy_from_slice(&(since.as_nanos() as i64).to_le_bytes());
    all
}

/// Asserts that a client's request is answered by the mission's state, and that an invalid request is rejected with
/// the reason.
fn assert_orders(client: &zenoh::Session, name: &str, instance: &str) {
    let abort = format!("{name}/abort/{TRIGGER}");
    assert!(call(client, &abort, &[1, 2, 3]).is_err());
    let every = format!("{name}/*/{TRIGGER}");
    let new = attachment(Duration::ZERO);
    assert!(call(client, &every, &new).is_err_and(|why| why.contains("wildcard")));
    let land = format!("{name}/land/{TRIGGER}");
    let old = attachment(Duration::from_secs(60));
    let ((success, text), _) = call(client, &land, &old).expect("answered");
    assert!(!success && text.contains("by its own stamp"), "{text}");
    let attachment = new;
    let ((success, text), _) = call(client, &land, &attachment).expect("answered");
    assert!(success && text.starts_with("drone 1: "), "{text}");
    let ((success, text), answered) = call(client, &abort, &attachment).expect("answered");
    // The landing may or may not have begun.
    assert!(success && text.contains("operator's command"), "{text}");
    let own = |a: &[u8]| (a[..8].to_vec(), a[16..].to_vec());
    assert_eq!(own(&answered), own(&attachment));
    status_when(instance, |s| s["mission"].to_string().contains("Operator"));
}

#[test]
fn ros2_node_of_a_landing() {
    let instance = instance("ros2");
    let port = free_tcp_port();
    // The node starts before everything that it needs.
    let node = Node::start(&instance, port);
    node.prints("no router at");
    let router = session("router", "listen/endpoints", port);
    node.prints("connected to the router at");
    let hover = scratch("ros2-hover.toml");
    std::fs::write(&hover, HOVER).expect("written");
    let flags = format!("--transport udp --warm-up 70 --scenario {}", hover.display());
    let landing = land(&instance, &flags);

    let client = session("client", "connect/endpoints", port);
    let all = tokens(&client, 10);
    let of = |letters: &str| all.iter().filter(|t| t.contains(letters)).count();
    assert_eq!([of("/NN/"), of("/MP/"), of("/SS/")], [1, 7, 2], "{all:#?}");
    let name = "7/alight/drone_1";
    assert_published(&client, name);
    assert_orders(&client, name, &instance);

    // Without a landing, and then without a router, the node reports its absence, and ends when asked to.
    drop(landing);
    let land = format!("{name}/land/{TRIGGER}");
    let ((success, text), _) = call(&client, &land, &attachment(Duration::ZERO)).expect("answered");
    assert!(!success && text.contains("no process reports"), "{text}");
    router.close().wait().expect("closed");
    node.prints("no router at");
    node.end();
    std::fs::remove_file(&hover).expect("removed");
}
