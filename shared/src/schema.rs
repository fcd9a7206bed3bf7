//! Message schemas for other programs: JSON Schema (draft 2020-12) from the message types and their doc
//! comments, with the unit and frame from a comment or name.
//!
//! `required` lists fields in wire order, enumerations list variants by number; `format` is a number's width.

use std::borrow::Cow;

use schemars::{
    JsonSchema, Schema, SchemaGenerator, generate::SchemaSettings, json_schema,
    transform::transform_subschemas,
};
use serde_json::{Value, json};

use crate::wire::hash_bytes;

/// Units recognised in comments after a comma or bracket.
const UNITS: [&str; 18] = [
    "m/s²", "m/s", "m²", "m", "rad/s²", "rad/s", "rad²", "rad", "deg", "1/s", "s", "ns", "Hz", "V", "A",
    "bytes/s", "bytes", "min",
];
/// Units by name suffix, for fields without a unit in their comment.
const SUFFIXES: [(&str, &str); 12] = [
    ("bytes_per_s", "bytes/s"),
    ("_mps2", "m/s²"),
    ("_mps", "m/s"),
    ("_m", "m"),
    ("_rad", "rad"),
    ("_deg", "deg"),
    ("_ns", "ns"),
    ("_s", "s"),
    ("_hz", "Hz"),
    ("_v", "V"),
    ("_a", "A"),
    ("_bytes", "bytes"),
];
/// Frames recognised in comments, most specific first.
const FRAMES: [&str; 9] = [
    "vessel's NED",
    "drone's NED",
    "vessel's body frame",
    "vessel's body",
    "body frame",
    "camera frame",
    "deck's axes",
    "deck's centre",
    "NED",
];

/// A 16-bit float (IEEE 754 binary16) in schemas; [`half::f16`] has no schema of its own.
pub enum F16 {}

impl JsonSchema for F16 {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "f16".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "number", "format": "float16" })
    }
}

