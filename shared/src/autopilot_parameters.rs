//! Parameters of PX4 and ArduCopter that a landing relies on: one table for the documents, `alight check`, `alight
//! explain`, the link and the simulated autopilots.
//!
//! After set-point loss (companion, pilot or cable failed) the failsafe must stop the descent. A sink rate of `v` = 2.5
//! m/s, a timeout of `T` = 0.5 s and a deceleration of `a` = 8 m/s² need `v T + v² / (2 a)` = 1.6 m. This is the
//! mission's decision clearance, below which the plan sinks more slowly.
//!
//! While Alight commands, every other failsafe must leave the mode alone. A Hold or Brake stands still while the deck
//! rises into the drone. A return flies to where the boat was, and a landing ends in the water.
//!
//! Sources: PX4's `*params.c` and `*params.yaml` of Commander, Navigator, Battery and the multicopter controllers (1.16,
//! 1.17, 1.18 beta); ArduPilot's `ArduCopter/Parameters.cpp` and ParameterRepository (4.5 to 4.7).

use core::fmt;

/// Requirement on a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// From the first to the second value, inclusive (infinite: no limit); the third is the value to set.
    Within(f64, f64, f64),
    /// Equal to this value, given with its name.
    Is(f64, &'static str),
    /// One of these values, with their names; the first is the value to set.
    OneOf(&'static [(f64, &'static str)]),
    /// A bit mask with these bits.
    Bits(u32),
    /// Any value: no value is good in every case, and the reason explains the choice.
    Any,
}

/// Consequence of an unsuitable value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// No landing is permitted.
    Reject,
    /// A landing may end worse than necessary.
    Warn,
}

/// Maker of a firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Maker {
    /// PX4.
    Px4,
    /// ArduPilot; its multirotor firmware is ArduCopter.
    ArduPilot,
}

/// Version of a firmware: major and minor number.
pub type Version = [u8; 2];

/// Versions from the first on, before the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Versions {
    /// First version.
    pub from: Version,
    /// First version that is excluded.
    pub before: Version,
}

impl Versions {
    /// All versions.
    pub const ALL: Versions = Versions {
        from: [0, 0],
        before: [u8::MAX; 2],
    };
    const fn since(from: Version) -> Versions {
        Versions {
            from,
            ..Versions::ALL
        }
    }
    const fn before(before: Version) -> Versions {
        Versions {
            before,
            ..Versions::ALL
        }
    }
    /// Whether `version` is one of these.
    pub fn contain(&self, version: Version) -> bool {
        self.from <= version && version < self.before
    }
}

impl fmt::Display for Versions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Versions { from, before } = *self;
        if from != Versions::ALL.from {
            write!(f, " from {}.{} on", from[0], from[1])?;
        }
        if before != Versions::ALL.before {
            write!(f, " before {}.{}", before[0], before[1])?;
        }
        Ok(())
    }
}

/// Parameter of an autopilot, with its requirement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Maker of the firmware.
    pub maker: Maker,
    /// Versions of the firmware with this name, unit and requirement.
    pub versions: Versions,
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

/// ArduCopter parameter that selects the meaning of a set-point's thrust.
pub const THRUST_OPTION: &str = "GUID_OPTIONS";

const INFINITY: f64 = f64::INFINITY;
const ALL: Versions = Versions::ALL;
/// PX4 1.18 has a Hold for a lost remote control that leaves OFFBOARD alone.
const BEFORE_1_18: Versions = Versions::before([1, 18]);
const SINCE_1_18: Versions = Versions::since([1, 18]);
/// ArduCopter 4.7 renamed parameters in centimetres to metres.
const BEFORE_4_7: Versions = Versions::before([4, 7]);
const SINCE_4_7: Versions = Versions::since([4, 7]);

const SINKS: &str = "the drone keeps descending for this time after the last set-point";
const BRAKES: &str = "this limits the deceleration of its descent without set-points";
const MIXER: &str = "at low thrust its mixer cuts roll and pitch torque";
const REMOTE: &str = "when the remote control is lost it flies to where the boat was, or lands on the water";
const REMOTE_NEAR: &str = "when the remote control is lost near the deck it holds, and the deck rises into the drone; \
                           otherwise the landing continues, and only an abort by radio stops it";
const STATION: &str = "when the ground station is lost it leaves the landing: it holds while the deck rises, or flies \
                       to where the boat was";
const RESCUE: &str = "Alight lands by the charge. 0 leaves its last descent alone; the others end it, but land a drone whose computer has \
     failed, over water too";
const FENCE: &str = "the boat may leave a fence; beyond it the drone leaves the landing: it holds while the deck rises, \
                     or flies to where the boat was";
const HOME: &str = "a return must end in a hover until the pilot or Alight takes over: home may be water";
const ARMS: &str = "it does not arm on a rocking deck";

