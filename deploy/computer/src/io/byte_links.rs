//! Several byte links; a separate task reads and writes each.

use std::{collections::BTreeMap, net::SocketAddr};

use tokio::sync::mpsc;

use crate::io::byte_link::ByteLink;

/// Maximum number of arrivals that wait for the reader; further bytes remain in the system's buffers.
const MAX_WAITING: usize = 16;
const MAX_UNSENT: usize = 16;

pub struct ByteArrival {
    pub link: usize,
    /// Received bytes, at most [`super::byte_link::MAX_AT_ONCE`].
    pub bytes: Vec<u8>,
    pub open: bool,
    pub error: Option<String>,
    /// Number of datagrams from foreign senders so far, and the newest sender.
    pub foreign: Option<(u64, SocketAddr)>,
}

pub struct ByteLinks {
    arrivals: mpsc::Receiver<ByteArrival>,
    out: BTreeMap<usize, mpsc::Sender<Vec<u8>>>,
}

impl ByteLinks {
    /// Starts reading the links inside a tokio runtime; the tasks end when the value is dropped.
    pub fn start(links: impl IntoIterator<Item = (usize, ByteLink)>) -> ByteLinks {
        let (to, arrivals) = mpsc::channel(MAX_WAITING);
        let start = |(number, link)| {
            let (sender, messages) = mpsc::channel(MAX_UNSENT);
            tokio::spawn(run(number, link, to.clone(), messages));
            (number, sender)
        };
        let out = links.into_iter().map(start).collect();
        ByteLinks { arrivals, out }
    }
    pub async fn next(&mut self) -> ByteArrival {
        match self.arrivals.recv().await {
            Some(arrival) => arrival,
            None => core::future::pending().await,
        }
    }
    pub fn arrived(&mut self) -> Option<ByteArrival> {
        self.arrivals.try_recv().ok()
    }
    /// Sends a message on a link; drops it if the link's queue is full.
    pub fn write(&self, link: usize, message: &[u8]) {
        let _lost = self.out.get(&link).map(|to| to.try_send(message.to_vec()));
    }
}

async fn run(
    number: usize,
    mut link: ByteLink,
    to: mpsc::Sender<ByteArrival>,
    mut messages: mpsc::Receiver<Vec<u8>>,
) {
    let mut foreign = None;
    let mut open = false;
    let mut bytes = Vec::new();
    loop {
        let news = (link.foreign_senders(), link.is_open()) != (foreign, open);
        foreign = link.foreign_senders();
        open = link.is_open();
        let arrival = ByteArrival {
            link: number,
            bytes: core::mem::take(&mut bytes),
            open,
            error: link.last_error(),
            foreign,
        };
        let something = !arrival.bytes.is_empty() || arrival.error.is_some() || news;
        if something && to.send(arrival).await.is_err() {
            return;
        }
        tokio::select! {
            () = link.read(|b| bytes.extend_from_slice(b)) => {}
            message = messages.recv() => match message {
                Some(message) => link.write(&message),
                None => return,
            },
        }
    }
}
