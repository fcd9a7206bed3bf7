use super::*;
use alight_shared::msg::ComputerReport;
use std::{
    io::{Read, Write},
    net::TcpStream,
};

use alight_shared::{
    msg::{MissionState, State as Phase},
    time::Time,
};

use crate::status::{StateView, Status};
use alight_computer::record::messages::Message;

use crate::view::view_observer::ViewObserver;

const TIMEOUT: Duration = Duration::from_secs(10);

fn served(may_order: bool) -> Served {
    let free = "127.0.0.1:0".parse().unwrap();
    Served {
        page: free,
        foxglove: Some(free),
        name: "test".into(),
        may_order,
    }
}
fn picture(name: &str) -> Picture {
    let state = StateView {
        name: name.into(),
        ..StateView::default()
    };
    Picture {
        status: Status {
            state: Some(state),
            ..Status::default()
        },
        ..Picture::default()
    }
}
fn connect(to: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(to).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream
}
fn ask(to: SocketAddr, method: &str, path: &str, more: &str) -> String {
    let mut stream = connect(to);
    let request = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: 0\r\n{more}\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}
fn read_until(stream: &mut TcpStream, text: &str) -> String {
    let (mut all, mut part) = (String::new(), [0; 4096]);
    while !all.contains(text) {
        let n = stream.read(&mut part).unwrap();
        assert!(n > 0, "it ended: {all}");
        all.push_str(&String::from_utf8_lossy(&part[..n]));
    }
    all
}

#[test]
fn viewers_page_over_loopback() {
    let server = Server::start(served(false)).unwrap();
    let to = server.page();
    let host = format!("Host: {to}\r\n");
    for (path, needle) in [
        ("/", "<canvas id=\"above\""),
        ("/view.css", ":root.night"),
        ("/view.js", "EventSource"),
        ("/worker.js", "/manifest.json"),
        ("/manifest.json", "standalone"),
        ("/icon.svg", "<svg"),
    ] {
        let answer = ask(to, "GET", path, &host);
        assert!(
            answer.starts_with("HTTP/1.1 200") && answer.contains(needle),
            "{path}"
        );
        assert!(answer.contains("default-src 'self'"), "{path} names no policy");
    }
    assert!(ask(to, "GET", "/state", &host).starts_with("HTTP/1.1 503"));
    server.show(picture("Approach"));
    assert!(ask(to, "GET", "/state", &host).contains("\"name\":\"Approach\""));
    for (named, code) in [
        ("boat.local", 200),
        ("boat:7450", 200),
        ("127.0.0.1.evil.example", 403),
    ] {
        let answer = ask(to, "GET", "/state", &format!("Host: {named}\r\n"));
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {code}")),
            "{named}: {answer}"
        );
    }
    assert!(ask(to, "GET", "/camera.jpg?1", &host).starts_with("HTTP/1.1 404"));
    server.show_camera(b"an image".into());
    let image = ask(to, "GET", "/camera.jpg?2", &host);
    assert!(image.contains("image/jpeg") && image.contains("no-store") && image.ends_with("an image"));
    assert!(!server.is_watched());
    let mut viewer = connect(to);
    viewer
        .write_all(format!("GET /events HTTP/1.1\r\n{host}\r\n").as_bytes())
        .unwrap();
    let first = read_until(&mut viewer, "\"name\":\"Approach\"");
    assert!(first.contains("text/event-stream"), "{first}");
    assert!(server.is_watched());
    server.show(picture("Descent"));
    read_until(&mut viewer, "\"name\":\"Descent\"");
    assert!(ask(to, "GET", "/order", &host).starts_with("HTTP/1.1 405"));
}

#[test]
fn viewers_page_size_and_hosts() {
    let files = [
        include_str!("../page/view.html"),
        include_str!("../page/view.css"),
        include_str!("../page/view.js"),
        include_str!("../page/worker.js"),
    ];
    assert!(files.iter().map(|f| f.lines().count()).sum::<usize>() <= 1300);
    assert!(
        files
            .iter()
            .all(|f| !f.contains("//www") && !f.contains("http:") && !f.contains("https:"))
    );
}

