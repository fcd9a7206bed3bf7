//! Processes of a vessel's and of a drone's computer, in layers that use only the layers before them:
//! [`exit`], [`quantity`] and [`terminal`]; [`config`]; [`certificates`] and [`io`]; [`record`]; [`process`],
//! [`vessel`] and [`drone`]; [`subject`], [`situation`] and [`playback`].

pub mod certificates;
pub mod config;
pub mod drone;
pub mod exit;
pub mod io;
pub mod playback;
pub mod process;
pub mod quantity;
pub mod record;
#[cfg(test)]
mod scratch;
pub mod situation;
pub mod subject;
pub mod table;
pub mod terminal;
pub mod vessel;
