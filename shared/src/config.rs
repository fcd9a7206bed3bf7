//! Typed configuration in TOML with units in key names. Unknown keys and values out of range are rejected
//! with an error that names key, value and range.

mod whole;

use std::{
    collections::BTreeMap,
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;
use toml::{Table, Value};

/// Reason for rejecting a configuration.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file could not be read.
    #[error("reading configuration {path}: {source}; check the path and its permissions")]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// Not TOML, an unknown key, or a value of the wrong type.
    #[error("parsing configuration {origin}: {message}")]
    Parse {
        /// File or other origin of the text.
        origin: String,
        /// Error of the parser, with line and column.
        message: String,
    },
    /// A value outside its range.
    #[error("configuration key `{key}` is {value}; allowed: {allowed}; correct it and try again")]
    Range {
        /// Dotted key.
        key: String,
        /// Value found.
        value: String,
        /// Permitted range as text.
        allowed: String,
    },
}

/// Configuration table whose values can be checked and whose keys can be described.
pub trait Check {
    /// Tables of former versions by dotted name, with their replacements.
    const FORMER: &'static [(&'static str, &'static str)] = &[];
    /// Checks every value of this table at the path `at`.
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError>;
    /// Inserts the meaning of each key (including unit and source) under its dotted name.
    fn describe(_at: &Keys<'_>, _keys: &mut BTreeMap<String, String>)
    where
        Self: Sized,
    {
    }
}

/// Number, or list of numbers, that can be checked against a range.
pub trait InRange {
    /// Checks `range.start <= value <= range.end` for every number; a NaN fails.
    fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError>;
}

macro_rules! in_range {
    ($($number:ty)*) => {$(
        impl InRange for $number {
            fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError> {
                at.range(key, *self as f64, *range.start(), *range.end())
            }
        }
    )*};
}
in_range!(f64 f32 u8 u16 u32 u64 i64 usize);

impl<T: InRange> InRange for [T] {
    fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError> {
        let mut values = self.iter().enumerate();
        values.try_for_each(|(i, v)| v.in_range(at, &format!("{key}[{i}]"), range))
    }
}
impl<T: InRange, const N: usize> InRange for [T; N] {
    fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError> {
        self.as_slice().in_range(at, key, range)
    }
}
impl<T: InRange> InRange for Vec<T> {
    fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError> {
        self.as_slice().in_range(at, key, range)
    }
}
impl<T: InRange> InRange for Option<T> {
    fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError> {
        self.as_ref().map_or(Ok(()), |v| v.in_range(at, key, range))
    }
}

/// Declares a configuration table: for each key its meaning, unit and source (the doc comment), type, default
/// and range. Generates the struct, `Default`, [`Check`] and serde's traits.
///
/// ```
/// alight_shared::config! {
///     /// A heater.
///     pub struct Heater {
///         /// Power, W.
///         pub power_w: f64 = 100.0, in 0.0..=2000.0;
///         /// Names of its switches.
///         pub switches: Vec<String> = vec!["main".into()];
///         /// Its location, a nested table.
///         pub deck: alight_shared::geometry::DeckGeometry;
///     }
///     check |this, at| {
///         at.require(!this.switches.is_empty(), "switches", 0, "one name or more")?;
///     }
/// }
/// ```
/// `= DEFAULT, table` gives a nested table a default other than its own.
#[macro_export]
macro_rules! config {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $(
                $(#[$($doc:tt)*])*
                pub $field:ident: $type:ty $(= $default:expr $(, $kind:ident $($range:expr)?)?)?;
            )*
        }
        $(former $former:expr;)?
        $(check |$this:ident, $at:ident| $body:block)?
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $($(#[$($doc)*])* pub $field: $type,)*
        }
        impl ::core::default::Default for $name {
            fn default() -> Self {
                $name { $($field: $crate::config!(@default $($default)?),)* }
            }
        }
        impl $crate::config::Check for $name {
            $(const FORMER: &'static [(&'static str, &'static str)] = $former;)?
            #[allow(unused_variables, reason = "a table may have nothing to check")]
            fn check(
                &self,
                at: &$crate::config::Keys<'_>,
            ) -> ::core::result::Result<(), $crate::config::ConfigError> {
                $($crate::config!(@check self at $field $(= $default $(, $kind $($range)?)?)?);)*
                $({
                    let $this = self;
                    let $at = at;
                    $body
                })?
                Ok(())
            }
            fn describe(
                at: &$crate::config::Keys<'_>,
                keys: &mut ::std::collections::BTreeMap<String, String>,
            ) {
                $(
                    let text: &[&str] = &[$($crate::config!(@doc $($doc)*)),*];
                    keys.insert(at.key(stringify!($field)), text.join("\n"));
                    $crate::config!(@describe at keys $field $type $(= $default $(, $kind)?)?);
                )*
            }
        }
    };
    (@default) => { ::core::default::Default::default() };
    (@default $default:expr) => { $default };
    (@check $self:ident $at:ident $field:ident = $default:expr, in $range:expr) => {
        $crate::config::InRange::in_range(&$self.$field, $at, stringify!($field), &($range))?
    };
    (@check $self:ident $at:ident $field:ident = $default:expr) => {};
    (@check $self:ident $at:ident $field:ident $(= $default:expr, table)?) => {
        $crate::config::Check::check(&$self.$field, &$at.table(stringify!($field)))?
    };
    (@describe $at:ident $keys:ident $field:ident $type:ty = $default:expr, in) => {};
    (@describe $at:ident $keys:ident $field:ident $type:ty = $default:expr) => {};
    (@describe $at:ident $keys:ident $field:ident $type:ty $(= $default:expr, table)?) => {
        <$type as $crate::config::Check>::describe(&$at.table(stringify!($field)), $keys)
    };
    (@doc doc = $text:literal) => { $text };
    (@doc $($other:tt)*) => { "" };
}

/// Dotted path of a table, for errors.
#[derive(Clone, Copy, Debug)]
pub struct Keys<'a> {
    parent: Option<&'a Keys<'a>>,
    name: &'a str,
}

impl<'a> Keys<'a> {
    /// Root of a file.
    pub const ROOT: Keys<'static> = Keys {
        parent: None,
        name: "",
    };

