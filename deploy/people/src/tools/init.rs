//! `alight init`: asks the installer about boat and drone, then writes and checks both computers' files.
//!
//! The files are the shipped ones with their comments; the answers replace the values. The configuration's own checks
//! validate each answer before the next question.

#[cfg(test)]
mod tests;

use std::{
    fs::OpenOptions,
    io::{BufRead, Write},
    path::{Path, PathBuf},
};

use alight_computer::{
    config::{DroneComputerConfig, VesselComputerConfig},
    exit::{CliError, Doing, Exit},
    terminal,
};
use alight_shared::{
    config,
    geometry::GRAVITY,
    tags::{of_vessel, suggested},
};
use clap::Args;

use crate::{
    status::finding::FindingLevel,
    tools::{check, tag},
};

/// Directory of the files.
#[derive(Args, Debug)]
#[command(
    after_help = "An empty answer keeps the value in brackets. The answers may come from a file, a line each:\n\
alight init --out boat < answers.txt\n\
Exit codes as of `alight check`: 0 fine, 1 warnings, 2 broken, such as missing certificates."
)]
pub struct InitArgs {
    /// Directory of vessel.toml and drone.toml, created if missing; existing files are kept
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
}

const SENSORS: usize = 8;
const TRIES: usize = 5;

#[derive(Clone, Debug, PartialEq)]
struct Boat {
    vessel: String,
    drone: String,
}

#[derive(Clone, Copy)]
enum BoatFile {
    Vessel,
    Drone,
}

/// Key of a file: file, table ("" for top-level keys) and name.
type Place = (BoatFile, &'static str, &'static str);

/// Question for a value, and the keys that are set to the answer.
struct Question(&'static str, &'static [Place]);

const INERTIA: Place = (BoatFile::Drone, "drone.airframe", "inertia_kgm2");
const CAMERA: Place = (BoatFile::Drone, "camera", "source");
const DISTORTION: Question = Question(
    "The lens's distortion k1, k2, p1, p2, k3",
    &[(BoatFile::Drone, "drone.camera.lens", "distortion")],
);
const QUESTIONS: &[Question] = &[
    Question(
        "Number of the vessel, 1 to 65535",
        &[
            (BoatFile::Vessel, "", "vessel_id"),
            (BoatFile::Drone, "bridge", "vessel_id"),
        ],
    ),
    Question(
        "Number of the drone, 1 to 65535",
        &[(BoatFile::Drone, "bridge", "drone_id")],
    ),
    Question(
        "Length of the deck along the vessel, m",
        &[
            (BoatFile::Vessel, "vessel.deck", "length_m"),
            (BoatFile::Drone, "drone.deck", "length_m"),
        ],
    ),
    Question(
        "Width of the deck, m",
        &[
            (BoatFile::Vessel, "vessel.deck", "width_m"),
            (BoatFile::Drone, "drone.deck", "width_m"),
        ],
    ),
    Question(
        "Centre of its upper surface from amidships at the water line: forward, right, down, m",
        &[
            (BoatFile::Vessel, "vessel.deck", "centre_m"),
            (BoatFile::Drone, "drone.deck", "centre_m"),
        ],
    ),
    Question(
        "Force with which the deck holds a standing drone (net, magnets, latch), N; 0: a plain deck",
        &[
            (BoatFile::Vessel, "vessel.deck", "hold_n"),
            (BoatFile::Drone, "drone.deck", "hold_n"),
        ],
    ),
    Question(
        "The inertial sensor's place from the same point: forward, right, down, m",
        &[(BoatFile::Vessel, "vessel.imu", "lever_arm_m")],
    ),
    Question(
        "The GNSS antenna's place: forward, right, down, m",
        &[(BoatFile::Vessel, "vessel.gnss", "antenna_m")],
    ),
    Question(
        "The autopilot's MAVLink, a URL (serial:///dev/ttyACM0:921600)",
        &[(BoatFile::Drone, "autopilot", "connect")],
    ),
    Question(
        "The drone's take-off mass, kg",
        &[(BoatFile::Drone, "drone.airframe", "mass_kg")],
    ),
    Question(
        "Distance of each of its rotors from the centre, m",
        &[(BoatFile::Drone, "drone.airframe", "arm_m")],
    ),
    Question(
        "Its moments of inertia about forward, right, down, kg m² (in brackets: scaled by mass and arm)",
        &[INERTIA],
    ),
    Question(
        "Distance between its feet: fore-aft, sideways, m",
        &[(BoatFile::Drone, "drone.airframe", "feet_span_m")],
    ),
    Question(
        "Its foot plane below the centre of mass, m",
        &[(BoatFile::Drone, "drone.airframe", "feet_below_m")],
    ),
    Question(
        "Its hover thrust, 0 to 1 (MPC_THR_HOVER, MOT_THST_HOVER)",
        &[(BoatFile::Drone, "autopilot", "hover_thrust")],
    ),
    Question("Its belly camera (/dev/video0; -: none for Alight)", &[CAMERA]),
    Question(
        "Winds and speeds in knots, true or false",
        &[
            (BoatFile::Vessel, "view", "knots"),
            (BoatFile::Drone, "view", "knots"),
        ],
    ),
];

