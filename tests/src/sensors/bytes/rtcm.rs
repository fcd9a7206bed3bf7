//! RTCM 3 frames of a moving base (RTCM 10403.3, section 4): real numbers, lengths and checksums; nothing
//! decodes the content.

use alight_shared::rtcm;

/// `number`: 12 bits; subtype or station 0; `content`: at most 1020 bytes.
pub fn frame(number: u16, content: &[u8]) -> Vec<u8> {
    let [high, low] = (number << 4).to_be_bytes();
    rtcm::frame(&[&[high, low, 0], content].concat())
}

pub fn content(frame: &[u8]) -> &[u8] {
    let end = frame.len().saturating_sub(3);
    frame.get(6..end).unwrap_or_default()
}
