//! Admission of inputs for all nodes: counted rejections, newest values, periods, senders, precedence of commands.

mod access;
pub mod command;
mod latest;
mod periodic;
mod rejection;
mod retransmission;
mod sender;

pub use access::AccessRejection;
pub use command::CommandAdmission;
pub use latest::{Latest, Rule};
pub use periodic::Periodic;
pub use rejection::{RejectionReason, Rejections};
pub use retransmission::Retransmission;
pub use sender::{Arrival, Sender};

use crate::{
    msg::{Header, Message, message_version},
    time::Clock,
};

/// Checks version and content of a message.
pub fn check_message<M: Message>(message: &M) -> Result<(), RejectionReason> {
    if message.header().version != message_version() {
        return Err(RejectionReason::Version);
    }
    message.check().map_err(|_field| RejectionReason::OutOfRange)
}

/// Checks that a header concerns this vessel, and this drone or any (drone 0).
pub fn check_identity<C: Clock>(header: &Header<C>, vessel: u32, drone: u32) -> Result<(), RejectionReason> {
    if header.version != message_version() {
        return Err(RejectionReason::Version);
    }
    if header.vessel != vessel {
        return Err(RejectionReason::Vessel);
    }
    if header.drone != 0 && header.drone != drone {
        return Err(RejectionReason::Drone);
    }
    Ok(())
}
