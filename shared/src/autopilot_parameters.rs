//! Parameters of PX4 and ArduCopter that a landing relies on, with limits and reasons.
//!
//! After set-point loss (companion, pilot or cable failed) the failsafe must stop the descent. A sink rate of `v` = 2.5
//! m/s, a timeout of `T` = 0.5 s and a deceleration of `a` = 8 m/s² need `v T + v² / (2 a)` = 1.6 m. This is the
//! mission's decision clearance, below which the plan sinks more slowly.

use core::fmt;

/// Requirement on a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// Within these bounds, inclusive; an infinite bound means no limit.
    Within(f64, f64),
    /// Equal to this value, given with its name.
    Is(f64, &'static str),
    /// One of these values, with their names.
    OneOf(&'static [(f64, &'static str)]),
    /// A bit mask with these bits.
    Bits(u32),
}

/// Consequence of an unsuitable value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// No landing is permitted.
    Reject,
    /// A landing may end worse than necessary.
    Warn,
}

/// Parameter of an autopilot, with its requirement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name in the autopilot.
    pub name: &'static str,
    /// Unit after a space, or empty.
    pub unit: &'static str,
    /// Requirement on the value.
    pub wanted: Wanted,
    /// Severity of an unsuitable value.
    pub severity: Severity,
    /// Effect of an unsuitable value.
    pub why: &'static str,
}

/// Unanswered requests after which the autopilot is assumed to lack a parameter.
pub const REQUESTS: u32 = 10;

/// PX4's parameters. After a lost link, at low battery or outside the fence, it must not fly to the home
/// position or land there: the boat has left it, and it is now open water.
///
/// Source: PX4's parameter reference (main): Commander, Geofence, Return Mode.
pub const PX4: &[Parameter] = &[
    Parameter {
        name: "COM_OF_LOSS_T",
        unit: " s",
        wanted: Wanted::Within(0.1, 0.5),
        severity: Severity::Reject,
        why: "the drone keeps descending for this time after the last set-point",
    },
    Parameter {
        name: "COM_OBL_RC_ACT",
        unit: "",
        wanted: Wanted::Is(5.0, "Hold"),
        severity: Severity::Reject,
        why: "without set-points it must stop above the deck, and stay on the deck until disarmed",
    },
    Parameter {
        name: "MPC_ACC_UP_MAX",
        unit: " m/s²",
        wanted: Wanted::Within(8.0, f64::INFINITY),
        severity: Severity::Reject,
        why: "this limits the deceleration of its descent without set-points",
    },
    // PX4's default is off, which is safer on the ground; instead, the set-points keep a minimum thrust.
    Parameter {
        name: "MC_AIRMODE",
        unit: "",
        wanted: Wanted::Within(1.0, 2.0),
        severity: Severity::Warn,
        why: "at low thrust its mixer cuts roll and pitch torque",
    },
    Parameter {
        name: "NAV_RCL_ACT",
        unit: "",
        wanted: Wanted::Is(1.0, "Hold"),
        severity: Severity::Warn,
        why: "when the remote control is lost it flies to where the boat was, or lands on the water",
    },
    Parameter {
        name: "NAV_DLL_ACT",
        unit: "",
        wanted: Wanted::OneOf(&[(0.0, "nothing"), (1.0, "Hold")]),
        severity: Severity::Warn,
        why: "when the ground station is lost it flies to where the boat was, or lands on the water",
    },
    Parameter {
        name: "COM_LOW_BAT_ACT",
        unit: "",
        wanted: Wanted::OneOf(&[(2.0, "Land"), (3.0, "Return, then Land")]),
        severity: Severity::Warn,
        why: "if Alight has failed for good it hovers until the battery is empty and falls",
    },
    Parameter {
        name: "BAT_CRIT_THR",
        unit: "",
        wanted: Wanted::Within(0.03, 0.08),
        severity: Severity::Warn,
        why: "COM_LOW_BAT_ACT acts below this charge, and must do so after Alight has chosen a landing place",
    },
    Parameter {
        name: "GF_ACTION",
        unit: "",
        wanted: Wanted::OneOf(&[(0.0, "nothing"), (1.0, "Warning"), (2.0, "Hold")]),
        severity: Severity::Warn,
        why: "beyond its fence it flies to where the boat was, or lands on the water",
    },
    Parameter {
        name: "RTL_LAND_DELAY",
        unit: " s",
        wanted: Wanted::Is(-1.0, "hovers"),
        severity: Severity::Warn,
        why: "a return must end in a hover until the pilot or Alight takes over: home may be water",
    },
    // With the defaults, checks of redundant sensors fail on a rocking deck.
    Parameter {
        name: "COM_ARM_IMU_ACC",
        unit: " m/s²",
        wanted: Wanted::Within(0.7, f64::INFINITY),
        severity: Severity::Warn,
        why: "it does not arm on a rocking deck",
    },
    Parameter {
        name: "COM_ARM_IMU_GYR",
        unit: " rad/s",
        wanted: Wanted::Within(0.25, f64::INFINITY),
        severity: Severity::Warn,
        why: "it does not arm on a rocking deck",
    },
    Parameter {
        name: "COM_ARM_MAG_STR",
        unit: "",
        wanted: Wanted::OneOf(&[(0.0, "off"), (2.0, "Warning only")]),
        severity: Severity::Warn,
        why: "it does not arm above a steel deck",
    },
];

