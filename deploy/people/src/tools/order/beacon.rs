//! `alight order deck-at`: sends an operator's position of the vessel to the predictor on this computer. If
//! `mission.min_vessel` permits it, the drone then searches for the deck's tags there; it never lands without tags.

use alight_computer::{
    exit::{CliError, Exit},
    process::life::draw_boot,
    quantity::SECOND,
    subject::commanded_drone,
    terminal,
};
use alight_shared::{
    admission::Retransmission,
    msg::{BeaconSource, DeckBeacon, DeckForecast, Header, MAX_BEACON_LASTS_S, Message, VesselLevel},
    time::{DroneClock, SteadyClock, Time},
    topics,
};
use alight_transport::{
    clock::steady_ns,
    memory::{Publisher, Subscriber},
};
use serde_json::json;

use super::{CommandArgs, MAX_LASTING_S, POLL_PERIOD, join};

/// Speed uncertainty of a drifting vessel without a stated speed, m/s; for a stated speed, a tenth of that speed is
/// added.
const DRIFT_MPS: f64 = 0.3;
const STATED_SD_MPS: f64 = 0.1;
const LASTS_S: u32 = 300;

/// Latitude and longitude, deg, from the arguments of `deck-at`.
fn place(values: &[String]) -> Result<[f64; 2], CliError> {
    let wrong = || {
        CliError(format!(
            "deck-at {}: two numbers in degrees are needed, latitude (-90 to 90) and longitude (-180 to 180), as in \
             alight order deck-at 59.3456 18.1234",
            values.join(" ")
        ))
    };
    let [latitude, longitude] = values else {
        return Err(wrong());
    };
    let degrees = |number: &str, limit: f64| number.parse().ok().filter(|v: &f64| v.abs() <= limit);
    match (degrees(latitude, 90.0), degrees(longitude, 180.0)) {
        (Some(latitude), Some(longitude)) => Ok([latitude, longitude]),
        (_, _) => Err(wrong()),
    }
}

/// Velocity, north and east, m/s; an error for a moving vessel without a course.
fn velocity(speed: Option<f64>, course: Option<f64>) -> Result<[f64; 2], CliError> {
    let speed_mps = speed.unwrap_or_default();
    if speed_mps != 0.0 && course.is_none() {
        return Err(CliError(format!(
            "deck-at --speed {speed_mps}: --course DEG is required, too"
        )));
    }
    let (sin, cos) = course.unwrap_or_default().to_radians().sin_cos();
    Ok([speed_mps * cos, speed_mps * sin])
}

fn beacon(args: &CommandArgs, header: Header<DroneClock>) -> Result<DeckBeacon, CliError> {
    let [latitude_deg, longitude_deg] = place(&args.values)?;
    let beacon = DeckBeacon {
        header,
        source: BeaconSource::Operator,
        latitude_deg,
        longitude_deg,
        velocity: velocity(args.speed, args.course)?,
        place_sd_m: args.error,
        velocity_sd_mps: args.speed.map_or(DRIFT_MPS, |v| STATED_SD_MPS + 0.1 * v.abs()),
        lasts_s: f64::from(args.lasting(SECOND, MAX_LASTING_S, LASTS_S)?).clamp(1.0, MAX_BEACON_LASTS_S),
    };
    beacon.check().map_err(|field| {
        CliError(format!(
            "deck-at with {field} out of range: a vessel moves at 20 m/s at most, and its place is known to 1 to 1000 m"
        ))
    })?;
    Ok(beacon)
}

/// Rounding tolerance, s, within which the times of a forecast's beacon and of the given beacon are equal.
const SAME_S: f64 = 1e-5;

/// Standard deviation, m, and age, s, of a forecast's beacon if its time is that of the given beacon.
fn followed(f: &DeckForecast, given: Time<DroneClock>) -> Option<[f64; 2]> {
    let [_, age_s] = f.beacon?;
    let apart_s = (f.header.at - given).secs() - age_s;
    f.beacon.filter(|_| f.header.at > given && apart_s.abs() < SAME_S)
}

