//! `alight order station`: keeps a position next to the vessel for a while.

use std::ops::RangeInclusive;

use alight_computer::{
    exit::CliError,
    quantity::{MINUTE, whole},
};
use alight_shared::msg::{MAX_STATION_HEIGHT_M, MAX_STATION_M, MAX_STATION_MIN, Station};
use clap::Args;

use super::{CommandArgs, OrderArg};

/// Position of a station.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationArgs {
    /// station: above the deck, m [default: the approach's]
    ///
    /// Height above the deck's mean level, at least that of the approach.
    #[arg(long, value_name = "M", value_parser = whole::<u8>(1..=i64::from(MAX_STATION_HEIGHT_M)))]
    pub height: Option<u8>,
    /// station: ahead, m, negative astern
    ///
    /// Distance from the deck's centre.
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = whole::<i8>(METRES))]
    pub ahead: Option<i8>,
    /// station: to starboard, m [default: 20]
    ///
    /// A negative value is to port. With --ahead the default is 0.
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = whole::<i8>(METRES))]
    pub right: Option<i8>,
}

const METRES: RangeInclusive<i64> = -(MAX_STATION_M as i64)..=MAX_STATION_M as i64;

pub(super) fn ordered(args: &CommandArgs) -> Result<Station, CliError> {
    let given = &args.station;
    let given_min = args
        .lasting
        .map(|t| t.whole(MINUTE, &(1..=MAX_STATION_MIN.into())));
    let given_min = given_min.transpose().map_err(|e| CliError::because("--for", e))?;
    let for_min = given_min.map(|min| u8::try_from(min).unwrap_or_default());
    let station = Station::named([given.ahead, given.right], given.height, for_min);
    if station.is_sane() {
        return Ok(station);
    }
    Err(CliError(format!(
        "alight order station: at most {MAX_STATION_M} m from the deck's centre, --for 1 to {MAX_STATION_MIN} (min)"
    )))
}

pub(super) fn check(args: &CommandArgs) -> Result<(), CliError> {
    if args.station != StationArgs::default() && args.order != OrderArg::Station {
        return Err(CliError(
            "--height, --ahead and --right belong to alight order station".into(),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        command: CommandArgs,
    }

    fn read(arguments: &str) -> Option<CommandArgs> {
        let line = Line::try_parse_from(format!("command {arguments}").split(' '));
        line.ok().map(|line| line.command)
    }

    #[test]
    fn station_as_ordered() {
        let all = |arguments| {
            let s = read(arguments).and_then(|args| ordered(&args).ok())?;
            Some((s.height_m, s.ahead_m, s.right_m, s.for_min))
        };
        assert_eq!(all("station"), Some((0, 0, 20, 10)));
        assert_eq!(all("station --ahead -30 --for 5"), Some((0, -30, 0, 5)));
        assert_eq!(all("station --ahead -30 --for 300s"), Some((0, -30, 0, 5)));
        assert_eq!(all("station --height 25 --right -40"), Some((25, 0, -40, 10)));
        for wrong in [
            "station --right 61",
            "station --ahead 50 --right 50",
            "station --height 51",
            "station --for 31",
            "station --for 0",
            "station --for 300",
            "station --for 90s",
            "station --height NaN",
        ] {
            assert_eq!(all(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn station_options_belong_to_a_station() {
        assert!(check(&read("station --height 20").unwrap()).is_ok());
        assert!(check(&read("hold --height 20").unwrap()).is_err());
    }
}
