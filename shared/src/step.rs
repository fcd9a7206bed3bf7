//! A row's step as those see it that only look: a log, which writes it, and a test, which reads it.

use core::any::Any;

use serde::Serialize;

use crate::process::ProcessKind;
use crate::wire::{self, WireError};

/// An input or an output of a step.
pub trait Recorded: Any {
    /// Appends it as a record; an error where it is longer than [`wire::MAX_RECORD_BYTES`].
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError>;
    /// [`wire::hash_record`] of it.
    fn hash(&self) -> Result<u64, WireError>;
}

impl<T: Serialize + Any> Recorded for T {
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError> {
        wire::append_record(to, self)
    }
    fn hash(&self) -> Result<u64, WireError> {
        wire::hash_record(self)
    }
}

/// A step.
#[derive(Clone, Copy)]
pub struct Step<'a> {
    /// The row that stepped.
    pub process: ProcessKind,
    /// The boot id of its start.
    pub boot: u32,
    /// The row's own time, ns.
    pub now_ns: i64,
    /// Input of the step.
    pub input: &'a dyn Recorded,
    /// Output of the step.
    pub output: &'a dyn Recorded,
}

impl Step<'_> {
    /// The input, where it is of this type.
    pub fn input<I: 'static>(&self) -> Option<&I> {
        let input: &dyn Any = self.input;
        input.downcast_ref()
    }
    /// The output, where it is of this type.
    pub fn output<O: 'static>(&self) -> Option<&O> {
        let output: &dyn Any = self.output;
        output.downcast_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_by_the_types_of_its_ends() {
        let step = Step {
            process: ProcessKind::Pilot,
            boot: 1,
            now_ns: 5,
            input: &7_u32,
            output: &"up".to_string(),
        };
        assert_eq!((step.input::<u32>(), step.input::<u64>()), (Some(&7), None));
        assert_eq!(step.output::<String>().map(String::as_str), Some("up"));
        let mut bytes = Vec::new();
        step.input.append(&mut bytes).unwrap();
        assert_eq!(bytes, wire::encode_record(&7_u32).unwrap());
        assert_eq!(step.output.hash().unwrap(), wire::hash_record(&"up").unwrap());
    }
}
