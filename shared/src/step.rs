//! A row's step as those see it that only look: a log, which writes it, and a test, which reads it.

use core::any::Any;

use serde::Serialize;

use crate::process::ProcessKind;
use crate::wire::{self, WireError};

/// An input or an output of a step.
pub trait Recorded: Any {
    /// Appends it as a record; an error where it is longer than [`wire::MAX_RECORD_BYTES`].
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError>;
}

impl<T: Serialize + Any> Recorded for T {
    fn append(&self, to: &mut Vec<u8>) -> Result<(), WireError> {
        wire::append_record(to, self)
    }
}

/// The parts of a step that are messages of topics.
pub trait Parts {
    /// The input with `change` applied to each part that a topic brought, an `Option` or a `Vec` of messages.
    fn input_with(&self, change: &mut dyn FnMut(&mut dyn Any)) -> Box<dyn Recorded>;
    /// Shows each part of the output that goes to a topic.
    fn written(&self, each: &mut dyn FnMut(&dyn Any));
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
    /// Messages in both.
    pub parts: &'a dyn Parts,
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
