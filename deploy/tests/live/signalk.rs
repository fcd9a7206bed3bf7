//! `alight signalk` with a Signal K server, and its deltas as input of a vessel's sensor.

use std::{
    net::{TcpListener, TcpStream},
    process::Stdio,
    time::Duration,
};

use alight_shared::msg::SensorReadings;
use alight_usv::sensors::Readings;
use serde_json::Value;
use tungstenite::{Message, WebSocket};

use crate::{
    common::{Running, alight, instance, signal},
    sensors::Sensors,
};

fn server() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", listener.local_addr().unwrap());
    (listener, url)
}
fn client(listener: &TcpListener) -> WebSocket<TcpStream> {
    let (stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut socket = tungstenite::accept(stream).unwrap();
    let hello = r#"{"name":"signalk-server","version":"2.8.0","self":"vessels.urn:mrn:imo:mmsi:230099999"}"#;
    socket.send(Message::text(hello)).unwrap();
    socket
}

#[test]
fn signalk_client_across_a_restart_of_the_server() {
    let (listener, url) = server();
    let name = instance("signalk-none");
    let child = alight(format!("signalk --instance {name} --connect {url}"))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut program = Running(child);
    for _ in 0..2 {
        let mut socket = client(&listener);
        // The program neither answers this request nor treats it as an order.
        let put =
            r#"{"requestId":"1","context":"vessels.self","put":{"path":"alight.deck.closed","value":true}}"#;
        socket.send(Message::text(put)).unwrap();
        let text = loop {
            if let Message::Text(text) = socket.read().unwrap() {
                break text;
            }
        };
        let delta: Value = serde_json::from_str(text.as_str()).unwrap();
        let values = delta["updates"][0]["values"].as_array().unwrap();
        let of = |path: &str| {
            values
                .iter()
                .find(|v| v["path"] == path)
                .map(|v| v["value"].clone())
        };
        // No process runs: every connection receives all values.
        assert_eq!(of("alight.drones.1.running"), Some(false.into()), "{delta}");
        assert_eq!(
            of("notifications.alight.drones.1.processes").unwrap()["state"],
            "warn",
            "{delta}"
        );
    }
    signal(u64::from(program.0.id()), "-TERM");
    assert!(program.0.wait().expect("ends").success());
}

#[test]
fn sensor_process_on_a_signalk_server() {
    let (listener, url) = server();
    let source = format!("[[sensor.sources]]\nname = \"boat\"\nconnect = \"{url}\"\nformat = \"signalk\"\n");
    let sensors = Sensors::start("signalk", &source);
    let mut readings = sensors.memory.subscriber::<SensorReadings>().unwrap();
    let mut socket = client(&listener);
    let mut all = Readings::default();
    for k in 0..2000 {
        let stamp = format!(
            "2026-05-20T12:{:02}:{:02}.{:03}Z",
            k / 6000,
            (k / 100) % 60,
            10 * (k % 100)
        );
        let delta = format!(
            r#"{{"context":"vessels.self","updates":[{{"$source":"n2k.5","timestamp":"{stamp}","values":[
            {{"path":"navigation.headingTrue","value":1.5}},
            {{"path":"navigation.attitude","value":{{"roll":0.1,"pitch":-0.05,"yaw":1.5}}}}]}}]}}"#
        );
        socket.send(Message::text(delta)).unwrap();
        std::thread::sleep(Duration::from_millis(5));
        for m in &readings.all(0) {
            all.append(m);
        }
        if all.attitude.len() >= 20 && all.heading.len() >= 20 {
            break;
        }
    }
    assert!(all.attitude.len() >= 20 && all.heading.len() >= 20, "{all:?}");
    assert!(
        (all.attitude[0].tilt[0] - 0.1).abs() < 1e-9,
        "{:?}",
        all.attitude[0]
    );
    sensors.assert_stops();
}
