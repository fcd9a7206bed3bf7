use std::{
    fs,
    path::{Path, PathBuf},
};

use alight_computer::{
    certificates::{
        AUTHORITY_FILE, AUTHORITY_KEY, CERTIFICATE_FILE, RENEWAL_DAYS, expiry, init, issue, read,
    },
    exit::{CliError, Doing, Exit},
    quantity::whole,
    terminal::{self, Form},
};
use clap::{Args, Subcommand};
use serde::Serialize;
use serde_json::json;
use time::OffsetDateTime;

const MAX_SHOWN: usize = 256;

/// Certificates to create or show.
#[derive(Args, Debug)]
pub struct KeysArgs {
    #[command(subcommand)]
    pub what: KeysVerb,
}

/// Certificate to make.
#[derive(Subcommand, Debug)]
#[command(after_help = "Start with:\n  alight keys init --dir keys\n  \
alight keys vessel 1 --dir keys --address 192.168.7.1\n  alight keys drone 1 --dir keys\n\n\
Copy keys/vessel-1 to the vessel and keys/drone-1 to the drone; keep keys/authority-key.pem off both.\n\
Exit codes: 0 fine, 1 something expires within 30 days or has expired, 2 bad input.")]
pub enum KeysVerb {
    /// Create a private authority, whose key signs all other certificates.
    Init {
        /// Directory of the authority
        #[arg(long, value_name = "DIR", default_value = "keys")]
        dir: PathBuf,
        /// Validity in days
        #[arg(long, value_name = "DAYS", default_value_t = 3650, value_parser = whole::<u32>(1..=36500))]
        days: u32,
    },
    /// Create a vessel's key and certificate.
    Vessel(SideArgs),
    /// Create a drone's key and certificate.
    Drone(SideArgs),
    /// Create an operator's key and certificate, which allow commanding drones through the vessel.
    Operator(SideArgs),
    /// Show certificates and their expiry dates.
    Show {
        /// Directory of the authority, or of one side
        #[arg(long, value_name = "DIR", default_value = "keys")]
        dir: PathBuf,
        /// Output format.
        #[command(flatten)]
        form: Form,
    },
}

/// One side.
#[derive(Args, Debug)]
pub struct SideArgs {
    /// Number in the configuration (vessel_id, drone_id)
    pub name: u32,
    /// Directory of the authority
    #[arg(long, value_name = "DIR", default_value = "keys")]
    pub dir: PathBuf,
    /// Addresses or host names that the other side dials [default: 127.0.0.1]
    #[arg(long, value_name = "HOST")]
    pub address: Vec<String>,
    /// Validity in days
    #[arg(long, value_name = "DAYS", default_value_t = 825, value_parser = whole::<u32>(1..=36500))]
    pub days: u32,
}

pub fn run(args: &KeysArgs) -> Result<Exit, CliError> {
    match &args.what {
        KeysVerb::Init { dir, days } => {
            init(dir, *days)?;
            terminal::line(format_args!(
                "authority in {}; keep {AUTHORITY_KEY} off the vehicles: anyone who has it can make certificates",
                dir.display()
            ));
            Ok(Exit::Success)
        }
        KeysVerb::Vessel(side) => issue_and_report(side, "vessel"),
        KeysVerb::Drone(side) => issue_and_report(side, "drone"),
        KeysVerb::Operator(side) => issue_and_report(side, "operator"),
        KeysVerb::Show { dir, form } => show(dir, *form),
    }
}

fn issue_and_report(side: &SideArgs, kind: &str) -> Result<Exit, CliError> {
    let directory = issue(&side.dir, kind, side.name, &side.address, side.days)?;
    terminal::line(format_args!(
        "copy {} to the {kind}, and name its files in the radio's tls section",
        directory.display()
    ));
    Ok(Exit::Success)
}

#[derive(Serialize)]
struct Row {
    file: String,
    days_left: i64,
}

fn show(dir: &Path, form: Form) -> Result<Exit, CliError> {
    let doing = format_args!("listing {}", dir.display());
    let mut found = vec![dir.join(AUTHORITY_FILE), dir.join(CERTIFICATE_FILE)];
    let entries = if dir.exists() {
        Some(fs::read_dir(dir).doing(doing)?)
    } else {
        None
    };
    for entry in entries.into_iter().flatten().take(MAX_SHOWN) {
        let entry = entry.doing(doing)?;
        found.push(entry.path().join(CERTIFICATE_FILE));
    }
    found.retain(|path| path.exists());
    found.sort();
    if found.is_empty() {
        return Err(CliError(format!(
            "no certificate in {0}: name their directory with --dir; alight keys init --dir {0} makes an authority",
            dir.display()
        )));
    }
    let mut rows = Vec::new();
    for path in &found {
        let left = expiry(&read(path, "it was there")?, path)? - OffsetDateTime::now_utc();
        rows.push(Row {
            file: path.display().to_string(),
            days_left: left.whole_days(),
        });
    }
    let worst = rows.iter().map(|r| r.days_left).min().unwrap_or(0);
    if !form.print(&json!({ "certificates": rows }), &rows)? {
        for Row {
            file,
            days_left: days,
        } in &rows
        {
            let note = match *days {
                d if d < 0 => "EXPIRED",
                d if d < RENEWAL_DAYS => "expires soon: make a new one",
                _ => "",
            };
            terminal::line(format_args!("{days:>6} days  {file}  {note}"));
        }
    }
    Ok(Exit::of(worst >= RENEWAL_DAYS))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_computer::certificates::{KEY_FILE, files};

    #[test]
    fn certificate_expiry_and_existing_files() {
        let dir = std::env::temp_dir().join(format!("alight-keys-{}", std::process::id()));
        init(&dir, 10).unwrap();
        assert!(init(&dir, 10).is_err(), "an authority is never replaced");
        let side = issue(&dir, "vessel", 7, &["192.168.7.1".into()], 1000).unwrap();
        assert!(issue(&dir, "vessel", 7, &[], 1000).is_err());
        let path = side.join(CERTIFICATE_FILE);
        let left = expiry(&fs::read_to_string(&path).unwrap(), &path).unwrap() - OffsetDateTime::now_utc();
        assert!((9..=10).contains(&left.whole_days()), "{left}");
        let mode = std::os::unix::fs::PermissionsExt::mode(
            &fs::metadata(side.join(KEY_FILE)).unwrap().permissions(),
        );
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(
            show(&dir, Form::default()).unwrap(),
            Exit::Failed,
            "ten days are few"
        );
        assert!(
            files(&dir, Vec::new()).is_err(),
            "the authority has no side of its own"
        );
        fs::remove_dir_all(&dir).unwrap();
    }
}