impl Boat {
    fn shipped() -> Boat {
        Boat {
            vessel: include_str!("../../../vessel/vessel.toml").into(),
            drone: include_str!("../../../drone/drone.toml").into(),
        }
    }
    fn file(&mut self, of: BoatFile) -> &mut String {
        match of {
            BoatFile::Vessel => &mut self.vessel,
            BoatFile::Drone => &mut self.drone,
        }
    }
    fn value(&mut self, (of, table, key): Place) -> Option<String> {
        let mut found = lines(self.file(of)).filter(|(at, _)| *at == (table, key));
        let (_, line) = found.next()?;
        line.split_once(" = ").map(|(_, value)| value.to_owned())
    }
    fn set(&mut self, (of, table, key): Place, value: &str) {
        self.replace((of, table, key), &format!("{key} = {value}"));
    }
    fn replace(&mut self, (of, table, key): Place, with: &str) {
        let text = self.file(of);
        let (mut all, mut replaced) = (String::new(), false);
        for (at, line) in lines(text) {
            if at == (table, key) && replaced {
                continue;
            }
            let is_it = at == (table, key);
            all += if is_it { with } else { line };
            all.push('\n');
            replaced |= is_it;
        }
        *text = all;
    }
    fn check(&self) -> Result<(VesselComputerConfig, DroneComputerConfig), CliError> {
        Ok((
            config::parse(&self.vessel, "vessel.toml")?,
            config::parse(&self.drone, "drone.toml")?,
        ))
    }
    fn number(&mut self, table: &'static str, key: &'static str) -> f64 {
        let value = self.value((BoatFile::Drone, table, key));
        value.and_then(|v| v.parse().ok()).unwrap_or_default()
    }
    /// Scales the shipped drone's moments of inertia to this mass and arm length.
    fn scale_inertia(&mut self) {
        let mut shipped = Boat::shipped();
        let size = |boat: &mut Boat| {
            let arm_m = boat.number("drone.airframe", "arm_m");
            boat.number("drone.airframe", "mass_kg") * arm_m * arm_m
        };
        let factor = size(self) / size(&mut shipped);
        let moments = shipped.value(INERTIA).unwrap_or_default();
        let moments = moments.trim_matches(['[', ']']).split(", ");
        let scaled = moments.filter_map(|m| m.parse::<f64>().ok());
        let scaled: Vec<String> = scaled
            .map(|m| format!("{:?}", (1e4 * m * factor).round().max(1.0) / 1e4))
            .collect();
        self.set(INERTIA, &format!("[{}]", scaled.join(", ")));
    }
    /// Sets values that follow from the answers: names of certificates, maximum thrust, tags that fit the deck.
    fn derive(&mut self) -> Result<(), CliError> {
        let hovers = |boat: &mut Boat| {
            let mass_kg = boat.number("drone.airframe", "mass_kg");
            [mass_kg, boat.number("autopilot", "hover_thrust")]
        };
        let [mass_kg, hover] = hovers(self);
        if [mass_kg, hover] != hovers(&mut Boat::shipped()) {
            let thrust_n = (10.0 * mass_kg * GRAVITY / hover).round() / 10.0;
            self.set(
                (BoatFile::Drone, "drone.airframe", "max_thrust_n"),
                &format!("{thrust_n:?}"),
            );
        }
        let size = ["length_m", "width_m"].map(|side| self.number("drone.deck", side));
        let (vessel, drone) = self.check()?;
        let tags = of_vessel(&suggested(size[0], size[1]), vessel.vessel_id);
        let tags: String = tags.iter().map(tag::row).collect();
        self.set((BoatFile::Drone, "drone.deck", "tags"), &format!("[\n{tags}]"));
        let (other, own) = (vessel.vessel_id, drone.bridge.drone_id);
        self.set(
            (BoatFile::Vessel, "radio.tls", "peers"),
            &format!("[\"drone-{own}\"]"),
        );
        self.set(
            (BoatFile::Drone, "radio.tls", "peers"),
            &format!("[\"vessel-{other}\"]"),
        );
        self.check().map(|_| ())
    }
}

