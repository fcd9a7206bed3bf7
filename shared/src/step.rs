//! Read-only view of a node's step for observers such as a log or a test.

use core::any::Any;

use serde::Serialize;

use crate::{
    process::ProcessKind,
    wire::{self, WireError},
};

/// Input or output of a step.
pub trait Recorded: Any {
    /// Appends the value to `to` as a record; an error if longer than [`wire::MAX_RECORD_BYTES`].
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError>;
}

impl<T: Serialize + Any> Recorded for T {
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError> {
        wire::append_record(to, self)
    }
}

/// The parts of a step that are messages of topics.
pub trait Parts {
    /// Input with `change` applied to each part from a topic, an `Option` or a `Vec` of messages.
    fn input_with(&self, change: &mut dyn FnMut(&mut dyn Any)) -> Box<dyn Recorded>;
    /// Passes each part of the output that goes to a topic to `each`.
    fn written(&self, each: &mut dyn FnMut(&dyn Any));
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
    /// Messages in input and output.
    pub parts: &'a dyn Parts,
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
        struct NoParts;
        impl Parts for NoParts {
            fn input_with(&self, _: &mut dyn FnMut(&mut dyn Any)) -> Box<dyn Recorded> {
                Box::new(())
            }
            fn written(&self, _: &mut dyn FnMut(&dyn Any)) {}
        }
        let step = Step {
            process: ProcessKind::Pilot,
            boot: 1,
            now_ns: 5,
            input: &7_u32,
            output: &"up".to_string(),
            parts: &NoParts,
        };
        assert_eq!((step.input::<u32>(), step.input::<u64>()), (Some(&7), None));
        assert_eq!(step.output::<String>().map(String::as_str), Some("up"));
        let mut bytes = Vec::new();
        step.input.append(&mut bytes).unwrap();
        assert_eq!(bytes, wire::encode_record(&7_u32).unwrap());
    }
}