    /// The table `name` below this one.
    pub const fn table(&'a self, name: &'a str) -> Keys<'a> {
        Keys {
            parent: Some(self),
            name,
        }
    }
    /// Dotted name of `key` in this table.
    pub fn key(&self, key: &str) -> String {
        let mut parts = vec![key];
        let mut at = Some(self);
        while let Some(k) = at {
            if !k.name.is_empty() {
                parts.push(k.name);
            }
            at = k.parent;
        }
        parts.reverse();
        parts.join(".")
    }
    /// Checks `low <= value <= high`; a NaN fails.
    pub fn range(&self, key: &str, value: f64, low: f64, high: f64) -> Result<(), ConfigError> {
        if (low..=high).contains(&value) {
            return Ok(());
        }
        Err(ConfigError::Range {
            key: self.key(key),
            value: format!("{value}"),
            allowed: format!("{low} to {high}"),
        })
    }
    /// Checks every item of a list.
    pub fn ranges(&self, key: &str, values: &[f64], low: f64, high: f64) -> Result<(), ConfigError> {
        values
            .iter()
            .enumerate()
            .try_for_each(|(i, v)| self.range(&format!("{key}[{i}]"), *v, low, high))
    }
    /// Checks another condition; `allowed` describes the allowed values.
    pub fn require(
        &self,
        ok: bool,
        key: &str,
        value: impl ToString,
        allowed: &str,
    ) -> Result<(), ConfigError> {
        if ok {
            return Ok(());
        }
        Err(ConfigError::Range {
            key: self.key(key),
            value: value.to_string(),
            allowed: allowed.into(),
        })
    }
}

/// Parses and checks a configuration; `origin` names it in errors. If a list is longer than its type, the
/// error states the meaning of the key; for a former table, it names the replacement.
pub fn parse<T: DeserializeOwned + Check>(text: &str, origin: &str) -> Result<T, ConfigError> {
    let meaning = |key: &str| {
        let mut meanings = BTreeMap::new();
        T::describe(&Keys::ROOT, &mut meanings);
        meanings.remove(key)
    };
    let former = text.parse::<Table>().ok().and_then(|table| {
        let has = |name: &str| {
            name.split('.')
                .try_fold(&Value::Table(table.clone()), |at, key| at.get(key))
                .is_some()
        };
        T::FORMER.iter().find(|(name, _)| has(name))
    });
    if let Some((name, became)) = former {
        return Err(ConfigError::Parse {
            origin: origin.into(),
            message: format!("[{name}]: {became}"),
        });
    }
    let config: T = whole::read(text, origin, meaning)?;
    config.check(&Keys::ROOT)?;
    Ok(config)
}

/// Reads TOML without a declared table; a list longer than its type is an error.
pub fn read<T: DeserializeOwned>(text: &str, origin: &str) -> Result<T, ConfigError> {
    whole::read(text, origin, |_| None)
}

