//! Motor stops in the air: hover, approach, tracking and descents that are called off at a random
//! clearance, over and over. None may stop the motors.

use alight_shared::msg::{CommandKind, State};
use serde::Serialize;

use crate::harness::physics::TICK;
use crate::harness::scenario::{NodeConfigs, Scenario, SetupError};
use crate::harness::tap::NoTap;
use crate::harness::world::World;
use crate::physics::streams::Streams;
use crate::sensors::noise::Noise;

/// What happened in one session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AirborneReport {
    /// Time in the air, h.
    pub hours: f64,
    /// Motors stopped without a contact in the last half second.
    pub false_stops: u32,
    /// Descents called off.
    pub aborts: u32,
    /// Contacts with the deck (a descent called off too late, or a deck that rose).
    pub contacts: u32,
    /// Lowest clearance at which a descent was called off and no contact followed, m.
    pub lowest_m: f64,
    /// It ended in the water.
    pub water: u32,
}

impl AirborneReport {
    /// Both sessions together.
    pub fn and(self, o: AirborneReport) -> AirborneReport {
        AirborneReport {
            hours: self.hours + o.hours,
            false_stops: self.false_stops + o.false_stops,
            aborts: self.aborts + o.aborts,
            contacts: self.contacts + o.contacts,
            lowest_m: self.lowest_m.min(o.lowest_m),
            water: self.water + o.water,
        }
    }
}

/// Flies for `duration_s` or until the motors stop, whichever is first.
pub fn fly_session(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    duration_s: f64,
) -> Result<AirborneReport, SetupError> {
    let mut world = World::new(scenario, nodes, seed)?;
    world.warm_up(&mut NoTap);
    let mut draw = Noise::new(&Streams::new(seed), "airborne.commands");
    let mut report = AirborneReport {
        lowest_m: f64::INFINITY,
        ..AirborneReport::default()
    };
    let mut command_at = 5.0 + 25.0 * draw.uniform();
    let mut call_off_below = 0.3 + 5.0 * draw.uniform();
    let mut last_contact = f64::NEG_INFINITY;
    let mut lowest = f64::INFINITY;
    let mut landing = false;
    for k in 0..(duration_s / TICK.secs()) as u64 {
        let t = k as f64 * TICK.secs();
        let observed = world.observation();
        let clearance = observed.feet.iter().map(|f| f[2]).fold(f64::INFINITY, f64::min);
        if !observed.contacts.is_empty() {
            last_contact = t;
            report.contacts += 1;
        }
        if observed.in_water {
            report.water = 1;
            break;
        }
        if !observed.motors_on {
            report.false_stops += u32::from(t > last_contact + 0.5);
            break;
        }
        let descending = matches!(world.mission_state().state, State::Descent | State::Flare);
        lowest = lowest.min(clearance.max(0.0));
        if !landing && t >= command_at {
            landing = true;
            lowest = f64::INFINITY;
            world.command(CommandKind::Land);
        } else if landing && descending && clearance < call_off_below {
            landing = false;
            report.aborts += 1;
            report.lowest_m = report.lowest_m.min(clearance);
            world.command(if draw.chance(0.5) {
                CommandKind::Hold
            } else {
                CommandKind::Abort
            });
            command_at = t + 2.0 + 20.0 * draw.uniform();
            call_off_below = 0.3 + 5.0 * draw.uniform();
        }
        world.tick(&mut NoTap);
        report.hours += TICK.secs() / 3600.0;
    }
    Ok(report)
}