/// Lines of a shipped file, each with the table and key that it belongs to, ("", "") for comments and headings. A
/// value of several lines is an array and ends with its bracket.
fn lines(text: &str) -> impl Iterator<Item = ((&str, &str), &str)> {
    let (mut table, mut open) = ("", None);
    text.lines().map(move |line| {
        if let Some(key) = open {
            open = (line != "]").then_some(key);
            return ((table, key), line);
        }
        if let Some(name) = line.strip_prefix('[') {
            table = name.trim_matches(['[', ']']);
        }
        let is_name = |key: &&str| key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let key = line.split_once(" = ").map(|(key, _)| key);
        let Some(key) = key.filter(is_name) else {
            return (("", ""), line);
        };
        open = line.ends_with('[').then_some(key);
        ((table, key), line)
    })
}

fn written(answer: &str, before: &str) -> Result<String, String> {
    let number = |text: &str| {
        let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
        number
            .map(|x| format!("{x:?}"))
            .ok_or_else(|| format!("{text}: a number is needed, such as 1.5"))
    };
    if before.starts_with('"') {
        let text = if answer == "-" { "" } else { answer };
        Ok(toml::Value::String(text.into()).to_string())
    } else if before.starts_with('[') {
        let parts = answer.split([',', ' ']).filter(|p| !p.is_empty());
        let numbers: Vec<String> = parts.map(number).collect::<Result<_, _>>()?;
        Ok(format!("[{}]", numbers.join(", ")))
    } else if before.parse::<bool>().is_ok() {
        let truth = answer.parse::<bool>();
        truth
            .map(|b| b.to_string())
            .map_err(|_| format!("{answer}: true or false is needed"))
    } else if before.contains('.') {
        number(answer)
    } else {
        let whole = answer.parse::<i64>();
        whole
            .map(|n| n.to_string())
            .map_err(|_| format!("{answer}: a whole number is needed, such as 3"))
    }
}

struct Installer<R, W> {
    answers: R,
    out: W,
}

impl<R: BufRead, W: Write> Installer<R, W> {
    /// Reads one answer; an empty answer keeps the present value.
    fn ask(&mut self, question: &str, stands: &str) -> Result<String, CliError> {
        const ASKING: &str = "asking for the installed equipment";
        write!(self.out, "{question} [{stands}]: ").doing(ASKING)?;
        self.out.flush().doing(ASKING)?;
        let mut line = String::new();
        let n = self.answers.read_line(&mut line).doing(ASKING)?;
        if n == 0 {
            return Err(CliError(format!(
                "the answers end before \"{question}\": nothing was written; an empty line keeps the value in brackets"
            )));
        }
        Ok(line.trim().to_owned())
    }
    /// Asks until `take` accepts the answer, at most [`TRIES`] times; prints the reason for each rejection.
    fn until(
        &mut self,
        question: &str,
        stands: &str,
        mut take: impl FnMut(&str) -> Result<(), String>,
    ) -> Result<(), CliError> {
        for _ in 0..TRIES {
            let answer = self.ask(question, stands)?;
            match take(&answer) {
                Ok(()) => return Ok(()),
                Err(why) => writeln!(self.out, "  {why}").doing("asking for the installed equipment")?,
            }
        }
        Err(CliError(format!(
            "\"{question}\" has no valid answer: nothing was written"
        )))
    }
    fn value(&mut self, boat: &mut Boat, Question(question, places): &Question) -> Result<(), CliError> {
        let Some(stands) = places.first().and_then(|at| boat.value(*at)) else {
            return Ok(());
        };
        let shown = stands.trim_matches(['"', '[', ']']);
        self.until(question, shown, |answer| {
            if answer.is_empty() {
                return Ok(());
            }
            let (new, mut changed) = (written(answer, &stands)?, boat.clone());
            places.iter().for_each(|at| changed.set(*at, &new));
            if places
                .iter()
                .any(|(_, _, key)| ["mass_kg", "arm_m"].contains(key))
            {
                changed.scale_inertia();
            }
            // The tags of the shipped deck may not fit another deck; they are chosen again at the end.
            changed.derive().map_err(|e| e.to_string())?;
            *boat = changed;
            Ok(())
        })
    }
    /// Asks for size, focal lengths and principal point of the belly camera's lens, which belong together.
    fn lens(&mut self, boat: &mut Boat) -> Result<(), CliError> {
        const QUESTION: &str = "The camera's lens, from a calibration: width, height, fx, fy, cx, cy, px";
        let place = |key| (BoatFile::Drone, "drone.camera.lens", key);
        let stands = ["width_px", "height_px", "focal_px", "centre_px"]
            .map(|key| boat.value(place(key)).unwrap_or_default())
            .join(", ")
            .replace(['[', ']'], "");
        self.until(QUESTION, &stands, |answer| {
            if answer.is_empty() {
                return Ok(());
            }
            let numbers: Vec<&str> = answer.split([',', ' ']).filter(|p| !p.is_empty()).collect();
            let [width, height, fx, fy, cx, cy] = numbers.as_slice() else {
                return Err(format!("{answer}: six numbers are needed, such as {stands}"));
            };
            let mut changed = boat.clone();
            changed.set(place("width_px"), &written(width, "1")?);
            changed.set(place("height_px"), &written(height, "1")?);
            changed.set(place("focal_px"), &written(&format!("{fx} {fy}"), "[")?);
            changed.set(place("centre_px"), &written(&format!("{cx} {cy}"), "[")?);
            changed.check().map_err(|e| e.to_string())?;
            *boat = changed;
            Ok(())
        })
    }
    fn address(&mut self, boat: &mut Boat) -> Result<(), CliError> {
        const QUESTION: &str = "The vessel's address on the network of the radio";
        self.until(QUESTION, "192.168.7.1", |answer| {
            let mut changed = boat.clone();
            if !answer.is_empty() {
                let endpoint = toml::Value::String(format!("quic/{answer}:7447"));
                changed.set((BoatFile::Drone, "radio", "connect"), &format!("[{endpoint}]"));
            }
            changed.check().map_err(|e| e.to_string())?;
            *boat = changed;
            Ok(())
        })
    }
    fn sensors(&mut self, boat: &mut Boat) -> Result<(), CliError> {
        const SOURCES: Place = (BoatFile::Vessel, "sensor", "sources");
        let (shipped, mut sources) = (boat.clone(), Vec::new());
        for k in 1..=SENSORS {
            let mut connect = String::new();
            let question = format!("Sensor {k} of the vessel, a URL (udpin://0.0.0.0:10110), empty: no more");
            self.until(&question, "", |answer| {
                answer.clone_into(&mut connect);
                Ok(())
            })?;
            if connect.is_empty() {
                break;
            }
            self.until(
                "  its format: nmea, n2k, signalk, ubx or mavlink",
                "nmea",
                |answer| {
                    let format = if answer.is_empty() { "nmea" } else { answer };
                    let [connect, format] =
                        [connect.as_str(), format].map(|text| toml::Value::String(text.into()));
                    let source = format!(
                        "\n[[sensor.sources]]\nname = \"sensor-{k}\"\nconnect = {connect}\nformat = {format}"
                    );
                    let (mut all, mut changed) = (sources.clone(), shipped.clone());
                    all.push(source);
                    changed.replace(SOURCES, &all.join("\n"));
                    changed.check().map_err(|e| e.to_string())?;
                    (sources, *boat) = (all, changed);
                    Ok(())
                },
            )?;
        }
        Ok(())
    }
    fn boat(&mut self) -> Result<Boat, CliError> {
        let mut boat = Boat::shipped();
        for question in QUESTIONS {
            self.value(&mut boat, question)?;
        }
        if boat.value(CAMERA).is_some_and(|source| source != "\"\"") {
            self.lens(&mut boat)?;
            self.value(&mut boat, &DISTORTION)?;
        }
        self.address(&mut boat)?;
        self.sensors(&mut boat)?;
        boat.derive()?;
        Ok(boat)
    }
}

