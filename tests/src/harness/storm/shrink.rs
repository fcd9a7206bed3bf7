//! Finds the shortest list that still breaks the same rule by omitting faults, then halving sizes and durations.

use super::{Storm, watch::StormRule};

const MAX_TRIES: usize = 80;
const HALVINGS: usize = 4;

/// `breaks` flies a storm and returns the broken rule.
pub fn shrink(storm: &Storm, rule: StormRule, mut breaks: impl FnMut(&Storm) -> Option<StormRule>) -> Storm {
    let mut best = storm.clone();
    let mut tries = 0;
    let mut still = |candidate: &Storm| {
        tries += 1;
        tries <= MAX_TRIES && breaks(candidate) == Some(rule)
    };
    let mut k = 0;
    while k < best.faults.len() {
        let mut candidate = best.clone();
        candidate.faults.remove(k);
        if still(&candidate) {
            best = candidate;
        } else {
            k += 1;
        }
    }
    let calm = Storm {
        wind_mps: 0.0,
        ..best.clone()
    };
    if best.wind_mps > 0.0 && still(&calm) {
        best = calm;
    }
    for _ in 0..HALVINGS {
        let before = best.clone();
        for k in 0..best.faults.len() {
            for halve in [
                |f: &mut super::Fault| f.size = half(f.size),
                |f: &mut super::Fault| f.lasts_s = half(f.lasts_s),
            ] {
                let mut candidate = best.clone();
                candidate.faults.get_mut(k).into_iter().for_each(halve);
                let stronger = |(new, old): (&super::Fault, &super::Fault)| {
                    new.size != old.size && !new.kind.is_milder_by_half()
                };
                let stronger = candidate.faults.iter().zip(&best.faults).any(stronger);
                let same = candidate == best || stronger;
                if !same && still(&candidate) {
                    best = candidate;
                }
            }
        }
        if best == before {
            break;
        }
    }
    best
}

/// Half of `v`, rounded to a thousandth.
fn half(v: f64) -> f64 {
    (v * 500.0).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::{super::FaultKind, *};

    #[test]
    fn shrunk_list_of_the_fault_that_matters() {
        let storm = Storm::drawn(7, 6);
        let mut storm = storm;
        storm.faults[3].kind = FaultKind::Blind;
        storm.faults[3].lasts_s = 8.0;
        // A vision outage of 1 s or more breaks the rule.
        let breaks = |s: &Storm| {
            let long = |f: &super::super::Fault| f.kind == FaultKind::Blind && f.lasts_s >= 1.0;
            s.faults.iter().any(long).then_some(StormRule::Water)
        };
        let small = shrink(&storm, StormRule::Water, breaks);
        assert_eq!(small.faults.len(), 1);
        assert!((1.0..2.0).contains(&small.faults[0].lasts_s) && small.wind_mps == 0.0);
        // Breaking a different rule does not count.
        assert_eq!(shrink(&storm, StormRule::Stuck, breaks), storm);
    }
}
