//! User interfaces: [`explain`], [`status`], [`view`] and [`tools`]. Each module uses only the modules before it.

pub mod explain;
pub mod status;
pub mod tools;
pub mod view;