/// Relative luminance of `#rrggbb` (WCAG 2.2).
fn luminance(colour: &str) -> f64 {
    let part = |k: usize| {
        let x = f64::from(u8::from_str_radix(&colour[k..k + 2], 16).unwrap()) / 255.0;
        if x <= 0.04045 {
            x / 12.92
        } else {
            ((x + 0.055) / 1.055).powf(2.4)
        }
    };
    0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5)
}

#[test]
fn viewers_page_contrast_by_day_and_night() {
    let css = include_str!("../page/view.css");
    let palette = |selector: &str| {
        let block = css.split_once(&format!("{selector} {{")).unwrap().1;
        let block = block.split_once('}').unwrap().0;
        let named = block
            .split(';')
            .filter_map(|l| l.trim().strip_prefix("--")?.split_once(": "));
        named
            .map(|(n, c)| (n, c.trim().to_owned()))
            .collect::<std::collections::BTreeMap<_, _>>()
    };
    for selector in [":root", ":root.night"] {
        let colours = palette(selector);
        let on =
            |back: &'static str, inks: &[&'static str]| inks.iter().map(|i| (*i, back)).collect::<Vec<_>>();
        let mut pairs = on(
            "card",
            &["ink", "soft", "line", "drone", "plan", "forecast", "deck"],
        );
        pairs.extend(on("back", &["ink", "soft", "line"]));
        pairs.extend(on("water", &["ink", "deck"]));
        pairs.extend([
            ("card", "ink"),
            ("card", "soft"),
            ("card", "drone"),
            ("warning", "warning-back"),
            ("alarm", "alarm-back"),
            ("go", "go-back"),
            ("wait", "wait-back"),
            ("no", "no-back"),
        ]);
        for (ink, back) in pairs {
            let [a, b] = [ink, back].map(|n| luminance(&colours[n]) + 0.05);
            let contrast = a.max(b) / a.min(b);
            assert!(contrast >= 4.5, "{selector}: {ink} on {back}: {contrast:.2}");
        }
        // The backgrounds of the verdicts are told apart without their colours.
        let mut backs = ["go-back", "wait-back", "no-back"].map(|n| luminance(&colours[n]) + 0.05);
        backs.sort_by(f64::total_cmp);
        for pair in backs.windows(2) {
            assert!(pair[1] >= 3.0 * pair[0], "{selector}: {backs:?}");
        }
    }
    assert!(!css.contains("opacity"), "opacity changes the contrast");
}

#[test]
fn viewers_page_structure() {
    let html = include_str!("../page/view.html");
    assert_eq!(html.matches("<h1").count(), 1);
    for part in [
        "<dl id=\"figures\"",
        "id=\"verdict\"",
        "id=\"stages\"",
        "id=\"sentence\"",
        "id=\"strip\"",
        "<canvas id=\"side\"",
        "rel=\"manifest\"",
        "lang=\"en\"",
    ] {
        assert!(html.contains(part), "{part}");
    }
    // A screen reader would read out each change, so only two lines are announced, and only when their kind changes.
    assert!(!html.contains("aria-live"));
    let live: Vec<&str> = html
        .lines()
        .filter(|l| l.contains("\"status\"") || l.contains("\"alert\""))
        .collect();
    assert_eq!(live.len(), 3, "{live:?}");
    assert!(
        live.iter().all(|l| l.contains("spoken") || l.contains("answer")),
        "{live:?}"
    );
    let manifest: serde_json::Value = serde_json::from_str(include_str!("../page/manifest.json")).unwrap();
    assert_eq!(
        (&manifest["start_url"], &manifest["display"]),
        (&"/".into(), &"standalone".into())
    );
}

