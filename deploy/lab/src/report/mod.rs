//! Documents of reports.

pub mod document;
