//! Bytes to and from what is no computer of ours: sockets and serial ports.

pub mod byte_link;
pub mod link_url;
pub mod sensor_socket;
