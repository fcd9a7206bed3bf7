//! A node of ROS 2 without ROS: what a computer of Alight knows, published as ROS's own messages over Zenoh in the form of
//! rmw_zenoh, and two services that pass on an order.
//!
//! Inside out: [`messages`] and [`cdr`] are ROS's types and their bytes, [`frames`] turns NED and FRD into ENU and FLU,
//! [`names`] makes keys and liveliness tokens; [`poses`] and [`diagnostics`] fill the messages; [`orders`] passes on what
//! the services ask for; [`session`] is the Zenoh session of all of them, and [`command`] is `alight ros2`. Nothing in a flight
//! waits for it.
//!
//! hiroz 0.2, of Zenoh's makers, is not used: it turns on Zenoh's shared memory and brings `zenoh-ext` with bincode 1, and the
//! dependencies of both have advisories; whether its keys have hashes (all but Humble's) is a feature chosen when it is built,
//! where `--distro` is chosen when it runs; and it is experimental by its own description.

pub mod cdr;
pub mod command;
pub mod diagnostics;
pub mod frames;
pub mod messages;
pub mod names;
pub mod orders;
pub mod poses;
pub mod session;
