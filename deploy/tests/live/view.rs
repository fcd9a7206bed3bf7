//! The viewers' server next to a landing of all processes.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::Value;

use crate::common::{free_port, instance, signal};
use crate::landing::{land, pid, status_when};

/// The page's newest picture.
fn picture(port: u16) -> Value {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).expect("the page's address");
    stream
        .set_read_timeout(Some(Duration::from_secs(10)))
        .expect("a timeout");
    let request = format!("GET /state HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("asked");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("answered");
    let body = answer.split("\r\n\r\n").nth(1).unwrap_or_default();
    serde_json::from_str(body).unwrap_or_else(|e| panic!("{e}: {answer}"))
}

#[test]
fn killed_viewers_server_of_a_landing() {
    let (instance, port) = (instance("viewed"), free_port());
    let flags = format!("--transport udp --warm-up 600 --view=127.0.0.1:{port}");
    let _landing = land(&instance, &flags);
    let runs = |s: &Value| pid(s, "view").filter(|_| pid(s, "pilot").is_some());
    let first = status_when(&instance, |s| runs(s).is_some() && !s["mission"].is_null());
    let shown = picture(port);
    assert_eq!(shown["state"]["name"], "Idle", "{shown}");
    assert!(
        shown["title"].as_str().is_some_and(|t| t.contains(&instance)),
        "{shown}"
    );

    // The page draws what `alight status --json` prints.
    for key in first.as_object().expect("an object").keys() {
        assert!(shown.get(key).is_some(), "{key}: {shown}");
    }

    let killed = runs(&first).expect("it runs");
    signal(killed, "-KILL");
    let second = status_when(&instance, |s| runs(s).is_some_and(|p| p != killed));
    assert_eq!(picture(port)["state"]["name"], "Idle");
    for process in ["bridge", "predictor", "mission", "planner", "pilot", "autopilot"] {
        assert_eq!(pid(&first, process), pid(&second, process), "{process}");
    }
}
