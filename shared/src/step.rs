//! Read-only view of a node's step for observers: a log writes it, and a test reads it.

use core::any::Any;

use serde::Serialize;

use crate::process::ProcessKind;
use crate::wire::{self, WireError};

/// Input or output of a step.
pub trait Recorded: Any {
    /// Appends the value to `to` as a record. Returns an error if the record is longer than [`wire::MAX_RECORD_BYTES`].
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError>;
    /// Hash by [`wire::hash_record`].
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

/// One step of a node.
#[derive(Clone, Copy)]
pub struct Step<'a> {
    /// Process of the node.
    pub process: ProcessKind,
    /// Boot id of the process.
    pub boot: u32,
    /// Time on the node's own clock, ns.
    pub now_ns: i64,
    /// Input of the step.
    pub input: &'a dyn Recorded,
    /// Output of the step.
    pub output: &'a dyn Recorded,
}

impl Step<'_> {
    /// Input, if it is of this type.
    pub fn input<I: 'static>(&self) -> Option<&I> {
        let input: &dyn Any = self.input;
        input.downcast_ref()
    }
    /// Output, if it is of this type.
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
