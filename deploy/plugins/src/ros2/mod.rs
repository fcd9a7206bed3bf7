//! ROS 2 node without ROS: publishes the data of an Alight computer as ROS messages over Zenoh, in the form of
//! rmw_zenoh, and offers two services that forward orders.
//!
//! From the lowest layer up: [`messages`] and [`cdr`] are ROS types and their encoding, [`frames`] converts NED and
//! FRD to ENU and FLU, [`names`] makes keys and liveliness tokens; [`poses`], [`fixed`] and [`diagnostics`] fill the
//! messages; [`orders`] forwards the services' orders; [`session`] is the Zenoh session for all of these, and
//! [`command`] is `alight ros2`. No flight waits for the node.
//!
//! hiroz 0.2, by Zenoh's makers, is not used. It is experimental by its own description, enables Zenoh's shared
//! memory and depends on `zenoh-ext` with bincode 1; the dependencies of both have advisories. Whether its keys have
//! hashes (for all distributions but Humble) is a feature chosen at build time, while `--distro` is chosen at run
//! time.

pub mod cdr;
pub mod command;
pub mod diagnostics;
pub mod fixed;
pub mod frames;
pub mod messages;
pub mod names;
pub mod orders;
pub mod poses;
pub mod session;
