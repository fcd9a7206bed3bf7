//! Protobuf messages of numbers and texts, for figures that no well-known schema has.

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `double`.
    Number,
    /// `string`.
    Text,
    /// `repeated double`.
    Numbers,
}

/// A message type: a name in the package `alight` and its fields, numbered from 1 on.
#[derive(Clone, Copy, Debug)]
pub struct Flat {
    /// Name without the package.
    pub name: &'static str,
    /// Field names and kinds.
    pub fields: &'static [(&'static str, Kind)],
}

/// A value of a field.
#[derive(Clone, Copy, Debug)]
pub enum Value<'a> {
    /// A number.
    Number(f64),
    /// A text.
    Text(&'a str),
    /// A list.
    Numbers(&'a [f64]),
}

fn varint(to: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        to.push(v as u8 | 0x80);
        v >>= 7;
    }
    to.push(v as u8);
}
/// Wire type 2: length and bytes.
fn bytes(to: &mut Vec<u8>, field: u64, content: &[u8]) {
    varint(to, field << 3 | 2);
    varint(to, content.len() as u64);
    to.extend_from_slice(content);
}
/// Wire type 0.
fn number(to: &mut Vec<u8>, field: u64, v: u64) {
    varint(to, field << 3);
    varint(to, v);
}

impl Flat {
    /// Full name.
    pub fn full_name(&self) -> String {
        format!("alight.{}", self.name)
    }
    /// A `google.protobuf.FileDescriptorSet` of this one message (descriptor.proto: set.file = 1;
    /// file.name = 1, package = 2, message_type = 4, syntax = 12; message.name = 1, field = 2;
    /// field.name = 1, number = 3, label = 4, type = 5).
    pub fn descriptor_set(&self) -> Vec<u8> {
        let mut message = Vec::new();
        bytes(&mut message, 1, self.name.as_bytes());
        for (i, (name, kind)) in self.fields.iter().enumerate() {
            // LABEL_OPTIONAL 1, LABEL_REPEATED 3; TYPE_DOUBLE 1, TYPE_STRING 9.
            let (label, kind) = match kind {
                Kind::Number => (1, 1),
                Kind::Text => (1, 9),
                Kind::Numbers => (3, 1),
            };
            let mut field = Vec::new();
            bytes(&mut field, 1, name.as_bytes());
            number(&mut field, 3, i as u64 + 1);
            number(&mut field, 4, label);
            number(&mut field, 5, kind);
            bytes(&mut message, 2, &field);
        }
        let mut file = Vec::new();
        bytes(&mut file, 1, format!("alight/{}.proto", self.name).as_bytes());
        bytes(&mut file, 2, b"alight");
        bytes(&mut file, 4, &message);
        bytes(&mut file, 12, b"proto3");
        let mut set = Vec::new();
        bytes(&mut set, 1, &file);
        set
    }
    /// Encodes `values` in the order of the fields; values that no field expects are left out.
    pub fn encode(&self, to: &mut Vec<u8>, values: &[Value<'_>]) {
        for (i, ((_, kind), value)) in self.fields.iter().zip(values).enumerate() {
            let field = i as u64 + 1;
            match (kind, value) {
                (Kind::Number, Value::Number(v)) => {
                    varint(to, field << 3 | 1);
                    to.extend_from_slice(&v.to_le_bytes());
                }
                (Kind::Text, Value::Text(v)) => bytes(to, field, v.as_bytes()),
                (Kind::Numbers, Value::Numbers(v)) => {
                    varint(to, field << 3 | 2);
                    varint(to, 8 * v.len() as u64);
                    v.iter().for_each(|v| to.extend_from_slice(&v.to_le_bytes()));
                }
                (Kind::Number | Kind::Text | Kind::Numbers, _) => {
                    debug_assert!(false, "{}: field {field} is of another kind", self.name);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINT: Flat = Flat {
        name: "Point",
        fields: &[("x", Kind::Number), ("label", Kind::Text), ("sd", Kind::Numbers)],
    };

    #[test]
    fn bytes_are_those_of_the_protobuf_encoding() {
        let mut to = Vec::new();
        POINT.encode(
            &mut to,
            &[Value::Number(1.0), Value::Text("ab"), Value::Numbers(&[2.0])],
        );
        let mut expected = vec![0x09];
        expected.extend(1.0f64.to_le_bytes());
        expected.extend([0x12, 2, b'a', b'b', 0x1a, 8]);
        expected.extend(2.0f64.to_le_bytes());
        assert_eq!(to, expected);
    }

    #[test]
    fn lengths_beyond_127_take_two_bytes() {
        let mut to = Vec::new();
        varint(&mut to, 300);
        assert_eq!(to, [0xac, 0x02]);
    }

    #[test]
    fn the_descriptor_names_package_message_and_fields() {
        let set = POINT.descriptor_set();
        for name in ["alight", "Point", "label", "proto3"] {
            assert!(
                set.windows(name.len()).any(|w| w == name.as_bytes()),
                "{name} is missing"
            );
        }
        // set.file, then the file's name.
        assert_eq!((set[0], set[2]), (0x0a, 0x0a));
    }
}
