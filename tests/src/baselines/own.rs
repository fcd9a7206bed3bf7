//! A law supplied by the caller, who constructs it for each start of the planner.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use alight_shared::time::Span;
use alight_uav::planner::law::Law;
use alight_uav::settings::DroneSettings;

#[derive(Clone, Debug, Default)]
pub struct LawReport(Arc<Mutex<ReportedLaw>>);

#[derive(Clone, Debug, Default)]
pub struct ReportedLaw {
    /// Reason why the law has stopped planning; the flight continues without plans.
    pub failure: Option<String>,
    /// Reason for the current absence of a plan.
    pub none: Option<String>,
    /// Solve time of the newest plan; None: the scenario's.
    pub solve: Option<Span>,
}

impl LawReport {
    pub fn get(&self) -> MutexGuard<'_, ReportedLaw> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

type MakeLaw = dyn Fn(&DroneSettings, &LawReport) -> Box<dyn Law> + Send + Sync;

/// Planner under test. Mission and predictor keep the drone's own settings.
#[derive(Clone)]
pub struct OwnLaw {
    name: String,
    make: Arc<MakeLaw>,
}

impl OwnLaw {
    /// `name` identifies the planner in the outcomes.
    pub fn new(
        name: impl Into<String>,
        make: impl Fn(&DroneSettings, &LawReport) -> Box<dyn Law> + Send + Sync + 'static,
    ) -> OwnLaw {
        OwnLaw {
            name: name.into(),
            make: Arc::new(make),
        }
    }
    pub fn name(&self) -> &str {
        &self.name
    }
    pub fn law(&self, drone: &DroneSettings, report: &LawReport) -> Box<dyn Law> {
        (self.make)(drone, report)
    }
}

impl fmt::Debug for OwnLaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnLaw").field(&self.name).finish()
    }
}
impl PartialEq for OwnLaw {
    fn eq(&self, other: &OwnLaw) -> bool {
        self.name == other.name
    }
}
