//! Jumps of the autopilot's origin, which put everything in its frame elsewhere.

/// The autopilot's count of origin resets as last reported.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct OriginResets(Option<u8>);

impl OriginResets {
    /// Whether the origin has moved since the last report.
    pub(crate) fn moved(&mut self, count: u8) -> bool {
        self.0.replace(count).is_some_and(|last| last != count)
    }
}