#[test]
fn viewers_order_next_to_120_slow_connections() {
    let server = Server::start(served(true)).unwrap();
    server.show(picture("Descent"));
    let to = server.page();
    let mut viewer = connect(to);
    viewer
        .write_all(format!("GET /events HTTP/1.1\r\nHost: {to}\r\n\r\n").as_bytes())
        .unwrap();
    read_until(&mut viewer, "\"name\":\"Descent\"");
    // Each connection begins a request and does not end it.
    let slow: Vec<TcpStream> = (0..120)
        .map(|k| {
            let mut stream = connect(to);
            stream
                .write_all(format!("GET /state HTTP/1.1\r\nX-Slow: {k}\r\n").as_bytes())
                .unwrap();
            stream
        })
        .collect();
    let given = std::thread::spawn(move || {
        let own = format!("Host: {to}\r\nOrigin: http://{to}\r\n");
        ask(to, "POST", "/order", &own)
    });
    let order = (0..1000).find_map(|_| {
        alight_computer::process::supervisor::pause(Duration::from_millis(5));
        server.order()
    });
    let order = order.unwrap();
    assert_eq!(order.name, "");
    order.reply.send(Ok("abort taken".into())).unwrap();
    let answer = given.join().unwrap();
    assert!(
        answer.starts_with("HTTP/1.1 200") && answer.ends_with("abort taken"),
        "{answer}"
    );
    server.show(picture("Gave up"));
    read_until(&mut viewer, "\"name\":\"Gave up\"");
    drop(slow);
}

#[test]
fn viewers_order_without_leave_or_from_other_pages() {
    let allowed = Server::start(served(true)).unwrap();
    let to = allowed.page();
    let own = format!("Host: {to}\r\nOrigin: http://{to}\r\n");
    let port = to.port();
    for (what, given) in [
        ("no origin", format!("Host: {to}\r\n")),
        ("null", format!("Host: {to}\r\nOrigin: null\r\n")),
        (
            "another page",
            format!("Host: {to}\r\nOrigin: http://evil.example\r\n"),
        ),
        (
            "another port",
            format!("Host: {to}\r\nOrigin: http://127.0.0.1:1\r\n"),
        ),
        (
            "another scheme",
            format!("Host: {to}\r\nOrigin: https://{to}\r\n"),
        ),
        ("two origins", format!("{own}Origin: http://evil.example\r\n")),
        (
            "a host name of others that leads here",
            format!("Host: evil.example:{port}\r\nOrigin: http://evil.example:{port}\r\n"),
        ),
        (
            "a name that begins like an address",
            format!(
                "Host: localhost.evil.example:{port}\r\nOrigin: http://localhost.evil.example:{port}\r\n"
            ),
        ),
    ] {
        let answer = ask(to, "POST", "/order", &given);
        assert!(answer.starts_with("HTTP/1.1 403"), "{what}: {answer}");
    }
    assert!(allowed.order().is_none(), "an order came through");
    let forbidden = Server::start(served(false)).unwrap();
    let to = forbidden.page();
    let answer = ask(
        to,
        "POST",
        "/order",
        &format!("Host: {to}\r\nOrigin: http://{to}\r\n"),
    );
    assert!(
        answer.starts_with("HTTP/1.1 403") && answer.contains("view.abort"),
        "{answer}"
    );
    assert!(forbidden.order().is_none());
}

#[test]
fn viewer_that_does_not_read() {
    let server = Server::start(served(false)).unwrap();
    let to = server.page();
    let mut slow = connect(to);
    slow.write_all(format!("GET /events HTTP/1.1\r\nHost: {to}\r\n\r\n").as_bytes())
        .unwrap();
    read_until(&mut slow, "text/event-stream");
    // 4 MB in pictures of 10 kB.
    let filler = "x".repeat(10_000);
    for k in 0..400 {
        server.show(picture(&format!("picture {k}. {filler}")));
        alight_computer::process::supervisor::pause(Duration::from_millis(2));
    }
    let (mut waiting, mut part) = (0, [0; 1 << 16]);
    let mut tail = String::new();
    while !tail.contains("picture 399.") {
        let n = slow.read(&mut part).unwrap();
        assert!(n > 0, "it ended after {waiting} bytes");
        waiting += n;
        tail = String::from_utf8_lossy(&part[..n]).into_owned();
    }
    // Only the kernel's buffers at both ends held pictures.
    assert!(waiting < 320 << 10, "{waiting} bytes were queued");
    assert!(ask(to, "GET", "/state", &format!("Host: {to}\r\n")).contains("picture 399."));
}

/// Foxglove client: JSON texts, and numbers of subscriptions in binary frames.
type Viewer = tungstenite::WebSocket<TcpStream>;

