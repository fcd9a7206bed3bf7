//! Separately removable parts of a measurement, and texts about them.

use alight_shared::msg::NOT_MEASURED_SD;

use super::{has_climb, has_height, has_place, has_velocity, standstill::Channel};
use crate::sensors::Measurement;

#[derive(Clone, Copy, Debug)]
pub(super) enum Part {
    Force,
    /// Roll and pitch. The whole attitude is removed with them.
    Tilt,
    Heading,
    /// Latitude and longitude of a fix.
    Place,
    /// Heave of an attitude.
    Heave,
    /// Angular rates of an attitude, compared with its roll and pitch.
    Rates,
    /// Yaw rate, compared with the heading.
    YawRate,
    /// Rate of turn of a heading.
    RateOfTurn,
    /// Velocity of a fix.
    Velocity,
    /// Vertical velocity of a fix.
    Climb,
    /// Height of a fix.
    Height,
}
pub(super) const PARTS: [Part; 11] = [
    Part::Force,
    Part::Tilt,
    Part::Heading,
    Part::Place,
    Part::Heave,
    Part::Rates,
    Part::YawRate,
    Part::RateOfTurn,
    Part::Velocity,
    Part::Climb,
    Part::Height,
];

/// Texts about a part: name, unit, unit in SI, compared quantity, remaining channels, remedy.
pub(super) struct Texts {
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    pub(super) factor: f64,
    pub(super) compared: &'static str,
    pub(super) used: &'static str,
    pub(super) remedy: &'static str,
}

impl Part {
    /// Removes the part. Returns false if the measurement does not have it.
    pub(super) fn leave_out(self, m: &mut Measurement) -> bool {
        match (self, m) {
            (Part::Heave, Measurement::Attitude(m)) => m.heave.take().is_some(),
            (Part::Rates | Part::YawRate, Measurement::Attitude(m)) => m.rates.take().is_some(),
            (Part::RateOfTurn, Measurement::Heading(m)) => m.rate.take().is_some(),
            (Part::Velocity, Measurement::Gnss(m)) => {
                let was_there = has_velocity(m);
                (m.velocity, m.velocity_sd) = ([0.0; 3], [NOT_MEASURED_SD; 3]);
                was_there
            }
            (Part::Climb, Measurement::Gnss(m)) => {
                let was_there = has_climb(m);
                (m.velocity[2], m.velocity_sd[2]) = (0.0, NOT_MEASURED_SD);
                was_there
            }
            (Part::Height, Measurement::Gnss(m)) => {
                let was_there = has_height(m);
                (m.datum.height_m, m.position[2], m.height_spread) = (0.0, 0.0, 0.0);
                m.position_sd[2] = NOT_MEASURED_SD;
                was_there
            }
            (Part::Place, Measurement::Gnss(m)) => {
                let was_there = has_place(m);
                (m.position_sd[0], m.position_sd[1]) = (NOT_MEASURED_SD, NOT_MEASURED_SD);
                was_there
            }
            (_, _) => false,
        }
    }
    pub(super) const fn is_whole(self) -> bool {
        matches!(self, Part::Tilt | Part::Heading | Part::Force)
    }
    /// Channels whose standstill applies to this part.
    pub(super) const fn channels(self) -> &'static [Channel] {
        match self {
            Part::Heave => &[Channel::Heave],
            Part::Rates => &[Channel::Rates],
            Part::RateOfTurn => &[Channel::RateOfTurn],
            Part::Height => &[Channel::Height],
            Part::Place => &[Channel::Place],
            Part::Tilt => &[Channel::Tilt, Channel::Roll, Channel::Pitch],
            Part::Heading => &[Channel::Heading],
            Part::YawRate | Part::Velocity | Part::Climb | Part::Force => &[],
        }
    }
    pub(super) fn texts(self) -> Texts {
        let degrees = 1_f64.to_degrees();
        let (name, unit, factor, compared, used, remedy) = match self {
            Part::Heave => (
                "heave",
                "m",
                1.0,
                "height",
                "roll and pitch are used",
                "set mount.heave = \"none\" for this source, or repair the sensor",
            ),
            Part::Rates => (
                "angular rate",
                "deg/s",
                degrees,
                "roll and pitch",
                "roll and pitch are used",
                "check unit, sign and mounting of the sensor's rates",
            ),
            Part::YawRate => (
                "yaw rate",
                "deg/s",
                degrees,
                "heading",
                "roll and pitch are used",
                "check unit, sign and mounting of the sensor's rates",
            ),
            Part::RateOfTurn => (
                "rate of turn",
                "deg/s",
                degrees,
                "heading",
                "the heading is used",
                "check unit and sign of the rate of turn at its sensor",
            ),
            Part::Velocity => (
                "velocity",
                "m/s",
                1.0,
                "position",
                "the position is used",
                "check the receiver's set-up, or replace it",
            ),
            Part::Climb => (
                "vertical velocity",
                "m/s",
                1.0,
                "height",
                "the height is used",
                "check its sign, or switch it off at the receiver",
            ),
            Part::Height => (
                "height",
                "m",
                1.0,
                "place",
                "latitude and longitude are used",
                "give the antenna a free view of the sky, or check the receiver's set-up",
            ),
            Part::Tilt => (
                "attitude",
                "deg",
                degrees,
                "heave",
                "no part of it is used",
                "check the sensor and its mount.mounting_deg",
            ),
            Part::Place => (
                "place",
                "deg",
                1.0,
                "velocity",
                "height and velocity are used",
                "restart the receiver, or check its set-up",
            ),
            Part::Heading => (
                "heading",
                "deg",
                degrees,
                "course",
                "no part of it is used",
                "check that the instrument is aligned, its set-up and its cable",
            ),
            Part::Force => (
                "specific force",
                "deg",
                degrees,
                "",
                "the sensor is not used",
                "set mount.mounting_deg of this source to the sensor's orientation in the vessel",
            ),
        };
        Texts {
            name,
            unit,
            factor,
            compared,
            used,
            remedy,
        }
    }
}
