//! Parameters of PX4 and ArduCopter that a landing relies on: what each must be, and why.
//!
//! Without set-points (companion, pilot or cable dead) the failsafe has to stop the descent: a sink of `v` = 2.5 m/s,
//! a timeout of `T` = 0.5 s and a braking of `a` = 8 m/s² need `v T + v² / (2 a)` = 1.6 m, the mission's decision
//! clearance, below which the plan sinks more slowly.

use core::fmt;

/// What a parameter must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// Between these, both included; an infinite one is no limit.
    Within(f64, f64),
    /// This value, and its name.
    Is(f64, &'static str),
    /// Any but this value, and its name.
    IsNot(f64, &'static str),
    /// A bit mask with these bits.
    Bits(u32),
}

/// What a value of another kind means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// No landing is permitted.
    Refuse,
    /// A landing may end worse than it has to.
    Warn,
}

/// One parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// The autopilot's name of it.
    pub name: &'static str,
    /// Unit, with a space before it, or nothing.
    pub unit: &'static str,
    /// What it must be.
    pub wanted: Wanted,
    /// What follows when it is not.
    pub severity: Severity,
    /// What happens when it is not.
    pub why: &'static str,
}

/// Requests without an answer after which a parameter counts as one that the autopilot does not have.
pub const REQUESTS: u32 = 10;

/// How many of [`PARAMETERS`] are PX4's; the others are ArduCopter's.
const PX4: usize = 4;

/// All of them: PX4's, then ArduCopter's.
///
/// Source: PX4's parameter reference (main), ArduPilot's `Parameters.cpp` and `AC_AttitudeControl_Multi.cpp`.
pub const PARAMETERS: [Parameter; 9] = [
    Parameter {
        name: "COM_OF_LOSS_T",
        unit: " s",
        wanted: Wanted::Within(0.1, 0.5),
        severity: Severity::Refuse,
        why: "for so long after the last set-point the drone sinks on",
    },
    Parameter {
        name: "COM_OBL_RC_ACT",
        unit: "",
        wanted: Wanted::Is(5.0, "Hold"),
        severity: Severity::Refuse,
        why: "without set-points it has to stop above the deck, and on the deck to stay for the disarm",
    },
    Parameter {
        name: "MPC_ACC_UP_MAX",
        unit: " m/s²",
        wanted: Wanted::Within(8.0, f64::INFINITY),
        severity: Severity::Refuse,
        why: "without set-points it brakes the sink with no more than this",
    },
    // Off is PX4's default, and on the ground the safer one; the set-points keep a least thrust instead.
    Parameter {
        name: "MC_AIRMODE",
        unit: "",
        wanted: Wanted::Within(1.0, 2.0),
        severity: Severity::Warn,
        why: "at little thrust its mixer cuts roll and pitch torque",
    },
    Parameter {
        name: "GUID_TIMEOUT",
        unit: " s",
        wanted: Wanted::Within(0.1, 0.5),
        severity: Severity::Refuse,
        why: "for so long after the last set-point the drone sinks on",
    },
    Parameter {
        name: THRUST_OPTION,
        unit: "",
        wanted: Wanted::Bits(8),
        severity: Severity::Refuse,
        why: "it takes the thrust of a set-point for a climb rate",
    },
    Parameter {
        name: "ATC_THR_MIX_MIN",
        unit: "",
        wanted: Wanted::Within(0.1, f64::INFINITY),
        severity: Severity::Warn,
        why: "at little thrust its mixer cuts roll and pitch torque",
    },
    Parameter {
        name: "FS_THR_ENABLE",
        unit: "",
        wanted: Wanted::IsNot(3.0, "Land"),
        severity: Severity::Warn,
        why: "when the remote control is lost it lands where it is, on the water",
    },
    Parameter {
        name: "FS_GCS_ENABLE",
        unit: "",
        wanted: Wanted::IsNot(5.0, "Land"),
        severity: Severity::Warn,
        why: "when the ground station is lost it lands where it is, on the water",
    },
];

/// ArduCopter's parameter of how it reads a set-point's thrust.
pub const THRUST_OPTION: &str = "GUID_OPTIONS";

/// Those of PX4 with their numbers in [`PARAMETERS`].
pub fn of_px4() -> impl Iterator<Item = (usize, &'static Parameter)> {
    PARAMETERS.iter().enumerate().take(PX4)
}
/// Those of ArduCopter with their numbers in [`PARAMETERS`].
pub fn of_ardu_copter() -> impl Iterator<Item = (usize, &'static Parameter)> {
    PARAMETERS.iter().enumerate().skip(PX4)
}

/// The parameter with this number, as a reason carries it.
pub(crate) fn numbered(number: f64) -> Option<&'static Parameter> {
    let mut all = PARAMETERS.iter().enumerate();
    all.find(|(k, _)| *k as f64 == number).map(|(_, p)| p)
}

