//! Bytes and levels of other equipment: sockets, serial ports, CAN interfaces, digital lines.

pub mod byte_link;
pub mod byte_links;
pub mod can;
pub mod digital_line;
pub mod link_end;
pub mod mavlink_key;
pub mod peer;
pub mod runtime;
pub mod store;
pub mod wakes;
pub mod wall;
pub mod web_socket;
