//! The deck's position as the autopilot's home position.

use alight_shared::{geodesy::Datum, msg::State};
use alight_uav::autopilot::{AutopilotLinkConfig, message::MavCmd};

use super::{
    BOTH, commanding, config,
    rig::{LinkRig, hold, lead},
};

#[test]
fn home_on_the_deck() {
    for firmware in BOTH {
        let c = AutopilotLinkConfig {
            send_home: true,
            ..config()
        };
        let mut p = LinkRig::new(firmware, 5.0, &c);
        let origin = Datum::new(43.5, 16.3, 12.0);
        p.linked.autopilot.origin = origin;
        p.linked.autopilot.geoid_m = Some(38.0);
        p.forecast = true;
        p.run(4.0);
        p.take_command();
        p.mission = State::Tracking;
        p.pilot = Some(hold);
        p.run(16.0);
        // At rest the home position is sent once, and not again for 30 s.
        let times = |p: &LinkRig| -> Vec<f64> {
            let home = p
                .commands
                .iter()
                .filter(|(_, c)| c.command == MavCmd::MAV_CMD_DO_SET_HOME);
            home.map(|(t, _)| *t).collect()
        };
        assert_eq!(times(&p).len(), 1, "{firmware:?}");
        let home = p.linked.autopilot.home.unwrap();
        assert!(home.distance_m(&origin) < 3.0, "{firmware:?}: {home:?}");
        // At 1 m/s the drone stays above the deck.
        p.pilot = Some(lead);
        p.run(40.0);
        let times = times(&p);
        assert!((4..=9).contains(&times.len()), "{firmware:?}: {times:?}");
        assert!(times.windows(2).all(|w| w[1] - w[0] > 4.99), "{times:?}");
        let moved = p.linked.autopilot.home.unwrap().distance_m(&home);
        assert!((15.0..80.0).contains(&moved), "{moved} m");
    }
}

#[test]
fn home_and_deck_not_configured() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.forecast = true;
        p.run(10.0);
        assert!(p.commands_of(MavCmd::MAV_CMD_DO_SET_HOME).is_empty() && p.linked.autopilot.home.is_none());
        assert!(p.targets.is_empty() && p.deck_messages == 0);
    }
}
