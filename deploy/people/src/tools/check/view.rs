use std::net::SocketAddr;

use alight_computer::config::view::ViewConfig;

use crate::status::finding::{Finding, FindingTopic};

pub fn judge(view: &ViewConfig) -> Option<Finding> {
    const TOPIC: FindingTopic = FindingTopic("view");
    if !view.on {
        return None;
    }
    let alone = view
        .listen
        .parse()
        .is_ok_and(|a: SocketAddr| a.ip().is_loopback());
    Some(if alone || !view.abort {
        TOPIC.fine(format!("page at http://{}", view.listen))
    } else {
        TOPIC.warning(
            format!(
                "every browser that reaches http://{} can give the crew's order",
                view.listen
            ),
            "view.abort = false, or view.listen on loopback, unless that network is the crew's alone",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::FindingLevel;

    #[test]
    fn warning_of_orders_over_a_network() {
        let level = |on, listen: &str, abort| {
            let view = ViewConfig {
                on,
                listen: listen.into(),
                abort,
                ..ViewConfig::default()
            };
            judge(&view).map(|f| f.level)
        };
        assert_eq!(level(false, "192.168.7.1:7450", true), None);
        assert_eq!(level(true, "127.0.0.1:7450", true), Some(FindingLevel::Fine));
        assert_eq!(level(true, "192.168.7.1:7450", false), Some(FindingLevel::Fine));
        for listen in ["192.168.7.1:7450", "0.0.0.0:7450", "[::]:7450"] {
            assert_eq!(level(true, listen, true), Some(FindingLevel::Warning), "{listen}");
        }
    }
}
