//! Requests to the autopilot API (version 2) of a Signal K server, over HTTP, each on a connection of its own.
//!
//! A request is a line `METHOD PATH BODY`; its answer is the same line with the status and the body of the response behind it
//! (`alight_usv::helm`). HTTP 1.0 asks for a response that ends with its connection, in one part.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::timeout;

use crate::io::web_socket::authorization;

/// The default autopilot of a server.
const API: &str = "/signalk/v2/api/vessels/self/autopilots/_default";
/// A response has this long: a change is answered once the autopilot shows it.
const RESPONSE: Duration = Duration::from_secs(10);
/// Requests under way, at most: a look a second, and a change a second. What comes on top is left out, and comes again.
const MAX_REQUESTS: usize = 12;
/// Longest response, bytes.
const MAX_RESPONSE: usize = 16 << 10;

/// A server.
pub struct SignalKAutopilot {
    host: String,
    token: Option<PathBuf>,
    requests: JoinSet<io::Result<String>>,
}

impl SignalKAutopilot {
    /// At `HOST:PORT`, with the token in a file where it asks for one.
    pub fn of(host: String, token: Option<PathBuf>) -> SignalKAutopilot {
        SignalKAutopilot {
            host,
            token,
            requests: JoinSet::new(),
        }
    }
    /// Begins the requests of these lines, inside a tokio runtime.
    pub fn send(&mut self, lines: &[u8]) {
        for line in String::from_utf8_lossy(lines).lines() {
            if self.requests.len() < MAX_REQUESTS {
                let (host, token, line) = (self.host.clone(), self.token.clone(), line.to_owned());
                let request = async move { request(&host, token.as_deref(), &line).await };
                self.requests.spawn(request);
            }
        }
    }
    /// The answer to one of them that has come: a line.
    pub fn answered(&mut self) -> Option<io::Result<String>> {
        let done = self.requests.try_join_next()?;
        Some(done.map_err(io::Error::other).flatten())
    }
}

async fn request(host: &str, token: Option<&Path>, line: &str) -> io::Result<String> {
    let doing = |e: io::Error| io::Error::new(e.kind(), format!("the autopilot of ws://{host}: {e}"));
    let answered = timeout(RESPONSE, exchange(host, token, line)).await;
    let silent = |_| {
        let why = format!("no response within {} s", RESPONSE.as_secs());
        io::Error::new(ErrorKind::TimedOut, why)
    };
    let response = answered.map_err(silent).flatten().map_err(doing)?;
    let (status, body) = parts(&response).ok_or_else(|| {
        doing(io::Error::new(
            ErrorKind::InvalidData,
            "the response is not HTTP: see to the port, which is 3000 unless the address names one",
        ))
    })?;
    Ok(format!("{line} {status} {}\n", body.replace(['\n', '\r'], " ")))
}

/// The whole response, head and body.
async fn exchange(host: &str, token: Option<&Path>, line: &str) -> io::Result<String> {
    let mut fields = line.splitn(3, ' ');
    let (method, path) = (
        fields.next().unwrap_or_default(),
        fields.next().unwrap_or_default(),
    );
    let body = fields.next().filter(|_| method != "GET").unwrap_or_default();
    let authorization = match token {
        Some(file) => {
            let header = authorization(file)?;
            format!("Authorization: {}\r\n", header.to_str().unwrap_or_default())
        }
        None => String::new(),
    };
    let request = format!(
        "{method} {API}{} HTTP/1.0\r\nHost: {host}\r\n{authorization}Content-Type: application/json\r\nContent-Length: \
         {}\r\n\r\n{body}",
        path.trim_end_matches('/'),
        body.len()
    );
    let stream = TcpStream::connect(host).await?;
    let mut rest = request.as_bytes();
    while !rest.is_empty() {
        stream.writable().await?;
        match stream.try_write(rest) {
            Ok(n) => rest = rest.get(n..).unwrap_or_default(),
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            Err(e) => return Err(e),
        }
    }
    let (mut response, mut part) = (Vec::new(), [0; 4096]);
    while response.len() <= MAX_RESPONSE {
        stream.readable().await?;
        match stream.try_read(&mut part) {
            Ok(0) => return Ok(String::from_utf8_lossy(&response).into_owned()),
            Ok(n) => response.extend_from_slice(part.get(..n).unwrap_or_default()),
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            Err(e) => return Err(e),
        }
    }
    let why = format!("the response is longer than {MAX_RESPONSE} bytes");
    Err(io::Error::new(ErrorKind::InvalidData, why))
}

