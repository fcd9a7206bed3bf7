//! WebSocket to a Signal K server, with text messages both ways. A silent server is pinged; without a reply the
//! connection is closed.

use std::{
    fs::{self, File},
    io::{self, ErrorKind},
    os::fd::OwnedFd,
    path::Path,
    sync::{Arc, OnceLock},
    time::Duration,
};

use alight_usv::sensors::MAX_SIGNALK_MESSAGE as MAX_MESSAGE;
use futures_util::{SinkExt, StreamExt};
use tokio::{
    net::{TcpStream, UnixStream},
    time::{Instant, timeout, timeout_at},
};
use tokio_tungstenite::{
    WebSocketStream, client_async_with_config,
    tungstenite::{
        Error, Message,
        client::IntoClientRequest,
        http::header::{AUTHORIZATION, HeaderValue},
        protocol::WebSocketConfig,
    },
};

/// Timeout of a connection, including the name lookup and the server's reply.
const CONNECT: Duration = Duration::from_secs(3);
const SEND: Duration = Duration::from_secs(3);
/// Silence after which the server is pinged; after the same time again the connection is closed. A server pings every
/// 30 s.
const SILENT: Duration = Duration::from_secs(10);
const MAX_REASON: usize = 120;
const MAX_TOKEN: u64 = 4096;

#[derive(Clone, Copy, Debug)]
pub enum Subscribe {
    Own,
    None,
}

pub struct SignalKSocket {
    stream: WebSocketStream<TcpStream>,
    /// Time by which the next message is expected.
    due: Instant,
    pinged: bool,
}

impl SignalKSocket {
    /// Connects to the server at `host` (`HOST:PORT`), with the token in a file if one is needed.
    pub async fn connect(
        host: &str,
        subscribe: Subscribe,
        token: Option<&Path>,
    ) -> io::Result<SignalKSocket> {
        let subscribe = match subscribe {
            Subscribe::Own => "self",
            Subscribe::None => "none",
        };
        // A value that the server cached long ago is not a measurement.
        let url = format!("ws://{host}/signalk/v1/stream?subscribe={subscribe}&sendCachedValues=false");
        let mut request = url.into_client_request().map_err(io::Error::other)?;
        if let Some(file) = token {
            request.headers_mut().insert(AUTHORIZATION, authorization(file)?);
        }
        let config = WebSocketConfig::default()
            .read_buffer_size(16 << 10)
            .write_buffer_size(0)
            .max_write_buffer_size(MAX_MESSAGE)
            .max_message_size(Some(MAX_MESSAGE))
            .max_frame_size(Some(MAX_MESSAGE));
        let connect = async {
            let stream = TcpStream::connect(host).await?;
            stream.set_nodelay(true)?;
            let connected = client_async_with_config(request, stream, Some(config)).await;
            connected.map_err(|e| rejected(&e))
        };
        let silent = |_| {
            let why = format!("no answer within {} s", CONNECT.as_secs());
            io::Error::new(ErrorKind::TimedOut, why)
        };
        let (stream, _) = timeout(CONNECT, connect).await.map_err(silent)??;
        Ok(SignalKSocket {
            stream,
            due: Instant::now() + SILENT,
            pinged: false,
        })
    }
    /// Waits for the next message. Cancelling the wait loses nothing.
    pub async fn receive(&mut self) -> io::Result<String> {
        loop {
            let Ok(message) = timeout_at(self.due, self.stream.next()).await else {
                if self.pinged {
                    let why = format!("the server is silent for {} s", 2 * SILENT.as_secs());
                    return Err(io::Error::new(ErrorKind::TimedOut, why));
                }
                self.pinged = true;
                self.due += SILENT;
                self.put(Message::Ping(Vec::<u8>::new().into())).await?;
                continue;
            };
            self.due = Instant::now() + SILENT;
            self.pinged = false;
            match message {
                Some(Ok(Message::Text(text))) => return Ok(text.as_str().to_owned()),
                None => return Err(closed("without a reason")),
                Some(Ok(Message::Close(frame))) => {
                    let close_reason = frame.map_or(String::new(), |f| f.to_string());
                    return Err(closed(if close_reason.is_empty() {
                        "without a reason"
                    } else {
                        &close_reason
                    }));
                }
                // The next poll answers pings.
                Some(Ok(_)) => {}
                Some(Err(e)) => return Err(io::Error::other(e)),
            }
        }
    }
    pub async fn send(&mut self, text: String) -> io::Result<()> {
        self.put(Message::text(text)).await
    }
    async fn put(&mut self, message: Message) -> io::Result<()> {
        let sent = timeout(SEND, self.stream.send(message)).await?;
        sent.map_err(io::Error::other)
    }
}

