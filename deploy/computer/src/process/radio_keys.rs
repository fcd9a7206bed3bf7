use alight_shared::topics;

pub fn vessel_key(id: u32, topic: &str) -> String {
    format!("alight/vessel-{id}/{topic}")
}
pub fn drone_key(id: &str, topic: &str) -> String {
    format!("alight/drone-{id}/{topic}")
}
/// Key expression of the status of every drone; the key has the chunk `drone-N`.
pub fn any_drone_status() -> String {
    format!("alight/drone-$*/{}", topics::DRONE_STATUS.name)
}
pub fn any_operator_command() -> String {
    format!("alight/operator-$*/{}", topics::OPERATOR.name)
}
pub fn any_time_request() -> String {
    format!("alight/*/{}", topics::TIME_REQUEST.name)
}
