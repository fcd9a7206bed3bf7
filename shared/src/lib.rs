//! The vocabulary of Alight: what vessel and drone agree on, without any middleware.
//!
//! Read in this order: [`time`], [`frames`], [`msg`], [`topics`], [`node`], [`config`], then the
//! two models that both computers share: [`vessel_model`] and [`kalman`].

pub mod config;
pub mod frames;
pub mod geometry;
pub mod kalman;
pub mod msg;
pub mod node;
pub mod seq;
pub mod time;
pub mod topics;
#[cfg(feature = "transport")]
pub mod transport;
pub mod vessel_model;
pub mod wire;
