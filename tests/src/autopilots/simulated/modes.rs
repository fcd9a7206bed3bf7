use alight_shared::msg::AutopilotMode;
use alight_uav::autopilot::modes::{Firmware, px4_mode};

pub const fn own_mission(firmware: Firmware) -> u32 {
    match firmware {
        Firmware::Px4 => px4_mode(4, 4),
        Firmware::ArduCopter => 3,
    }
}

/// `Other` is the position mode of manual flight.
pub const fn mode_number(firmware: Firmware, mode: AutopilotMode) -> u32 {
    match (firmware, mode) {
        (Firmware::Px4, AutopilotMode::Other) => px4_mode(3, 0),
        (Firmware::Px4, AutopilotMode::Hold) => px4_mode(4, 3),
        (Firmware::Px4, AutopilotMode::Return) => px4_mode(4, 5),
        (Firmware::Px4, AutopilotMode::Land) => px4_mode(4, 6),
        (Firmware::Px4, AutopilotMode::Offboard) => px4_mode(6, 0),
        (Firmware::ArduCopter, AutopilotMode::Other) => 5,
        (Firmware::ArduCopter, AutopilotMode::Hold) => 17,
        (Firmware::ArduCopter, AutopilotMode::Return) => 6,
        (Firmware::ArduCopter, AutopilotMode::Land) => 9,
        (Firmware::ArduCopter, AutopilotMode::Offboard) => 4,
    }
}
