//! Findings on the radio's certificates, for `alight check` and for the status of a running vessel.

use alight_computer::certificates::RENEWAL_DAYS;
use alight_shared::msg::Certificate;

use super::finding::{Finding, FindingTopic};

fn is_loopback(endpoint: &str) -> bool {
    let host = endpoint.split_once('/').map_or(endpoint, |(_, host)| host);
    host.starts_with("127.") || host.starts_with("localhost:") || host.starts_with("[::1]")
}

/// Finding on a radio with these endpoints and no certificate.
pub fn none<'a>(endpoints: impl Iterator<Item = &'a str> + Clone) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("certificate");
    if endpoints.clone().any(|e| e.starts_with("quic/")) {
        return TOPIC.broken(
            "the radio's endpoint is quic/ but radio.tls names no files",
            "make them with alight keys and name them in radio.tls",
        );
    }
    if endpoints.clone().all(is_loopback) {
        return TOPIC.fine("none; only this computer can reach the radio");
    }
    TOPIC.warning(
        "the radio is not protected: any peer that reaches the port is accepted",
        "use quic/ endpoints with certificates of alight keys, or UDP on an address inside WireGuard only",
    )
}

pub fn judge(read: Result<&Certificate, &str>) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("certificate");
    let c = match read {
        Ok(certificate) => certificate,
        Err(why) => {
            let remedy = "copy the directory that alight keys made to the path in radio.tls, readable for the user alight";
            return TOPIC.broken(why, remedy);
        }
    };
    let path = &c.path;
    let renew = "make a new one with alight keys, copy it here, restart";
    match c.days_left {
        _ if c.in_future => {
            let found = format!("{path} is not valid yet by this computer's clock");
            TOPIC.broken(found, "set the clock")
        }
        days if days < 0 => TOPIC.broken(format!("{path} expired {} days ago", -days), renew),
        days if days < RENEWAL_DAYS => TOPIC.warning(format!("{path} expires in {days} days"), renew),
        days => TOPIC.fine(format!("{path}: {}, {days} days left", c.name)),
    }
}
