//! Names on the wire, as rmw_zenoh makes them: key expressions of topics and services, liveliness tokens of nodes and
//! their entities in ROS's graph, and the attachment of each message.
//!
//! Sources: ros2/rmw_zenoh, its design document and `rmw_zenoh_cpp/src/detail/liveliness_utils.cpp`; pyzeros 0.1.0.
//! For Humble: ros2/rmw_zenoh pull requests 388 and 572, PX4/PX4-Autopilot pull request 26619.

use alight_computer::exit::CliError;
use clap::ValueEnum;
use xxhash_rust::xxh3::xxh3_128;

use crate::ros2::messages::RosType;

pub const MAX_DOMAIN: u32 = 232;
const MAX_NAMESPACE: usize = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entity {
    Publisher,
    Server,
}

impl Entity {
    const fn letters(self) -> &'static str {
        match self {
            Entity::Publisher => "MP",
            Entity::Server => "SS",
        }
    }
}

/// Distribution of ROS 2. Before Iron, types have no hashes; publishers and receivers with different key forms do not
/// exchange messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Distro {
    /// Keys without hashes (rmw_zenoh 0.1).
    Humble,
    /// Keys with hashes (rmw_zenoh 0.2).
    #[default]
    Jazzy,
    /// Keys with hashes, as for Jazzy.
    Kilted,
}

const NO_HASH: &str = "TypeHashNotSupported";

