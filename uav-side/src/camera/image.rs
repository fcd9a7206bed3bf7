//! Grey image of bounded size, and its file format PGM.

use alight_shared::{
    config::{ConfigError, Keys},
    time::{DroneClock, Time},
    wire::hash_bytes,
};
use nalgebra::Vector2;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use thiserror::Error;

/// Minimum side of an image, px: a tag needs 10 cells, and the detector works on tiles.
pub const MIN_SIDE_PX: usize = 32;
pub const MAX_SIDE_PX: usize = 8192;
pub const MAX_PIXELS: usize = 12 * 1024 * 1024;

#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ImageError {
    /// The size is out of bounds, or the number of pixels does not match it.
    #[error(
        "an image of {width} x {height} px with {pixels} bytes is rejected: allowed are 32 to 8192 px a side, \
         12.6 million in all, one byte for each"
    )]
    Size {
        width: usize,
        height: usize,
        pixels: usize,
    },
    #[error("not an 8-bit grey PGM image (P5): {0}")]
    Pgm(&'static str),
}

impl ImageError {
    fn size(width: usize, height: usize, pixels: usize) -> ImageError {
        ImageError::Size {
            width,
            height,
            pixels,
        }
    }
}

/// 8-bit grey image, rows from the top, without padding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
    is_kept: bool,
}

/// Checks the image of a lens: size (width and height, px), scale and principal point.
pub(super) fn check_image(
    at: &Keys<'_>,
    [width_px, height_px]: [u32; 2],
    focal_px: &[f64; 2],
    centre_px: &[f64; 2],
) -> Result<(), ConfigError> {
    at.require(
        GreyImage::accepts(width_px as usize, height_px as usize),
        "width_px, height_px",
        format!("{width_px} x {height_px}"),
        "32 to 8192 each, at most 12.6 million pixels",
    )?;
    at.ranges("focal_px", focal_px, 10.0, 1e5)?;
    let sides = [width_px, height_px].map(f64::from);
    let is_inside = centre_px
        .iter()
        .zip(sides)
        .all(|(at, side)| (0.0..=side).contains(at));
    at.require(
        is_inside,
        "centre_px",
        format!("{centre_px:?}"),
        &format!(
            "a point in the image of {width_px} x {height_px} px: a calibration belongs to images of one size, \
             set width_px and height_px to it"
        ),
    )
}

impl Serialize for GreyImage {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let pixels = self.is_kept.then_some(&self.pixels);
        (self.width, self.height, hash_bytes(&self.pixels), pixels).serialize(to)
    }
}
impl<'de> Deserialize<'de> for GreyImage {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let (width, height, _, pixels) = <(_, _, u64, Option<Vec<u8>>)>::deserialize(from)?;
        let pixels = pixels.ok_or_else(|| D::Error::custom("an image is recorded by its hash alone"))?;
        let mut image = GreyImage::new(width, height, pixels).map_err(D::Error::custom)?;
        image.keep();
        Ok(image)
    }
}

impl GreyImage {
    pub fn accepts(width: usize, height: usize) -> bool {
        let side = MIN_SIDE_PX..=MAX_SIDE_PX;
        side.contains(&width) && side.contains(&height) && width * height <= MAX_PIXELS
    }
    pub fn new(width: usize, height: usize, pixels: Vec<u8>) -> Result<GreyImage, ImageError> {
        if !GreyImage::accepts(width, height) || width * height != pixels.len() {
            return Err(ImageError::size(width, height, pixels.len()));
        }
        Ok(GreyImage {
            width,
            height,
            pixels,
            is_kept: false,
        })
    }
    /// Makes recordings contain the pixels instead of their hash.
    pub fn keep(&mut self) {
        self.is_kept = true;
    }
    /// Reads a binary PGM: `P5`, width, height and 255, comments from `#` to the end of a line, one blank, rows.
    pub fn from_pgm(bytes: &[u8]) -> Result<GreyImage, ImageError> {
        let rest = bytes.strip_prefix(b"P5").ok_or(ImageError::Pgm("no P5"))?;
        let (width, rest) = number(rest)?;
        let (height, rest) = number(rest)?;
        let (depth, rest) = number(rest)?;
        if depth != 255 {
            return Err(ImageError::Pgm("its maximum value is not 255"));
        }
        let rows = rest.get(1..).ok_or(ImageError::Pgm("no pixels"))?;
        // Bytes after the first image belong to another image.
        let length = width.saturating_mul(height);
        let rows = rows.get(..length).unwrap_or(rows);
        if !GreyImage::accepts(width, height) {
            return Err(ImageError::size(width, height, rows.len()));
        }
        GreyImage::new(width, height, rows.to_vec())
    }
    pub fn to_pgm(&self) -> Vec<u8> {
        let mut bytes = format!("P5\n{} {}\n255\n", self.width, self.height).into_bytes();
        bytes.extend_from_slice(&self.pixels);
        bytes
    }
    pub fn width(&self) -> usize {
        self.width
    }
    pub fn height(&self) -> usize {
        self.height
    }
    pub(super) fn has_size(&self, width_px: u32, height_px: u32) -> bool {
        [self.width, self.height] == [width_px as usize, height_px as usize]
    }
    /// Grey level of the pixel at this point (px); None outside the image.
    pub(super) fn level_near(&self, at: Vector2<f64>) -> Option<u8> {
        let (column, row) = (at.x.round(), at.y.round());
        let inside = (0.0..self.width as f64).contains(&column) && (0.0..self.height as f64).contains(&row);
        let index = || row as usize * self.width + column as usize;
        inside.then(index).and_then(|k| self.pixels.get(k).copied())
    }
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }
}