/// Reason why a stream of lines ended; empty while it runs.
#[derive(Clone, Debug, Default)]
pub struct SocketEnding(Arc<OnceLock<io::Error>>);

impl SocketEnding {
    /// Reason of the end, or the reader's `error` if no reason is recorded.
    pub fn reason(&self, error: io::Error) -> io::Error {
        let known = self.0.get();
        known.map_or(error, |e| io::Error::new(e.kind(), e.to_string()))
    }
}

/// Messages about the server's own vessel as a stream of lines, which ends with the connection.
pub async fn lines(host: &str, token: Option<&Path>) -> io::Result<(File, SocketEnding)> {
    let mut socket = SignalKSocket::connect(host, Subscribe::Own, token).await?;
    let (ours, theirs) = UnixStream::pair()?;
    let ending = SocketEnding::default();
    let end = ending.clone();
    tokio::spawn(async move {
        let why = loop {
            match socket.receive().await {
                // Inside a JSON message a line feed is white space.
                Ok(text) => {
                    let line = text.replace(['\n', '\r'], " ") + "\n";
                    if write(&ours, line.as_bytes()).await.is_err() {
                        return;
                    }
                }
                Err(why) => break why,
            }
        };
        let _first = end.0.set(why);
        drop(ours);
    });
    Ok((OwnedFd::from(theirs.into_std()?).into(), ending))
}