/// Makes rows from the columns maker, versions, name, unit, requirement, severity, effect.
macro_rules! rows {
    ($($maker:ident, $versions:expr, $name:literal, $unit:literal, $wanted:expr, $severity:ident, $why:expr;)*) => {
        &[$(Parameter {
            maker: Maker::$maker,
            versions: $versions,
            name: $name,
            unit: $unit,
            wanted: $wanted,
            severity: Severity::$severity,
            why: $why,
        }),*]
    };
}
use Wanted::{Any, Bits, Is, OneOf, Within};

/// Every parameter that a landing relies on. A row's index identifies it in a reason.
#[rustfmt::skip]
pub const PARAMETERS: &[Parameter] = rows! {
    Px4, ALL, "COM_OF_LOSS_T", " s", Within(0.1, 0.5, 0.25), Reject, SINKS;
    ArduPilot, ALL, "GUID_TIMEOUT", " s", Within(0.1, 0.5, 0.3), Reject, SINKS;
    Px4, ALL, "COM_OBL_RC_ACT", "", Is(5.0, "Hold"), Reject,
        "without set-points it must stop above the deck, and stay on the deck until disarmed";
    Px4, ALL, "MPC_ACC_UP_MAX", " m/s²", Within(8.0, INFINITY, 8.0), Reject, BRAKES;
    Px4, ALL, "MPC_JERK_AUTO", " m/s³", Within(30.0, INFINITY, 30.0), Warn, BRAKES;
    ArduPilot, ALL, "GUID_OPTIONS", "", Bits(8), Reject, "it interprets the thrust of a set-point as a climb rate";
    Px4, ALL, "MC_AIRMODE", "", Within(1.0, 2.0, 1.0), Warn, MIXER;
    ArduPilot, ALL, "ATC_THR_MIX_MIN", "", Within(0.1, INFINITY, 0.1), Warn, MIXER;
    Px4, BEFORE_1_18, "NAV_RCL_ACT", "", Is(1.0, "Hold"), Warn, REMOTE;
    Px4, SINCE_1_18, "NAV_RCL_ACT", "", Is(7.0, "Hold, not in OFFBOARD"), Warn, REMOTE_NEAR;
    ArduPilot, ALL, "FS_THR_ENABLE", "", OneOf(&[(7.0, "Brake"), (0.0, "nothing")]), Warn, REMOTE;
    Px4, BEFORE_1_18, "COM_RCL_EXCEPT", "", Bits(4), Warn, REMOTE_NEAR;
    ArduPilot, ALL, "FS_OPTIONS", "", Bits(4), Warn, REMOTE_NEAR;
    Px4, ALL, "NAV_DLL_ACT", "", Is(0.0, "nothing"), Warn, STATION;
    ArduPilot, ALL, "FS_GCS_ENABLE", "", Is(0.0, "nothing"), Warn, STATION;
    Px4, SINCE_1_18, "MAN_OVERRIDE_SPD", " 1/s", Any, Warn,
        "a stick moved faster than this ends OFFBOARD: the pilot's quickest takeover; -1 switches it off";
    ArduPilot, ALL, "FS_DR_ENABLE", "", Is(0.0, "nothing"), Warn,
        "when GNSS is lost it flies to where the boat was, or lands on the water, at once; 0 leaves FS_DR_TIMEOUT to land";
    ArduPilot, ALL, "FS_EKF_ACTION", "", Any, Warn,
        "no value is good: Land (1) ends in the water, AltHold (2) drifts until the pilot steers, 0 (from 4.7 on) flies on \
         by a wrong estimate";
    Px4, ALL, "COM_LOW_BAT_ACT", "", OneOf(&[(0.0, "a warning"), (3.0, "Return, then Land"), (2.0, "Land")]), Warn, RESCUE;
    ArduPilot, ALL, "BATT_FS_CRT_ACT", "", OneOf(&[(0.0, "nothing"), (1.0, "Land")]), Warn, RESCUE;
    Px4, ALL, "BAT_CRIT_THR", "", Within(0.03, 0.08, 0.05), Warn,
        "COM_LOW_BAT_ACT acts below this charge, and must do so after Alight has chosen a landing place";
    ArduPilot, ALL, "BATT_FS_LOW_ACT", "", Is(0.0, "nothing"), Warn,
        "on a low battery it flies to where the boat was, or lands on the water, before Alight has chosen a place";
    ArduPilot, ALL, "BATT_MONITOR", "", Within(3.0, INFINITY, 4.0), Warn,
        "it reports no battery, and no take-off begins; 4 measures voltage and current";
    Px4, ALL, "GF_ACTION", "", OneOf(&[(1.0, "Warning"), (0.0, "nothing")]), Warn, FENCE;
    ArduPilot, ALL, "FENCE_ACTION", "", Is(0.0, "report"), Warn, FENCE;
    Px4, ALL, "RTL_LAND_DELAY", " s", Is(-1.0, "hovers"), Warn, HOME;
    ArduPilot, BEFORE_4_7, "RTL_ALT_FINAL", " cm", Within(300.0, INFINITY, 1000.0), Warn, HOME;
    ArduPilot, SINCE_4_7, "RTL_ALT_FINAL_M", " m", Within(3.0, INFINITY, 10.0), Warn, HOME;
    // With the defaults of some boards, checks of redundant sensors fail on a rocking deck.
    Px4, ALL, "COM_ARM_IMU_ACC", " m/s²", Within(0.7, INFINITY, 0.7), Warn, ARMS;
    Px4, ALL, "COM_ARM_IMU_GYR", " rad/s", Within(0.25, INFINITY, 0.25), Warn, ARMS;
    Px4, ALL, "COM_ARM_MAG_STR", "", OneOf(&[(2.0, "Warning only"), (0.0, "off")]), Warn,
        "it does not arm above a steel deck";
    ArduPilot, ALL, "INS_GYR_CAL", "", Is(0.0, "Never"), Warn,
        "it mistakes the rocking of the deck at start-up for a gyro bias: calibrate the gyros ashore";
    ArduPilot, ALL, "EK3_SRC1_YAW", "", OneOf(&[(1.0, "compass"), (2.0, "GPS"), (3.0, "GPS, else compass")]), Warn,
        "it has no heading on the deck and aligns it in flight";
};

