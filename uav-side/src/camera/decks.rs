//! Assigns the tags in an image to decks, because neighbouring boats may use the same tag numbers.

use alight_shared::tags::DeckTag;
use nalgebra::{Vector2, Vector3};

use super::square_pose::{DetectedTag, solve};

pub(super) const MAX_DECKS: usize = 4;
/// Maximum distance between a tag and its nominal place on a deck, m: half of the narrowest deck.
const WITHIN_M: f64 = 0.8;

/// Tags grouped by deck, starting with the deck of the largest tag. If no number is repeated, all tags belong to one
/// deck.
pub(super) fn apart(detected: Vec<DetectedTag>) -> Vec<Vec<DetectedTag>> {
    let (mut rest, mut decks) = (detected, Vec::new());
    while decks.len() < MAX_DECKS && !rest.is_empty() {
        let Some(around) = repeats(&rest).then(|| around_largest(&rest)).flatten() else {
            decks.push(rest);
            break;
        };
        let (own, others) = (0..rest.len()).partition::<Vec<usize>, _>(|k| around.contains(k));
        let of = |which: &[usize]| which.iter().filter_map(|k| rest.get(*k)).copied().collect();
        decks.push(of(&own));
        rest = of(&others);
    }
    decks
}

fn repeats(detected: &[DetectedTag]) -> bool {
    (detected.iter().enumerate()).any(|(k, a)| detected.iter().skip(k + 1).any(|b| a.tag.id == b.tag.id))
}

fn middle(s: &DetectedTag) -> Vector2<f64> {
    s.image.iter().sum::<Vector2<f64>>() / 4.0
}

/// The largest tag and those at their nominal places on its deck, one of each number; None if it has no pose.
fn around_largest(detected: &[DetectedTag]) -> Option<Vec<usize>> {
    let size = |s: &DetectedTag| (s.image[2] - s.image[0]).norm_squared();
    let largest = detected.iter().max_by(|a, b| size(a).total_cmp(&size(b)))?;
    let pose = solve(&[*largest])?;
    let off_m = |s: &DetectedTag| {
        let DeckTag { centre_m, .. } = s.tag;
        let at = pose.attitude * Vector3::from(centre_m) + pose.position;
        if at.z > 0.0 {
            (at.xy() / at.z - middle(s)).norm() * at.z
        } else {
            f64::INFINITY
        }
    };
    let best_of = |id: u16| {
        let same = detected.iter().enumerate().filter(|(_, s)| s.tag.id == id);
        same.map(|(k, s)| (k, off_m(s)))
            .filter(|(_, off)| *off < WITHIN_M)
            .min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let mut own: Vec<usize> = detected
        .iter()
        .filter_map(|s| best_of(s.tag.id))
        .map(|(k, _)| k)
        .collect();
    own.sort_unstable();
    own.dedup();
    (!own.is_empty()).then_some(own)
}

#[cfg(test)]
mod tests {
    use super::{super::square_pose::corners_of, *};
    use alight_shared::geometry::DeckGeometry;
    use nalgebra::UnitQuaternion;

    /// Two decks 3 m apart with different tilts, viewed from 9 m above, with the tags in any order.
    #[test]
    fn tags_of_two_boats_in_one_image() {
        let tags = DeckGeometry::default().tags();
        let deck = |x: f64, roll: f64| -> Vec<DetectedTag> {
            let attitude = UnitQuaternion::from_euler_angles(roll, -0.05, 0.3);
            let image = |corner: Vector3<f64>| {
                let at = attitude * corner + Vector3::new(x, 0.4, 9.0);
                at.xy() / at.z
            };
            (tags.iter())
                .map(|tag| DetectedTag {
                    tag: *tag,
                    image: corners_of(tag).map(image),
                    sd: 1e-3,
                })
                .collect()
        };
        let (a, b) = (deck(-1.0, 0.08), deck(2.0, -0.06));
        let mixed: Vec<_> = a.iter().zip(&b).flat_map(|(a, b)| [*b, *a]).collect();
        let mut places: Vec<f64> = apart(mixed)
            .iter()
            .map(|detected| {
                assert_eq!(detected.len(), tags.len());
                let pose = solve(detected).unwrap();
                assert!(pose.misfit < 1.0, "{}", pose.misfit);
                pose.position.x
            })
            .collect();
        places.sort_by(f64::total_cmp);
        assert!(
            (places[0] + 1.0).abs() < 0.01 && (places[1] - 2.0).abs() < 0.01,
            "{places:?}"
        );
        // The image shows only one boat, or one boat and half of another.
        assert_eq!(apart(a.clone()).len(), 1);
        let half: Vec<_> = a.iter().chain(b.iter().take(3)).copied().collect();
        let sizes: Vec<_> = apart(half).iter().map(Vec::len).collect();
        assert_eq!(sizes.iter().sum::<usize>(), tags.len() + 3);
        assert_eq!(sizes.len(), 2);
    }
}
