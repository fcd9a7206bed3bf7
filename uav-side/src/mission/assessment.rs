//! Situation of a step from the newest inputs, and odds of a landing.

use alight_shared::{
    frames::{DroneNed, Vector},
    landing::{Slopes, Staying, SupportPolygon, WindPush},
    msg::{
        CameraLight, DeckGrant, LandedState, Motors, OwnMission, PLACES, Phase, Reason, ReasonCode, Solve,
        State, WaitingPlace,
    },
    time::{DroneClock, Time},
    topics,
};
use nalgebra::Vector2;

use super::{
    MissionNode,
    outlook::Outlook,
    reservation::{Reservation, stated_course},
    situation::{
        Charges, ControlState, Deck, OwnState, Situation, SortieEvidence, TakeOffEvidence, rotors_carry,
        several, tips_rad,
    },
    take_off,
};
use crate::{contingency::outside_m, planner::rendezvous::push::LateralDisturbance};

impl MissionNode {
    /// On each new forecast, updates the odds of a landing and the probability above which waiting does not pay.
    pub(super) fn judge(&mut self, now: Time<DroneClock>, s: &mut Situation) {
        let forecast_at = self.forecast.get().map(|f| f.header.at);
        match self.judged {
            Some((at, staying, odds)) if Some(at) == forecast_at => {
                s.staying = staying;
                s.odds = odds.filter(|_| s.fresh_deck().is_some());
            }
            Some(_) | None => self.update_odds(now, s),
        }
        self.judged = forecast_at.map(|at| (at, s.staying, s.odds));
        let follows = self.phase.state().phase() == Phase::Follow;
        let identified = s.fresh_deck().is_some_and(|d| d.identified);
        if let Some(odds) = s.odds.filter(|_| follows && identified) {
            self.waiting.update(now, odds.whole());
        }
        s.worth_waiting = self.waiting.threshold(self.config.waiting_cost_per_s());
    }

    fn update_odds(&self, now: Time<DroneClock>, s: &mut Situation) {
        let (plate, drone) = (&self.deck_geometry, &self.drone_geometry);
        let support = SupportPolygon::on(plate, drone, self.config.friction);
        s.staying = Staying::of(&Slopes::of(self.forecast.get(), &self.wind()), &support);
        let (Some(forecast), Some(deck)) = (self.forecast.get(), s.fresh_deck()) else {
            return;
        };
        let Some(state) = self.drone.get() else { return };
        let deck_z = forecast.stages.first().map_or(0.0, |stage| stage.position[2]);
        let change = LateralDisturbance::change(state, deck_z - drone.feet_below_m, s.water_z);
        // The contact is in the weaker wind at the deck.
        let measured = self.wind();
        let mean = measured.mean + change;
        let weaker = (mean.norm() / measured.mean.norm().max(1e-6)).min(1.0);
        let wind = WindPush {
            mean,
            gust_sd: measured.gust_sd * weaker.sqrt(),
        };
        let outlook = Outlook {
            forecast,
            deck,
            wind,
            blown: state.disturbance() + change,
            staying: &s.staying,
            drone,
            plate,
            chooses: deck.clearance_m > self.config.flare_clearance_m,
            planned_s: self.planned_contact_s(now),
            response: self.set_point.get().map(|s| s.response).unwrap_or_default(),
        };
        s.odds = outlook.odds(now);
    }

    /// Updates the progress towards the deck; returns the time since the last step, s.
    pub(super) fn watch_way(&mut self, now: Time<DroneClock>, s: &Situation) -> f64 {
        let dt = self.stepped.map_or(0.0, |at| (now - at).secs()).clamp(0.0, 1.0);
        self.stepped = Some(now);
        let approaches = self.phase.state() == State::Approach;
        if let Some(d) = s.fresh_deck() {
            let assumed_mps = self.config.battery_air_speed_mps - d.leaving_mps;
            let closing_mps = approaches.then_some(d.closing_mps);
            self.battery.approach(dt, d.distance_m, closing_mps, assumed_mps);
        }
        dt
    }

