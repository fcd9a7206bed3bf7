//! Plain data that may lie in shared memory, and the topic of each. What moves it is another crate; this one states, type by
//! type, that it may be moved.
#![allow(unsafe_code)]

use core::fmt::Debug;

use serde::Serialize;

use crate::process::ProcessState;
use crate::topics::{self, Topic};

/// A message that lies in shared memory as it is, and the one topic it travels on.
///
/// # Safety
/// The type is plain data of fixed size, without pointers, references or handles, all the way down, and every process that
/// shares it is of the same build, or the type is `repr(C)` without enumerations and `Option`.
pub unsafe trait Plain: Copy + Debug + Serialize + 'static {
    /// Its topic: name, buffer and staleness limit.
    const TOPIC: &'static Topic;
    /// Its sequence number and boot id, to count what was missed; None for messages without.
    fn order(&self) -> Option<(u32, u32)>;
    /// Its time of validity, ns on its own clock.
    fn at_ns(&self) -> i64;
}

/// What is done for every type of shared memory.
pub trait Visitor {
    /// What ends it early.
    type Error;
    /// For one.
    fn visit<T: Plain>(&mut self) -> Result<(), Self::Error>;
}

// SAFETY: every type of the table of topics that lies in memory is plain data of fixed size without pointers, references or handles,
// all the way down, and `repr(C)` but for two details whose layout Rust fixes only within one
// compilation: enumerations (`repr(u8)`) with few valid values, and `Option` in odometry, in a plan, in surroundings, in grants, in forecasts, in the checkpoints, in
// metrics, in what the vessel's processes report and in what a computer reports of itself. Both are sound here because a
// service's attributes carry `MESSAGE_VERSION` and the package's version, so that only processes of one program ever share a service, and because no process writes a message
// otherwise than by copying a whole valid value. Bounded lists check their length when they are read.
macro_rules! plain {
    ($($ty:ty => $topic:ident;)*) => {
        $(
            #[allow(unsafe_code, reason = "the SAFETY comment of `plain!` says why it is sound")]
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
        /// Visits every type that lies in shared memory.
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
        // Many processes share the topic: a gap means nothing.
        None
    }
    fn at_ns(&self) -> i64 {
        self.at_ns
    }
}