/// Status and body of a response.
fn parts(response: &str) -> Option<(u16, &str)> {
    let (head, body) = response.split_once("\r\n\r\n")?;
    let mut status = head.lines().next()?.split(' ');
    let version = status.next()?;
    let code = status.next()?.parse().ok()?;
    version.starts_with("HTTP/1.").then_some((code, body))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpListener;

    /// A server that gives one response to one request; what it was asked.
    fn server(response: &'static str) -> (String, std::thread::JoinHandle<String>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let host = listener.local_addr().unwrap().to_string();
        let asked = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut all, mut part) = (Vec::new(), [0; 1024]);
            while !all.ends_with(b"}") && !all.ends_with(b"\r\n\r\n") {
                let n = stream.read(&mut part).unwrap();
                all.extend_from_slice(&part[..n]);
            }
            stream.write_all(response.as_bytes()).unwrap();
            String::from_utf8(all).unwrap()
        });
        (host, asked)
    }
    async fn answer(autopilot: &mut SignalKAutopilot) -> io::Result<String> {
        loop {
            if let Some(answer) = autopilot.answered() {
                return answer;
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    #[tokio::test]
    async fn signalk_autopilot_requests_and_answers() {
        let (host, asked) = server("HTTP/1.1 200 OK\r\nContent-Length: 20\r\n\r\n{\"state\":\n\"standby\"}");
        let mut autopilot = SignalKAutopilot::of(host, None);
        autopilot.send(b"GET / {}\n");
        let line = answer(&mut autopilot).await.unwrap();
        assert_eq!(line, "GET / {} 200 {\"state\": \"standby\"}\n");
        let head = format!("GET {API} HTTP/1.0\r\n");
        let text = asked.join().unwrap();
        assert!(
            text.starts_with(&head) && text.ends_with("Content-Length: 0\r\n\r\n"),
            "{text}"
        );

        let file = std::env::temp_dir().join(format!("alight-pilot-token-{}", std::process::id()));
        std::fs::write(&file, "eyJhbGci\n").unwrap();
        let (host, asked) = server("HTTP/1.1 403 Forbidden\r\n\r\n");
        let mut autopilot = SignalKAutopilot::of(host, Some(file.clone()));
        autopilot.send(b"PUT /target {\"value\":0.7}\n");
        let line = answer(&mut autopilot).await.unwrap();
        assert_eq!(line, "PUT /target {\"value\":0.7} 403 \n");
        let text = asked.join().unwrap();
        assert!(
            text.starts_with(&format!("PUT {API}/target HTTP/1.0\r\n")),
            "{text}"
        );
        assert!(text.contains("\r\nAuthorization: Bearer eyJhbGci\r\n"), "{text}");
        assert!(
            text.ends_with("Content-Length: 13\r\n\r\n{\"value\":0.7}"),
            "{text}"
        );
        std::fs::remove_file(&file).unwrap();
    }

    #[tokio::test]
    async fn signalk_autopilot_that_is_not_there() {
        let (host, asked) = server("SSH-2.0-OpenSSH_9.6\r\n");
        let mut autopilot = SignalKAutopilot::of(host.clone(), None);
        autopilot.send(b"GET / {}\n");
        let e = answer(&mut autopilot).await.unwrap_err().to_string();
        assert!(e.contains(&host) && e.contains("not HTTP"), "{e}");
        asked.join().unwrap();
        // A flood is not passed on.
        autopilot.send(&b"GET / {}\n".repeat(100));
        assert_eq!(autopilot.requests.len(), MAX_REQUESTS);
    }
}
