//! Landings at night: lit tags, printed tags, a lamp on the deck.

use alight_shared::msg::{ReasonCode, State};
use alight_sim::{
    harness::{
        outcome::Outcome,
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
        trial,
    },
    physics::vessel::response::HULLS,
    sensors::night::NightConfig,
};

/// Starlight, and tags as bright as a phone screen.
fn lit() -> NightConfig {
    NightConfig {
        ambient_lux: 0.001,
        tags_cdpm2: 100.0,
        ..NightConfig::default()
    }
}

/// Moderate sea at night, with a hull from a table or the simulated hull, without ultraviolet markers.
fn at_night(hull: Option<&str>, night: NightConfig) -> (Scenario, NodeConfigs) {
    let mut scenario = Scenario::default();
    let mut nodes = NodeConfigs::default();
    scenario.sea = "moderate".parse().unwrap();
    if let Some(hull) = hull {
        scenario.install_hull(&mut nodes, hull).unwrap();
    }
    scenario.sensors.night = Some(night);
    scenario.sensors.uvdar.max_range_m = 0.0;
    (scenario, nodes)
}

fn pooled(seeds: core::ops::Range<u64>, night: NightConfig) -> Vec<Outcome> {
    let hulls = [None, Some(HULLS[1]), Some(HULLS[2])];
    let worlds = hulls.map(|hull| at_night(hull, night));
    let flown = seeds.map(|seed| {
        let (scenario, nodes) = &worlds[seed as usize % worlds.len()];
        let o = trial::outcome(scenario, nodes, seed, "night").unwrap();
        println!(
            "seed {seed}: {:?} {} {:?} m",
            o.outcome, o.reason, o.position_error_m
        );
        o
    });
    flown.collect()
}
fn landed(all: &[Outcome]) -> usize {
    all.iter().filter(|o| o.success).count()
}

#[test]
#[ignore = "10 flights; CI runs them by name"]
fn landings_by_night_on_lit_tags() {
    let all = pooled(0..10, lit());
    let failed = all.iter().filter(|o| o.is_unsafe()).count();
    assert!(
        landed(&all) >= 9 && failed == 0,
        "{} landed, {failed} unsafe",
        landed(&all)
    );
}

#[test]
fn landing_by_night_in_rendered_images() {
    // Settings for the dark overexpose the tags until metering finds them.
    let mut night = lit();
    night.tags_cdpm2 = 1000.0;
    let (mut scenario, nodes) = at_night(None, night);
    scenario.sensors.render.on = true;
    let o = trial::outcome(&scenario, &nodes, 3, "night").unwrap();
    assert!(
        o.success && o.position_error_m.unwrap() < 0.15,
        "{}: {:?} m",
        o.reason,
        o.position_error_m
    );
}

#[test]
fn printed_tags_by_night_with_the_reason() {
    for (render, limit_s) in [(false, 60.0), (true, 15.0)] {
        let (mut scenario, nodes) = at_night(None, NightConfig::default());
        scenario.sensors.render.on = render;
        let mut rig = Rig::landing(&scenario, &nodes, 5).unwrap();
        let is_dark = |rig: &Rig| rig.mission(0).waiting.code == ReasonCode::TooDark;
        assert!(rig.until(60.0, is_dark), "{}", rig.mission(0).waiting);
        // It stays dark, and the drone must not descend.
        rig.run(limit_s);
        assert!(
            rig.state(0) == State::Approach && is_dark(&rig),
            "{}",
            rig.mission(0).waiting
        );
        assert!(!rig.visited(0).contains(&State::Descent));
        let text = rig.mission(0).waiting.to_string();
        assert!(text.contains("4.0 ms and gain at their limits"), "{text}");
    }
}

#[test]
fn printed_tags_on_a_lit_deck() {
    // Work light on a small boat.
    let night = NightConfig {
        ambient_lux: 40.0,
        ..NightConfig::default()
    };
    let (scenario, nodes) = at_night(None, night);
    let o = trial::outcome(&scenario, &nodes, 4, "night").unwrap();
    assert!(o.success, "{}", o.reason);
}

#[test]
fn lamp_on_the_deck_into_the_lens() {
    // With a searchlight 1.5 m from the tags' centre, no contact may be unsafe.
    let lamp = NightConfig {
        lamp_cd: 3e4,
        ..lit()
    };
    let all = pooled(0..2, lamp);
    assert!(all.iter().all(|o| !o.is_unsafe() && o.unsafe_contacts == 0));
    // An infra-red filter passes a hundredth of the lamp's light.
    let filtered = NightConfig { filter: 0.01, ..lamp };
    assert_eq!(landed(&pooled(0..2, filtered)), 2);
}

/// With a lamp 1 m from the tags' centre, the drone lands, or waits and reports why.
#[test]
fn lamp_that_blinds_with_the_reason() {
    for (lamp_cd, seed, lands) in [(1e5, 3, true), (1e6, 4, false)] {
        let blinding = NightConfig {
            lamp_cd,
            lamp_m: [0.0, 1.0, -0.3],
            ..lit()
        };
        let o = &pooled(seed..seed + 1, blinding)[0];
        assert!(!o.is_unsafe() && o.unsafe_contacts == 0, "{o:?}");
        let explained = o.success || o.reason.contains("blinded");
        assert!(explained && o.success == lands, "{lamp_cd} cd: {}", o.reason);
    }
}