/// Sends the beacon to the predictor, and waits until a forecast reports it.
pub(super) fn run(args: &CommandArgs) -> Result<Exit, CliError> {
    place(&args.values)?;
    velocity(args.speed, args.course)?;
    let computer = commanded_drone(args.config.as_deref(), args.instance.as_deref(), false)?;
    if computer.drone.mission.min_vessel > VesselLevel::Beacon {
        return Err(CliError(
            "deck-at: this drone does not fly to beacons: set drone.mission.min_vessel = \"beacon\" (or \"tag\") first".into(),
        ));
    }
    let name = args.instance.as_ref().unwrap_or(&computer.instance);
    let memory = join(name, "alight-drone", "name a landing's with --instance")?;
    let mut forecasts: Subscriber<DeckForecast> = memory.subscriber()?;
    let mut beacons: Publisher<DeckBeacon> = memory.publisher()?;
    let given: Time<DroneClock> = computer.clock.read(steady_ns());
    let (vessel, drone) = (computer.bridge.vessel_id, computer.bridge.drone_id);
    let message = beacon(args, Header::new(vessel, drone, draw_boot(), 1, given))?;
    let now = || Time::<SteadyClock>::from_nanos(steady_ns());
    let mut sending = Retransmission::new(message, now(), topics::LOCAL_RETRIES);
    let mut taken = None;
    while !sending.is_over(now()) {
        let at: Time<DroneClock> = computer.clock.now();
        taken = forecasts
            .newest(at.nanos())
            .and_then(|f| followed(&f, given))
            .or(taken);
        if taken.is_some() {
            break;
        }
        beacons.send_any(sending.due(now()).as_ref());
        if !memory.wait(POLL_PERIOD) {
            return Ok(Exit::Failed);
        }
    }
    if args.json {
        terminal::line(json!({ "taken": taken.is_some(), "number": drone, "beacon": message }));
    } else {
        terminal::line(match taken {
            Some([sd_m, age_s]) => {
                format!("drone {drone}: vessel known by beacon, {sd_m:.0} m, {age_s:.1} s old")
            }
            None => format!(
                "drone {drone}: the predictor has not taken the position: alight status lists the processes. A more exact \
                 beacon takes precedence, and the autopilot has to report its origin first"
            ),
        });
    }
    Ok(Exit::of(taken.is_some()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Args, FromArgMatches};

    #[test]
    fn forecast_by_another_beacon() {
        let given = Time::from_secs(1000.0);
        let forecast = |at_s: f64, age_s: f64| DeckForecast {
            header: Header::new(1, 1, 1, 1, Time::from_secs(at_s)),
            beacon: Some([20.0, age_s]),
            ..DeckForecast::default()
        };
        assert_eq!(followed(&forecast(1000.4, 0.4), given), Some([20.0, 0.4]));
        for (at_s, age_s) in [(1000.4, 0.1), (1000.4, 3.0), (999.9, 0.0)] {
            assert_eq!(followed(&forecast(at_s, age_s), given), None, "{age_s} s old");
        }
        assert_eq!(followed(&DeckForecast::default(), given), None);
    }

    /// Impossible or incomplete values are rejected, because the most accurate beacon replaces all others.
    #[test]
    fn beacons_that_are_rejected() {
        let given = |options: &str| {
            let line = format!("command deck-at 59.3 18.1 {options}");
            let command = CommandArgs::augment_args(clap::Command::new("command"));
            let matches = command.try_get_matches_from(line.split_whitespace()).unwrap();
            let args = CommandArgs::from_arg_matches(&matches).unwrap();
            beacon(&args, Header::new(1, 1, 1, 1, Time::from_secs(1000.0)))
        };
        for good in ["", "--speed 0", "--speed 2 --course 90", "--error 1"] {
            assert!(given(good).is_ok(), "{good}");
        }
        for wrong in [
            "--error nan",
            "--error=-5",
            "--error 0.9",
            "--error 1001",
            "--speed 2",
            "--speed nan",
        ] {
            assert!(given(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn places_that_are_none() {
        let values = |text: &str| -> Vec<String> { text.split(' ').map(String::from).collect() };
        assert_eq!(place(&values("59.3456 -18.1234")).ok(), Some([59.3456, -18.1234]));
        for wrong in ["", "59.3", "59.3 18.1 4", "91 0", "59 181", "north 18", "NaN 0"] {
            assert!(place(&values(wrong)).is_err(), "{wrong}");
        }
    }
}
