//! Planners and predictors supplied by the caller, who constructs one for each start.

use std::{
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use alight_shared::{msg::DeckForecast, time::Span};
use alight_uav::{planner::law::Law, predictor::PredictorIn, settings::DroneSettings};

#[derive(Clone, Debug, Default)]
pub struct OwnReport(Arc<Mutex<Reported>>);

#[derive(Clone, Debug, Default)]
pub struct Reported {
    /// Reason why the planner or predictor has failed; the flight continues without its plans or forecasts.
    pub failure: Option<String>,
    /// Reason for the current absence of a plan or forecast.
    pub none: Option<String>,
    /// Solve time of the newest plan; None: the scenario's.
    pub solve: Option<Span>,
}

impl OwnReport {
    /// Reason why there is no plan or forecast.
    pub fn failure(&self) -> Option<String> {
        let report = self.get();
        let none = || Some(format!("has no answer: {}", report.none.as_ref()?));
        report.failure.clone().or_else(none)
    }
    pub fn get(&self) -> MutexGuard<'_, Reported> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Corrects each forecast of the drone's own predictor; it receives the inputs of all steps.
pub type Predict = dyn FnMut(&PredictorIn, &mut Option<DeckForecast>);
/// Planner under test. Mission and predictor keep the drone's own settings.
pub type OwnLaw = OwnPart<dyn Law>;
/// Predictor under test.
pub type OwnPredictor = OwnPart<Predict>;

type Make<T> = dyn Fn(&DroneSettings, &OwnReport) -> Box<T> + Send + Sync;

/// Part of the drone that the caller supplies.
pub struct OwnPart<T: ?Sized> {
    name: String,
    make: Arc<Make<T>>,
}

impl<T: ?Sized> OwnPart<T> {
    /// `name` identifies the part in the outcomes.
    pub fn new(
        name: impl Into<String>,
        make: impl Fn(&DroneSettings, &OwnReport) -> Box<T> + Send + Sync + 'static,
    ) -> Self {
        OwnPart {
            name: name.into(),
            make: Arc::new(make),
        }
    }
    pub fn name(&self) -> &str {
        &self.name
    }
    pub fn start(&self, drone: &DroneSettings, report: &OwnReport) -> Box<T> {
        (self.make)(drone, report)
    }
}

impl<T: ?Sized> Clone for OwnPart<T> {
    fn clone(&self) -> Self {
        let name = self.name.clone();
        let make = self.make.clone();
        OwnPart { name, make }
    }
}
impl<T: ?Sized> fmt::Debug for OwnPart<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnPart").field(&self.name).finish()
    }
}
impl<T: ?Sized> PartialEq for OwnPart<T> {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}
