//! RTCM 3 frames of a receiver that is a moving base (RTCM 10403.3, section 4): real numbers, lengths and checksums around a
//! content that nothing decodes.

/// First byte of a frame.
const PREAMBLE: u8 = 0xD3;
/// CRC-24Q: x^24 + x^23 + x^18 + x^17 + x^14 + x^11 + x^10 + x^7 + x^6 + x^5 + x^4 + x^3 + x + 1.
const POLYNOMIAL: u32 = 0x186_4CFB;

/// Frame of a message of twelve bits `number` with subtype or station 0, then `content`, 1020 bytes at most.
pub fn frame(number: u16, content: &[u8]) -> Vec<u8> {
    let (length, number) = (content.len() as u16 + 3, number << 4);
    let mut bytes = vec![PREAMBLE];
    bytes.extend(length.to_be_bytes());
    bytes.extend(number.to_be_bytes());
    bytes.push(0);
    bytes.extend_from_slice(content);
    let crc = bytes.iter().fold(0_u32, |crc, byte| {
        (0..8).fold(crc ^ (u32::from(*byte) << 16), |crc, _| {
            let shifted = crc << 1;
            if shifted & 0x100_0000 == 0 {
                shifted
            } else {
                shifted ^ POLYNOMIAL
            }
        })
    });
    let [_, check @ ..] = crc.to_be_bytes();
    bytes.extend(check);
    bytes
}

/// Content of a whole frame of [`frame`].
pub fn content(frame: &[u8]) -> &[u8] {
    let end = frame.len().saturating_sub(3);
    frame.get(6..end).unwrap_or_default()
}
