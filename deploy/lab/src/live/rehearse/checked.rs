use serde_json::Value;

const PARAMETERS: &str = "parameters";
const AUTOPILOTS_OWN: [&str; 2] = [PARAMETERS, "origin"];

/// Whether the computer passes, and the counts of its findings. A `firmware` that starts with the rehearsal receives
/// its parameters during the warm-up, after this check: findings on them are shown, and checked again before the
/// landing ([`fitness`]).
pub fn judge(findings: &[Value], firmware: bool) -> (bool, String) {
    let count = |level: &str| findings.iter().filter(|f| f["level"] == level).count();
    let later = |f: &&Value| firmware && f["level"] == "broken" && f["topic"] == PARAMETERS;
    let broken = count("broken");
    let later = findings.iter().filter(later).count();
    let mut figure = format!(
        "{broken} BROKEN, {} WARNING, {} fine",
        count("warning"),
        count("fine")
    );
    if later > 0 {
        figure += &format!("; {later} of the firmware's parameters, checked again before the landing");
    }
    (broken == later && !findings.is_empty(), figure)
}

/// Whether a firmware is fit for a landing at the end of the warm-up. `rejection` is the reason why it is not, from
/// the link that reads its parameters.
pub fn fitness(rejection: Option<&str>) -> (bool, String) {
    match rejection {
        Some("") => (true, "its parameters suit a landing, and it has an origin".into()),
        Some(why) => (false, why.into()),
        None => (false, "no report from the link to it".into()),
    }
}

/// Findings in the output of the check (`--json`). Without a `firmware`, findings on the simulated autopilot are
/// omitted, because they do not concern the installer.
pub fn findings(printed: &[u8], firmware: bool) -> Vec<Value> {
    let printed: Value = serde_json::from_slice(printed).unwrap_or_default();
    let mut findings = printed["findings"].as_array().cloned().unwrap_or_default();
    findings.retain(|f| firmware || AUTOPILOTS_OWN.iter().all(|own| f["topic"] != *own));
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn findings_of_the_simulated_autopilot() {
        let topics = ["autopilot", "parameters", "origin", "camera"].map(|topic| json!({ "topic": topic }));
        let printed = json!({ "findings": topics }).to_string();
        let all = findings(printed.as_bytes(), true);
        assert_eq!(all, topics);
        assert_eq!(
            findings(printed.as_bytes(), false),
            [&all[0], &all[3]].map(Value::clone)
        );
        assert!(findings(b"no JSON", false).is_empty());
    }

    #[test]
    fn parameters_set_after_the_first_check() {
        let finding = |level: &str, topic: &str| json!({ "level": level, "topic": topic });
        let stock = [
            finding("fine", "memory"),
            finding("warning", "view"),
            finding("broken", "parameters"),
            finding("broken", "parameters"),
        ];
        let (ok, figure) = judge(&stock, true);
        assert!(
            ok && figure.contains("2 of the firmware's parameters"),
            "{figure}"
        );
        assert!(!judge(&stock, false).0, "of one that has its parameters already");
        let camera = [finding("broken", "parameters"), finding("broken", "camera")];
        assert!(!judge(&camera, true).0 && !judge(&[], true).0);
        assert!(fitness(Some("")).0);
        let (ok, figure) = fitness(Some("COM_OF_LOSS_T is 1.0"));
        assert!(!ok && figure.contains("COM_OF_LOSS_T"));
        assert!(!fitness(None).0);
    }
}
