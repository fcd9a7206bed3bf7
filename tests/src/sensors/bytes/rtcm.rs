//! RTCM 3 frames from a moving base (RTCM 10403.3, section 4), with realistic numbers, lengths and checksums;
//! nothing decodes their content.

use alight_shared::rtcm;

/// `number` has 12 bits; subtype or station is 0; `content` has at most 1020 bytes.
pub fn frame(number: u16, content: &[u8]) -> Vec<u8> {
    let [high, low] = (number << 4).to_be_bytes();
    rtcm::frame(&[&[high, low, 0], content].concat())
}

pub fn content(frame: &[u8]) -> &[u8] {
    let end = frame.len().saturating_sub(3);
    frame.get(6..end).unwrap_or_default()
}