impl Parameter {
    /// Whether `value` is as wanted. Autopilots keep 32 bits of it.
    pub fn suits(&self, value: f64) -> bool {
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
        match self.wanted {
            Wanted::Within(low, high) => {
                (value >= low || same(value, low)) && (value <= high || same(value, high))
            }
            Wanted::Is(wanted, _) => same(value, wanted),
            Wanted::IsNot(other, _) => value.is_finite() && !same(value, other),
            Wanted::Bits(bits) => (0.0..=1e9).contains(&value) && value as u32 & bits == bits,
        }
    }
    /// What a person reads about this value of it.
    pub fn describe(&self, value: f64) -> impl fmt::Display + use<> {
        Described(*self, value)
    }
}

struct Described(Parameter, f64);

impl fmt::Display for Described {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Described(p, value) = self;
        let unit = p.unit;
        // As the autopilot shows it, not with the digits of a wider float.
        write!(f, "{} is {}{unit}", p.name, *value as f32)?;
        if p.suits(*value) {
            return Ok(());
        }
        match p.wanted {
            Wanted::Within(low, high) if high.is_infinite() => write!(f, ", at least {low}{unit}")?,
            Wanted::Within(low, high) => write!(f, ", {low} to {high}{unit}")?,
            Wanted::Is(wanted, name) => write!(f, ", {wanted} ({name})")?,
            Wanted::IsNot(other, name) => write!(f, ", another than {other} ({name})")?,
            Wanted::Bits(bits) => write!(f, ", one with {bits} added")?,
        }
        write!(f, " is needed: {}", p.why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> &'static Parameter {
        PARAMETERS.iter().find(|p| p.name == name).unwrap()
    }

    #[test]
    fn parameters_suit_at_their_limits_in_single_precision_and_not_beyond() {
        for (name, good, bad) in [
            (
                "COM_OF_LOSS_T",
                &[0.1, 0.25, f64::from(0.5_f32)][..],
                &[0.0, 0.51, 1.0, f64::NAN][..],
            ),
            ("COM_OBL_RC_ACT", &[5.0], &[0.0, 4.0, f64::NAN]),
            ("MPC_ACC_UP_MAX", &[8.0, 15.0], &[4.0, 7.9]),
            (
                "GUID_OPTIONS",
                &[8.0, 9.0, 72.0],
                &[0.0, 7.0, -8.0, f64::INFINITY],
            ),
            ("FS_THR_ENABLE", &[0.0, 1.0], &[3.0, f64::NAN]),
        ] {
            let p = named(name);
            assert!(good.iter().all(|v| p.suits(*v)), "{name}");
            assert!(!bad.iter().any(|v| p.suits(*v)), "{name}");
        }
    }

    #[test]
    fn parameter_is_described_with_its_value_and_the_wanted_one() {
        let text = |name: &str, value| named(name).describe(value).to_string();
        assert_eq!(
            text("COM_OF_LOSS_T", 1.0),
            "COM_OF_LOSS_T is 1 s, 0.1 to 0.5 s is needed: for so long after the last set-point the drone sinks on"
        );
        assert!(
            text("MPC_ACC_UP_MAX", 4.0).starts_with("MPC_ACC_UP_MAX is 4 m/s², at least 8 m/s² is needed")
        );
        assert!(text("COM_OBL_RC_ACT", 0.0).contains("is 0, 5 (Hold) is needed"));
        assert!(text("GUID_OPTIONS", 1.0).contains("one with 8 added"));
        assert_eq!(text("GUID_TIMEOUT", f64::from(0.3_f32)), "GUID_TIMEOUT is 0.3 s");
    }

    #[test]
    fn parameters_have_names_that_fit_a_message_and_belong_to_one_firmware() {
        assert!(PARAMETERS.iter().all(|p| p.name.len() <= 16));
        assert!(of_px4().any(|(_, p)| p.name == "MC_AIRMODE"));
        assert!(of_ardu_copter().all(|(k, p)| p.name != "MC_AIRMODE" && numbered(k as f64) == Some(p)));
        assert_eq!(of_px4().count() + of_ardu_copter().count(), PARAMETERS.len());
        assert_eq!(numbered(f64::NAN), None);
    }

    #[test]
    fn parameters_that_suit_stop_the_sink_above_the_deck() {
        let least = |name: &str| match named(name).wanted {
            Wanted::Within(low, high) => (low, high),
            other => panic!("{other:?}"),
        };
        let ((_, timeout), (braking, _)) = (least("COM_OF_LOSS_T"), least("MPC_ACC_UP_MAX"));
        let stop_m = 2.5 * timeout + 2.5 * 2.5 / (2.0 * braking);
        assert!(stop_m < 1.65, "{stop_m}");
    }
}