impl Maker {
    /// Version that is assumed for a firmware that does not report its own.
    pub const fn assumed(self) -> Version {
        match self {
            Maker::Px4 => [1, 17],
            Maker::ArduPilot => [4, 6],
        }
    }
    /// Parameters of this maker's firmware in `version`, each with the number that identifies it in a reason.
    pub fn parameters(self, version: Version) -> impl Iterator<Item = (usize, &'static Parameter)> {
        let of_version = move |p: &Parameter| p.maker == self && p.versions.contain(version);
        PARAMETERS.iter().enumerate().filter(move |(_, p)| of_version(p))
    }
}

/// Parameter that a reason identifies by this number.
pub(crate) fn numbered(number: f64) -> Option<&'static Parameter> {
    let mut all = PARAMETERS.iter().enumerate();
    all.find(|(k, _)| *k as f64 == number).map(|(_, p)| p)
}

impl Parameter {
    /// Whether `value` is suitable. Autopilots store 32 bits.
    pub fn suits(&self, value: f64) -> bool {
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
        match self.wanted {
            Within(low, high, _) => {
                (value >= low || same(value, low)) && (value <= high || same(value, high))
            }
            Is(wanted, _) => same(value, wanted),
            OneOf(values) => values.iter().any(|(wanted, _)| same(value, *wanted)),
            Bits(bits) => (0.0..=1e9).contains(&value) && value as u32 & bits == bits,
            Any => true,
        }
    }
    /// Value to set in place of `value`, which stays if it is suitable.
    pub fn corrected(&self, value: f64) -> f64 {
        if self.suits(value) {
            return value;
        }
        match self.wanted {
            Within(_, _, set) | Is(set, _) => set,
            OneOf(values) => values.first().map_or(value, |(set, _)| *set),
            Bits(bits) if (0.0..=1e9).contains(&value) => f64::from(value as u32 | bits),
            Bits(bits) => f64::from(bits),
            Any => value,
        }
    }
    /// Message about this value; if it is unsuitable, with the suitable ones and the reason.
    pub fn describe(&self, value: f64) -> impl fmt::Display + use<> {
        Described(*self, value)
    }
    /// Suitable values in words.
    pub fn suitable(&self) -> impl fmt::Display + use<> {
        Suitable(*self)
    }
}

struct Suitable(Parameter);

impl fmt::Display for Suitable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Parameter { unit, wanted, .. } = self.0;
        match wanted {
            Within(low, high, _) if high.is_infinite() => write!(f, "at least {low}{unit}"),
            Within(low, high, _) => write!(f, "{low} to {high}{unit}"),
            Is(wanted, name) => write!(f, "{wanted} ({name})"),
            OneOf(values) => {
                for (k, (wanted, name)) in values.iter().enumerate() {
                    let before = if k == 0 { "" } else { " or " };
                    write!(f, "{before}{wanted} ({name})")?;
                }
                Ok(())
            }
            Bits(bits) => write!(f, "one with {bits} added"),
            Any => f.write_str("any"),
        }
    }
}

struct Described(Parameter, f64);

