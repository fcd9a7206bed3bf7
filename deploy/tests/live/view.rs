use std::{
    io::{Read, Write},
    net::TcpStream,
    time::Duration,
};

use serde_json::Value;

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

/// Asserts that the page draws the output of `alight status --json`.
pub fn assert_shown(port: u16, instance: &str, status: &Value) {
    let shown = picture(port);
    assert_eq!(shown["state"]["name"], "Idle", "{shown}");
    assert!(
        shown["title"].as_str().is_some_and(|t| t.contains(instance)),
        "{shown}"
    );
    for key in status.as_object().expect("an object").keys() {
        assert!(shown.get(key).is_some(), "{key}: {shown}");
    }
}
