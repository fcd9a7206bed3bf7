//! Image of a camera, taken in the same way as by the camera's process, or reported by that process.

use std::{
    sync::mpsc::{SyncSender, sync_channel},
    time::Duration,
};

use alight_computer::{config::camera::CameraSource, drone::camera_source::Images, exit::CliError};
use alight_shared::{
    metrics::{MetricName, MetricValue},
    process::ProcessState,
    tags::Tags,
};
use alight_transport::clock::{ProcessClock, steady_ns};
use alight_uav::camera::{
    ImageLight, TagSettings,
    detector::TagDetector,
    foreign_tags::ForeignTags,
    metering::{Light, Setting},
};

use crate::tools::check::facts::CameraImages;

/// Time for which images are examined, ns; long enough for the metering to converge.
const LOOK_NS: i64 = 2_000_000_000;
/// Number of images per search for foreign tags; a search takes longer than an image period.
const FINDER_PERIOD: u64 = 10;

/// Examines images of `size` (width, height), px, from a device or from files for 2 s, and searches them for `tags`.
pub fn look(
    config: &CameraSource,
    size: [usize; 2],
    tags: Option<(&TagSettings, &Tags)>,
) -> Result<CameraImages, String> {
    // If the device sends no images, this thread runs until the program ends.
    let (views, receiver) = sync_channel(1);
    let (config, tags) = (
        config.clone(),
        tags.map(|(settings, tags)| (settings.clone(), *tags)),
    );
    std::thread::spawn(move || {
        if let Err(CliError(why)) = show(&config, size, tags.as_ref().map(|(s, t)| (s, t)), &views) {
            let _late = views.send(Err(why));
        }
    });
    let end_ns = steady_ns() + LOOK_NS;
    let mut newest = Err("no image came within 2 s".into());
    loop {
        let left = Duration::from_nanos(u64::try_from(end_ns - steady_ns()).unwrap_or(0));
        match receiver.recv_timeout(left) {
            Ok(Ok(view)) => newest = Ok(view),
            Ok(Err(why)) => return Err(why),
            Err(_) => return newest,
        }
    }
}

/// Sends the state after each image, until the images or the receiver end.
fn show(
    config: &CameraSource,
    size: [usize; 2],
    tags: Option<(&TagSettings, &Tags)>,
    views: &SyncSender<Result<CameraImages, String>>,
) -> Result<(), CliError> {
    let mut images = Images::open(config, size)?;
    let mut detector = tags.map(|(settings, tags)| TagDetector::new(settings, tags));
    let mut finder = tags.map(|(settings, tags)| ForeignTags::new(settings, tags));
    let mut view = CameraImages::default();
    while let Some(frame) = images.next_frame(&ProcessClock::default())? {
        view.images += 1;
        let found = [frame.image.width(), frame.image.height()];
        if found != size {
            let text = format!("its images have {found:?} px, those of the lens {size:?}");
            return Err(CliError(text));
        }
        if let Some(detector) = &mut detector {
            let tag = detector.find(&frame.image).first().map(|found| found.light);
            let image = ImageLight::of(&frame.image);
            images.meter(
                view.images,
                view.images,
                &tag.map_or(Light::Image(image), Light::Tag),
            );
            let dark = tag.is_none() && images.at_limit() && image.is_dark(detector.min_margin());
            view.dark = dark.then_some(image.mean);
            view.tag = tag.map(|t| [t.contrast(), t.saturation]).or(view.tag);
            if view.tag.is_none() && view.images % FINDER_PERIOD == 1 {
                let found = finder.as_mut().and_then(|s| s.find(&frame.image));
                view.foreign_tag = found.or(view.foreign_tag);
            }
        }
        view.exposure = images.exposure();
        if views.send(Ok(view.clone())).is_err() {
            break;
        }
    }
    Ok(())
}

