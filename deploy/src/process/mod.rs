//! What every process does around its node: it wakes with messages, steps, publishes, records, reports itself
//! twice a second, and ends when it is asked to. And what starts processes and starts them again.

pub mod args;
pub mod flight;
pub mod instance;
pub mod journal;
pub mod keeper;
pub mod life;
pub mod local_command;
pub mod metrics;
pub mod notify;
pub mod observer;
pub mod radio_keys;
pub mod radio_rates;
pub mod scheduling;
pub mod shell;
pub mod snapshot;
pub mod supervision;
pub mod supervisor;
