//! Access control of the radio: publishing rights by the name in a certificate, enforced by zenoh on both sides.
//!
//! Keys are `alight/NAME/TOPIC`, where NAME is the common name of the publisher's certificate. We publish our
//! own keys, a peer publishes and replies under its own name, and both may subscribe and query; all else is
//! forbidden. zenoh does not report a rejection to the publisher.

use alight_shared::msg::MAX_PEERS;
use serde_json::{Value, json};

/// Maximum size of a query with payload, bytes; ours have no payload.
const MAX_QUESTION_BYTES: usize = 256;
/// Maximum query rate per key and link, Hz. A drone queries once on connection. Ten links use up a key's reply rate.
const MAX_QUESTION_HZ: f64 = 2.0;

/// Key chunk under a name for the schemas of its messages; `**` of other programs does not match it.
pub const SCHEMA: &str = "@schema";
/// Subject of messages that come through a router, whose certificate name is configured.
const ROUTER: &str = "router";
pub const PEERS: usize = MAX_PEERS;

/// Whether `name` is valid as a key chunk and as a certificate's common name.
pub fn is_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 64
        && name
            .chars()
            .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

/// zenoh's `access_control` for a node whose keys begin with `name`, which publishes `own` and listens to
/// `peers`. Behind a router, all messages arrive under the name in its certificate. The peers' keys are then
/// permitted on its link, and the router must check which certificate may use which key.
pub fn rules(name: &str, own: &[String], peers: &[String], router: Option<&str>) -> Value {
    let both = ["ingress", "egress"];
    let rule = |id: &str, flows: &[&str], messages: &[&str], keys: Value| {
        json!({
            "id": id, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys,
        })
    };
    let keys_of = |name: &str| json!([format!("{name}/**"), format!("{name}/{SCHEMA}/**")]);
    let all = json!(["alight/**", format!("alight/*/{SCHEMA}/**")]);
    let listened = [
        "declare_subscriber",
        "declare_liveliness_subscriber",
        "liveliness_query",
        "query",
    ];
    let answered = ["reply", "declare_queryable", "liveliness_token"];
    let mut rules = vec![
        rule("subscribe", &both, &listened, all),
        rule("answer", &["egress"], &answered, keys_of(name)),
    ];
    let mut granted = vec!["subscribe", "answer"];
    if !own.is_empty() {
        rules.push(rule("speak", &["egress"], &["put"], json!(own)));
        granted.push("speak");
    }
    let subject = |peer: &str| router.map_or(peer, |_| ROUTER).to_owned();
    let subjects: Vec<(&str, &str)> = match router {
        Some(router) => vec![(ROUTER, router)],
        None => peers.iter().map(|p| (p.as_str(), p.as_str())).collect(),
    };
    let ids: Vec<&str> = subjects.iter().map(|(id, _)| *id).collect();
    let mut policies = vec![json!({ "rules": granted, "subjects": ids })];
    for peer in peers {
        let receive = format!("receive-{peer}");
        let answers = format!("answers-{peer}");
        let own = format!("alight/{peer}");
        rules.push(rule(
            &receive,
            &["ingress"],
            &["put"],
            json!([format!("{own}/**")]),
        ));
        rules.push(rule(&answers, &["ingress"], &answered, keys_of(&own)));
        policies.push(json!({ "rules": [receive, answers], "subjects": [subject(peer)] }));
    }
    let subjects: Vec<Value> = subjects
        .iter()
        .map(|(id, name)| json!({ "id": id, "cert_common_names": [name] }))
        .collect();
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    })
}

/// zenoh's `low_pass_filter`: oversized queries end without a reply before any of our code runs.
///
/// Not applied to messages: dropped ones are neither counted nor logged (zenoh 1.10.2 without `stats`,
/// `interceptor/low_pass.rs`), while `packets dropped` reveals a peer that sends too much. A message far
/// above the limit is never assembled (`transport/link/rx/max_message_size`).
pub fn question_sizes() -> Value {
    json!([{
        "flows": ["ingress"],
        "messages": ["query"],
        "key_exprs": ["alight/**", format!("alight/*/{SCHEMA}/**")],
        "size_limit": MAX_QUESTION_BYTES,
    }])
}

/// zenoh's `downsampling` per link: a peer that queries without pause cannot block replies to others. A
/// surplus query ends without a reply.
///
/// Not applied to messages: it keeps the first one of a period and drops later ones
/// (`interceptor/downsampling.rs`), such as the second of two orders, or the newest state.
pub fn question_rates(name: &str, own: &[String]) -> Value {
    let schemas = format!("{name}/{SCHEMA}/**");
    let keys = [&schemas].into_iter().chain(own);
    let rules: Vec<Value> = keys
        .map(|key| json!({ "key_expr": key, "freq": MAX_QUESTION_HZ }))
        .collect();
    json!([{ "flows": ["ingress"], "messages": ["query"], "rules": rules }])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn access_rules_by_name() {
        let own = vec!["alight/vessel-1/estimate".to_owned()];
        let peers = ["drone-1".to_owned(), "drone-2".to_owned()];
        let rules = rules("alight/vessel-1", &own, &peers, None);
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rules.to_string()).unwrap();
        for peer in &peers {
            let id = format!("receive-{peer}");
            let rule = rules["rules"]
                .as_array()
                .unwrap()
                .iter()
                .find(|r| r["id"] == *id)
                .unwrap();
            assert_eq!(rule["key_exprs"], json!([format!("alight/{peer}/**")]));
            let policy = rules["policies"].as_array().unwrap().iter();
            let to: Vec<_> = policy
                .filter(|p| p["rules"].as_array().unwrap().contains(&json!(id)))
                .collect();
            assert_eq!(to.len(), 1);
            assert_eq!(to[0]["subjects"], json!([peer]));
        }
        assert_eq!(
            rules["subjects"][1],
            json!({ "id": "drone-2", "cert_common_names": ["drone-2"] })
        );
        assert!(is_name("drone-12") && !is_name("drone/1") && !is_name("*") && !is_name(""));
    }

    #[test]
    fn access_rules_through_a_router() {
        let peers = ["drone-1".to_owned(), "drone-2".to_owned()];
        let rules = rules("alight/vessel-1", &[], &peers, Some("vessel-9"));
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rules.to_string()).unwrap();
        assert_eq!(
            rules["subjects"],
            json!([{ "id": ROUTER, "cert_common_names": ["vessel-9"] }])
        );
        for policy in rules["policies"].as_array().unwrap() {
            assert_eq!(policy["subjects"], json!([ROUTER]));
        }
    }
}
