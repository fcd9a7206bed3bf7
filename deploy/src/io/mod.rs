//! Bytes and levels of other equipment: sockets, serial ports, digital lines.

pub mod byte_link;
pub mod byte_links;
pub mod digital_line;
pub mod mavlink_key;
pub mod peer;
pub mod runtime;
