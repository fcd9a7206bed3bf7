use super::*;
use crate::io::link_end::serial;
use std::{
    fs::File,
    future::Future,
    io::Read,
    net::{TcpStream, UdpSocket},
    path::Path,
};
use tokio::time::timeout;

async fn read_at_least(link: &mut ByteLink, enough: usize) -> Vec<u8> {
    let mut all = Vec::new();
    let reading = async {
        while all.len() < enough {
            link.read(|b| all.extend_from_slice(b)).await;
        }
    };
    let _late = timeout(Duration::from_secs(5), reading).await;
    all
}

async fn reading<F: Future>(link: &mut ByteLink, of: F) -> F::Output {
    let mut of = core::pin::pin!(of);
    loop {
        tokio::select! {
            done = &mut of => return done,
            () = link.read(|_| {}) => {}
        }
    }
}

fn port(link: &ByteLink) -> SocketAddr {
    match &link.open {
        Some(Open::Udp { socket, .. }) => socket.get_ref().local_addr().unwrap(),
        Some(Open::Listening(listener)) => listener.socket.get_ref().local_addr().unwrap(),
        _ => panic!("not listening"),
    }
}

#[tokio::test]
async fn udp_link_with_a_second_peer() {
    let mut link = ByteLink::new(LinkUrl::UdpIn("127.0.0.1:0".into(), None))
        .await
        .unwrap();
    let at = port(&link);
    let [first, second] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    first.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
    link.write(b"no peer there");
    first.send_to(b"one", at).unwrap();
    assert_eq!(read_at_least(&mut link, 3).await, b"one");
    second.send_to(b"two", at).unwrap();
    first.send_to(b"three", at).unwrap();
    assert_eq!(read_at_least(&mut link, 5).await, b"three");
    link.write(b"answer");
    let mut buffer = [0; 16];
    assert_eq!(first.recv(&mut buffer).unwrap(), 6);
    assert_eq!(link.foreign(), 1);
}

#[tokio::test]
async fn udp_link_whose_first_sender_speaks_another_language() {
    let speaks: Speaks = std::sync::Arc::new(|datagram| datagram.starts_with(b"$GP"));
    let url = LinkUrl::UdpIn("127.0.0.1:0".into(), None);
    let mut link = ByteLink::with_peer(url, Some(speaks)).await.unwrap();
    let at = port(&link);
    let [wind, receiver] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    for _ in 0..3 {
        wind.send_to(b"$WIMWV", at).unwrap();
        receiver.send_to(b"$GPGGA", at).unwrap();
    }
    assert_eq!(read_at_least(&mut link, 18).await, b"$GPGGA$GPGGA$GPGGA");
    assert_eq!(link.foreign_senders(), Some((3, wind.local_addr().unwrap())));
}

#[tokio::test]
async fn connection_from_another_address() {
    let url = LinkUrl::TcpIn("127.0.0.1:0".into(), Some([10, 0, 0, 7].into()));
    let mut link = ByteLink::new(url).await.unwrap();
    let mut intruder = TcpStream::connect(port(&link)).unwrap();
    link.read(|_| {}).await;
    let why = link.last_error().unwrap();
    assert!(why.contains("is rejected") && link.opened() == 0, "{why}");
    assert!(matches!(link.open, Some(Open::Listening(_))));
    assert!(matches!(intruder.read(&mut [0; 1]), Ok(0) | Err(_)), "closed");
}

fn terminal() -> (std::os::fd::OwnedFd, String) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let line = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&line).unwrap();
    unlockpt(&line).unwrap();
    let path = ptsname(&line, Vec::new()).unwrap().into_string().unwrap();
    (line, path)
}

#[tokio::test]
async fn serial_port_open_in_another_program() {
    let (_line, path) = terminal();
    let first = serial(Path::new(&path), 115_200).unwrap();
    // The lock belongs to the open file, so a second open in the same program is also rejected.
    let url: LinkUrl = format!("serial://{path}:115200").parse().unwrap();
    let mut second = ByteLink::new(url).await.unwrap();
    second.read(|_| {}).await;
    let why = second.last_error().unwrap();
    assert!(why.contains("another program has this port open"), "{why}");
    assert_eq!(second.opened(), 0);
    // The second link opens the port once it is free. Unlike a real port, a pseudo-terminal stays exclusive except
    // for root.
    drop(first);
    if !rustix::process::geteuid().is_root() {
        return;
    }
    second.read(|_| {}).await;
    assert_eq!((second.opened(), second.last_error()), (1, None));
}

