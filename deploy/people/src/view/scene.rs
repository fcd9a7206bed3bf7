//! Deck, drone and plan on axes that move with the deck, so that a plan that lands ends on it.

use alight_computer::process::snapshot::Snapshot;
use alight_shared::{
    frames::wrap_angle,
    msg::{DeckForecast, DeckStage, Plan},
    time::{DroneClock, Span, Time},
};

use crate::{
    status::compass::mean_velocity,
    view::picture::{ContactView, DeckPoint, DroneView, SceneView},
};

const PATH_STEP: usize = 2;
/// Age at which a plan is no longer drawn, s: the vessel has moved away from it.
const FORGOTTEN_S: f64 = 5.0;
/// Time for which a past planned contact is shown, s.
const PAST_S: f64 = 1.0;

/// Scene at `now_ns` of the observer's clock, without the bodies' dimensions; None without a forecast of the deck.
pub fn scene(known: &Snapshot, now_ns: i64) -> Option<SceneView> {
    let forecast = known.forecast.as_ref()?;
    let now = forecast.header.at + Span::from_secs(known.forecast.age_s(now_ns));
    let deck = deck_at(forecast, now)?;
    let heading = forecast.mean_heading;
    let drone = drone(known, now_ns);
    let plan = known.plan.filter(|_| known.plan.age_s(now_ns) < FORGOTTEN_S);
    let plan_stale = known.plan.is_old(now_ns);
    let [roll, pitch, yaw] = deck.euler;
    Some(SceneView {
        euler_deg: degrees([roll, pitch, wrap_angle(yaw - heading)]),
        heading_deg: tenth(heading.to_degrees().rem_euclid(360.0)),
        way_mps: way(forecast),
        forecast_stale: known.forecast.is_old(now_ns),
        contact: plan
            .filter(|_| !plan_stale)
            .and_then(|p| contact(&p, forecast, now, &deck)),
        plan: plan.map_or_else(Vec::new, |p| path(&p, forecast)),
        plan_stale,
        drone,
        ..SceneView::default()
    })
}

/// Drone relative to the deck at the time of its newest state.
pub fn drone(known: &Snapshot, now_ns: i64) -> Option<DroneView> {
    let (forecast, d) = (known.forecast.as_ref()?, (*known.drone)?);
    let (below, heading) = (deck_at(forecast, d.header.at)?, forecast.mean_heading);
    let e = d.euler();
    Some(DroneView {
        at: place(d.position, below.position, heading),
        closing_mps: hundredth(d.velocity[2] - below.velocity[2]),
        euler_deg: degrees([e.x, e.y, wrap_angle(e.z - heading)]),
        stale: known.drone.is_old(now_ns),
    })
}

/// Deck at `t`. Outside the forecast it continues with the velocity of the first or last stage.
fn deck_at(forecast: &DeckForecast, t: Time<DroneClock>) -> Option<DeckStage> {
    if let Some(deck) = forecast.at(t) {
        return Some(deck);
    }
    let steps = i64::try_from(forecast.stages.len()).ok()? - 1;
    let (mut deck, at) = if t < forecast.header.at {
        (*forecast.stages.first()?, forecast.header.at)
    } else {
        (
            *forecast.stages.last()?,
            forecast.header.at + forecast.step * steps,
        )
    };
    let dt_s = (t - at).secs();
    deck.position[0] += deck.velocity[0] * dt_s;
    deck.position[1] += deck.velocity[1] * dt_s;
    Some(deck)
}

/// Stages of the plan until the planned contact, each relative to the deck forecast for its time.
fn path(plan: &Plan, forecast: &DeckForecast) -> Vec<DeckPoint> {
    let time = |k: i64| plan.header.at + plan.step * k;
    let stages = (0..).zip(plan.stages.iter());
    let end = i64::try_from(plan.stages.len()).map_or(plan.header.at, |n| time(n - 1));
    let touchdown = plan.touchdown_at.filter(|at| *at <= end);
    let until = touchdown.unwrap_or(Time::from_nanos(i64::MAX));
    let last = touchdown.and_then(|at| Some((at, plan.sample(at)?.position)));
    stages
        .map(|(k, stage)| (time(k), stage.position))
        .step_by(PATH_STEP)
        .take_while(|(t, _)| *t < until)
        .chain(last)
        .filter_map(|(t, at)| Some(place(at, deck_at(forecast, t)?.position, forecast.mean_heading)))
        .collect()
}

fn contact(
    plan: &Plan,
    forecast: &DeckForecast,
    now: Time<DroneClock>,
    deck: &DeckStage,
) -> Option<ContactView> {
    let at = plan.touchdown_at?;
    let in_s = (at - now).secs();
    let then = forecast.at(at);
    (in_s > -PAST_S).then(|| ContactView {
        in_s: tenth(in_s.max(0.0)),
        tilt_deg: then.map(|d| [d.euler[0], d.euler[1]].map(|a| tenth(a.to_degrees()))),
        rise_m: then.map(|d| hundredth(deck.position[2] - d.position[2])),
    })
}

/// Mean velocity of the vessel in the forecast, forward and to starboard, m/s.
fn way(forecast: &DeckForecast) -> [f64; 2] {
    let [north, east] = mean_velocity(forecast);
    let [forward, right, _] = place([north, east, 0.0], [0.0; 3], forecast.mean_heading);
    [tenth(forward), tenth(right)]
}

/// Position `at` in NED relative to the deck at `deck`, on axes along `heading`, rad.
fn place(at: [f64; 3], deck: [f64; 3], heading: f64) -> DeckPoint {
    let (sin, cos) = heading.sin_cos();
    let [north, east, down] = [at[0] - deck[0], at[1] - deck[1], at[2] - deck[2]];
    [cos * north + sin * east, cos * east - sin * north, -down].map(hundredth)
}

fn degrees(euler: [f64; 3]) -> [f64; 3] {
    euler.map(|a| tenth(a.to_degrees()))
}

fn tenth(x: f64) -> f64 {
    (10.0 * x).round() / 10.0
}

fn hundredth(x: f64) -> f64 {
    (100.0 * x).round() / 100.0
}
