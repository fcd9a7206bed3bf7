//! Interfaces for people: [`explain`]; [`status`]; [`view`]; [`tools`]. Each uses only those before it.

pub mod explain;
pub mod status;
pub mod tools;
pub mod view;