/// ArduCopter's parameters, with the same failsafes as [`PX4`].
///
/// Source: ArduPilot's `ArduCopter/Parameters.cpp`, `AC_AttitudeControl_Multi.cpp`, `AP_BattMonitor_Params.cpp`,
/// `AC_Fence.cpp`, `AP_InertialSensor.cpp`, `AP_NavEKF_Source.cpp`.
pub const ARDU_COPTER: &[Parameter] = &[
    Parameter {
        name: "GUID_TIMEOUT",
        unit: " s",
        wanted: Wanted::Within(0.1, 0.5),
        severity: Severity::Reject,
        why: "the drone keeps descending for this time after the last set-point",
    },
    Parameter {
        name: THRUST_OPTION,
        unit: "",
        wanted: Wanted::Bits(8),
        severity: Severity::Reject,
        why: "it interprets the thrust of a set-point as a climb rate",
    },
    Parameter {
        name: "ATC_THR_MIX_MIN",
        unit: "",
        wanted: Wanted::Within(0.1, f64::INFINITY),
        severity: Severity::Warn,
        why: "at low thrust its mixer cuts roll and pitch torque",
    },
    Parameter {
        name: "FS_THR_ENABLE",
        unit: "",
        wanted: Wanted::OneOf(&[(0.0, "nothing"), (7.0, "Brake")]),
        severity: Severity::Warn,
        why: "when the remote control is lost it flies to where the boat was, or lands on the water",
    },
    Parameter {
        name: "FS_GCS_ENABLE",
        unit: "",
        wanted: Wanted::OneOf(&[(0.0, "nothing"), (7.0, "Brake")]),
        severity: Severity::Warn,
        why: "when the ground station is lost it flies to where the boat was, or lands on the water",
    },
    Parameter {
        name: "BATT_MONITOR",
        unit: "",
        wanted: Wanted::Within(3.0, f64::INFINITY),
        severity: Severity::Warn,
        why: "it reports no battery, and no take-off begins; 4 measures voltage and current",
    },
    Parameter {
        name: "BATT_FS_LOW_ACT",
        unit: "",
        wanted: Wanted::Is(0.0, "nothing"),
        severity: Severity::Warn,
        why: "on a low battery it flies to where the boat was, or lands on the water, before Alight has chosen a place",
    },
    Parameter {
        name: "BATT_FS_CRT_ACT",
        unit: "",
        wanted: Wanted::Is(1.0, "Land"),
        severity: Severity::Warn,
        why: "on a critical battery, if Alight has failed, it hovers until it falls or flies to where the boat was",
    },
    Parameter {
        name: "BATT_CRT_VOLT",
        unit: " V",
        wanted: Wanted::Within(3.0, f64::INFINITY),
        severity: Severity::Warn,
        why: "without a critical voltage BATT_FS_CRT_ACT never acts",
    },
    Parameter {
        name: "FENCE_ACTION",
        unit: "",
        wanted: Wanted::OneOf(&[(0.0, "report"), (4.0, "Brake")]),
        severity: Severity::Warn,
        why: "beyond its fence it flies to where the boat was, or lands on the water",
    },
    Parameter {
        name: "RTL_ALT_FINAL",
        unit: " cm",
        wanted: Wanted::Within(300.0, f64::INFINITY),
        severity: Severity::Warn,
        why: "a return must end in a hover until the pilot or Alight takes over: home may be water",
    },
    Parameter {
        name: "INS_GYR_CAL",
        unit: "",
        wanted: Wanted::Is(0.0, "Never"),
        severity: Severity::Warn,
        why: "it mistakes the rocking of the deck at start-up for a gyro bias: calibrate the gyros ashore",
    },
    Parameter {
        name: "EK3_SRC1_YAW",
        unit: "",
        wanted: Wanted::OneOf(&[(1.0, "compass"), (2.0, "GPS"), (3.0, "GPS, else compass")]),
        severity: Severity::Warn,
        why: "it has no heading on the deck and aligns it in flight",
    },
];