impl Distro {
    /// Last part of a key on which this type is published.
    fn hash(self, kind: &RosType) -> &'static str {
        match self {
            Distro::Humble => NO_HASH,
            Distro::Jazzy | Distro::Kilted => kind.hash,
        }
    }
    /// Whether the token belongs to a session that exchanges no messages with a node of this distribution.
    pub fn is_apart(self, token: &str) -> bool {
        let mut parts = token.split('/');
        match self {
            Distro::Humble => parts.any(|part| part.starts_with("RIHS01_")),
            Distro::Jazzy | Distro::Kilted => parts.any(|part| part == NO_HASH),
        }
    }
    pub const fn remedy(self) -> &'static str {
        match self {
            Distro::Humble => {
                "a session of a distribution later than ROS 2 Humble receives nothing: start alight ros2 --distro \
                 jazzy for it"
            }
            Distro::Jazzy | Distro::Kilted => {
                "a session of ROS 2 Humble receives nothing: start alight ros2 --distro humble for it"
            }
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Absolute name, such as `/alight/drone_1/odometry`.
    pub name: String,
    pub kind: RosType,
    pub entity: Entity,
    /// Number of messages that a receiver is to keep (quality of service: reliable, volatile, keep last).
    pub depth: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosNode {
    domain: u32,
    namespace: String,
    name: String,
    distro: Distro,
}

/// Whether `part` is valid between the slashes of a ROS name.
fn is_name(part: &str) -> bool {
    let starts = part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    starts && part.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

impl RosNode {
    /// Node in this domain and namespace, such as `alight` or `fleet/alight`; empty: the root.
    pub fn new(domain: u32, namespace: &str, name: String, distro: Distro) -> Result<RosNode, CliError> {
        let inner = namespace.trim_matches('/');
        let fits = inner.is_empty() || inner.split('/').all(is_name) && inner.len() <= MAX_NAMESPACE;
        if !fits {
            return Err(CliError(format!(
                "the namespace {namespace:?}: letters, digits and _ in parts between /, none of which begins with a \
                 digit; {MAX_NAMESPACE} at most"
            )));
        }
        let namespace = if inner.is_empty() {
            String::new()
        } else {
            format!("/{inner}")
        };
        Ok(RosNode {
            domain,
            namespace,
            name,
            distro,
        })
    }
    pub fn name(&self) -> &str {
        &self.name
    }
    pub fn distro(&self) -> Distro {
        self.distro
    }
    /// Key expression of the tokens of all nodes in the domain.
    pub fn tokens(&self) -> String {
        format!("@ros2_lv/{}/**", self.domain)
    }
    /// Absolute name of the private name `~/name`.
    pub fn private(&self, name: &str) -> String {
        format!("{}/{}/{name}", self.namespace, self.name)
    }
    /// Key on which a topic is published or a service answers.
    pub fn key(&self, at: &Endpoint) -> String {
        let name = at.name.trim_start_matches('/');
        let hash = self.distro.hash(&at.kind);
        format!("{}/{name}/{}/{hash}", self.domain, at.kind.name)
    }
    pub fn token(&self, zid: &str) -> String {
        // The node is entity 0.
        format!("{}/0/NN/{}", self.of_session(zid), self.place())
    }
    /// Liveliness token of a topic or service, which is the entity with this `number` in the node.
    pub fn token_of(&self, zid: &str, number: usize, at: &Endpoint) -> String {
        let depth = at.depth;
        format!(
            "{}/{number}/{}/{}/{}/{}/{}/::,{depth}:,:,:,,",
            self.of_session(zid),
            at.entity.letters(),
            self.place(),
            escaped(&at.name),
            at.kind.name,
            self.distro.hash(&at.kind)
        )
    }
    fn of_session(&self, zid: &str) -> String {
        format!("@ros2_lv/{}/{zid}/0", self.domain)
    }
    /// Part of a token: the enclave of SROS 2, which is empty; the namespace; the name.
    fn place(&self) -> String {
        format!("%/{}/{}", escaped(&self.namespace), self.name)
    }
}

fn escaped(name: &str) -> String {
    if name.is_empty() {
        return "%".into();
    }
    name.replace('/', "%")
}

/// Identity of a sender in the form of rmw_zenoh: a hash of its token.
pub fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

/// Length of the gid; in an attachment it precedes the gid.
const GID_LENGTH: u8 = 16;
/// Sequence number, time, length, gid.
const ATTACHMENT_BYTES: usize = 8 + 8 + 1 + 16;
const TIME: core::ops::Range<usize> = 8..16;

/// Attachment of a message: sequence number, time of sending (ns since 1970), sender.
pub fn attachment(number: i64, sent_ns: i64, gid: [u8; 16]) -> Vec<u8> {
    let mut all = Vec::with_capacity(ATTACHMENT_BYTES);
    all.extend(number.to_le_bytes());
    all.extend(sent_ns.to_le_bytes());
    all.push(GID_LENGTH);
    all.extend(gid);
    all
}

/// Sending time of a message with this attachment, ns since 1970 by its sender's clock; None if the attachment is
/// invalid.
pub fn sent_ns(attachment: &[u8]) -> Option<i64> {
    let bytes = attachment.get(TIME)?.try_into().ok()?;
    Some(i64::from_le_bytes(bytes))
}

/// Attachment of the response to a request: the same number and gid, by which the client recognises it, and the time.
/// None if the request's attachment is invalid; newer versions of rmw_zenoh omit the gid's length.
pub fn response_attachment(request: &[u8], sent_ns: i64) -> Option<Vec<u8>> {
    let fits = (ATTACHMENT_BYTES - 1..=ATTACHMENT_BYTES).contains(&request.len());
    let mut all = fits.then(|| request.to_vec())?;
    all.get_mut(TIME)?.copy_from_slice(&sent_ns.to_le_bytes());
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::messages::{RosMessage, RosOdometry, TRIGGER, TfMessage};

    // From pyzeros 0.1.0: `token_keyexpr`, `publisher_keyexpr` and `rmw_zenoh_gid` for these names.
    const ZID: &str = "aabbccddeeff00112233445566778899";
    const SESSION: &str = "@ros2_lv/0/aabbccddeeff00112233445566778899/0/";
    const GID: &str = "5911a5503778ca320ecf58280fb03ec7";

    fn drone(namespace: &str) -> RosNode {
        RosNode::new(0, namespace, "drone_1".into(), Distro::Jazzy).unwrap()
    }
    fn publisher<M: RosMessage>(name: String, depth: u32) -> Endpoint {
        Endpoint {
            name,
            kind: M::TYPE,
            entity: Entity::Publisher,
            depth,
        }
    }

    #[test]
    fn ros_keys_and_tokens() {
        let node = drone("alight");
        assert_eq!(node.token(ZID), format!("{SESSION}0/NN/%/%alight/drone_1"));
        let odometry = publisher::<RosOdometry>(node.private("odometry"), 10);
        let kind = format!("nav_msgs::msg::dds_::Odometry_/{}", RosOdometry::TYPE.hash);
        assert_eq!(node.key(&odometry), format!("0/alight/drone_1/odometry/{kind}"));
        let token = node.token_of(ZID, 1, &odometry);
        let place = "MP/%/%alight/drone_1/%alight%drone_1%odometry";
        assert_eq!(token, format!("{SESSION}1/{place}/{kind}/::,10:,:,:,,"));
        let hex: String = gid(&token).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(hex, GID);

        let tf = node.token_of(ZID, 2, &publisher::<TfMessage>("/tf".into(), 100));
        assert!(tf.contains("/%tf/tf2_msgs::msg::dds_::TFMessage_/"), "{tf}");
        assert!(tf.ends_with("/::,100:,:,:,,"), "{tf}");
        let land = Endpoint {
            name: node.private("land"),
            kind: TRIGGER,
            entity: Entity::Server,
            depth: 10,
        };
        let kind = format!("std_srvs::srv::dds_::Trigger_/{}", TRIGGER.hash);
        assert_eq!(node.key(&land), format!("0/alight/drone_1/land/{kind}"));
        let place = "SS/%/%alight/drone_1/%alight%drone_1%land";
        assert_eq!(
            node.token_of(ZID, 3, &land),
            format!("{SESSION}3/{place}/{kind}/::,10:,:,:,,")
        );
    }

    /// Form of a Humble key by PX4/PX4-Autopilot pull request 26619 and copper-project/copper-rs issue 1222.
    #[test]
    fn ros_keys_of_humble_without_hashes() {
        let node = |distro| RosNode::new(0, "alight", "drone_1".into(), distro).unwrap();
        let humble = node(Distro::Humble);
        let jazzy = node(Distro::Jazzy);
        let odometry = publisher::<RosOdometry>(humble.private("odometry"), 10);
        let kind = "nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported";
        assert_eq!(humble.key(&odometry), format!("0/alight/drone_1/odometry/{kind}"));
        let token = humble.token_of(ZID, 1, &odometry);
        let place = "MP/%/%alight/drone_1/%alight%drone_1%odometry";
        assert_eq!(token, format!("{SESSION}1/{place}/{kind}/::,10:,:,:,,"));
        let land = Endpoint {
            name: humble.private("land"),
            kind: TRIGGER,
            entity: Entity::Server,
            depth: 10,
        };
        let kind = "std_srvs::srv::dds_::Trigger_/TypeHashNotSupported";
        assert_eq!(humble.key(&land), format!("0/alight/drone_1/land/{kind}"));
        // Each distribution recognises the other by the tokens of entities; a node's token has no type.
        let hashed = jazzy.token_of(ZID, 1, &odometry);
        assert_eq!(
            hashed.replace(RosOdometry::TYPE.hash, "TypeHashNotSupported"),
            token
        );
        for distro in [Distro::Jazzy, Distro::Kilted] {
            assert!(distro.is_apart(&token) && !distro.is_apart(&hashed), "{distro:?}");
        }
        assert!(Distro::Humble.is_apart(&hashed) && !Distro::Humble.is_apart(&token));
        for distro in [Distro::Humble, Distro::Jazzy, Distro::Kilted] {
            assert!(!distro.is_apart(&humble.token(ZID)));
        }
        assert!(Distro::Jazzy.remedy().contains("alight ros2 --distro humble"));
        assert_eq!(humble.tokens(), "@ros2_lv/0/**");
    }

    #[test]
    fn ros_namespaces() {
        assert_eq!(
            drone("/fleet/alight/").private("land"),
            "/fleet/alight/drone_1/land"
        );
        let root = drone("");
        assert_eq!(root.private("land"), "/drone_1/land");
        assert!(root.token(ZID).ends_with("/NN/%/%/drone_1"));
        let long = "a".repeat(MAX_NAMESPACE + 1);
        for wrong in ["a b", "1a", "a//b", "a/*", "a/$b", "~", &long] {
            let node = RosNode::new(0, wrong, "drone_1".into(), Distro::Jazzy);
            assert!(node.is_err(), "{wrong}");
        }
    }

    #[test]
    fn ros_attachments() {
        // From pyzeros 0.1.0: `Attachment(...).serialize()[4:]`.
        let gid: [u8; 16] = core::array::from_fn(|k| k as u8);
        let all = attachment(7, 1_700_000_000_123_456_789, gid);
        let hex: String = all.iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(
            hex,
            "070000000000000015cd853dfe9c971710000102030405060708090a0b0c0d0e0f"
        );
        assert_eq!(sent_ns(&all), Some(1_700_000_000_123_456_789));
        assert_eq!(sent_ns(&all[..15]), None);
        assert_eq!(response_attachment(&all, 5), Some(attachment(7, 5, gid)));
        assert!(response_attachment(&all[..32], 5).is_some_and(|r| r.len() == 32));
        for length in [0, 8, 31] {
            assert_eq!(response_attachment(&all[..length], 5), None);
        }
        assert_eq!(response_attachment(&[0; 34], 5), None);
    }
}
