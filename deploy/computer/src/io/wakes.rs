//! Listeners of the topics that wake a row, awaited in tokio together with the row's edge.

use std::{future::poll_fn, task::Poll};

use alight_transport::{memory::Listener, readiness::watched};
use tokio::io::{Interest, unix::AsyncFd};

use crate::exit::{CliError, Doing};

pub struct Wakes(Vec<AsyncFd<Listener>>);

impl Wakes {
    /// Watches these listeners; needs a tokio runtime.
    pub fn watch(wakes: impl IntoIterator<Item = Listener>) -> Result<Wakes, CliError> {
        let watch = |listener| watched(listener, Interest::READABLE).doing("waiting for messages");
        Ok(Wakes(wakes.into_iter().map(watch).collect::<Result<_, _>>()?))
    }
    pub async fn woken(&self) -> Result<(), CliError> {
        let woken = poll_fn(|cx| {
            let mut woken = Poll::Pending;
            // Polls every listener, so that each wakes this task.
            for wake in &self.0 {
                match wake.poll_read_ready(cx) {
                    Poll::Ready(Ok(mut ready)) => {
                        wake.get_ref().drain();
                        ready.clear_ready();
                        woken = Poll::Ready(Ok(()));
                    }
                    Poll::Ready(Err(e)) => return Poll::Ready(Err(e)),
                    Poll::Pending => {}
                }
            }
            woken
        });
        woken.await.doing("waiting for messages")
    }
}