/// ArduCopter parameter that selects the meaning of a set-point's thrust.
pub const THRUST_OPTION: &str = "GUID_OPTIONS";

/// PX4's parameters, each with the number that identifies it in a reason.
pub fn of_px4() -> impl Iterator<Item = (usize, &'static Parameter)> {
    PX4.iter().enumerate()
}
/// ArduCopter's parameters, numbered after PX4's.
pub fn of_ardu_copter() -> impl Iterator<Item = (usize, &'static Parameter)> {
    ARDU_COPTER.iter().enumerate().map(|(k, p)| (PX4.len() + k, p))
}

/// Parameter that a reason identifies by this number.
pub(crate) fn numbered(number: f64) -> Option<&'static Parameter> {
    let mut all = of_px4().chain(of_ardu_copter());
    all.find(|(k, _)| *k as f64 == number).map(|(_, p)| p)
}

impl Wanted {
    /// A suitable value; for a mask its required bits only.
    pub fn value(&self) -> f64 {
        match self {
            Wanted::Within(low, high) if low.is_infinite() => *high,
            Wanted::Within(low, _) => *low,
            Wanted::Is(value, _) => *value,
            Wanted::OneOf(values) => values.first().map_or(0.0, |(value, _)| *value),
            Wanted::Bits(bits) => f64::from(*bits),
        }
    }
}

impl Parameter {
    /// Whether `value` is suitable. Autopilots store 32 bits.
    pub fn suits(&self, value: f64) -> bool {
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
        match self.wanted {
            Wanted::Within(low, high) => {
                (value >= low || same(value, low)) && (value <= high || same(value, high))
            }
            Wanted::Is(wanted, _) => same(value, wanted),
            Wanted::OneOf(values) => values.iter().any(|(wanted, _)| same(value, *wanted)),
            Wanted::Bits(bits) => (0.0..=1e9).contains(&value) && value as u32 & bits == bits,
        }
    }
    /// Message about this value; if it is unsuitable, with the suitable ones and the reason.
    pub fn describe(&self, value: f64) -> impl fmt::Display + use<> {
        Described(*self, value)
    }
}

struct Described(Parameter, f64);

impl fmt::Display for Described {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Described(p, value) = self;
        let unit = p.unit;
        // In single precision, as the autopilot displays it.
        write!(f, "{} is {}{unit}", p.name, *value as f32)?;
        if p.suits(*value) {
            return Ok(());
        }
        match p.wanted {
            Wanted::Within(low, high) if high.is_infinite() => write!(f, "; at least {low}{unit}")?,
            Wanted::Within(low, high) => write!(f, "; {low} to {high}{unit}")?,
            Wanted::Is(wanted, name) => write!(f, "; {wanted} ({name})")?,
            Wanted::OneOf(values) => {
                for (k, (wanted, name)) in values.iter().enumerate() {
                    let before = if k == 0 { ";" } else { " or" };
                    write!(f, "{before} {wanted} ({name})")?;
                }
            }
            Wanted::Bits(bits) => write!(f, "; one with {bits} added")?,
        }
        write!(f, " is needed: {}", p.why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> &'static Parameter {
        PX4.iter().chain(ARDU_COPTER).find(|p| p.name == name).unwrap()
    }