/// Reads, parses and checks a configuration file.
pub fn load<T: DeserializeOwned + Check>(path: &Path) -> Result<T, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
        path: path.into(),
        source,
    })?;
    parse(&text, &path.display().to_string())
}

/// Configuration as TOML with the meaning of each key (including unit and source) above it.
pub fn commented<T: Serialize + Check>(config: &T) -> Result<String, toml::ser::Error> {
    commented_keys(config, &|_| true)
}

/// Keys whose dotted names are in `wanted`, as TOML with the meaning of each above it.
pub fn commented_keys<T: Serialize + Check>(
    config: &T,
    wanted: &dyn Fn(&str) -> bool,
) -> Result<String, toml::ser::Error> {
    let mut meanings = BTreeMap::new();
    T::describe(&Keys::ROOT, &mut meanings);
    let Value::Table(table) = Value::try_from(config)? else {
        return toml::to_string(config);
    };
    let mut out = String::new();
    write_table(&table, "", &meanings, wanted, &mut out);
    Ok(out)
}

/// Writes simple keys before tables, as TOML requires.
fn write_table(
    table: &Table,
    path: &str,
    meanings: &BTreeMap<String, String>,
    wanted: &dyn Fn(&str) -> bool,
    out: &mut String,
) {
    let full = |key: &str| [path, key].join(if path.is_empty() { "" } else { "." });
    let comment = |key: &str, out: &mut String| {
        for line in meanings.get(&full(key)).iter().flat_map(|m| m.lines()) {
            out.push_str(&format!("#{line}\n"));
        }
    };
    let is_table = |v: &Value| v.is_table();
    for (key, value) in table.iter().filter(|(k, v)| !is_table(v) && wanted(&full(k))) {
        comment(key, out);
        out.push_str(&format!("{key} = {value}\n"));
    }
    for (key, value) in table {
        if let Value::Table(inner) = value {
            let mut below = String::new();
            write_table(inner, &full(key), meanings, wanted, &mut below);
            if below.is_empty() && !inner.is_empty() {
                continue;
            }
            out.push('\n');
            comment(key, out);
            out.push_str(&format!("[{}]\n{below}", full(key)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    config! {
        /// A heater.
        pub struct Heater {
            /// Power, W.
            /// Chosen: enough.
            pub power_w: f64 = 100.0, in 0.0..=2000.0;
            /// Names of its switches.
            pub switches: Vec<String> = vec!["main".into()];
            /// The box's fan.
            pub fan: Fan = Fan { speed_rpm: 700 }, table;
            /// The box's other fan.
            pub spare: Fan;
        }
        check |this, at| {
            at.require(!this.switches.is_empty(), "switches", 0, "one name or more")?;
        }
    }
    config! {
        /// A fan.
        pub struct Fan {
            /// Speed, 1/min.
            pub speed_rpm: u32 = 900, in 100.0..=3000.0;
        }
    }

    fn error(text: &str) -> String {
        parse::<Heater>(text, "test").unwrap_err().to_string()
    }

    #[test]
    fn config_error_with_key_value_and_range() {
        assert!(error("power_w = 1e4").contains("`power_w` is 10000; allowed: 0 to 2000"));
        assert!(error("power_w = nan").contains("NaN"));
        let nested = error("[spare]\nspeed_rpm = 5");
        assert!(
            nested.contains("`spare.speed_rpm` is 5; allowed: 100 to 3000"),
            "{nested}"
        );
        assert!(error("switches = []").contains("one name or more"));
        assert!(error("[fan]\nspeed = 1").contains("unknown field `speed`"));
    }

    #[test]
    fn declared_table_with_defaults_and_meanings() {
        let heater = Heater::default();
        assert_eq!((heater.fan.speed_rpm, heater.spare.speed_rpm), (700, 900));
        let text = commented(&heater).unwrap();
        assert!(
            text.contains("# Power, W.\n# Chosen: enough.\npower_w = 100.0\n"),
            "{text}"
        );
        assert!(
            text.contains("# The box's fan.\n[fan]\n# Speed, 1/min.\nspeed_rpm = 700\n"),
            "{text}"
        );
        assert_eq!(parse::<Heater>(&text, "test").unwrap(), heater);
        let text = commented_keys(&heater, &|key| key.starts_with("spare")).unwrap();
        assert_eq!(
            text,
            "\n# The box's other fan.\n[spare]\n# Speed, 1/min.\nspeed_rpm = 900\n"
        );
    }
}