    pub(super) fn wind(&self) -> WindPush {
        self.drone.get().map(WindPush::of).unwrap_or_default()
    }

    /// Ids and station heights (m) of the other drones in the waiting places.
    fn others(&self) -> [(u32, u8); PLACES] {
        let grant = self.grant.get();
        core::array::from_fn(|k| {
            let of = |g: &DeckGrant<DroneClock>| Some((*g.places.get(k)?, *g.stations.get(k)?));
            let other = grant.and_then(of).filter(|(drone, _)| *drone != self.drone_id);
            other.unwrap_or_default()
        })
    }

    pub(super) fn situation(&mut self, now: Time<DroneClock>) -> Situation {
        let heights = self.heights(now);
        let c = &self.config;
        let drone = self.drone.get();
        let own = drone.map(OwnState::of);
        let deck = match (self.forecast.get(), own, drone) {
            (Some(f), Some(own), Some(d)) => Deck::of(f, &own, &self.drone_geometry, &d.attitude(), c, now),
            _ => None,
        };
        let autopilot = self.autopilot.fresh(now, topics::AUTOPILOT.stale_after);
        let others = self.others();
        let outside = |feet: fn(&Deck) -> Vector2<f64>| {
            let at = deck.as_ref().map(feet);
            at.map_or(f64::INFINITY, |at| {
                outside_m(&at, &self.deck_geometry, &self.drone_geometry)
            })
        };
        Situation {
            now,
            flight: ControlState::of(autopilot, c.mode),
            rejection: autopilot
                .map(|a| a.rejection)
                .filter(|why| why.code != ReasonCode::None),
            moved: self
                .moved
                .map(|(_, by_m)| Reason::new(ReasonCode::OriginMoved, by_m, 0.0)),
            several: (self.forecast.fresh(now, topics::FORECAST.stale_after)).and_then(several),
            battery: autopilot.and_then(|_| self.battery.charge(c)),
            battery_reserve: self.battery_reserve(deck.as_ref()),
            charges: self.charges(heights.water_z.unwrap_or(0.0), deck.as_ref()),
            own,
            odometry_age_s: self.drone.age_s(now),
            odometry_limit_s: topics::DRONE_STATE.stale_after.secs(),
            deck,
            mean_deck_z: heights.deck_z,
            lowest_z: heights.lowest_z,
            doubt: heights.doubt,
            tilt_excess_rad: drone.map_or(0.0, |d| self.tilt.excess(d)),
            swing_rad: self.swing.rms(),
            staying: Staying::default(),
            odds: None,
            forced_descent: self.forced_descent.map(|(after, at)| at.unwrap_or(now + after)),
            worth_waiting: 0.0,
            water_z: heights.water_z.unwrap_or(0.0),
            forecast_age_s: self.forecast.age_s(now),
            forecast_limit_s: topics::FORECAST.stale_after.secs(),
            plan_age_s: self.plan_age_s(now),
            plan_limit_s: topics::PLAN.stale_after.secs(),
            outside_m: outside(|d| d.feet),
            rests_outside_m: outside(|d| d.feet + d.slide),
            reservation: Reservation::of(self.grant.get(), self.drone_id, now, c),
            other_deck: (self.grant.get().and_then(|g| g.dimensions))
                .and_then(|vessel| self.deck_geometry.dimensions().differs_from(&vessel)),
            course: stated_course(self.grant.get(), now),
            dark: self
                .light
                .fresh(now, topics::CAMERA_LIGHT.stale_after)
                .and_then(CameraLight::hides_tags),
            place: self.place(),
            others: others.map(|(drone, _)| drone),
            other_stations_m: others.map(|(_, height_m)| height_m),
            motors_stopped: self
                .set_point
                .fresh(now, topics::SET_POINT.stale_after)
                .is_some_and(|s| s.motors == Motors::Stop),
            rotors_carry: autopilot.and_then(|a| rotors_carry(a, &self.drone_geometry)),
            hard_contact_mps: self.set_point.get().and_then(|s| s.hard_contact_mps),
            deck_wanted: (self.grant.fresh(now, topics::DECK.stale_after)).is_some_and(|g| g.wanted),
            not_cleared: take_off::not_cleared(self.grant.get(), self.drone_id, now),
            on_ground: autopilot.is_some_and(|a| a.landed == LandedState::OnGround),
            battery_for_take_off: self.battery.for_take_off(c),
            sortie: SortieEvidence {
                own_mission: autopilot.map_or(OwnMission::None, |a| a.own_mission),
                ..SortieEvidence::default()
            },
            leaving: TakeOffEvidence {
                tips_rad: (self.forecast.get().zip(drone)).map_or(0.0, |(f, d)| tips_rad(f, d, now)),
                ..TakeOffEvidence::default()
            },
        }
    }

