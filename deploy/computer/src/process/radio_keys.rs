//! Keys of the radio.

use alight_shared::topics;

/// The key of `topic` as vessel `id` publishes it.
pub fn vessel_key(id: u32, topic: &str) -> String {
    format!("alight/vessel-{id}/{topic}")
}
/// The key of `topic` as drone `id` publishes it.
pub fn drone_key(id: &str, topic: &str) -> String {
    format!("alight/drone-{id}/{topic}")
}
/// The status of any drone. One chunk of a key is `drone-N`.
pub fn any_drone_status() -> String {
    format!("alight/drone-$*/{}", topics::DRONE_STATUS.name)
}
/// Commands of any operator.
pub fn any_operator_command() -> String {
    format!("alight/operator-$*/{}", topics::OPERATOR.name)
}
/// Time requests of any drone.
pub fn any_time_request() -> String {
    format!("alight/*/{}", topics::TIME_REQUEST.name)
}
