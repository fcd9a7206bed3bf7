//! Lines exchanged with planners and predictors that are other programs: JSON, one object per line.

use alight_shared::{
    landing::{MAX_MPS, MAX_TILT_RAD},
    msg::{
        DeckForecast, DeckStage, DroneState, FORECAST_STAGES, Message as _, MissionState, PLAN_STAGES, Phase,
        Plan, PlanStage, Seq, State,
    },
    time::{DroneTime, Span, Time},
};
use alight_uav::settings::DroneSettings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Version of both lines; a program that answers with another version is rejected.
pub const PLANNER_VERSION: u32 = 1;
/// Maximum length of an answer, bytes: 41 stages of 15 numbers take 15 kB.
pub const MAX_LINE_BYTES: usize = 128 << 10;
pub const MAX_REASON: usize = 200;
/// Maximum solve time, s: the pilot flies no plan that is older than 0.5 s, and a plan is as old as its solve.
pub const MAX_SOLVE_S: f64 = 0.4;
/// Time after its planned touchdown for which a plan is accepted, s.
const MAX_PAST_S: f64 = 5.0;
const MAX_STEP_S: f64 = 1.0;

/// Input of a planner that is another program, sent once per plan period.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PlannerInput<'a> {
    /// Version of this format.
    pub version: u32,
    /// Present time on the drone's clock, s. All times in both lines are on this clock.
    pub time_s: f64,
    /// State of the mission, and the motion that it permits.
    pub mission: Permission,
    /// Measured state of the drone.
    pub drone: MeasuredDrone,
    /// Predicted motion of the deck; null without a recent forecast.
    pub forecast: Option<PredictedDeck<'a>>,
    /// Limits of the drone and of a plan.
    pub limits: Limits,
    /// True wind, towards north and east, m/s; null until it is known.
    pub wind: Option<[f64; 2]>,
    /// Horizontal acceleration that is not caused by the rotors, NED, m/s².
    pub disturbance: [f64; 2],
}

/// State of the mission, and the motion that it permits.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Permission {
    /// Present state.
    pub state: State,
    /// Phase of the state: Navigation (far from the vessel), Follow (above the vessel), Landing (descent and flare).
    pub phase: Phase,
    /// Proposed descent speed relative to the deck, m/s, which a plan may exceed; 0: no descent.
    pub descent_mps: f64,
    /// Commanded height of the drone's centre of mass above the deck's mean level, m.
    pub height_m: f64,
    /// Minimum height above the water (negative NED z), m.
    pub minimum_altitude_m: f64,
    /// Minimum clearance of the feet above the deck, m; null: down to the deck.
    pub lowest_clearance_m: Option<f64>,
    /// Target of the feet relative to the deck's centre, NED, m.
    pub meets: [f64; 2],
    /// Position to hold in the states that hold, drone's NED, m.
    pub hold_position: [f64; 3],
    /// Heading to hold, rad.
    pub hold_yaw: f64,
    /// Predicted probability of a successful landing; null without a prediction.
    pub probability: Option<f64>,
    /// Predicted probability of an unsafe contact; null without a prediction.
    pub harm: Option<f64>,
}

/// Measured state of the drone.
#[derive(Debug, Serialize, JsonSchema)]
pub struct MeasuredDrone {
    /// Time of validity, s.
    pub time_s: f64,
    /// Centre of mass, drone's NED, m.
    pub position: [f64; 3],
    /// Velocity, NED, m/s.
    pub velocity: [f64; 3],
    /// Roll, pitch, yaw (ZYX), rad.
    pub euler: [f64; 3],
    /// Body rates, rad/s.
    pub rates: [f64; 3],
    /// Standard deviations of `position`, m.
    pub position_sd: [f64; 3],
    /// Standard deviations of `velocity`, m/s.
    pub velocity_sd: [f64; 3],
}

/// Predicted motion of the deck.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PredictedDeck<'a> {
    /// Time of the first stage, s.
    pub time_s: f64,
    /// Time between stages, s.
    pub step_s: f64,
    /// Age of the newest vessel estimate used, s; null before the first.
    pub radio_age_s: Option<f64>,
    /// Age of the newest vision measurement used, s; null before the first.
    pub vision_age_s: Option<f64>,
    /// Mean height of the deck, drone's NED z, m.
    pub mean_z: Option<f64>,
    /// Deck at each stage, with standard deviations.
    #[schemars(length(max = 41))]
    pub stages: &'a [DeckStage],
}
const _: () = assert!(FORECAST_STAGES == 41 && PLAN_STAGES == 41);