fn foxglove(to: SocketAddr) -> Viewer {
    use tungstenite::client::IntoClientRequest;
    let mut request = format!("ws://{to}/").into_client_request().unwrap();
    let protocol = "foxglove.sdk.v1".parse().unwrap();
    request.headers_mut().insert("Sec-WebSocket-Protocol", protocol);
    tungstenite::client(request, connect(to)).unwrap().0
}
fn topics(viewer: &mut Viewer) -> Vec<(u64, String)> {
    let mut all = Vec::new();
    while all.len() < 22 {
        let message = viewer.read().unwrap();
        let Ok(text) = message.to_text() else { continue };
        let Ok(json) = serde_json::from_str::<serde_json::Value>(text) else {
            continue;
        };
        for channel in json["channels"].as_array().into_iter().flatten() {
            assert_eq!(channel["encoding"], "protobuf");
            let (id, topic) = (channel["id"].as_u64(), channel["topic"].as_str());
            all.push((id.unwrap(), topic.unwrap().to_owned()));
        }
    }
    all
}

#[test]
fn foxglove_viewer_topics_and_rates() {
    let mut observer = ViewObserver::start(served(false), ComputerReport::default(), &None, false).unwrap();
    let mut viewer = foxglove(observer.server.foxglove().unwrap());
    let all = topics(&mut viewer);
    for topic in [
        "/tf",
        "/mission",
        "/plan",
        "/deck/forecast",
        "/link",
        "/log",
        "/drone/autopilot",
    ] {
        assert!(
            all.iter().any(|(_, t)| t == topic),
            "{topic} is not among {all:?}"
        );
    }
    let mission = all.iter().find(|(_, t)| t == "/mission").unwrap().0;
    let subscribe = format!(r#"{{"op":"subscribe","subscriptions":[{{"id":5,"channelId":{mission}}}]}}"#);
    viewer.send(tungstenite::Message::text(subscribe)).unwrap();
    // Five seconds of a mission at 50 Hz, as fast as possible once the viewer has subscribed.
    let mut t = 0_i64;
    let mut step = |observer: &mut ViewObserver| {
        t += 20_000_000;
        let state = MissionState {
            state: Phase::Tracking,
            ..MissionState::default()
        };
        observer.message(Time::from_nanos(t), &Message::Mission(&state));
        observer.show(Time::from_nanos(t));
    };
    let received = |viewer: &mut Viewer| {
        let message = viewer.read().unwrap();
        let data = message.into_data();
        // Opcode 1, number of the subscription, time.
        (data.first() == Some(&1)).then(|| u64::from_le_bytes(data[5..13].try_into().unwrap()))
    };
    viewer
        .get_ref()
        .set_read_timeout(Some(Duration::from_millis(20)))
        .unwrap();
    let begun = (0..500).any(|_| {
        step(&mut observer);
        viewer.read().is_ok_and(|m| m.is_binary())
    });
    assert!(begun, "no message in 500 steps");
    viewer.get_ref().set_read_timeout(Some(TIMEOUT)).unwrap();
    for _ in 0..250 {
        step(&mut observer);
    }
    let times: Vec<u64> = core::iter::repeat_with(|| received(&mut viewer))
        .flatten()
        .take(48)
        .collect();
    assert!(times.windows(2).all(|w| w[1] - w[0] == 100_000_000), "{times:?}");
}

#[test]
fn foxglove_viewer_that_does_not_read() {
    let mut observer = ViewObserver::start(served(false), ComputerReport::default(), &None, false).unwrap();
    let mut viewer = foxglove(observer.server.foxglove().unwrap());
    let all: Vec<String> = topics(&mut viewer)
        .iter()
        .map(|(id, _)| format!(r#"{{"id":{id},"channelId":{id}}}"#))
        .collect();
    let subscribe = format!(r#"{{"op":"subscribe","subscriptions":[{}]}}"#, all.join(","));
    viewer.send(tungstenite::Message::text(subscribe)).unwrap();
    // An hour of states, of which the viewer's queue keeps the newest; the next viewer is still served.
    let state = MissionState::default();
    for k in 0..36_000_i64 {
        observer.message(Time::from_nanos(k * 100_000_000), &Message::Mission(&state));
        observer.show(Time::from_nanos(k * 100_000_000));
    }
    let mut other = foxglove(observer.server.foxglove().unwrap());
    assert!(topics(&mut other).len() >= 22);
}
