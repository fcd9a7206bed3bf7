//! Digital line: a file that contains 0 or 1, or a line of the kernel's GPIO character device.
//!
//! `/dev/gpiochip0:17` is line 17 of that chip, active high; `/dev/gpiochip0:17:active-low` has a pull-up and is
//! active at ground, as for a switch to ground or a lamp fed from the supply. Any other text is the path of a file,
//! such as `/sys/class/leds/helm/brightness`, or of a file through which a program drives another interface.

use std::{
    fs::{self, File, OpenOptions},
    io::{Read, Write},
    path::{Path, PathBuf},
};

use gpiocdev::{
    Request,
    line::{Bias, Value},
    request::Builder,
};

const MAX_BYTES: u64 = 16;
const CHIP: &str = "/dev/gpiochip";

#[derive(Clone, Debug, PartialEq, Eq)]
enum Place {
    File(PathBuf),
    Gpio { chip: PathBuf, line: u32, low: bool },
}

impl Place {
    fn of(text: &str) -> Result<Place, String> {
        if !text.starts_with(CHIP) {
            return Ok(Place::File(text.into()));
        }
        let mut parts = text.splitn(3, ':');
        let chip = parts.next().unwrap_or_default();
        let line = parts.next().and_then(|line| line.parse().ok());
        match (line, parts.next()) {
            (Some(line), low @ (None | Some("active-low"))) => Ok(Place::Gpio {
                chip: chip.into(),
                line,
                low: low.is_some(),
            }),
            _ => Err(format!(
                "not CHIP:LINE or CHIP:LINE:active-low, such as {CHIP}0:17"
            )),
        }
    }
}

/// Digital line. A GPIO line is requested from the kernel at its first use and then kept.
pub struct DigitalLine {
    place: Result<Place, String>,
    lent: Option<Request>,
}

impl DigitalLine {
    /// An invalid name is reported as an error at each use.
    pub fn new(name: &str) -> DigitalLine {
        DigitalLine {
            place: Place::of(name),
            lent: None,
        }
    }
    /// Whether only one program can use the line.
    pub fn is_exclusive(&self) -> bool {
        matches!(self.place, Ok(Place::Gpio { .. }))
    }
    pub fn read(&mut self) -> Result<bool, String> {
        let (chip, line, low) = match &self.place {
            Err(e) => return Err(e.clone()),
            Ok(Place::File(path)) => return read_file(path),
            Ok(Place::Gpio { chip, line, low }) => (chip, *line, *low),
        };
        let request = |lent: Option<Request>| match lent {
            Some(lent) => Ok(lent),
            None => ask(chip, line, low, |b| {
                b.as_input().with_bias(low.then_some(Bias::PullUp))
            }),
        };
        let lent = request(self.lent.take())?;
        let level = lent.value(line).map_err(|e| e.to_string())? == Value::Active;
        self.lent = Some(lent);
        Ok(level)
    }
    pub fn write(&mut self, level: bool) -> Result<(), String> {
        let (chip, line, low) = match &self.place {
            Err(e) => return Err(e.clone()),
            Ok(Place::File(path)) => return write_file(path, level),
            Ok(Place::Gpio { chip, line, low }) => (chip, *line, *low),
        };
        let value = Value::from(level);
        let lent = match self.lent.take() {
            Some(lent) => {
                lent.set_value(line, value).map_err(|e| e.to_string())?;
                lent
            }
            None => ask(chip, line, low, |b| b.as_output(value))?,
        };
        self.lent = Some(lent);
        Ok(())
    }
}

fn ask(
    chip: &Path,
    line: u32,
    low: bool,
    direction: impl Fn(&mut Builder) -> &mut Builder,
) -> Result<Request, String> {
    let mut builder = Request::builder();
    builder.on_chip(chip).with_consumer("alight").with_line(line);
    direction(&mut builder);
    if low {
        builder.as_active_low();
    }
    builder.request().map_err(|e| e.to_string())
}

fn read_file(path: &Path) -> Result<bool, String> {
    is_regular(path)?;
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAX_BYTES).read_to_end(&mut bytes));
    read.map_err(|e| e.to_string())?;
    match bytes.trim_ascii() {
        b"0" => Ok(false),
        b"1" => Ok(true),
        other => Err(format!(
            "it holds {:?}, not 0 or 1",
            String::from_utf8_lossy(other)
        )),
    }
}

fn write_file(path: &Path, level: bool) -> Result<(), String> {
    is_regular(path)?;
    let file = OpenOptions::new().write(true).truncate(true).open(path);
    let level: &[u8] = if level { b"1\n" } else { b"0\n" };
    file.and_then(|mut file| file.write_all(level))
        .map_err(|e| e.to_string())
}

/// Rejects pipes and devices, which may block forever; files of sysfs are regular.
fn is_regular(path: &Path) -> Result<(), String> {
    let regular = fs::metadata(path).map_err(|e| e.to_string())?.is_file();
    regular.then_some(()).ok_or_else(|| "not a regular file".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;

    #[test]
    fn digital_line_names() {
        let gpio = |line, low| {
            Ok(Place::Gpio {
                chip: "/dev/gpiochip0".into(),
                line,
                low,
            })
        };
        assert_eq!(Place::of("/dev/gpiochip0:17"), gpio(17, false));
        assert_eq!(Place::of("/dev/gpiochip0:4:active-low"), gpio(4, true));
        assert_eq!(Place::of("/run/helm"), Ok(Place::File("/run/helm".into())));
        for wrong in [
            "/dev/gpiochip0",
            "/dev/gpiochip0:x",
            "/dev/gpiochip0:1:low",
            "/dev/gpiochip0:-1",
        ] {
            assert!(Place::of(wrong).is_err(), "{wrong}");
            assert!(DigitalLine::new(wrong).read().unwrap_err().contains(":17"));
        }
        let mut line = DigitalLine::new("/dev/gpiochip250:1");
        assert!(line.is_exclusive() && line.read().is_err() && line.write(true).is_err());
    }

    #[test]
    fn digital_line_file() {
        let path = scratch("line");
        let mut line = DigitalLine::new(&path.display().to_string());
        assert!(line.read().is_err(), "missing");
        assert!(line.write(true).is_err(), "a missing file is not created");
        assert!(DigitalLine::new("/dev/zero").read().is_err(), "endless");
        assert!(DigitalLine::new("/dev/null").write(true).is_err());
        for (text, level) in [("0", Some(false)), ("1\n", Some(true)), (" 0\r\n", Some(false))] {
            fs::write(&path, text).unwrap();
            assert_eq!(line.read().ok(), level, "{text:?}");
        }
        for nonsense in ["", "2", "01", "1 0", "\u{0}", &"1".repeat(1 << 20)] {
            fs::write(&path, nonsense).unwrap();
            assert!(line.read().unwrap_err().contains("not 0 or 1"));
        }
        for level in [false, true] {
            line.write(level).unwrap();
            assert_eq!(line.read(), Ok(level));
        }
        fs::remove_file(&path).unwrap();
    }
}
