//! Bounded human-readable text, such as an error message of the operating system.

use core::fmt;
use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::Seq;

/// At most `N` bytes of text, stored in place; a longer text is truncated.
#[derive(Clone, Copy, Default, PartialEq)]
#[repr(C)]
pub struct Text<const N: usize>(Seq<u8, N>);

impl<const N: usize> Text<N> {
    /// The text; empty if the bytes are not valid UTF-8.
    pub fn as_str(&self) -> &str {
        // Bytes from another process are untrusted.
        core::str::from_utf8(&self.0).unwrap_or_default()
    }
}

impl<const N: usize> From<&str> for Text<N> {
    fn from(text: &str) -> Self {
        let fits = text.char_indices().map(|(k, c)| k + c.len_utf8());
        let end = fits.take_while(|end| *end <= N).last().unwrap_or(0);
        Text(Seq::filled(text.bytes().take(end)))
    }
}

impl<const N: usize> fmt::Display for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}
impl<const N: usize> Serialize for Text<N> {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.serialize_str(self.as_str())
    }
}
impl<'de, const N: usize> Deserialize<'de> for Text<N> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        String::deserialize(d).map(|text| text.as_str().into())
    }
}
impl<const N: usize> JsonSchema for Text<N> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Text".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "maxLength": N })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_longer_than_its_place() {
        assert_eq!(Text::<3>::from("deck").as_str(), "dec");
        assert_eq!(Text::<3>::from("5 µ").as_str(), "5 ");
        assert_eq!(Text::<4>::from("5 µ").as_str(), "5 µ");
    }
}