    #[test]
    fn parameter_limits_in_single_precision() {
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
            // A return to the boat's former position is as bad as a landing on water.
            ("FS_THR_ENABLE", &[0.0, 7.0], &[1.0, 3.0, 4.0, 5.0, f64::NAN]),
            ("NAV_RCL_ACT", &[1.0], &[2.0, 3.0, 5.0]),
            ("NAV_DLL_ACT", &[0.0, 1.0], &[2.0, 3.0]),
            // A drone whose companion has failed for good must not hover until it falls.
            ("COM_LOW_BAT_ACT", &[2.0, 3.0], &[0.0, 1.0]),
            ("BAT_CRIT_THR", &[0.05, 0.07], &[0.0, 0.1, 0.15]),
            ("GF_ACTION", &[0.0, 1.0, 2.0], &[3.0, 4.0, 5.0]),
            ("RTL_LAND_DELAY", &[-1.0], &[0.0, 30.0]),
            ("BATT_MONITOR", &[3.0, 4.0, 8.0], &[0.0]),
            ("BATT_FS_CRT_ACT", &[1.0], &[0.0, 2.0, 3.0, 5.0]),
            ("BATT_CRT_VOLT", &[13.2, 20.0], &[0.0]),
            ("FENCE_ACTION", &[0.0, 4.0], &[1.0, 2.0, 3.0]),
            ("RTL_ALT_FINAL", &[300.0, 1000.0], &[0.0, 50.0]),
            ("INS_GYR_CAL", &[0.0], &[1.0]),
            ("EK3_SRC1_YAW", &[1.0, 2.0, 3.0], &[0.0, 8.0]),
        ] {
            let p = named(name);
            assert!(good.iter().all(|v| p.suits(*v)), "{name}");
            assert!(!bad.iter().any(|v| p.suits(*v)), "{name}");
        }
    }

    #[test]
    fn parameter_description() {
        let text = |name: &str, value| named(name).describe(value).to_string();
        assert_eq!(
            text("COM_OF_LOSS_T", 1.0),
            "COM_OF_LOSS_T is 1 s; 0.1 to 0.5 s is needed: the drone keeps descending for this time after the last \
             set-point"
        );
        assert!(
            text("MPC_ACC_UP_MAX", 4.0).starts_with("MPC_ACC_UP_MAX is 4 m/s²; at least 8 m/s² is needed")
        );
        assert!(text("COM_OBL_RC_ACT", 0.0).contains("is 0; 5 (Hold) is needed"));
        assert!(text("GUID_OPTIONS", 1.0).contains("one with 8 added"));
        assert!(text("NAV_DLL_ACT", 2.0).contains("NAV_DLL_ACT is 2; 0 (nothing) or 1 (Hold) is needed"));
        assert_eq!(text("GUID_TIMEOUT", f64::from(0.3_f32)), "GUID_TIMEOUT is 0.3 s");
    }

    #[test]
    fn parameter_names() {
        assert!(PX4.iter().chain(ARDU_COPTER).all(|p| p.name.len() <= 16));
        assert!(of_px4().any(|(_, p)| p.name == "MC_AIRMODE"));
        assert!(of_ardu_copter().all(|(k, p)| p.name != "MC_AIRMODE" && numbered(k as f64) == Some(p)));
        assert!(of_px4().all(|(k, p)| numbered(k as f64) == Some(p)));
        assert_eq!(numbered((PX4.len() + ARDU_COPTER.len()) as f64), None);
        assert_eq!(numbered(f64::NAN), None);
    }

    #[test]
    fn parameters_that_stop_the_sink_above_the_deck() {
        let bounds = |name: &str| match named(name).wanted {
            Wanted::Within(low, high) => (low, high),
            other => panic!("{other:?}"),
        };
        let ((_, timeout), (braking, _)) = (bounds("COM_OF_LOSS_T"), bounds("MPC_ACC_UP_MAX"));
        let stop_m = 2.5 * timeout + 2.5 * 2.5 / (2.0 * braking);
        assert!(stop_m < 1.65, "{stop_m}");
    }
}