impl<'a> PredictedDeck<'a> {
    pub fn of(f: &'a DeckForecast) -> PredictedDeck<'a> {
        PredictedDeck {
            time_s: f.header.at.secs(),
            step_s: f.step.secs(),
            radio_age_s: Some(f.radio_age_s).filter(|age| age.is_finite()),
            vision_age_s: Some(f.vision_age_s).filter(|age| age.is_finite()),
            mean_z: f.mean_z,
            stages: &f.stages,
        }
    }
}

/// Limits of the drone and of a plan.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Limits {
    /// Period of the plans in the phases Follow and Landing, s.
    pub period_s: f64,
    /// Horizontal speed per axis, m/s.
    pub horizontal_mps: f64,
    /// Vertical speed, m/s.
    pub vertical_mps: f64,
    /// Roll and pitch, rad.
    pub tilt_rad: f64,
    /// Maximum thrust per mass, m/s².
    pub thrust_mps2: f64,
    /// Distance of the foot plane below the centre of mass, m.
    pub feet_below_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Time constant of the autopilot's attitude loop, s.
    pub attitude_lag_s: f64,
    /// Length (along the vessel's x) and width of the deck, m.
    pub deck_m: [f64; 2],
    /// Friction coefficient of feet on the deck.
    pub friction: f64,
    /// Maximum speeds of a contact along the deck's normal and along the deck, m/s.
    pub contact_mps: f64,
    /// Maximum angle between deck and foot plane at a contact, rad.
    pub contact_tilt_rad: f64,
}

impl Limits {
    pub fn of(settings: &DroneSettings) -> Limits {
        let soft = &settings.planner.limits;
        let drone = &settings.airframe;
        Limits {
            period_s: 1.0 / settings.planner.landing_hz,
            horizontal_mps: soft.horizontal_mps,
            vertical_mps: soft.vertical_mps,
            tilt_rad: soft.tilt_deg.to_radians(),
            thrust_mps2: drone.max_thrust_n / drone.mass_kg,
            feet_below_m: drone.feet_below_m,
            mass_kg: drone.mass_kg,
            attitude_lag_s: drone.attitude_lag_s,
            deck_m: [settings.deck.length_m, settings.deck.width_m],
            friction: settings.mission.friction,
            contact_mps: MAX_MPS,
            contact_tilt_rad: MAX_TILT_RAD,
        }
    }
}

impl<'a> PlannerInput<'a> {
    pub fn of(
        now: DroneTime,
        (m, d): (&MissionState, &DroneState),
        forecast: Option<&'a DeckForecast>,
        limits: Limits,
    ) -> PlannerInput<'a> {
        PlannerInput {
            version: PLANNER_VERSION,
            time_s: now.secs(),
            mission: Permission {
                state: m.state,
                phase: m.state.phase(),
                descent_mps: m.descent_mps,
                height_m: m.height_m,
                minimum_altitude_m: m.minimum_altitude_m,
                lowest_clearance_m: m.lowest_clearance_m,
                meets: m.meets,
                hold_position: m.hold_position,
                hold_yaw: m.hold_yaw,
                probability: m.likelihood,
                harm: m.harm,
            },
            drone: MeasuredDrone {
                time_s: d.header.at.secs(),
                position: d.position,
                velocity: d.velocity,
                euler: d.euler().into(),
                rates: d.rates,
                position_sd: d.position_sd,
                velocity_sd: d.velocity_sd,
            },
            forecast: forecast.map(PredictedDeck::of),
            limits,
            wind: d.wind,
            disturbance: d.disturbance,
        }
    }
}

/// Answer of a planner that is another program: `stages` and `step_s`, or `none`, or `common`.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[cfg_attr(test, derive(Serialize))]
#[serde(deny_unknown_fields)]
pub struct PlannerAnswer {
    /// Version of this format.
    pub version: u32,
    /// Time between stages, s, at most 1; the first stage is at the input's time.
    #[serde(default)]
    pub step_s: Option<f64>,
    /// Plan of 2 to 41 stages; beyond the last stage the velocity is constant.
    #[serde(default)]
    #[schemars(length(max = 41))]
    pub stages: Option<Vec<AnsweredStage>>,
    /// Time at which the feet touch the deck in this plan, s.
    #[serde(default)]
    pub touchdown_s: Option<f64>,
    /// Horizontal acceleration caused by wind that the attitudes compensate, NED, m/s².
    #[serde(default)]
    pub disturbance: Option<[f64; 2]>,
    /// Reason why there is no plan at this time.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub none: Option<String>,
    /// True: the common planner (mpc) plans for this period.
    #[serde(default)]
    pub common: Option<bool>,
    /// Solve time of this plan, s, above 0 and at most 0.4, so that a seed reproduces a flight; absent: that of the
    /// scenario. With `exec-measured:` the measured time counts.
    #[serde(default)]
    pub solve_s: Option<f64>,
}