    fn battery_reserve(&self, deck: Option<&Deck>) -> f64 {
        let c = &self.config;
        deck.map_or(c.battery_reserve, |d| {
            let assumed_mps = c.battery_air_speed_mps - d.leaving_mps;
            self.battery.reserve(d.distance_m, assumed_mps, c)
        })
    }

    /// Charge needed from here for each landing place, over water at `water_z` (NED, m).
    fn charges(&self, water_z: f64, deck: Option<&Deck>) -> Charges {
        let (c, drone) = (&self.config, self.drone.get());
        let home = (drone.zip(self.autopilot.get().and_then(|a| a.home))).map(|(d, home)| {
            let there: Vector<DroneNed> = d.datum.to(&home);
            (there.0 + d.datum_offset() - d.position()).xy()
        });
        let deck = deck.map(|d| d.distance_m * Vector2::new(d.bearing_rad.cos(), d.bearing_rad.sin()));
        let wind = (drone.and_then(|d| d.wind)).map_or(Vector2::zeros(), Vector2::from);
        let up_m = drone.map_or(0.0, |d| water_z - d.position().z);
        let power = self.battery.known_power(c);
        let known = power.is_some();
        let power = power.unwrap_or_else(|| self.battery.usual_power(c));
        let charges = Charges::of(power, home, deck, wind, up_m, c);
        Charges {
            home_is_sea: charges.home_is_sea || self.progress.sortie || self.heights.stood_on_deck(),
            known,
            ..charges
        }
    }

    /// Age of the newest feasible plan, or the time since the pilot last admitted one, s.
    fn plan_age_s(&self, now: Time<DroneClock>) -> f64 {
        let Some(plan) = self.plan.get().filter(|p| p.solve != Solve::Infeasible) else {
            return f64::INFINITY;
        };
        let age_s = (now - plan.header.at).secs();
        match self.set_point.get() {
            Some(flown) if flown.plan_refusal.is_some() => {
                let refused_s = self.admitted_at.map_or(f64::INFINITY, |at| (now - at).secs());
                refused_s.max(age_s)
            }
            Some(_) | None => age_s,
        }
    }

    /// Time to the contact that a fresh plan of this landing intends, s.
    fn planned_contact_s(&self, now: Time<DroneClock>) -> Option<f64> {
        let plan = self.plan.fresh(now, topics::PLAN.stale_after)?;
        let lands = self.phase.state().phase() == Phase::Landing && plan.solve != Solve::Infeasible;
        let touchdown_at = plan.touchdown_at.filter(|_| lands)?;
        Some((touchdown_at - now).secs().max(0.0))
    }

    /// Waiting place in the newest grant; None without reservations.
    fn place(&self) -> Option<WaitingPlace> {
        let grant = self.grant.get().filter(|_| self.config.reservation_required);
        grant.and_then(|g| g.place(self.drone_id))
    }
}