/// Next decimal number in a PGM header, and the remaining bytes.
fn number(bytes: &[u8]) -> Result<(usize, &[u8]), ImageError> {
    let mut rest = bytes;
    loop {
        match rest {
            [b'#', ..] => {
                let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
                rest = rest.get(end..).unwrap_or_default();
            }
            [b, tail @ ..] if b.is_ascii_whitespace() => rest = tail,
            _ => break,
        }
    }
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    // A number of more than six digits exceeds every valid size.
    if digits == 0 || digits > 6 {
        return Err(ImageError::Pgm("its size is not a number"));
    }
    let (digits, rest) = rest.split_at(digits);
    let value = digits.iter().fold(0, |n, b| n * 10 + usize::from(b - b'0'));
    Ok((value, rest))
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CameraFrame {
    /// Time of the middle of the exposure.
    pub at: Time<DroneClock>,
    pub image: GreyImage,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn pgm_round_trip_with_comments() {
        let image = GreyImage::new(40, 33, (0..40 * 33).map(|k| k as u8).collect()).unwrap();
        assert_eq!(GreyImage::from_pgm(&image.to_pgm()), Ok(image.clone()));
        let text = b"P5 # made by hand\n# 7\n40\t33 255\n";
        let bytes = [&text[..], image.pixels()].concat();
        assert_eq!(GreyImage::from_pgm(&bytes), Ok(image));
    }

    #[test]
    fn record_of_an_image_by_hash_and_by_content() {
        use alight_shared::wire::{decode_record, encode_record};
        let mut image = GreyImage::new(40, 33, vec![7; 40 * 33]).unwrap();
        let hash = encode_record(&image).unwrap();
        assert_eq!(hash.len(), 3 * 8 + 1);
        assert!(decode_record::<GreyImage>(&hash).is_err());
        image.keep();
        let whole = encode_record(&image).unwrap();
        assert_eq!(decode_record::<GreyImage>(&whole).unwrap(), image);
    }

    #[test]
    fn image_size_out_of_bounds() {
        for (w, h) in [(31, 40), (40, 0), (8193, 40), (8192, 8192), (usize::MAX, 2)] {
            assert!(!GreyImage::accepts(w, h), "{w} x {h}");
        }
        assert!(GreyImage::from_pgm(b"P5 999999 999999 255\n").is_err());
        assert!(GreyImage::from_pgm(b"P5 99999999999999999999 40 255\n").is_err());
        assert!(GreyImage::from_pgm(b"P5 40 40 65535\n").is_err());
        assert!(GreyImage::from_pgm(b"P5 40 40 255\nshort").is_err());
        assert!(GreyImage::new(40, 40, vec![0; 1599]).is_err());
    }

    proptest! {
        #[test]
        fn pgm_arbitrary_bytes(head in "P5[ #0-9\n]{0,40}", bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _either = GreyImage::from_pgm(&[head.as_bytes(), &bytes].concat());
            let _either = GreyImage::from_pgm(&bytes);
        }
    }
}
