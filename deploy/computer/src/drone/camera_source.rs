//! Image sources: the simulated camera, a V4L2 device, files, a pipe of raw images.

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use alight_shared::time::{DroneTime, Span};
use alight_transport::clock::{ProcessClock, since_monotonic_ns, steady_ns};
use alight_uav::camera::{
    CameraFrame, GreyImage,
    metering::{Light, Setting},
};

use crate::{
    config::camera::CameraSource,
    drone::exposure::ExposureControl,
    exit::{CliError, Doing},
};

const MAX_FILES: usize = 100_000;
/// Lateness beyond which the schedule of files is shifted, ns.
const MAX_LATENESS_NS: i64 = 1_000_000_000;
const MAX_BYTES: u64 = 16 << 20;

pub enum Images {
    Device(Device),
    /// PGM files of a directory, in the order of their names.
    Files(Files),
    Pipe(Pipe),
}

impl Images {
    pub fn open(config: &CameraSource, size: [usize; 2]) -> Result<Images, CliError> {
        let path = Path::new(&config.source);
        let doing = format_args!("opening the camera's source {}", config.source);
        let meta = std::fs::metadata(path).map_err(|e| {
            CliError(format!(
                "{}: {e}; a camera's source is a V4L2 device, a PGM file or a directory of them, or a named pipe",
                doing
            ))
        })?;
        use std::os::unix::fs::FileTypeExt;
        let device = meta.file_type().is_char_device();
        if !device && config.fixed_gain().is_some_and(|_| config.exposure_s > 0.0) {
            return Err(CliError(format!(
                "{doing}: a gain is set, and only a V4L2 device has one; remove the key, and set the exposure where these \
                 images are made"
            )));
        }
        if meta.is_dir() || meta.is_file() {
            return Ok(Images::Files(Files::open(path, config.rate_hz)?));
        }
        if meta.file_type().is_fifo() {
            // Opening for writing as well avoids waiting for a writer, and keeps the pipe open when a writer
            // ends.
            let file = File::options().read(true).write(true).open(path);
            let file = file.doing(doing)?;
            return Ok(Images::Pipe(Pipe {
                file,
                delay: Span::from_secs(config.delay_s),
                size,
            }));
        }
        Ok(Images::Device(Device::open(config, size)?))
    }
    /// Waits for the next image; None if there are no more.
    pub fn next_frame(&mut self, clock: &ProcessClock) -> Result<Option<CameraFrame>, CliError> {
        match self {
            Images::Device(device) => device.next_frame(clock).map(Some),
            Images::Files(files) => files.next_frame(clock),
            Images::Pipe(pipe) => pipe.next_frame(clock),
        }
    }
    /// Exposure setting, or the reason why the device's automatic exposure is in use; None if the exposure is not
    /// controlled.
    pub fn exposure(&self) -> Option<Result<Setting, String>> {
        match self {
            Images::Device(device) => device.exposure.as_ref().map(|e| match e {
                Ok(control) => Ok(control.setting()),
                Err(why) => Err(why.clone()),
            }),
            Images::Files(_) | Images::Pipe(_) => None,
        }
    }
    /// Whether neither exposure nor gain can be increased. An uncontrolled setting counts as at its limit.
    pub fn at_limit(&self) -> bool {
        match self {
            Images::Device(device) => match &device.exposure {
                Some(Ok(control)) => control.at_limit(),
                Some(Err(_)) | None => true,
            },
            Images::Files(_) | Images::Pipe(_) => true,
        }
    }
    /// Meters image number `image` by its light; `newest` is the number of the newest image.
    pub fn meter(&mut self, image: u64, newest: u64, light: &Light) {
        if let Images::Device(device) = self
            && let Some(Ok(control)) = &mut device.exposure
            && let Err(why) = control.meter(&device.camera, image, newest, light)
        {
            device.exposure = Some(Err(why));
        }
    }
}

pub struct Files {
    paths: std::vec::IntoIter<PathBuf>,
    period_ns: i64,
    next_ns: i64,
}

impl Files {
    fn open(path: &Path, rate_hz: f64) -> Result<Files, CliError> {
        let mut paths = Vec::new();
        if path.is_dir() {
            let entries =
                std::fs::read_dir(path).doing(format_args!("reading the directory {}", path.display()))?;
            for entry in entries.flatten().take(MAX_FILES) {
                let path = entry.path();
                if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pgm")) {
                    paths.push(path);
                }
            }
            paths.sort();
            if paths.is_empty() {
                return Err(CliError(format!(
                    "{}: no .pgm file in it; convert images with: ffmpeg -i IMAGE -pix_fmt gray IMAGE.pgm",
                    path.display()
                )));
            }
        } else {
            paths.push(path.into());
        }
        Ok(Files {
            paths: paths.into_iter(),
            period_ns: (1e9 / rate_hz) as i64,
            next_ns: steady_ns(),
        })
    }
    fn next_frame(&mut self, clock: &ProcessClock) -> Result<Option<CameraFrame>, CliError> {
        let Some(path) = self.paths.next() else {
            return Ok(None);
        };
        let image = read_pgm(&path)?;
        let early_ns = self.next_ns - steady_ns();
        if early_ns > 0 {
            crate::process::supervisor::pause(std::time::Duration::from_nanos(early_ns.unsigned_abs()));
        }
        // Images keep their schedule even if this computer is late for one, because markers blink on that schedule.
        let at = clock.read(self.next_ns);
        self.next_ns = (self.next_ns + self.period_ns).max(steady_ns() - MAX_LATENESS_NS);
        Ok(Some(CameraFrame { at, image }))
    }
}