/// State of the drone at one time of the plan.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[cfg_attr(test, derive(Serialize))]
#[serde(deny_unknown_fields)]
pub struct AnsweredStage {
    /// Centre of mass, drone's NED, m.
    pub position: [f64; 3],
    /// Velocity, NED, m/s.
    pub velocity: [f64; 3],
    /// Acceleration, NED, m/s².
    pub acceleration: [f64; 3],
    /// Roll, pitch, yaw (ZYX), rad.
    pub euler: [f64; 3],
    /// Euler-angle rates, rad/s.
    #[serde(default)]
    pub euler_rates: Option<[f64; 3]>,
}

pub fn parsed<T: DeserializeOwned>(line: &[u8]) -> Result<T, String> {
    serde_json::from_slice(line).map_err(|e| {
        let begin: String = String::from_utf8_lossy(line).chars().take(40).collect();
        format!("answered {begin:?}, which is not the expected line of JSON ({e})")
    })
}
pub fn of_version(version: u32, wanted: u32) -> Result<(), String> {
    if version == wanted {
        Ok(())
    } else {
        Err(format!("answered in version {version} instead of {wanted}"))
    }
}

#[derive(Debug)]
pub enum Answer {
    /// Plan with its stated solve time.
    Plan(Box<Plan>, Option<Span>),
    None(String),
    Common,
}

impl PlannerAnswer {
    pub fn read(line: &[u8], now: DroneTime) -> Result<Answer, String> {
        let answer: PlannerAnswer = parsed(line)?;
        of_version(answer.version, PLANNER_VERSION)?;
        answer
            .checked(now)
            .map_err(|e| format!("answered with an invalid {e}"))
    }
    fn checked(self, now: DroneTime) -> Result<Answer, String> {
        let (stages, step_s) = match (self.stages, self.none, self.common.unwrap_or(false)) {
            (None, Some(why), false) => return Ok(Answer::None(why.chars().take(MAX_REASON).collect())),
            (None, None, true) => return Ok(Answer::Common),
            (Some(stages), None, false) => (stages, self.step_s.unwrap_or_default()),
            (None, None, false) | (Some(_), _, _) | (None, Some(_), true) => {
                return Err("choice: give one of stages, none and common".into());
            }
        };
        if !(2..=PLAN_STAGES).contains(&stages.len()) {
            return Err(format!(
                "number of stages: {} instead of 2 to {PLAN_STAGES}",
                stages.len()
            ));
        }
        if !(step_s > 0.0 && step_s <= MAX_STEP_S) {
            return Err(format!(
                "step_s: {step_s} is not above 0 and at most {MAX_STEP_S}"
            ));
        }
        if let Some(solve_s) = self.solve_s
            && !(solve_s > 0.0 && solve_s <= MAX_SOLVE_S)
        {
            return Err(format!(
                "solve_s: {solve_s} is not above 0 and at most {MAX_SOLVE_S}"
            ));
        }
        let plan = Plan {
            step: Span::from_secs(step_s),
            touchdown_at: self.touchdown_s.map(|s| Time::EPOCH + Span::from_secs(s)),
            disturbance: self.disturbance.unwrap_or_default(),
            stages: Seq::filled(stages.into_iter().map(|s| PlanStage {
                position: s.position,
                velocity: s.velocity,
                acceleration: s.acceleration,
                euler: s.euler,
                euler_rates: s.euler_rates.unwrap_or_default(),
            })),
            ..Plan::default()
        };
        plan.check()
            .map_err(|field| format!("{field}: a number is out of range"))?;
        if plan
            .touchdown_at
            .is_some_and(|at| (at - now).secs() < -MAX_PAST_S)
        {
            return Err("touchdown_s: it has passed".into());
        }
        Ok(Answer::Plan(Box::new(plan), self.solve_s.map(Span::from_secs)))
    }
}