impl fmt::Display for Described {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Described(p, value) = self;
        // In single precision, as the autopilot displays it.
        write!(f, "{} is {}{}", p.name, *value as f32, p.unit)?;
        if p.suits(*value) {
            return Ok(());
        }
        write!(f, "; {} is needed: {}", p.suitable(), p.why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> &'static Parameter {
        PARAMETERS.iter().find(|p| p.name == name).unwrap()
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
            ("FS_OPTIONS", &[4.0, 20.0], &[0.0, 16.0]),
            // A failsafe that leaves the landing near the deck lets it rise into the drone.
            ("NAV_DLL_ACT", &[0.0], &[1.0, 2.0, 3.0]),
            ("FS_GCS_ENABLE", &[0.0], &[1.0, 7.0]),
            ("GF_ACTION", &[0.0, 1.0], &[2.0, 3.0, 4.0, 5.0]),
            ("FENCE_ACTION", &[0.0], &[1.0, 2.0, 3.0, 4.0]),
            // A drone whose companion has failed for good must not hover until it falls.
            ("COM_LOW_BAT_ACT", &[0.0, 2.0, 3.0], &[1.0]),
            ("BAT_CRIT_THR", &[0.05, 0.07], &[0.0, 0.1, 0.15]),
            ("BATT_MONITOR", &[3.0, 4.0, 8.0], &[0.0]),
            ("BATT_FS_CRT_ACT", &[0.0, 1.0], &[2.0, 3.0, 5.0]),
            ("RTL_LAND_DELAY", &[-1.0], &[0.0, 30.0]),
            ("RTL_ALT_FINAL", &[300.0, 1000.0], &[0.0, 50.0]),
            ("RTL_ALT_FINAL_M", &[3.0, 10.0], &[0.0, 0.5]),
            ("INS_GYR_CAL", &[0.0], &[1.0]),
            ("EK3_SRC1_YAW", &[1.0, 2.0, 3.0], &[0.0, 8.0]),
            // The pilot's quickest takeover is never rejected.
            ("MAN_OVERRIDE_SPD", &[-1.0, 1.0, 3.0], &[]),
        ] {
            let p = named(name);
            assert!(good.iter().all(|v| p.suits(*v)), "{name}");
            assert!(!bad.iter().any(|v| p.suits(*v)), "{name}");
            assert!(bad.iter().all(|v| p.suits(p.corrected(*v))), "{name}");
            assert!(good.iter().all(|v| p.corrected(*v) == *v), "{name}");
        }
        assert_eq!(named("FS_OPTIONS").corrected(16.0), 20.0);
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
        assert!(text("GF_ACTION", 2.0).contains("GF_ACTION is 2; 1 (Warning) or 0 (nothing) is needed"));
        assert_eq!(text("GUID_TIMEOUT", f64::from(0.3_f32)), "GUID_TIMEOUT is 0.3 s");
        assert_eq!(Versions::ALL.to_string(), "");
        assert_eq!(SINCE_4_7.to_string(), " from 4.7 on");
    }

    #[test]
    fn rows_of_each_version() {
        let wanted = |maker: Maker, version, name| {
            let mut rows = maker.parameters(version).filter(|(_, p)| p.name == name);
            let first = rows.next().map(|(k, p)| {
                assert_eq!(numbered(k as f64), Some(p));
                p.corrected(f64::NAN)
            });
            assert!(rows.next().is_none(), "{name} twice in {version:?}");
            first
        };
        for (maker, version, name, value) in [
            (Maker::Px4, [1, 16], "NAV_RCL_ACT", Some(1.0)),
            (Maker::Px4, [1, 18], "NAV_RCL_ACT", Some(7.0)),
            (Maker::Px4, [1, 18], "COM_RCL_EXCEPT", None),
            (Maker::ArduPilot, [4, 6], "RTL_ALT_FINAL", Some(1000.0)),
            (Maker::ArduPilot, [4, 6], "RTL_ALT_FINAL_M", None),
            (Maker::ArduPilot, [4, 7], "RTL_ALT_FINAL", None),
            (Maker::ArduPilot, [4, 7], "RTL_ALT_FINAL_M", Some(10.0)),
        ] {
            assert_eq!(wanted(maker, version, name), value, "{name} in {version:?}");
        }
        assert!(PARAMETERS.iter().all(|p| p.name.len() <= 16));
        assert_eq!(numbered(PARAMETERS.len() as f64), None);
        assert_eq!(numbered(f64::NAN), None);
    }

    #[test]
    fn parameters_that_stop_the_sink_above_the_deck() {
        let bounds = |name: &str| match named(name).wanted {
            Within(low, high, _) => (low, high),
            other => panic!("{other:?}"),
        };
        let (_, timeout) = bounds("COM_OF_LOSS_T");
        let (braking, _) = bounds("MPC_ACC_UP_MAX");
        let stop_m = 2.5 * timeout + 2.5 * 2.5 / (2.0 * braking);
        assert!(stop_m < 1.65, "{stop_m}");
    }
}
