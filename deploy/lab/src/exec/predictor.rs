//! `--predictor exec:COMMAND`: a predictor that is another program. It predicts the deck's motion; ages, identity and
//! mean of the deck are those of the drone's own predictor.

use alight_shared::{
    msg::{
        DeckForecast, DeckStage, DroneState, FORECAST_STAGES, Message as _, Seq, TagPose, VesselEstimate,
        WaveModel,
    },
    time::DroneClock,
};
use alight_sim::baselines::own::{OwnPredictor, OwnReport};
use alight_uav::predictor::PredictorIn;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Part, ask,
    child::AnsweringChild,
    fail,
    protocol::{MAX_REASON, PredictedDeck, of_version, parsed},
    start,
};

/// Version of both lines; a program that answers with another version is rejected.
pub const PREDICTOR_VERSION: u32 = 1;
const FORECASTS: Part = ["predictor", "forecasts"];
/// Detections kept between two forecasts.
const MAX_TAGS: usize = 64;

/// Input of a predictor that is another program, sent once per forecast. Times of messages are on the drone's clock.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PredictorInput<'a> {
    /// Version of this format.
    pub version: u32,
    /// The vessel's newest estimate by radio; null before the first.
    pub estimate: Option<&'a VesselEstimate<DroneClock>>,
    /// The vessel's newest wave model by radio; null before the first.
    pub wave: Option<&'a WaveModel<DroneClock>>,
    /// State of the drone at the newest odometry.
    pub drone: Option<&'a DroneState>,
    /// Detections by the camera since the previous line.
    #[schemars(length(max = 64))]
    pub tags: &'a [TagPose],
    /// Forecast of the drone's own predictor, with the times to predict.
    pub forecast: PredictedDeck<'a>,
}

/// Answer of a predictor that is another program: `stages`, or `none`.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PredictorAnswer {
    /// Version of this format.
    pub version: u32,
    /// Deck with standard deviations, at the times of the input's stages. The first, the present, stays the drone's own.
    #[serde(default)]
    #[schemars(length(max = 41))]
    pub stages: Option<Vec<DeckStage>>,
    /// Reason why there is no forecast now.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub none: Option<String>,
}

impl PredictorAnswer {
    /// Forecast with the answered stages, or the reason for its absence.
    pub(super) fn read(line: &[u8], own: &DeckForecast) -> Result<Result<DeckForecast, String>, String> {
        let answer: PredictorAnswer = parsed(line)?;
        of_version(answer.version, PREDICTOR_VERSION)?;
        let stages = match (answer.stages, answer.none) {
            (Some(mut stages), None) => {
                if let (Some(first), Some(measured)) = (stages.first_mut(), own.stages.first()) {
                    *first = *measured;
                }
                stages
            }
            (None, Some(why)) => return Ok(Err(why.chars().take(MAX_REASON).collect())),
            (None, None) | (Some(_), Some(_)) => {
                return Err("answered with an invalid choice: give one of stages and none".into());
            }
        };
        let given = stages.len();
        let wanted = own.stages.len();
        if given != wanted {
            return Err(format!("answered with {given} stages instead of {wanted}"));
        }
        let forecast = DeckForecast {
            stages: Seq::<_, FORECAST_STAGES>::filled(stages),
            ..*own
        };
        let sound = forecast.check();
        sound.map_err(|field| format!("answered with an invalid {field}: a number is out of range"))?;
        Ok(Ok(forecast))
    }
}

/// Predictor run by the program that `name` starts; each flight starts a separate one.
pub fn predictor(name: &str) -> OwnPredictor {
    let own = name.to_owned();
    OwnPredictor::new(name, move |_, report| {
        let mut exec = ExecPredictor {
            child: start(&own, report, FORECASTS),
            report: report.clone(),
            ..ExecPredictor::default()
        };
        Box::new(move |input, forecast| exec.step(input, forecast))
    })
}

#[derive(Debug, Default)]
struct ExecPredictor {
    /// None after a failure.
    child: Option<AnsweringChild>,
    report: OwnReport,
    /// Newest input of each kind, and the detections since the previous line.
    newest: PredictorIn,
}

impl ExecPredictor {
    fn step(&mut self, input: &PredictorIn, forecast: &mut Option<DeckForecast>) {
        let newest = &mut self.newest;
        newest.estimate = input.estimate.or(newest.estimate);
        newest.wave = input.wave.or(newest.wave);
        newest.drone = input.drone.or(newest.drone);
        newest.tags.extend_from_slice(&input.tags);
        let excess = newest.tags.len().saturating_sub(MAX_TAGS);
        newest.tags.drain(..excess);
        let Some(own) = forecast.take() else { return };
        let Some(child) = &mut self.child else { return };
        let line = PredictorInput {
            version: PREDICTOR_VERSION,
            estimate: newest.estimate.as_ref(),
            wave: newest.wave.as_ref(),
            drone: newest.drone.as_ref(),
            tags: &newest.tags,
            forecast: PredictedDeck::of(&own),
        };
        let answer = ask(child, &line).and_then(|(line, _)| PredictorAnswer::read(&line, &own));
        newest.tags.clear();
        self.report.get().none = None;
        match answer {
            Ok(Ok(answered)) => *forecast = Some(answered),
            Ok(Err(why)) => self.report.get().none = Some(why),
            Err(why) => {
                fail(&self.report, FORECASTS, why);
                self.child = None;
            }
        }
    }
}
