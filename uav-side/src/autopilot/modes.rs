//! Flight mode numbers of PX4 and ArduCopter.

use alight_shared::{autopilot_parameters::Maker, msg::AutopilotMode};
use serde::{Deserialize, Serialize};

use super::{
    config::Diversion,
    message::{MavAutopilot, MavType, ParameterValue},
};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Firmware {
    #[default]
    #[serde(rename = "px4")]
    Px4,
    #[serde(rename = "ardupilot")]
    ArduCopter,
}

impl Firmware {
    /// Firmware of a sender; None unless it is the autopilot of a multirotor or helicopter.
    pub fn of(autopilot: MavAutopilot, vehicle: MavType) -> Option<Firmware> {
        // Boats and planes use other mode numbers.
        let is_copter = matches!(
            vehicle,
            MavType::MAV_TYPE_QUADROTOR
                | MavType::MAV_TYPE_COAXIAL
                | MavType::MAV_TYPE_HELICOPTER
                | MavType::MAV_TYPE_HEXAROTOR
                | MavType::MAV_TYPE_OCTOROTOR
                | MavType::MAV_TYPE_TRICOPTER
                | MavType::MAV_TYPE_DODECAROTOR
                | MavType::MAV_TYPE_DECAROTOR
        );
        if !is_copter {
            return None;
        }
        Firmware::of_autopilot(autopilot as u8)
    }
    pub(crate) fn of_autopilot(number: u8) -> Option<Firmware> {
        [Firmware::Px4, Firmware::ArduCopter]
            .into_iter()
            .find(|f| f.autopilot() as u8 == number)
    }
    pub const fn autopilot(self) -> MavAutopilot {
        match self {
            Firmware::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
            Firmware::ArduCopter => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        }
    }
    /// Earth radius with which the firmware converts latitude and longitude to NED, m.
    /// Source: PX4's `CONSTANTS_RADIUS_OF_EARTH`; ArduPilot's `LATLON_TO_M`.
    pub const fn map_radius_m(self) -> f64 {
        match self {
            Firmware::Px4 => 6_371_000.0,
            Firmware::ArduCopter => 6_378_100.0,
        }
    }
    pub const fn maker(self) -> Maker {
        match self {
            Firmware::Px4 => Maker::Px4,
            Firmware::ArduCopter => Maker::ArduPilot,
        }
    }
    pub const fn name(self) -> &'static str {
        match self {
            Firmware::Px4 => "PX4",
            Firmware::ArduCopter => "ArduCopter",
        }
    }
    /// Flight mode with this custom mode number. PX4: main mode in bits 16 to 23, sub-mode above. ArduCopter:
    /// mode number.
    pub fn mode(self, custom: u32) -> AutopilotMode {
        match self {
            Firmware::Px4 => match ((custom >> 16) & 0xff, custom >> 24) {
                (6, _) => AutopilotMode::Offboard,
                (4, 3) => AutopilotMode::Hold,
                (4, 5) => AutopilotMode::Return,
                (4, 6 | 9) => AutopilotMode::Land,
                _ => AutopilotMode::Other,
            },
            Firmware::ArduCopter => match custom {
                4 => AutopilotMode::Offboard,
                17 => AutopilotMode::Hold,
                6 | 21 | 27 => AutopilotMode::Return,
                9 => AutopilotMode::Land,
                _ => AutopilotMode::Other,
            },
        }
    }
    /// Whether this is PX4's Mission or ArduCopter's AUTO.
    pub(crate) fn flies_mission(self, custom: u32) -> bool {
        match self {
            Firmware::Px4 => ((custom >> 16) & 0xff, custom >> 24) == (4, 4),
            Firmware::ArduCopter => custom == 3,
        }
    }
    /// Value of a parameter. PX4 copies an integer's bytes into the float; ArduCopter casts the integer.
    pub fn parameter(self, value: ParameterValue) -> f64 {
        match (self, value.integer) {
            (Firmware::Px4, true) => f64::from(value.bits.cast_signed()),
            (Firmware::Px4, false) | (Firmware::ArduCopter, _) => f64::from(f32::from_bits(value.bits)),
        }
    }
    pub fn parameter_value(self, value: f64, integer: bool) -> ParameterValue {
        let bits = match (self, integer) {
            (Firmware::Px4, true) => (value as i32).cast_unsigned(),
            (Firmware::Px4, false) | (Firmware::ArduCopter, _) => (value as f32).to_bits(),
        };
        ParameterValue { bits, integer }
    }
    /// Second and third parameter of `MAV_CMD_DO_SET_MODE` for the mode that follows set-points.
    pub(crate) const fn offboard(self) -> [f64; 2] {
        match self {
            Firmware::Px4 => [6.0, 0.0],
            Firmware::ArduCopter => [4.0, 0.0],
        }
    }
    pub fn diversion(self, to: Diversion) -> Option<[f64; 2]> {
        match (self, to) {
            (_, Diversion::None) => None,
            (Firmware::Px4, Diversion::Return) => Some([4.0, 5.0]),
            (Firmware::Px4, Diversion::Land) => Some([4.0, 6.0]),
            (Firmware::ArduCopter, Diversion::Return) => Some([6.0, 0.0]),
            (Firmware::ArduCopter, Diversion::Land) => Some([9.0, 0.0]),
        }
    }
}

pub const fn px4_mode(main: u32, sub: u32) -> u32 {
    main << 16 | sub << 24
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mode_numbers_of_the_firmwares() {
        let px4 = |main, sub| Firmware::Px4.mode(px4_mode(main, sub));
        assert_eq!(px4(6, 0), AutopilotMode::Offboard);
        assert_eq!(px4(4, 3), AutopilotMode::Hold);
        assert_eq!(px4(4, 5), AutopilotMode::Return);
        assert_eq!(px4(4, 6), AutopilotMode::Land);
        assert_eq!(px4(3, 0), AutopilotMode::Other);
        assert_eq!(px4(1, 0), AutopilotMode::Other);
        let copter = |n| Firmware::ArduCopter.mode(n);
        assert_eq!(copter(4), AutopilotMode::Offboard);
        assert_eq!(copter(9), AutopilotMode::Land);
        assert_eq!(copter(6), AutopilotMode::Return);
        // STABILIZE, and the number of PX4's OFFBOARD, which ArduCopter does not know.
        assert_eq!(copter(0), AutopilotMode::Other);
        assert_eq!(copter(px4_mode(6, 0)), AutopilotMode::Other);
    }

    #[test]
    fn boat_with_the_same_firmware() {
        use MavAutopilot::{MAV_AUTOPILOT_ARDUPILOTMEGA as ARDUPILOT, MAV_AUTOPILOT_PX4 as PX4};
        let copter = Firmware::of(ARDUPILOT, MavType::MAV_TYPE_QUADROTOR);
        assert_eq!(copter, Some(Firmware::ArduCopter));
        assert_eq!(
            Firmware::of(PX4, MavType::MAV_TYPE_HEXAROTOR),
            Some(Firmware::Px4)
        );
        assert_eq!(Firmware::of(ARDUPILOT, MavType::MAV_TYPE_SURFACE_BOAT), None);
        assert_eq!(Firmware::of(PX4, MavType::MAV_TYPE_FIXED_WING), None);
        let station = Firmware::of(MavAutopilot::MAV_AUTOPILOT_INVALID, MavType::MAV_TYPE_GCS);
        assert_eq!(station, None);
    }
}
