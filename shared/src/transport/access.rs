//! Access control of the radio: publishing rights by the name in a certificate, checked by zenoh on both
//! sides.
//!
//! Keys are `alight/NAME/TOPIC`, and NAME is the common name of the speaker's certificate. Everything
//! is denied but this: we publish our own keys, a peer publishes keys under its own name, and
//! either may subscribe. zenoh does not report a rejection to the publisher.

use serde_json::{Value, json};

/// Peers at most.
pub const PEERS: usize = 64;

/// Whether `name` can be one chunk of a key and a certificate's common name.
pub fn is_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 64
        && name
            .chars()
            .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

/// zenoh's `access_control` for a side that publishes `own` and listens to `peers`.
pub fn rules(own: &[String], peers: &[String]) -> Value {
    let rule = |id: &str, flows: &[&str], message: &str, keys: Value| {
        json!({
            "id": id, "permission": "allow", "flows": flows, "messages": [message], "key_exprs": keys,
        })
    };
    let mut rules = vec![rule(
        "subscribe",
        &["ingress", "egress"],
        "declare_subscriber",
        json!(["alight/**"]),
    )];
    let mut granted = vec!["subscribe"];
    if !own.is_empty() {
        rules.push(rule("speak", &["egress"], "put", json!(own)));
        granted.push("speak");
    }
    let mut policies = vec![json!({ "rules": granted, "subjects": peers })];
    for peer in peers {
        let id = format!("hear-{peer}");
        rules.push(rule(
            &id,
            &["ingress"],
            "put",
            json!([format!("alight/{peer}/**")]),
        ));
        policies.push(json!({ "rules": [id], "subjects": [peer] }));
    }
    let subjects: Vec<Value> = peers
        .iter()
        .map(|peer| json!({ "id": peer, "cert_common_names": [peer] }))
        .collect();
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn access_rules_by_name() {
        let own = vec!["alight/vessel-1/estimate".to_owned()];
        let peers = ["drone-1".to_owned(), "drone-2".to_owned()];
        let rules = rules(&own, &peers);
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rules.to_string()).unwrap();
        for peer in &peers {
            let id = format!("hear-{peer}");
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
        assert!(is_name("drone-12") && !is_name("drone/1") && !is_name("*") && !is_name(""));
    }
}
