//! Limits of the messages' fields.

use alight_uav::autopilot::ground_station::{AGE, DISTANCE, WIND};

#[test]
fn names_of_values_of_ten_characters() {
    for name in [DISTANCE, AGE, WIND[0], WIND[1]] {
        assert!(name.len() <= 10, "{name}");
    }
}
