//! Landings in real time: the nodes as processes over Zenoh and iceoryx2, with a process for the simulated vehicles
//! and injected faults.

pub mod air;
pub mod args;
pub mod attach;
pub mod config;
pub mod detections;
pub mod emulator;
pub mod fault;
pub mod impairment;
pub mod land;
pub mod landing_setup;
pub mod list;
pub mod namespaces;
pub mod plant;
pub mod profile;
pub mod rehearse;
pub mod render_thread;
pub mod report;
pub mod serial_lines;
pub mod service;
pub mod truth;
pub mod world;
