//! Commands for users: flights, checks, certificates, configurations.

pub mod check;
pub mod command;
pub mod config;
pub mod estimate;
pub mod flights;
pub mod init;
pub mod keys;
pub mod replay;
pub mod schema;
pub mod tag;
pub mod view;
mod view_vessel;