#[tokio::test]
async fn messages_through_a_full_line_are_whole() {
    let (line, path) = terminal();
    let url: LinkUrl = format!("serial://{path}:115200").parse().unwrap();
    let mut link = ByteLink::new(url).await.unwrap();
    link.read(|_| {}).await;
    assert_eq!(link.opened(), 1, "{:?}", link.last_error());
    // More than the line can hold: some messages are dropped whole, one is sent in two pieces.
    const MESSAGE: usize = 250;
    let messages: Vec<Vec<u8>> = (0..200_u8).map(|k| vec![k; MESSAGE]).collect();
    for message in &messages {
        link.write(message);
    }
    assert!(link.unsent() > 0);
    let reader = File::from(line);
    let read = tokio::task::spawn_blocking(move || {
        let mut all = Vec::new();
        let mut buffer = [0; 4096];
        while !all.ends_with(&[250; MESSAGE]) {
            let n = (&reader).read(&mut buffer).unwrap();
            all.extend_from_slice(&buffer[..n]);
        }
        all
    });
    let mut last = tokio::time::interval(Duration::from_millis(5));
    let mut read = core::pin::pin!(read);
    let all = loop {
        tokio::select! {
            all = &mut read => break all.unwrap(),
            () = link.read(|_| {}) => {}
            _ = last.tick() => link.write(&[250; MESSAGE]),
        }
    };
    assert_eq!(all.len() % MESSAGE, 0);
    for message in all.chunks(MESSAGE) {
        assert!(message.iter().all(|b| *b == message[0]), "half a message");
    }
}

async fn tcp_link() -> (tokio::net::TcpListener, ByteLink) {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = LinkUrl::TcpOut(listener.local_addr().unwrap().to_string());
    (listener, ByteLink::new(url).await.unwrap())
}

#[tokio::test]
async fn tcp_link_reconnects_after_the_peer_closed() {
    let (listener, mut link) = tcp_link().await;
    for round in 1..=3 {
        let (other, _) = reading(&mut link, listener.accept()).await.unwrap();
        other.try_write(b"hello").unwrap();
        assert_eq!(read_at_least(&mut link, 5).await, b"hello");
        link.write(b"yes");
        other.readable().await.unwrap();
        let mut buffer = [0; 8];
        assert_eq!(
            (other.try_read(&mut buffer).unwrap(), &buffer[..3]),
            (3, &b"yes"[..])
        );
        assert_eq!(link.opened(), round);
        drop(other);
        link.read(|_| {}).await;
        assert!(link.open.is_none() && link.last_error().is_some());
    }
}

#[tokio::test]
#[ignore = "needs a virtual CAN interface: ip link add vcan0 type vcan; ip link set vcan0 up"]
async fn frames_of_a_can_interface() {
    let mut link = ByteLink::new("can://vcan0".parse().unwrap()).await.unwrap();
    link.read(|_| {}).await;
    assert_eq!((link.opened(), link.last_error()), (1, None));
    let id: can_socket::ExtendedId = 0x09f8_0115_u32.try_into().unwrap();
    let bus = can_socket::CanSocket::bind("vcan0").unwrap();
    for k in 0..100_u8 {
        bus.send(&can_socket::CanFrame::new(id, [k; 8])).unwrap();
    }
    let line = |k: u8| format!("vcan0 09F80115#{}\n", format!("{k:02X}").repeat(8));
    let all: String = (0..100).map(line).collect();
    assert_eq!(
        String::from_utf8(read_at_least(&mut link, all.len()).await).unwrap(),
        all
    );
}

