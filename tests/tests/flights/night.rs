//! Landings by night: lit tags, printed ones, a lamp on the deck.

use alight_shared::msg::{ReasonCode, State};
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::trial;
use alight_sim::physics::vessel::response::HULLS;
use alight_sim::sensors::night::NightConfig;

/// Under stars, tags that glow like a telephone's screen.
fn lit() -> NightConfig {
    NightConfig {
        ambient_lux: 0.001,
        tags_cdpm2: 100.0,
        ..NightConfig::default()
    }
}

/// A Moderate sea by night, on a hull of a table or the simulated one, without ultraviolet markers.
fn at_night(hull: Option<&str>, night: NightConfig) -> (Scenario, NodeConfigs) {
    let (mut scenario, mut nodes) = (Scenario::default(), NodeConfigs::default());
    scenario.sea = "moderate".parse().unwrap();
    if let Some(hull) = hull {
        scenario.install_hull(&mut nodes, hull).unwrap();
    }
    scenario.sensors.night = Some(night);
    scenario.sensors.uvdar.max_range_m = 0.0;
    (scenario, nodes)
}

/// One seed after the other on the simulated hull and two others.
fn pooled(seeds: core::ops::Range<u64>, night: NightConfig) -> Vec<Outcome> {
    let hulls = [None, Some(HULLS[1]), Some(HULLS[2])];
    let worlds = hulls.map(|hull| at_night(hull, night));
    let flown = seeds.map(|seed| {
        let (scenario, nodes) = &worlds[seed as usize % worlds.len()];
        let o = trial::outcome(scenario, nodes, seed, "night").unwrap();
        println!("seed {seed}: {:?} {} {:?} m", o.outcome, o.reason, o.position_error_m);
        o
    });
    flown.collect()
}
fn landed(all: &[Outcome]) -> usize {
    all.iter().filter(|o| o.success).count()
}

#[test]
fn landing_by_night_on_lit_tags() {
    let all = pooled(0..3, lit());
    assert_eq!((landed(&all), all.iter().filter(|o| o.is_unsafe()).count()), (3, 0));
}

#[test]
#[ignore = "a minute"]
fn rate_by_night_on_lit_tags() {
    let all = pooled(0..20, lit());
    let failed = all.iter().filter(|o| o.is_unsafe()).count();
    assert!(landed(&all) >= 18 && failed == 0, "{} landed, {failed} unsafe", landed(&all));
}

#[test]
fn landing_by_night_in_rendered_images() {
    // The drone's own metering finds the tags, which its settings of the dark overexpose.
    let mut night = lit();
    night.tags_cdpm2 = 1000.0;
    let (mut scenario, nodes) = at_night(None, night);
    scenario.sensors.render.on = true;
    let o = trial::outcome(&scenario, &nodes, 3, "night").unwrap();
    assert!(o.success && o.position_error_m.unwrap() < 0.15, "{}: {:?} m", o.reason, o.position_error_m);
}

/// A minute and a half after the order: the state, why it waits, and whether a descent was begun.
fn waiting(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> (State, ReasonCode, String, bool) {
    let mut rig = Rig::landing(scenario, nodes, seed).unwrap();
    rig.run(90.0);
    let why = rig.mission(0).waiting;
    let descends = rig.visited(0).contains(&State::Descent);
    (rig.state(0), why.code, why.to_string(), descends)
}

#[test]
fn printed_tags_by_night_with_the_reason() {
    for render in [false, true] {
        let (mut scenario, nodes) = at_night(None, NightConfig::default());
        scenario.sensors.render.on = render;
        let (state, code, text, descends) = waiting(&scenario, &nodes, 5);
        assert_eq!((state, code, descends), (State::Approach, ReasonCode::TooDark, false), "{text}");
        assert!(text.contains("4.0 ms and gain at their limits"), "{text}");
    }
}

#[test]
fn printed_tags_on_a_lit_deck() {
    // Floodlights of a quay or a work boat, 150 lux on the deck.
    let night = NightConfig {
        ambient_lux: 150.0,
        ..NightConfig::default()
    };
    let (scenario, nodes) = at_night(None, night);
    let o = trial::outcome(&scenario, &nodes, 4, "night").unwrap();
    assert!(o.success, "{}", o.reason);
}

#[test]
fn lamp_on_the_deck_that_blinds() {
    // A searchlight beside the tags: whatever comes of it, no contact is unsafe.
    let blinding = NightConfig {
        lamp_cd: 3e4,
        ..lit()
    };
    let all = pooled(0..3, blinding);
    assert!(all.iter().all(|o| !o.is_unsafe() && o.unsafe_contacts == 0));
    // Behind an infra-red filter the same lamp is nothing.
    let filtered = NightConfig {
        filter: 0.01,
        ..blinding
    };
    assert_eq!(landed(&pooled(0..2, filtered)), 2);
}
