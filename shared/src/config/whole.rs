//! TOML reader that rejects surplus list items; serde's `[f64; 3]` would silently ignore a fourth number.

use core::fmt::Display;

use serde::{
    de::{
        DeserializeOwned, Deserializer, Error as _, IntoDeserializer, Visitor,
        value::{MapAccessDeserializer, MapDeserializer, SeqDeserializer, StringDeserializer},
    },
    forward_to_deserialize_any,
};
use thiserror::Error;
use toml::{Table, Value};

use super::ConfigError;

#[derive(Debug, Error)]
enum Unread {
    /// The list is longer than its type.
    #[error("{key} is a list of {found}; its type takes {taken}")]
    TooLong { key: String, found: usize, taken: usize },
    /// The type rejects the value.
    #[error("{0}")]
    Rejected(String),
}

impl serde::de::Error for Unread {
    fn custom<T: Display>(message: T) -> Unread {
        Unread::Rejected(message.to_string())
    }
}

/// Reads TOML; `origin` names it in errors, and `meaning` returns the meaning of a dotted key, if known.
pub(super) fn read<T: DeserializeOwned>(
    text: &str,
    origin: &str,
    meaning: impl Fn(&str) -> Option<String>,
) -> Result<T, ConfigError> {
    let fault = |message: String| ConfigError::Parse {
        origin: origin.into(),
        message,
    };
    // The first pass gives errors with line and column; the second knows keys and lengths.
    let read: T = toml::from_str(text).map_err(|e| fault(e.to_string()))?;
    let table: Table = toml::from_str(text).map_err(|e| fault(e.to_string()))?;
    let again = T::deserialize(Whole {
        value: Value::Table(table),
        key: String::new(),
    });
    match again {
        Ok(_) => Ok(read),
        Err(Unread::Rejected(message)) => Err(fault(message)),
        Err(Unread::TooLong { key, found, taken }) => {
            let meaning = meaning(without_index(&key)).map(|m| in_one_line(&m));
            Err(ConfigError::Range {
                value: format!("a list of {found}"),
                allowed: match meaning.filter(|m| !m.is_empty()) {
                    Some(meaning) => format!("a list of {taken} ({meaning})"),
                    None => format!("a list of {taken}"),
                },
                key,
            })
        }
    }
}

/// Turns `keep_out_deg[0]` into `keep_out_deg`; leaves a key inside a list of tables unchanged.
fn without_index(key: &str) -> &str {
    match key.split_once('[') {
        Some((name, index)) if !index.contains('.') => name,
        Some(_) | None => key,
    }
}

/// Meaning in one line without its last full stop.
fn in_one_line(meaning: &str) -> String {
    let lines: Vec<&str> = meaning.lines().map(str::trim).collect();
    lines.join(" ").trim().trim_end_matches('.').to_owned()
}

struct Whole {
    value: Value,
    key: String,
}

impl Whole {
    fn entries(table: Table, key: &str) -> impl Iterator<Item = (String, Whole)> {
        table.into_iter().map(move |(name, value)| {
            let key = match key {
                "" => name.clone(),
                above => format!("{above}.{name}"),
            };
            (name, Whole { value, key })
        })
    }
}

impl<'de> IntoDeserializer<'de, Unread> for Whole {
    type Deserializer = Whole;

    fn into_deserializer(self) -> Whole {
        self
    }
}

