//! Bounded list of plain data: of fixed size in shared memory, with a length check on the wire.

use core::{
    fmt,
    ops::{Deref, DerefMut},
};
use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// At most `N` items of plain data, stored in place.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Seq<T, const N: usize> {
    len: u32,
    items: [T; N],
}

impl<T: Copy + Default, const N: usize> Seq<T, N> {
    /// An empty list.
    pub fn new() -> Self {
        Seq {
            len: 0,
            items: [T::default(); N],
        }
    }
    /// Takes the items that fit and drops the rest.
    pub fn filled(items: impl IntoIterator<Item = T>) -> Self {
        let mut s = Self::new();
        for i in items {
            if s.push(i).is_err() {
                break;
            }
        }
        s
    }
    /// Appends `item`, or returns it if the list is full.
    pub fn push(&mut self, item: T) -> Result<(), T> {
        match self.items.get_mut(self.len as usize) {
            Some(slot) => {
                *slot = item;
                self.len += 1;
                Ok(())
            }
            None => Err(item),
        }
    }
}

impl<T: Copy + Default, const N: usize> Default for Seq<T, N> {
    fn default() -> Self {
        Self::new()
    }
}
impl<T, const N: usize> Deref for Seq<T, N> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // A length from another process is untrusted: never index past the storage.
        self.items.get(..self.len as usize).unwrap_or(&self.items)
    }
}
impl<T, const N: usize> DerefMut for Seq<T, N> {
    fn deref_mut(&mut self) -> &mut [T] {
        let n = (self.len as usize).min(N);
        &mut self.items[..n]
    }
}
impl<T: PartialEq, const N: usize> PartialEq for Seq<T, N> {
    fn eq(&self, o: &Self) -> bool {
        **self == **o
    }
}
impl<T: fmt::Debug, const N: usize> fmt::Debug for Seq<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}
impl<T: Serialize, const N: usize> Serialize for Seq<T, N> {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_seq(self.iter())
    }
}
impl<'de, T: Deserialize<'de> + Copy + Default, const N: usize> Deserialize<'de> for Seq<T, N> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let items = Vec::<T>::deserialize(d)?;
        if items.len() > N {
            return Err(D::Error::custom(format!(
                "{} items, at most {N} are accepted",
                items.len()
            )));
        }
        Ok(Seq::filled(items))
    }
}
impl<T: JsonSchema, const N: usize> JsonSchema for Seq<T, N> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        format!("Seq_of_{}", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": generator.subschema_for::<T>(), "maxItems": N })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn push_to_a_full_seq() {
        let mut s = Seq::<u8, 2>::new();
        assert_eq!(s.push(1), Ok(()));
        assert_eq!(s.push(2), Ok(()));
        assert_eq!(s.push(3), Err(3));
        assert_eq!(&*s, &[1, 2]);
    }
}
