//! Deltas from a Signal K server, one per line. Paths and units: Signal K's specification.

use alight_shared::geodesy::Datum;

/// Delta for the server's own vessel.
fn delta(at_ns: i64, values: &[(&str, String)]) -> Vec<u8> {
    let values: Vec<String> = values
        .iter()
        .map(|(path, value)| format!("{{\"path\":\"{path}\",\"value\":{value}}}"))
        .collect();
    let (stamp, values) = (stamp(at_ns), values.join(","));
    format!(
        "{{\"context\":\"vessels.self\",\"updates\":[{{\"$source\":\"n2k.35\",\"timestamp\":\"{stamp}\",\
         \"values\":[{values}]}}]}}\n"
    )
    .into_bytes()
}
/// ISO 8601 text, in ms, for a time since 1970.
fn stamp(at_ns: i64) -> String {
    let ms = at_ns.div_euclid(1_000_000);
    let (mut day, ms) = (ms.div_euclid(86_400_000), ms.rem_euclid(86_400_000));
    let leap = |year: i64| (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    let mut year = 1970;
    while day >= 365 + i64::from(leap(year)) {
        day -= 365 + i64::from(leap(year));
        year += 1;
    }
    let months = [
        31,
        28 + i64::from(leap(year)),
        31,
        30,
        31,
        30,
        31,
        31,
        30,
        31,
        30,
        31,
    ];
    let mut month = 1;
    for days in months {
        if day < days {
            break;
        }
        (day, month) = (day - days, month + 1);
    }
    let (hours, minutes, seconds) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60);
    format!(
        "{year:04}-{month:02}-{:02}T{hours:02}:{minutes:02}:{seconds:02}.{:03}Z",
        day + 1,
        ms % 1000
    )
}
fn place(place: Datum) -> String {
    let (latitude, longitude) = (place.latitude_deg, place.longitude_deg);
    format!("{{\"latitude\":{latitude},\"longitude\":{longitude}}}")
}

pub fn heading(at_ns: i64, heading: f64) -> Vec<u8> {
    let heading = heading.rem_euclid(core::f64::consts::TAU);
    delta(at_ns, &[("navigation.headingTrue", heading.to_string())])
}
pub fn rate_of_turn(at_ns: i64, rate: f64) -> Vec<u8> {
    delta(at_ns, &[("navigation.rateOfTurn", rate.to_string())])
}
pub fn heave(at_ns: i64, heave_m: f64) -> Vec<u8> {
    delta(at_ns, &[("environment.heave", heave_m.to_string())])
}
pub fn attitude(at_ns: i64, [roll, pitch]: [f64; 2]) -> Vec<u8> {
    let value = format!("{{\"roll\":{roll},\"pitch\":{pitch},\"yaw\":null}}");
    delta(at_ns, &[("navigation.attitude", value)])
}
/// Course and speed over ground, from the velocity to north and east, m/s.
pub fn velocity(at_ns: i64, [north, east]: [f64; 2]) -> Vec<u8> {
    let course = east.atan2(north).rem_euclid(core::f64::consts::TAU);
    let values = [
        ("navigation.courseOverGroundTrue", course.to_string()),
        ("navigation.speedOverGround", north.hypot(east).to_string()),
    ];
    delta(at_ns, &values)
}
pub fn position(at_ns: i64, at: Datum) -> Vec<u8> {
    delta(at_ns, &[("navigation.position", place(at))])
}
/// Fix of quality 1; the height is above the sea, which is `geoid_m` above the ellipsoid.
pub fn gnss(at_ns: i64, (at, geoid_m): (Datum, f64), hdop: f64) -> Vec<u8> {
    let values = [
        ("navigation.position", place(at)),
        ("navigation.gnss.methodQuality", "\"GNSS Fix\"".into()),
        (
            "navigation.gnss.antennaAltitude",
            (at.height_m - geoid_m).to_string(),
        ),
        ("navigation.gnss.geoidalSeparation", geoid_m.to_string()),
        ("navigation.gnss.horizontalDilution", hdop.to_string()),
    ];
    delta(at_ns, &values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_of_signalk() {
        for (at_ns, text) in [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_400_000_000_000, "2000-02-29T00:00:00.000Z"),
            (1_460_220_069_078_000_000, "2016-04-09T16:41:09.078Z"),
            (1_798_761_599_999_000_000, "2026-12-31T23:59:59.999Z"),
        ] {
            assert_eq!(stamp(at_ns), text);
        }
    }
}