#[tokio::test]
async fn signalk_server_that_is_restarted() {
    use alight_usv::sensors::MAX_SIGNALK_MESSAGE;
    use futures_util::SinkExt;
    use tokio_tungstenite::{accept_async, tungstenite::Message};

    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = LinkUrl::SignalK(listener.local_addr().unwrap().to_string(), None);
    let mut link = ByteLink::new(url).await.unwrap();
    for round in 1..=2 {
        let accept = async { accept_async(listener.accept().await.unwrap().0).await.unwrap() };
        let mut server = reading(&mut link, accept).await;
        server.send(Message::text("{\"a\":\n1}")).await.unwrap();
        server.send(Message::text("{}")).await.unwrap();
        assert_eq!(read_at_least(&mut link, 12).await, b"{\"a\": 1}\n{}\n");
        assert_eq!(link.opened(), round);
        link.write(b"nothing is sent to it");
        let why = if round == 1 {
            server.close(None).await.unwrap();
            "the server closed the connection"
        } else {
            let _sent = server
                .send(Message::text("x".repeat(MAX_SIGNALK_MESSAGE + 1)))
                .await;
            "too long"
        };
        let mut error = None;
        while error.is_none() {
            link.read(|_| {}).await;
            error = link.last_error();
        }
        let error = error.unwrap();
        assert!(link.open.is_none() && error.contains(why), "{error}");
    }
}

#[tokio::test]
async fn link_backoff_doubles_up_to_a_bound() {
    let absent = LinkUrl::Serial("/nonexistent/tty".into(), 57600);
    let mut link = ByteLink::new(absent).await.unwrap();
    let mut tries = Vec::new();
    let mut waited = Duration::ZERO;
    while waited < Duration::from_secs(20) {
        link.next_try = Instant::now();
        link.read(|_| {}).await;
        assert!(link.last_error().is_some());
        let pause = link.next_try.duration_since(Instant::now());
        assert!(pause <= MAX_BACKOFF);
        waited += pause;
        tries.push(pause);
    }
    assert!(tries.len() <= 16, "{tries:?}");
}

#[tokio::test]
async fn link_that_opens_and_breaks_at_once() {
    let (listener, mut link) = tcp_link().await;
    for round in 0..4_u32 {
        link.next_try = Instant::now();
        let (other, _) = reading(&mut link, listener.accept()).await.unwrap();
        if round == 3 {
            other.try_write(b"hello").unwrap();
            assert_eq!(read_at_least(&mut link, 5).await, b"hello");
            assert_eq!(link.backoff, INITIAL_BACKOFF);
        }
        drop(other);
        while link.last_error().is_none() {
            link.read(|_| {}).await;
        }
        let doublings = if round == 3 { 1 } else { round + 1 };
        assert_eq!(link.backoff, INITIAL_BACKOFF * 2_u32.pow(doublings), "{round}");
    }
}

#[tokio::test]
async fn name_without_an_address_next_to_another_source() {
    use crate::io::byte_links::ByteLinks;

    // A label of this length is invalid, so no server is queried.
    let host = "x".repeat(64);
    for kind in ["ws", "tcpout", "udpout"] {
        let absent = format!("{kind}://{host}:3000");
        let absent: LinkUrl = absent.parse().unwrap();
        assert!(
            ByteLink::with_peer(absent.clone(), None).await.is_err(),
            "an autopilot's is rejected"
        );
        let absent = ByteLink::of_several(absent, None).await.unwrap();
        let own = ByteLink::of_several(LinkUrl::UdpIn("127.0.0.1:0".into(), None), None)
            .await
            .unwrap();
        let at = port(&own);
        let mut links = ByteLinks::start([(0, absent), (1, own)]);
        let sensor = UdpSocket::bind("127.0.0.1:0").unwrap();
        sensor.send_to(b"$HEHDT", at).unwrap();
        let mut why = None;
        let mut bytes = Vec::new();
        while why.is_none() || bytes.is_empty() {
            let next = timeout(Duration::from_secs(20), links.next()).await.unwrap();
            match next.link {
                0 => why = next.error,
                _ => bytes.extend(next.bytes),
            }
        }
        assert!(why.unwrap().contains("trying again"));
        assert_eq!(bytes, b"$HEHDT");
    }
}

#[tokio::test]
async fn link_rejects_a_port_in_use() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let url = LinkUrl::UdpIn(taken.local_addr().unwrap().to_string(), None);
    let Err(e) = ByteLink::new(url).await else {
        panic!("bound twice")
    };
    assert!(e.0.contains("opening udpin://127.0.0.1:"), "{e}");
}
