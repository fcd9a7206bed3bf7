use std::net::SocketAddr;

use alight_shared::config;

pub const PAGE: &str = "127.0.0.1:7450";
/// Default address at which Foxglove looks for a server.
pub const FOXGLOVE: &str = "127.0.0.1:8765";

config! {
    /// View of a landing in progress: `alight view`.
    pub struct ViewConfig {
        /// The service also starts the viewers' server. Source: For boats with a display; the server uses a few per
        /// cent of a processor.
        pub on: bool = false;
        /// Address of the page for browsers. A loopback address is reachable from this computer only, a network
        /// address from every computer of that network. Source: Ours.
        pub listen: String = PAGE.into();
        /// Address at which Foxglove connects; empty: none.
        /// Source: Foxglove's usual port is 8765.
        pub foxglove: String = String::new();
        /// The page and `alight status` show wind and vessel speed in knots instead of m/s. Source: Unit that the
        /// crew uses.
        pub knots: bool = false;
        /// The page offers the crew's orders: abort on the drone's computer, closing the deck on the vessel's. Anyone
        /// who can open the page can give these orders.
        pub abort: bool = false;
    }
    check |this, at| {
        const ADDRESS: &str = "an address and a port, such as 127.0.0.1:7450";
        at.require(this.listen.parse::<SocketAddr>().is_ok(), "listen", &this.listen, ADDRESS)?;
        let foxglove = this.foxglove.is_empty() || this.foxglove.parse::<SocketAddr>().is_ok();
        at.require(foxglove, "foxglove", &this.foxglove, ADDRESS)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::config::{Check, Keys};

    #[test]
    fn invalid_view_addresses() {
        let rejected = |listen: &str, foxglove: &str| {
            let config = ViewConfig {
                listen: listen.into(),
                foxglove: foxglove.into(),
                ..ViewConfig::default()
            };
            config.check(&Keys::ROOT).err().map(|e| e.to_string())
        };
        assert_eq!(rejected(PAGE, ""), None);
        assert_eq!(rejected("[::1]:7450", FOXGLOVE), None);
        assert!(rejected("boat:7450", "").is_some_and(|e| e.contains("listen")));
        assert!(rejected(PAGE, "8765").is_some_and(|e| e.contains("foxglove")));
    }
}