impl<'de> Deserializer<'de> for Whole {
    type Error = Unread;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Unread> {
        let Whole { value, key } = self;
        match value {
            Value::Array(values) => {
                let found = values.len();
                let mut items = values.into_iter().enumerate().map(|(k, value)| Whole {
                    value,
                    key: format!("{key}[{k}]"),
                });
                let read = visitor.visit_seq(SeqDeserializer::<_, Unread>::new(items.by_ref()))?;
                let left = items.count();
                if left > 0 {
                    let taken = found - left;
                    return Err(Unread::TooLong { key, found, taken });
                }
                Ok(read)
            }
            Value::Table(table) => {
                visitor.visit_map(MapDeserializer::<_, Unread>::new(Whole::entries(table, &key)))
            }
            simple @ (Value::String(_)
            | Value::Integer(_)
            | Value::Float(_)
            | Value::Boolean(_)
            | Value::Datetime(_)) => simple.deserialize_any(visitor).map_err(Unread::custom),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Unread> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Unread> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Unread> {
        let Whole { value, key } = self;
        match value {
            Value::String(variant) => visitor.visit_enum(StringDeserializer::<Unread>::new(variant)),
            Value::Table(table) => {
                let entries = MapDeserializer::<_, Unread>::new(Whole::entries(table, &key));
                visitor.visit_enum(MapAccessDeserializer::new(entries))
            }
            other @ (Value::Array(_)
            | Value::Integer(_)
            | Value::Float(_)
            | Value::Boolean(_)
            | Value::Datetime(_)) => Err(Unread::custom(format_args!(
                "{key} is {other}; it must be a name, or a table with one name"
            ))),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        config,
        config::{parse, read},
    };
    use serde::{Deserialize, Serialize};

    config! {
        /// A box.
        pub struct Parcel {
            /// Length, width and height, m.
            /// Chosen: some.
            pub size_m: [f64; 3] = [1.0; 3], in 0.0..=9.0;
            /// Direction of the lid.
            pub way: LidDirection = LidDirection::Nowhere;
            /// Corners.
            pub corners: Vec<[f64; 2]> = Vec::new();
            /// A mark.
            pub mark: Option<[u8; 2]> = None, in 0.0..=9.0;
            /// Names.
            pub names: Vec<String> = Vec::new();
            /// The lid.
            pub lid: Lid;
        }
    }
    config! {
        /// A lid.
        pub struct Lid {
            /// Hinges, m.
            pub hinges_m: [f64; 2] = [0.1; 2], in 0.0..=9.0;
        }
    }
    /// A direction of the lid.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum LidDirection {
        /// None.
        Nowhere,
        /// To a place.
        To([f64; 2]),
        /// Along a line.
        Along {
            /// Ends.
            ends_m: [f64; 2],
        },
    }

    fn error(text: &str) -> String {
        parse::<Parcel>(text, "test").unwrap_err().to_string()
    }

    #[test]
    fn list_that_is_longer_than_its_type() {
        for (text, key, found, taken) in [
            ("size_m = [1, 2, 3, 4, 5]", "size_m", 5, 3),
            ("mark = [1, 2, 3]", "mark", 3, 2),
            ("corners = [[0, 1], [0, 1, 2]]", "corners[1]", 3, 2),
            ("way = { to = [0.0, 1.0, 2.0] }", "way.to", 3, 2),
            ("[way.along]\nends_m = [0.0, 1.0, 2.0]", "way.along.ends_m", 3, 2),
            ("[lid]\nhinges_m = [0.0, 1.0, 2.0, 3.0]", "lid.hinges_m", 4, 2),
        ] {
            let message = error(text);
            let expected = format!("`{key}` is a list of {found}; allowed: a list of {taken}");
            assert!(message.contains(&expected), "{text}: {message}");
        }
        let message = error("size_m = [1, 2, 3, 4]");
        assert!(
            message.contains("(Length, width and height, m. Chosen: some)"),
            "{message}"
        );
        let message = error("corners = [[0, 1, 2]]");
        assert!(message.contains("a list of 2 (Corners)"), "{message}");
        assert!(error("size_m = [1, 2]").contains("invalid length 2"));
    }

    #[test]
    fn lists_that_fit() {
        let text = "size_m = [1, 2.5, 3]\nmark = [1, 2]\ncorners = [[0, 1], [2, 3]]\nnames = [\"a\", \"b\", \"c\"]\n\
                    way = { to = [0.0, 1.0] }\n[lid]\nhinges_m = [0.0, 1.0]\n";
        let parcel = parse::<Parcel>(text, "test").unwrap();
        assert_eq!(
            (parcel.size_m, parcel.way),
            ([1.0, 2.5, 3.0], LidDirection::To([0.0, 1.0]))
        );
        assert_eq!(
            parse::<Parcel>("way = \"nowhere\"", "test").unwrap().way,
            LidDirection::Nowhere
        );
        let message = read::<Lid>("hinges_m = [0, 1, 2]", "test")
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("`hinges_m` is a list of 3; allowed: a list of 2;"),
            "{message}"
        );
        assert_eq!(read::<Lid>("", "test").unwrap(), Lid::default());
    }
}
