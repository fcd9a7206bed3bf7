//! Documents and charts of reports.

pub mod chart;
pub mod document;
