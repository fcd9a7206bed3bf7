//! `alight study link --live N`: a few bad links live across the link emulator, beside lock-step.

use serde_json::{Value, json};

use super::display::time;
use super::lands::{self, Plan};
use crate::Refused;
use crate::args::StudyArgs;
use crate::say::note;

/// The links: name, and flags of `alight land`.
const LINKS: [(&str, &[&str]); 5] = [
    ("wifi-near", &["--link", "wifi-near"]),
    ("wifi-far", &["--link", "wifi-far"]),
    ("storm", &["--link", "storm"]),
    (
        "storm, 2 s of silence from the flare",
        &["--link", "storm", "--radio-lost", "flare", "--radio-back", "2"],
    ),
    (
        "radio-mesh, 10 s of silence from tracking",
        &[
            "--link",
            "radio-mesh",
            "--radio-lost",
            "tracking",
            "--radio-back",
            "10",
        ],
    ),
];

/// Flies `n` seeds of every link over UDP and over a stream: TLS where there are certificates.
pub fn run(args: &StudyArgs, n: u32) -> Result<Value, Refused> {
    let say = |line: String| note(args.json, line);
    let certificates = args.certificates.as_ref().map(|d| d.display().to_string());
    let stream = if certificates.is_some() { "tls" } else { "tcp" };
    say(
        "| link | transport | landed live | in lock-step | unsafe live | age p50, p95 live | in lock-step | \
         time live, s | in lock-step |\n|---|---|---|---|---|---|---|---|---|"
            .into(),
    );
    let mut rows = Vec::new();
    for (name, flags) in LINKS {
        for transport in ["udp", stream] {
            let mut land: Vec<String> = flags.iter().map(|f| (*f).to_string()).collect();
            land.extend(["--emulate", "always", "--transport", transport].map(String::from));
            if let Some(directory) = &certificates {
                land.extend(["--certificates".into(), directory.clone()]);
            }
            land.extend(args.land.iter().cloned());
            let summary = lands::fly_pairs(&Plan {
                trials: n,
                seed0: args.seed0,
                jobs: 1,
                instance: "study".into(),
                land,
            })?;
            let ([a, b], [c, d]) = (summary.age_s.map(time), summary.age_lock_step_s.map(time));
            say(format!(
                "| {name} | {transport} | {} of {n} | {} | {} | {a}, {b} | {c}, {d} | {:.1} | {:.1} |",
                summary.landed,
                summary.landed_lock_step,
                summary.unsafe_contacts,
                summary.landing_time_s,
                summary.landing_time_lock_step_s,
            ));
            rows.push(json!({ "link": name, "transport": transport, "summary": summary }));
        }
    }
    Ok(json!({ "rows": rows }))
}
