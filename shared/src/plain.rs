//! Plain data that may be transported in shared memory, with the topic of each type. Another crate implements
//! the transport.
#![allow(unsafe_code)]

use core::fmt::Debug;

use serde::Serialize;

use crate::{
    process::ProcessState,
    topics::{self, Topic},
};

/// Message stored in shared memory unchanged, and its only topic.
///
/// # Safety
/// The type is plain data of fixed size, without pointers, references or handles, all the way down, and every process that
/// shares it has the same [`Topic::layout`], or the type is `repr(C)` without enumerations and `Option`.
pub unsafe trait Plain: Copy + Debug + Serialize + 'static {
    /// Topic with name, buffer and staleness limit.
    const TOPIC: &'static Topic;
    /// Sequence number and boot id for counting missed messages; None for messages without them.
    fn order(&self) -> Option<(u32, u32)>;
    /// Time of validity, ns on its own clock.
    fn at_ns(&self) -> i64;
}

/// Operation performed on every type in shared memory.
pub trait Visitor {
    /// Error that ends the visit.
    type Error;
    /// Visits one type.
    fn visit<T: Plain>(&mut self) -> Result<(), Self::Error>;
}

// SAFETY: every memory type in the table of topics is plain data of fixed size without pointers, references or handles,
// all the way down, and `repr(C)` except for two details whose layout Rust fixes only within one compilation:
// enumerations (`repr(u8)`) with few valid values, and `Option` in odometry, plans, surroundings, grants, forecasts,
// checkpoints, metrics, reports of the vessel's processes and reports of a computer. Both are sound because a service's
// attribute is the hash of the layout (`Topic::layout`), so that only processes with one layout share a service, and
// because a process writes a message only by copying a whole valid value. Bounded lists check their length when read.
macro_rules! plain {
    ($($ty:ty => $topic:ident;)*) => {
        $(
            #[allow(unsafe_code, reason = "the SAFETY comment of `plain!` gives the reason")]
            unsafe impl $crate::plain::Plain for $ty {
                const TOPIC: &'static Topic = &$topic;
                fn order(&self) -> Option<(u32, u32)> {
                    Some((self.header.boot, self.header.sequence))
                }
                fn at_ns(&self) -> i64 {
                    self.header.at.nanos()
                }
            }
        )*
        /// Visits every type in shared memory.
        pub fn each_in_memory<V: $crate::plain::Visitor>(visitor: &mut V) -> Result<(), V::Error> {
            $(visitor.visit::<$ty>()?;)*
            visitor.visit::<$crate::process::ProcessState>()
        }
    };
}
// SAFETY: as above.
unsafe impl Plain for ProcessState {
    const TOPIC: &'static Topic = &topics::PROCESS;
    fn order(&self) -> Option<(u32, u32)> {
        // Many processes share the topic: sequence gaps carry no information.
        None
    }
    fn at_ns(&self) -> i64 {
        self.at_ns
    }
}

#[cfg(test)]
mod tests {
    use core::{mem::offset_of, ptr::from_ref};

    use crate::msg::{Reason, ReasonCode, RelativeState};

    fn byte<T>(value: &T, offset: usize) -> u8 {
        assert!(offset < size_of::<T>());
        // SAFETY: the byte is inside the value; the callers name bytes of tags and enumerations, which every value has.
        unsafe { *from_ref(value).cast::<u8>().add(offset) }
    }
    /// Size of an optional value, and offset of the value in it.
    fn layout<T>(value: T) -> [usize; 2] {
        let some = Some(value);
        let inside = from_ref(some.as_ref().unwrap()).addr();
        [size_of::<Option<T>>(), inside - from_ref(&some).addr()]
    }

    /// Rules by which other programs read shared memory (deploy/docs/radio.md).
    #[test]
    fn optional_values_in_memory() {
        // A tag as wide as the alignment, followed by the value.
        assert_eq!((layout(1.0_f64), layout([1_u32; 2])), ([16, 8], [12, 4]));
        assert_eq!([0, 7].map(|k| byte(&Some(1.0_f64), k)), [1, 0]);
        assert_eq!([0, 7].map(|k| byte(&None::<f64>, k)), [0, 0]);
        // No tag: None is an invalid number in the widest gap between the valid numbers of the value.
        assert_eq!(layout(Reason::default()), [size_of::<Reason>(), 0]);
        let code = byte(&None::<Reason>, offset_of!(Reason, code));
        assert_eq!(usize::from(code), ReasonCode::ALL.len());
        assert_eq!(layout(RelativeState::default()), [size_of::<RelativeState>(), 0]);
        let tag = offset_of!(RelativeState, contradicted_m);
        assert_eq!(byte(&None::<RelativeState>, tag), 2);
    }
}
