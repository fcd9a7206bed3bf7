use std::path::Path;

use alight_computer::record::flight::store;

use super::{
    files::RehearsalPlan,
    list::{self, CheckList},
};

/// Adds the newest flight of each computer whose file names a directory.
pub fn show(plan: &RehearsalPlan, list: &mut CheckList) {
    for (what, recorder) in [
        ("vessel's flight recorder", &plan.vessel.recorder),
        ("drone's flight recorder", &plan.drone.recorder),
    ] {
        if !recorder.directory.is_empty() {
            let (ok, figure) = newest(recorder.directory.as_ref());
            list.add(list::LADDER, what, ok, figure);
        }
    }
}

/// Whether the newest flight has a landing, and the size of the flight.
fn newest(root: &Path) -> (bool, String) {
    let all = store::flights(root).unwrap_or_default();
    let Some(flight) = all.last() else {
        return (false, "nothing is recorded".into());
    };
    let outcome = flight.summary().unwrap_or_default().outcome;
    let parts = flight.parts().0;
    let mb = flight.bytes() as f64 / 1e6;
    let ok = parts > 0 && outcome.ends_with("landed");
    (ok, format!("{outcome}, {parts} files, {mb:.1} MB"))
}