fn read_pgm(path: &Path) -> Result<GreyImage, CliError> {
    let doing = format_args!("reading the image {}", path.display());
    let mut bytes = Vec::new();
    let file = File::open(path).doing(doing)?;
    let read = file.take(MAX_BYTES).read_to_end(&mut bytes);
    read.doing(doing)?;
    GreyImage::from_pgm(&bytes).doing(doing)
}

/// Sequence of raw grey images, one byte per pixel.
pub struct Pipe {
    file: File,
    delay: Span,
    size: [usize; 2],
}

impl Pipe {
    fn next_frame(&mut self, clock: &ProcessClock) -> Result<Option<CameraFrame>, CliError> {
        let [width, height] = self.size;
        let mut pixels = vec![0; width * height];
        match self.file.read_exact(&mut pixels) {
            Ok(()) => {}
            Err(e) => return Err(CliError::because("reading images from a pipe", e)),
        }
        let now: DroneTime = clock.now();
        let image = GreyImage::new(width, height, pixels).doing("reading a pipe")?;
        Ok(Some(CameraFrame {
            at: now - self.delay,
            image,
        }))
    }
}

pub struct Device {
    camera: rscam::Camera,
    name: String,
    size: [usize; 2],
    /// Bytes per pixel, the first of which is brightness.
    stride: usize,
    delay: Span,
    /// Exposure control, or the reason why it is missing; None if not configured.
    exposure: Option<Result<ExposureControl, String>>,
}

impl Device {
    fn open(config: &CameraSource, size: [usize; 2]) -> Result<Device, CliError> {
        let [width, height] = size.map(|s| s as u32);
        let doing = format_args!("opening the camera {}", config.source);
        let mut camera = rscam::new(&config.source).doing(doing)?;
        let rate = (config.rate_hz.round() as u32).max(1);
        camera
            .start(&rscam::Config {
                interval: (1, rate),
                resolution: (width, height),
                format: config.format.as_bytes(),
                ..Default::default()
            })
            .map_err(|e| {
                CliError(format!(
                    "{} with {width} x {height} px, {}, {rate} Hz: {e}; v4l2-ctl --list-formats-ext prints its formats",
                    doing,
                    config.format
                ))
            })?;
        // Some drivers reset their controls when streaming starts.
        let exposure = (config.exposure_s > 0.0).then(|| ExposureControl::take(&camera, config));
        Ok(Device {
            camera,
            exposure,
            name: config.source.clone(),
            size,
            // The other formats begin with a plane of brightness.
            stride: if config.format == "YUYV" { 2 } else { 1 },
            delay: Span::from_secs(config.delay_s),
        })
    }
    fn next_frame(&mut self, clock: &ProcessClock) -> Result<CameraFrame, CliError> {
        let doing = format_args!("reading the camera {}", self.name);
        let [width, height] = self.size;
        let frame = self.camera.capture().doing(doing)?;
        // The driver stamps images with the kernel's slewed clock; without a stamp the arrival time is used.
        let stamped_us = i64::try_from(frame.get_timestamp()).unwrap_or(0);
        let age_ns = since_monotonic_ns(stamped_us.saturating_mul(1000));
        let is_stamped = (0..1_000_000_000).contains(&age_ns);
        let at: DroneTime = clock.read(steady_ns() - if is_stamped { age_ns } else { 0 });
        let bytes: &[u8] = &frame;
        let pixels: Vec<u8> = bytes
            .iter()
            .step_by(self.stride)
            .take(width * height)
            .copied()
            .collect();
        let image = GreyImage::new(width, height, pixels).doing(doing)?;
        Ok(CameraFrame {
            at: at - self.delay,
            image,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;

    fn source(name: &Path) -> CameraSource {
        CameraSource {
            source: name.display().to_string(),
            rate_hz: 120.0,
            ..CameraSource::default()
        }
    }

    #[test]
    fn camera_source_files_and_invalid_names() {
        let directory = scratch("images");
        std::fs::create_dir_all(&directory).unwrap();
        let size = [40, 32];
        let clock = ProcessClock::default();
        let rejection = |e: Result<Images, CliError>| e.err().unwrap().to_string();
        assert!(rejection(Images::open(&source(&directory), size)).contains("no .pgm file"));
        for (name, level) in [("b.pgm", 20), ("a.pgm", 10)] {
            let image = GreyImage::new(40, 32, vec![level; 40 * 32]).unwrap();
            std::fs::write(directory.join(name), image.to_pgm()).unwrap();
        }
        let mut images = Images::open(&source(&directory), size).unwrap();
        let levels: Vec<u8> = core::iter::from_fn(|| images.next_frame(&clock).unwrap())
            .map(|f| f.image.pixels()[0])
            .collect();
        assert_eq!(levels, [10, 20]);
        std::fs::write(directory.join("a.pgm"), b"P5 40 40 255\nshort").unwrap();
        let mut images = Images::open(&source(&directory), size).unwrap();
        assert!(images.next_frame(&clock).is_err());
        std::fs::remove_dir_all(&directory).unwrap();
        assert!(rejection(Images::open(&source(Path::new("/dev/video99")), size)).contains("V4L2"));
        assert!(Images::open(&source(Path::new("/dev/null")), size).is_err());
        let file = std::env::temp_dir();
        let fixed = CameraSource {
            gain: 4,
            ..source(&file)
        };
        assert!(rejection(Images::open(&fixed, size)).contains("only a V4L2 device"));
    }
}
