//! Descriptors awaited by tokio: shared-memory ports, sockets and serial lines together.

use std::{
    fs::File,
    io,
    net::{TcpListener, TcpStream, UdpSocket},
    os::fd::AsRawFd,
};

use tokio::io::{Interest, unix::AsyncFd};

use super::memory::Listener;

/// Owner of one descriptor for its whole lifetime.
pub trait OwnsDescriptor: AsRawFd + private::Sealed {}

mod private {
    /// Prevents implementations outside this module.
    pub trait Sealed {}
}

macro_rules! owners {
    ($($owner:ty),*) => { $(impl private::Sealed for $owner {} impl OwnsDescriptor for $owner {})* };
}
owners!(File, TcpListener, TcpStream, UdpSocket, Listener);

/// Registers `inner` with tokio, inside a runtime. Its descriptor must be non-blocking.
#[allow(unsafe_code)]
pub fn watched<T: OwnsDescriptor>(inner: T, interest: Interest) -> io::Result<AsyncFd<T>> {
    // SAFETY: each owner has one descriptor, which stays open and unchanged until it is dropped with the result.
    let watched = unsafe { AsyncFd::register_with_interest(inner, interest) };
    watched.map_err(Into::into)
}
