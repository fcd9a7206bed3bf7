//! Tags in an image without a tag of the deck: other numbers, mirrored ones, other families. They show an
//! operator why the deck is not detected; a flight does not search for them.

use alight_shared::tags::Tags;
use apriltag::{Detector, DetectorBuilder, Family, Image};

use super::detector::TagSettings;
use super::image::GreyImage;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForeignTag {
    /// Tag of the deck's family with this number, which the deck lacks.
    Number(usize),
    /// Mirrored tag of the deck's family with this number.
    Mirrored(usize),
    Family(&'static str),
}

pub struct ForeignTags {
    tags: Tags,
    min_margin: f64,
    own: Option<Detector>,
    others: Vec<(&'static str, Detector)>,
}

impl ForeignTags {
    /// A tag with a wrong bit is ignored.
    pub fn new(settings: &TagSettings, tags: &Tags) -> ForeignTags {
        let detector = |family: Family| {
            let mut detector = DetectorBuilder::new().add_family_bits(family, 0).build().ok()?;
            detector.set_thread_number(1);
            detector.set_decimation(settings.decimate as f32);
            Some(detector)
        };
        // A family with fewer bits (16h5) would be detected in every window.
        let others = [
            ("25h9", Family::tag_25h9()),
            ("standard 41h12", Family::tag_standard_41h12()),
        ];
        let others = others.into_iter();
        ForeignTags {
            tags: *tags,
            min_margin: settings.min_margin,
            own: detector(Family::tag_36h11()),
            others: others
                .filter_map(|(name, family)| Some((name, detector(family)?)))
                .collect(),
        }
    }
    pub fn find(&mut self, image: &GreyImage) -> Option<ForeignTag> {
        let (width, height) = (image.width(), image.height());
        let plain = buffer(width, height, image.pixels())?;
        let rows = image.pixels().chunks_exact(width);
        let mirrored: Vec<u8> = rows.flat_map(|row| row.iter().rev().copied()).collect();
        let mirrored = buffer(width, height, &mirrored)?;
        let margin = self.min_margin;
        if let Some(own) = &mut self.own {
            let is_decks = |id: usize| self.tags.iter().any(|tag| usize::from(tag.id) == id);
            if let Some(id) = numbers(own, &plain, margin).into_iter().find(|id| !is_decks(*id)) {
                return Some(ForeignTag::Number(id));
            }
            if let Some(id) = numbers(own, &mirrored, margin).first() {
                return Some(ForeignTag::Mirrored(*id));
            }
        }
        for (name, detector) in &mut self.others {
            if !numbers(detector, &plain, margin).is_empty() {
                return Some(ForeignTag::Family(name));
            }
        }
        None
    }
}

/// Image in the library's format; None if memory runs out.
fn buffer(width: usize, height: usize, pixels: &[u8]) -> Option<Image> {
    let mut image = Image::zeros_with_stride(width, height, width).ok()?;
    if image.as_mut().len() != pixels.len() {
        return None;
    }
    image.as_mut().copy_from_slice(pixels);
    Some(image)
}

fn numbers(detector: &mut Detector, image: &Image, min_margin: f64) -> Vec<usize> {
    let found = detector.detect(image);
    let clear = found
        .iter()
        .filter(|f| f64::from(f.decision_margin()) >= min_margin);
    clear.map(|f| f.id()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::layout::cells;
    use super::*;
    use alight_shared::tags::DeckTag;

    /// Image of a tag viewed from straight above, mirrored or not.
    fn image(id: u16, mirrored: bool) -> GreyImage {
        let cells = cells(id).unwrap();
        let pixels = (0..120 * 120).map(|k| {
            let (row, column) = (k / 120, k % 120);
            let column = if mirrored { 119 - column } else { column };
            let inside = (20..100).contains(&row) && (20..100).contains(&column);
            let white = !inside || cells[(row - 20) / 10 + 1][(column - 20) / 10 + 1];
            if white { 200 } else { 20 }
        });
        GreyImage::new(120, 120, pixels.collect()).unwrap()
    }

    #[test]
    fn tags_that_are_not_the_decks() {
        let tags = Tags::filled([DeckTag {
            id: 7,
            ..DeckTag::default()
        }]);
        let mut foreign_tags = ForeignTags::new(&TagSettings::default(), &tags);
        assert_eq!(foreign_tags.find(&image(7, false)), None);
        assert_eq!(foreign_tags.find(&image(3, false)), Some(ForeignTag::Number(3)));
        assert_eq!(foreign_tags.find(&image(7, true)), Some(ForeignTag::Mirrored(7)));
        let empty = GreyImage::new(64, 48, vec![90; 64 * 48]).unwrap();
        assert_eq!(foreign_tags.find(&empty), None);
    }
}