/// Format of a JSON line exchanged with another program: name, version, schema.
pub type LineFormat = (&'static str, u32, fn() -> Schema);

/// Schema of a message type.
pub fn of<T: JsonSchema>() -> Schema {
    generated::<T>(SchemaSettings::draft2020_12().for_serialize())
}

/// Schema of a line to another program, in which an infinite number is null.
pub fn of_input<T: JsonSchema>() -> Schema {
    generated::<T>(
        SchemaSettings::draft2020_12()
            .for_serialize()
            .with_transform(nullable),
    )
}

/// Schema of a line from another program, whose optional fields may be absent.
pub fn of_answer<T: JsonSchema>() -> Schema {
    generated::<T>(SchemaSettings::draft2020_12().for_deserialize())
}

/// Permits null for numbers that their comment calls infinite.
fn nullable(schema: &mut Schema) {
    transform_subschemas(&mut nullable, schema);
    let infinite = schema
        .get("description")
        .and_then(Value::as_str)
        .is_some_and(|text| text.contains("infinite"));
    if infinite && schema.get("type").and_then(Value::as_str) == Some("number") {
        schema.insert("type".into(), json!(["number", "null"]));
    }
}

fn generated<T: JsonSchema>(settings: SchemaSettings) -> Schema {
    let inlined = settings
        .with(|s| s.inline_subschemas = true)
        .with_transform(state);
    inlined.into_generator().into_root_schema_for::<T>()
}

/// Joins comments to one line, and adds units and frames.
fn state(schema: &mut Schema) {
    if let Some(Value::String(text)) = schema.get_mut("description") {
        *text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        text.retain(|c| !"[]`".contains(c));
    }
    transform_subschemas(&mut state, schema);
    let properties = schema.get_mut("properties").and_then(Value::as_object_mut);
    for (name, property) in properties.into_iter().flatten() {
        let Some(property) = property.as_object_mut() else {
            continue;
        };
        if !SchemaKind::of(property).is_number() {
            continue;
        }
        let text = property
            .get("description")
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_owned();
        if let Some(unit) = unit(name, &text).filter(|_| !property.contains_key("unit")) {
            property.insert("unit".into(), unit.into());
        }
        if let Some(frame) = FRAMES
            .iter()
            .find(|f| text.contains(**f))
            .filter(|_| !property.contains_key("frame"))
        {
            property.insert("frame".into(), (*frame).into());
        }
    }
}

/// Units of a field in the order of its comment.
fn unit(name: &str, comment: &str) -> Option<String> {
    let mut found: Vec<&str> = Vec::new();
    for (at, _) in comment.match_indices([',', '(']) {
        let after = comment[at + 1..].trim_start();
        let unit = UNITS.iter().find(|u| {
            let rest = after.strip_prefix(**u);
            rest.is_some_and(|r| r.is_empty() || r.starts_with([',', '.', ';', ':', ')', ' ']))
        });
        found.extend(unit.filter(|u| found.last() != Some(*u)));
    }
    if found.is_empty() {
        found.extend(
            SUFFIXES
                .iter()
                .find(|(end, _)| name.ends_with(end))
                .map(|(_, unit)| unit),
        );
    }
    (!found.is_empty()).then(|| found.join(", "))
}

type Object = serde_json::Map<String, Value>;

/// Encoding of a value.
#[derive(Clone, Debug, PartialEq)]
pub enum SchemaKind<'a> {
    /// Number with the width in `format`.
    Number(&'a str),
    /// Boolean.
    Bool,
    /// Text with a maximum length in bytes.
    Text(u64),
    /// Enumeration: variants by number, each with its content, if any.
    Enum(Vec<(&'a str, Option<&'a Object>)>),
    /// Array with a fixed length.
    Array(&'a Object, u64),
    /// List with a maximum length.
    List(&'a Object, u64),
    /// Struct: fields in wire order.
    Struct(Vec<(&'a str, &'a Object)>),
    /// Layout not given by the schema.
    Unknown,
}

impl<'a> SchemaKind<'a> {
    /// Encoding described by a schema; for an optional value, the encoding of the value itself.
    pub fn of(schema: &'a Object) -> SchemaKind<'a> {
        let of_type = match schema.get("type") {
            Some(Value::Array(types)) => types.iter().find_map(|t| t.as_str().filter(|t| *t != "null")),
            one => one.and_then(Value::as_str),
        };
        let number = |key: &str| schema.get(key).and_then(Value::as_u64);
        match of_type {
            Some("number" | "integer") => {
                SchemaKind::Number(schema.get("format").and_then(Value::as_str).unwrap_or_default())
            }
            Some("boolean") => SchemaKind::Bool,
            Some("string") => SchemaKind::text(schema),
            Some("array") => match (schema.get("items").and_then(Value::as_object), number("maxItems")) {
                (Some(items), Some(n)) if number("minItems") == Some(n) => SchemaKind::Array(items, n),
                (Some(items), most) => SchemaKind::List(items, most.unwrap_or(u64::MAX)),
                (None, _) => SchemaKind::Unknown,
            },
            Some("object") => SchemaKind::structure(schema),
            _ => SchemaKind::choice(schema),
        }
    }
    fn text(schema: &'a Object) -> SchemaKind<'a> {
        let names = schema.get("enum").and_then(Value::as_array);
        match (names, schema.get("const").and_then(Value::as_str)) {
            (Some(names), _) => SchemaKind::Enum(
                names
                    .iter()
                    .filter_map(Value::as_str)
                    .map(|name| (name, None))
                    .collect(),
            ),
            (None, Some(name)) => SchemaKind::Enum(vec![(name, None)]),
            (None, None) => SchemaKind::Text(
                schema
                    .get("maxLength")
                    .and_then(Value::as_u64)
                    .unwrap_or(u64::MAX),
            ),
        }
    }
    fn structure(schema: &'a Object) -> SchemaKind<'a> {
        let names = schema
            .get("required")
            .and_then(Value::as_array)
            .into_iter()
            .flatten();
        let property = |name: &str| schema.get("properties")?.get(name)?.as_object();
        let fields: Option<Vec<_>> = names
            .map(|n| Some((n.as_str()?, property(n.as_str()?)?)))
            .collect();
        fields.map_or(SchemaKind::Unknown, SchemaKind::Struct)
    }
    /// Encoding of a choice: variants of an enumeration, or an optional value.
    fn choice(schema: &'a Object) -> SchemaKind<'a> {
        let several = |key: &str| Some(schema.get(key)?.as_array()?.iter().filter_map(Value::as_object));
        if let Some(mut options) = several("anyOf") {
            let present = options.find(|o| o.get("type").and_then(Value::as_str) != Some("null"));
            return present.map_or(SchemaKind::Unknown, SchemaKind::of);
        }
        let variants = several("oneOf").into_iter().flatten().filter(|v| !is_null(v));
        let mut found = Vec::new();
        for variant in variants {
            match SchemaKind::of(variant) {
                // Variants without content and without comments share one schema.
                SchemaKind::Enum(names) => found.extend(names),
                SchemaKind::Struct(content) => {
                    let Some((name, content)) = content.first() else {
                        return SchemaKind::Unknown;
                    };
                    found.push((*name, Some(*content)));
                }
                SchemaKind::Number(_)
                | SchemaKind::Bool
                | SchemaKind::Text(_)
                | SchemaKind::Array(..)
                | SchemaKind::List(..)
                | SchemaKind::Unknown => return SchemaKind::Unknown,
            }
        }
        if found.is_empty() {
            SchemaKind::Unknown
        } else {
            SchemaKind::Enum(found)
        }
    }
    fn is_number(&self) -> bool {
        match self {
            SchemaKind::Number(_) => true,
            SchemaKind::Array(items, _) | SchemaKind::List(items, _) => SchemaKind::of(items).is_number(),
            SchemaKind::Bool
            | SchemaKind::Text(_)
            | SchemaKind::Enum(_)
            | SchemaKind::Struct(_)
            | SchemaKind::Unknown => false,
        }
    }
    /// Name used in the documentation.
    pub fn name(&self) -> String {
        match self {
            SchemaKind::Number(format) => short(format).into(),
            SchemaKind::Bool => "bool".into(),
            SchemaKind::Text(n) => format!("text <= {n}"),
            SchemaKind::Enum(variants) => format!("one of {}", variants.len()),
            SchemaKind::Array(items, n) => format!("{}[{n}]", SchemaKind::of(items).name()),
            SchemaKind::List(items, n) => format!("{}[<= {n}]", SchemaKind::of(items).name()),
            SchemaKind::Struct(_) => "struct".into(),
            SchemaKind::Unknown => "-".into(),
        }
    }
}

fn is_null(schema: &Object) -> bool {
    schema.get("type").and_then(Value::as_str) == Some("null")
}

/// Hash of names, fields, types and variants, without comments.
pub fn hash(schema: &Schema) -> u64 {
    let text = schema.as_object().map(described).unwrap_or_default();
    hash_bytes(text.as_bytes())
}

fn described(schema: &Object) -> String {
    let kind = SchemaKind::of(schema);
    let content = match &kind {
        SchemaKind::Number(_) | SchemaKind::Bool | SchemaKind::Text(_) => String::new(),
        SchemaKind::Unknown => Value::Object(schema.clone()).to_string(),
        SchemaKind::Array(items, _) | SchemaKind::List(items, _) => described(items),
        SchemaKind::Struct(fields) => fields
            .iter()
            .map(|(name, field)| format!("{name}: {}, ", described(field)))
            .collect(),
        SchemaKind::Enum(variants) => variants
            .iter()
            .map(|(name, content)| format!("{name} {}, ", content.map(described).unwrap_or_default()))
            .collect(),
    };
    let optional = if is_optional(schema) { "?" } else { "" };
    format!("{}{optional} {{{content}}}", kind.name())
}

/// Whether a value is optional.
pub fn is_optional(schema: &Object) -> bool {
    let null = |key: &str| {
        schema.get(key).and_then(Value::as_array).is_some_and(|all| {
            all.iter()
                .any(|t| t.as_str() == Some("null") || t.as_object().is_some_and(is_null))
        })
    };
    null("type") || null("anyOf") || null("oneOf")
}

fn short(format: &str) -> &str {
    match format {
        "double" => "f64",
        "float" => "f32",
        "float16" => "f16",
        "int64" => "i64",
        "int32" => "i32",
        "int16" => "i16",
        "int8" => "i8",
        "uint64" => "u64",
        "uint32" => "u32",
        "uint16" => "u16",
        "uint8" => "u8",
        other => other,
    }
}

/// Field of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Path of the field, such as `modes[].pole`.
    pub path: String,
    /// Encoding; a trailing `?` marks an optional field.
    pub kind: String,
    /// Units; empty if none.
    pub unit: String,
    /// Frame, or clock of a time; empty if none.
    pub frame: String,
    /// Description of the field.
    pub description: String,
}

/// Fields of a message in wire order.
pub fn fields(schema: &Schema) -> Vec<Field> {
    let mut found = Vec::new();
    if let Some(SchemaKind::Struct(content)) = schema.as_object().map(SchemaKind::of) {
        for (name, field) in content {
            add(name, field, &mut found);
        }
    }
    found
}

fn add(path: &str, schema: &Object, found: &mut Vec<Field>) {
    let text = |key: &str| {
        schema
            .get(key)
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_owned()
    };
    let kind = SchemaKind::of(schema);
    found.push(Field {
        path: path.into(),
        kind: format!("{}{}", kind.name(), if is_optional(schema) { "?" } else { "" }),
        unit: text("unit"),
        frame: text("frame"),
        description: text("description"),
    });
    let (inner, path) = match kind {
        SchemaKind::Array(items, _) | SchemaKind::List(items, _) => {
            (SchemaKind::of(items), format!("{path}[]"))
        }
        SchemaKind::Number(_)
        | SchemaKind::Bool
        | SchemaKind::Text(_)
        | SchemaKind::Enum(_)
        | SchemaKind::Struct(_)
        | SchemaKind::Unknown => (kind, path.to_owned()),
    };
    if let SchemaKind::Struct(content) = inner {
        for (name, field) in content {
            add(&format!("{path}.{name}"), field, found);
        }
    }
}

#[cfg(test)]
mod tests {
    macro_rules! message {
        ($name:ident, { $($variants:tt)* }, { $($fields:tt)* }) => {
            mod $name {
                #[derive(schemars::JsonSchema)]
                #[allow(dead_code, reason = "only its schema is read")]
                pub enum Mode { $($variants)* }
                #[derive(schemars::JsonSchema)]
                #[allow(dead_code, reason = "only its schema is read")]
                pub struct Message { $($fields)* }
            }
        };
    }
    message!(own, { /** A. */ Held, /** B. */ Flown(f32) }, { pub at: f64, pub mode: Option<Mode> });
    message!(commented, { /** C. */ Held, /** D. */ Flown(f32) }, { pub at: f64, /** m/s */ pub mode: Option<Mode> });
    message!(added, { /** A. */ Held, /** B. */ Flown(f32), /** C. */ Lost }, { pub at: f64, pub mode: Option<Mode> });
    message!(swapped, { /** B. */ Flown(f32), /** A. */ Held }, { pub at: f64, pub mode: Option<Mode> });
    message!(renamed, { /** A. */ Held, /** B. */ Moved(f32) }, { pub at: f64, pub mode: Option<Mode> });
    message!(wider, { /** A. */ Held, /** B. */ Flown(f64) }, { pub at: f64, pub mode: Option<Mode> });
    message!(reordered, { /** A. */ Held, /** B. */ Flown(f32) }, { pub mode: Option<Mode>, pub at: f64 });
    message!(present, { /** A. */ Held, /** B. */ Flown(f32) }, { pub at: f64, pub mode: Mode });

    #[test]
    fn hash_of_a_changed_layout() {
        fn hash<T: schemars::JsonSchema>() -> u64 {
            super::hash(&super::of::<T>())
        }
        let own = hash::<own::Message>();
        assert_eq!(hash::<commented::Message>(), own);
        let others = [
            hash::<added::Message>(),
            hash::<swapped::Message>(),
            hash::<renamed::Message>(),
            hash::<wider::Message>(),
            hash::<reordered::Message>(),
            hash::<present::Message>(),
        ];
        assert!(!others.contains(&own), "{own} {others:?}");
    }
}
