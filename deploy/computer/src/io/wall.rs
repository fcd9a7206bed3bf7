//! Time of day, for data that leave the computer; no flight depends on it.

use std::time::{SystemTime, UNIX_EPOCH};

/// Nanoseconds since 1970 by the system clock, which a time service may set; 0 if the clock is earlier.
#[allow(clippy::disallowed_methods)]
pub fn wall_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |d| i64::try_from(d.as_nanos()).unwrap_or(i64::MAX))
}
