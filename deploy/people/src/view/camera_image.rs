use alight_shared::time::{Span, Time, TrueTime};

use crate::view::picture::CameraView;

#[derive(Clone, Copy, Debug)]
pub struct ShownImage {
    /// Middle of the exposure, on the board's clock.
    pub at: Time<TrueTime>,
    /// Middle of the exposure on the drone's clock, ns.
    pub at_ns: i64,
    /// Number of tags and of deck outlines in the image.
    pub marks: [u32; 2],
}

impl ShownImage {
    pub fn view(&self, t: Time<TrueTime>) -> CameraView {
        let age = (t - self.at).max(Span::ZERO);
        CameraView {
            number: self.at_ns / 1_000_000,
            age_s: (10.0 * age.secs()).round() / 10.0,
            text: describe(self.marks),
        }
    }
}

fn describe([tags, outlines]: [u32; 2]) -> String {
    let tags = match tags {
        0 => return "no tag of the deck is detected".into(),
        1 => "1 tag of the deck is detected".to_owned(),
        n => format!("{n} tags of the deck are detected"),
    };
    let outline = if outlines > 0 {
        ", the deck's edge is drawn by them"
    } else {
        ", no pose of the deck fits them"
    };
    tags + outline
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_image_as_text() {
        let shown = |marks| ShownImage {
            at: Time::from_secs(100.0),
            at_ns: 7_000_000,
            marks,
        };
        let view = shown([2, 1]).view(Time::from_secs(100.42));
        assert_eq!((view.number, view.age_s), (7, 0.4));
        assert_eq!(
            view.text,
            "2 tags of the deck are detected, the deck's edge is drawn by them"
        );
        assert!(shown([0, 0]).view(Time::from_secs(99.0)).age_s < 0.05);
        assert!(describe([1, 0]).ends_with("no pose of the deck fits them"));
    }
}
