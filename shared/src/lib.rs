//! Types and models shared by vessel and drone, without any middleware.
//!
//! Suggested reading order: [`time`], [`frames`], [`geodesy`], [`geoid`], [`msg`], [`schema`], [`topics`], [`plain`],
//! [`node`], [`config`], [`admission`], then the estimation used by both computers: [`vessel_model`], [`motion_model`],
//! [`apparent_slope`] and [`estimation`].

// Message schemas show these comments to other programs.
#![warn(missing_docs)]

pub mod admission;
pub mod apparent_slope;
pub mod autopilot_parameters;
pub mod bus;
pub mod checkpoint;
pub mod config;
pub mod estimation;
pub mod frames;
pub mod geodesy;
pub mod geoid;
pub mod geometry;
pub mod landing;
pub mod lines;
#[cfg(feature = "mavlink")]
pub mod mavlink;
pub mod metrics;
pub mod motion_model;
pub mod msg;
pub mod node;
#[macro_use]
pub mod plain;
pub mod process;
pub mod radio;
pub mod rtcm;
pub mod schema;
pub mod step;
pub mod surroundings;
pub mod tags;
pub mod time;
pub mod topics;
pub mod vessel_model;
pub mod wire;