pub fn reported(process: &ProcessState) -> CameraImages {
    let of = |name: MetricName| match process.metric(name)? {
        MetricValue::Count(n) => Some(n as f64),
        MetricValue::Seconds(v) | MetricValue::Fraction(v) => Some(v),
        MetricValue::AccessRejection(_) | MetricValue::State(_) | MetricValue::ForeignTag(_) => None,
    };
    CameraImages {
        images: of(MetricName::Images).unwrap_or(0.0) as u64,
        exposure: of(MetricName::Exposure)
            .zip(of(MetricName::Gain))
            .map(|(exposure_s, gain)| Ok(Setting { exposure_s, gain })),
        tag: of(MetricName::TagContrast)
            .zip(of(MetricName::TagSaturation))
            .map(|(contrast, saturation)| [contrast, saturation]),
        dark: of(MetricName::TooDark)
            .filter(|dark| *dark > 0.0)
            .and(of(MetricName::ImageMean))
            .map(|mean| 255.0 * mean),
        foreign_tag: process.foreign_tag(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        frames::{DroneBody, Point, Vector},
        geometry::DeckGeometry,
        metrics::Metric,
        msg::Seq,
        tags::ForeignTag,
        time::Time,
    };
    use alight_sim::{
        physics::{body::RigidState, streams::Streams},
        sensors::{
            camera::{CameraMount, body_from_camera},
            render::{RenderConfig, Renderer, Shot},
        },
    };
    use alight_uav::camera::GreyImage;
    use nalgebra::Vector3;

    /// Image from a drone at `at` above a deck at the origin, `t_s` after the start, with the motion `velocity`
    /// during the exposure.
    fn rendered(renderer: &mut Renderer, at: [f64; 3], velocity: [f64; 3], t_s: f64) -> GreyImage {
        let mount = CameraMount {
            position: Vector3::zeros(),
            attitude: body_from_camera(),
        };
        let drone = RigidState::<DroneBody> {
            position: Point::from(Vector3::from(at)),
            velocity: Vector::from(velocity.into()),
            ..Default::default()
        };
        let shot = Shot {
            t: Time::from_secs(t_s),
            at: Time::from_secs(t_s),
            exposure_s: 0.004,
            gain: 1.0,
            view: mount.view(&drone),
            deck: RigidState::default(),
        };
        renderer.image(&shot).unwrap()
    }

    #[test]
    fn nothing_foreign_over_deck_and_sea() {
        let (render, deck) = (RenderConfig::default(), DeckGeometry::default());
        let mut renderer = Renderer::new(&render, &deck, &Streams::new(6));
        let mut finder = ForeignTags::new(&TagSettings::default(), &deck.tags());
        for (k, height) in [0.3, 1.0, 4.0, 9.0, 16.0, 25.0].into_iter().enumerate() {
            for (ahead, speed) in [(0.0, 0.0), (0.3 * height, 4.0), (30.0 + height, 0.0)] {
                let (at, velocity) = ([ahead, 0.2, -height], [speed, 0.0, 0.0]);
                let image = rendered(&mut renderer, at, velocity, 3.0 * k as f64);
                assert_eq!(finder.find(&image), None, "{at:?}");
            }
        }
    }

    #[test]
    fn camera_check_of_images() {
        let (render, deck) = (RenderConfig::default(), DeckGeometry::default());
        let mut renderer = Renderer::new(&render, &deck, &Streams::new(5));
        let image = rendered(&mut renderer, [0.2, 0.1, -4.0], [0.0; 3], 0.0);
        let path = std::env::temp_dir().join(format!("alight-look-{}.pgm", std::process::id()));
        std::fs::write(&path, image.to_pgm()).unwrap();
        let source = CameraSource {
            source: path.display().to_string(),
            ..CameraSource::default()
        };
        let view = look(&source, [640, 480], Some((&TagSettings::default(), &deck.tags()))).unwrap();
        std::fs::remove_file(&path).unwrap();
        let [contrast, saturation] = view.tag.unwrap();
        // White is 0.95 of 210, black 0.06 of it.
        assert!((0.65..0.8).contains(&contrast) && saturation < 0.01, "{view:?}");
        assert_eq!((view.images, view.exposure), (1, None));
        let gone = look(&source, [640, 480], None).unwrap_err();
        assert!(gone.contains("No such file"), "{gone}");
    }

    #[test]
    fn camera_check_of_a_running_drone() {
        let metrics = [
            MetricName::Images.count(900_u32),
            MetricName::Exposure.seconds(0.002),
            MetricName::Gain.count(3_u32),
            MetricName::TagContrast.fraction(0.5),
            MetricName::TagSaturation.fraction(0.02),
        ];
        let setting = Setting {
            exposure_s: 0.002,
            gain: 3.0,
        };
        let process = |metrics: &[Metric]| ProcessState {
            metrics: Seq::filled(metrics.iter().copied()),
            ..ProcessState::default()
        };
        let view = reported(&process(&metrics));
        assert_eq!(
            (view.images, view.exposure, view.tag),
            (900, Some(Ok(setting)), Some([0.5, 0.02]))
        );
        assert_eq!(reported(&process(&metrics[..1])).exposure, None);
        let mirrored = ForeignTag::Mirrored(7);
        let tag = [MetricName::ForeignTag.with(MetricValue::ForeignTag(Some(mirrored)))];
        assert_eq!(reported(&process(&tag)).foreign_tag, Some(mirrored));
        let dark = [
            MetricName::ImageMean.fraction(0.02),
            MetricName::TooDark.count(1_u32),
        ];
        assert_eq!(view.dark, None);
        assert!(
            reported(&process(&dark))
                .dark
                .is_some_and(|mean| (mean - 5.1).abs() < 1e-9)
        );
    }
}