async fn write(stream: &UnixStream, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        stream.writable().await?;
        match stream.try_write(bytes) {
            Ok(n) => bytes = bytes.get(n..).unwrap_or_default(),
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Authorization header with the token, which is the single line of `file`.
fn authorization(file: &Path) -> io::Result<HeaderValue> {
    let doing = |e: io::Error| io::Error::new(e.kind(), format!("reading the token {}: {e}", file.display()));
    let metadata = fs::metadata(file).map_err(doing)?;
    let short = metadata.is_file() && metadata.len() <= MAX_TOKEN;
    let text = if short {
        fs::read_to_string(file).map_err(doing)?
    } else {
        String::new()
    };
    let header = HeaderValue::from_str(&format!("Bearer {}", text.trim())).ok();
    let mut header = header.filter(|_| !text.trim().is_empty()).ok_or_else(|| {
        doing(io::Error::new(
            ErrorKind::InvalidData,
            format!("not a file of at most {MAX_TOKEN} bytes with one line"),
        ))
    })?;
    header.set_sensitive(true);
    Ok(header)
}

fn closed(close_reason: &str) -> io::Error {
    let short: String = close_reason
        .chars()
        .filter(|c| !c.is_control())
        .take(MAX_REASON)
        .collect();
    let why = format!("the server closed the connection: {short}");
    io::Error::new(ErrorKind::UnexpectedEof, why)
}

fn rejected(e: &Error) -> io::Error {
    let what = match e {
        Error::Http(answer) if matches!(answer.status().as_u16(), 401 | 403) => {
            "the server asks for a token: let its administrator make one, and add ?token=FILE to the address"
                .into()
        }
        Error::Http(answer) => format!("the server answers {}: not a Signal K server", answer.status()),
        e => e.to_string(),
    };
    io::Error::new(ErrorKind::ConnectionAborted, what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;
    use tokio::net::TcpListener;
    use tokio_tungstenite::{
        accept_hdr_async,
        tungstenite::handshake::server::{ErrorResponse, Request, Response},
    };

    /// Simulated server: receives a client's messages, sends its own, and ends.
    async fn server(
        listener: TcpListener,
        messages: Vec<Message>,
        status: Option<u16>,
    ) -> (String, Option<HeaderValue>, Vec<Message>) {
        let (stream, _) = listener.accept().await.unwrap();
        let mut path = String::new();
        let mut token = None;
        #[allow(clippy::result_large_err)]
        let look = |request: &Request, response: Response| {
            path = request.uri().to_string();
            token = request.headers().get(AUTHORIZATION).cloned();
            let Some(status) = status else { return Ok(response) };
            let mut rejection = ErrorResponse::new(None);
            *rejection.status_mut() = status.try_into().unwrap();
            Err(rejection)
        };
        let mut received = Vec::new();
        if let Ok(mut socket) = accept_hdr_async(stream, look).await {
            for message in messages {
                let _sent = socket.send(message).await;
            }
            while let Some(Ok(message)) = socket.next().await {
                let is_text = message.is_text();
                received.push(message);
                if is_text {
                    break;
                }
            }
        }
        (path, token, received)
    }
    async fn listening() -> (TcpListener, String) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let host = listener.local_addr().unwrap().to_string();
        (listener, host)
    }

    #[tokio::test]
    async fn signalk_socket_both_ways_with_a_token() {
        let file = scratch("token");
        fs::write(&file, "eyJhbGci\n").unwrap();
        let (listener, host) = listening().await;
        let messages = vec![
            Message::Ping(vec![1_u8].into()),
            Message::text("{\"a\":\n1}"),
            Message::text("two"),
        ];
        let server = tokio::spawn(server(listener, messages, None));
        let mut socket = SignalKSocket::connect(&host, Subscribe::None, Some(&file))
            .await
            .unwrap();
        assert_eq!(socket.receive().await.unwrap(), "{\"a\":\n1}");
        assert_eq!(socket.receive().await.unwrap(), "two");
        socket.send("three".into()).await.unwrap();
        let (path, token, received) = server.await.unwrap();
        assert_eq!(path, "/signalk/v1/stream?subscribe=none&sendCachedValues=false");
        assert_eq!(token.unwrap(), "Bearer eyJhbGci");
        assert_eq!(
            received,
            [Message::Pong(vec![1_u8].into()), Message::text("three")]
        );
        assert!(socket.receive().await.is_err(), "it has ended");
        fs::remove_file(&file).unwrap();
        let e = authorization(&file).unwrap_err().to_string();
        assert!(e.contains(&file.display().to_string()), "{e}");
    }

    #[tokio::test]
    async fn signalk_server_that_asks_for_a_token() {
        for (status, why) in [(401, "?token=FILE"), (404, "not a Signal K server")] {
            let (listener, host) = listening().await;
            let server = tokio::spawn(server(listener, Vec::new(), Some(status)));
            let connected = SignalKSocket::connect(&host, Subscribe::Own, None).await;
            let e = connected.err().unwrap().to_string();
            assert!(e.contains(why), "{status}: {e}");
            server.await.unwrap();
        }
    }

    #[tokio::test]
    async fn signalk_message_that_is_too_long() {
        let (listener, host) = listening().await;
        let messages = vec![Message::text("x".repeat(MAX_MESSAGE + 1))];
        let server = tokio::spawn(server(listener, messages, None));
        let mut socket = SignalKSocket::connect(&host, Subscribe::Own, None).await.unwrap();
        let e = socket.receive().await.unwrap_err().to_string();
        assert!(e.contains("too long"), "{e}");
        drop(socket);
        server.await.unwrap();
    }

    #[tokio::test]
    async fn signalk_server_that_falls_silent() {
        let (listener, host) = listening().await;
        let server = tokio::spawn(server(listener, Vec::new(), None));
        let mut socket = SignalKSocket::connect(&host, Subscribe::Own, None).await.unwrap();
        socket.due = Instant::now();
        socket.pinged = true;
        let e = socket.receive().await.unwrap_err();
        assert_eq!(e.kind(), ErrorKind::TimedOut, "{e}");
        drop(socket);
        server.await.unwrap();
    }
}