pub(super) fn write_new(path: &Path, content: &[u8]) -> Result<(), CliError> {
    let doing = || {
        format!(
            "writing {}; an existing file is not replaced: name another directory with --out",
            path.display()
        )
    };
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(path)
        .doing(doing())?;
    file.write_all(content).doing(doing())
}

pub fn run(args: &InitArgs) -> Result<Exit, CliError> {
    let files = ["vessel.toml", "drone.toml"].map(|name| args.out.join(name));
    if let Some(there) = files.iter().find(|f| f.exists()) {
        return Err(CliError(format!(
            "{} already exists and is not replaced: name another directory with --out",
            there.display()
        )));
    }
    let mut installer = Installer {
        answers: std::io::stdin().lock(),
        out: std::io::stdout().lock(),
    };
    let boat = installer.boat()?;
    drop(installer);
    std::fs::create_dir_all(&args.out).doing(format_args!("making {}", args.out.display()))?;
    let (vessel, drone) = boat.check()?;
    let mut worst = FindingLevel::Fine;
    let [first, second] = &files;
    write_new(first, boat.vessel.as_bytes())?;
    write_new(second, boat.drone.as_bytes()).inspect_err(|_| {
        // Both files or none: a remaining one would block the next attempt.
        let _stays = std::fs::remove_file(first);
    })?;
    for path in &files {
        terminal::line(format_args!("\nwritten: {}", path.display()));
        worst = worst.max(check::print(path, None));
    }
    terminal::line(format_args!(
        "\nNext: alight keys init, alight keys vessel {}, alight keys drone {} (alight help radio);\n\
         copy each file to /etc/alight of its computer, its keys to /etc/alight/keys, and there:\n\
         sudo -u alight alight check\n\
         drone.toml has mode = \"shadow\": the pilot flies and nothing is commanded (alight help install).",
        vessel.vessel_id, drone.bridge.drone_id
    ));
    Ok(worst.exit())
}
