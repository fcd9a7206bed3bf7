//! Descriptors that tokio waits for. A port of the shared memory, a socket or a serial line can so be waited for together.

use std::fs::File;
use std::io;
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::fd::AsRawFd;

use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

use super::memory::Listener;

/// What owns one descriptor for as long as it lives.
pub trait OwnsDescriptor: AsRawFd + private::Sealed {}

mod private {
    /// Keeps the list of owners to those below.
    pub trait Sealed {}
}

macro_rules! owners {
    ($($owner:ty),*) => { $(impl private::Sealed for $owner {} impl OwnsDescriptor for $owner {})* };
}
owners!(File, TcpListener, TcpStream, UdpSocket, Listener);

/// `inner` as tokio waits for it, inside a runtime. Its descriptor must be non-blocking.
#[allow(unsafe_code)]
pub fn watched<T: OwnsDescriptor>(inner: T, interest: Interest) -> io::Result<AsyncFd<T>> {
    // SAFETY: each of the owners has one descriptor, which is open and the same until it is dropped with the result.
    let watched = unsafe { AsyncFd::register_with_interest(inner, interest) };
    watched.map_err(Into::into)
}
