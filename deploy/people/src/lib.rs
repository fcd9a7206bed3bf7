//! User interfaces: [`explain`], [`status`], [`view`], [`said`] and [`tools`]. Each module uses only the modules before it.

pub mod explain;
pub mod said;
pub mod status;
pub mod tools;
pub mod view;
