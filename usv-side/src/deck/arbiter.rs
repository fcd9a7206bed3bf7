//! Deck arbiter: permits one drone at a time to descend.
//!
//! Every drone reports its mission state ([`DroneStatus`], 2 Hz), and the arbiter publishes the deck owner ([`DeckGrant`],
//! 2 Hz and at each change). A drone requests the deck by approaching it. It owns the deck until there is evidence that it
//! has left: for several seconds it reports itself armed, in the air and at a distance, or the crew reports that it has
//! left ([`claim`]). A single status is not enough, and silence is not evidence: a drone that owns the deck may have landed
//! and been switched off, and its radio may fail in one direction, so that it lands unnoticed. Therefore silence never
//! transfers the deck to another drone without the crew. Of the drones that request the deck, one with a low battery
//! comes first, and an owner with more charge that has not begun its descent gives way to it. While such a drone waits for
//! a silent owner or for one that stands on the deck, the arbiter raises an alarm ([`Starved`]).
//!
//! A drone switched on without a position may stand on the deck. Until it reports its position, no other
//! drone receives the deck, but the present owner keeps it.
//!
//! Every flying drone gets a waiting place off the deck. Only the owner may be within [`OWNER_ONLY_M`] of the deck:
//! another drone receives the deck only when the previous owner is beyond that distance. A silent drone keeps its
//! waiting place and the height of its station. If two stations have the same height, the grant omits the later one,
//! and its drone gives way.
//!
//! The crew closes and opens the deck ([`DeckOrder`]). An order to open it states that nothing lies on the deck. This
//! is evidence about a drone that stood on the deck, but not about a drone that was in the air when it fell silent: the
//! latter keeps the deck for as long as a landing takes, or until an order names it. A [`DeckCheckpoint`] outlives the
//! process. Configured digital inputs also close the deck ([`DeckInputs`]): the crew's switch, and a sensor for objects
//! on the deck other than drones. They never end an ownership, and an input that cannot be read closes the deck.
//!
//! A drone on the deck takes off only when cleared by the crew: for one take-off within a limited time
//! ([`DeckOrder::TakeOff`]), or for each of its take-offs ([`DeckOrder::TakeOffStanding`], [`clearance`]),
//! but in both cases only until someone approaches the deck. A clearance ends with this process.
//!
//! The grant also contains the helm's intended course ([`Course`]); requests for a steady one are reported.

use core::mem::discriminant;

use alight_shared::{
    admission::check_message,
    msg::{
        Closure, Course, DECK_CLOSED, DeckDimensions, DeckGrant, DeckOrder, DroneStatus, Header, LandedState,
        PLACES, STATION_APART_M, SilentDrone, Starved, State,
    },
    node::Node,
    time::{Span, Time, VesselClock, VesselTime},
    topics,
};
use serde::{Deserialize, Serialize};

mod claim;
pub(crate) mod clearance;
mod drone;

use super::{
    MAX_DRONES,
    checkpoint::{Claim, DeckCheckpoint, DroneClaim},
    config::DeckConfig,
    inputs::{DeckInputs, Reading},
    stated_course::StatedCourse,
};
use claim::ClaimEvidence;
use clearance::{Clearance, Clearances, StandingCharge};
use drone::Drone;

/// Interval between grants without a change.
const PERIOD: Span = Span::from_millis(500);
/// Time after which a drone counts as silent: four periods.
const FRESH: Span = Span::from_millis(2000);
/// Time for which one of two drones with the same number must be silent to end the conflict.
const RIVAL_TIMEOUT: Span = Span::from_millis(10_000);
/// Battery of a waiting drone that counts as low, 0 to 1: 1.5 times the mission's reserve, so that the crew
/// can look at the deck.
const LOW_BATTERY: f64 = 0.3;

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ArbiterIn {
    /// Drone statuses in order of arrival.
    pub statuses: Vec<DroneStatus>,
    pub orders: Vec<DeckOrder>,
    pub inputs: DeckInputs,
    pub dimensions: Option<DeckDimensions>,
    /// Checkpoint of the previous start, at the first step.
    pub checkpoint: Option<DeckCheckpoint>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ArbiterOut {
    pub grant: Option<DeckGrant<VesselClock>>,
}

/// Node that decides which drone owns the deck.
#[derive(Clone, Debug, Default)]
pub struct DeckArbiter {
    config: DeckConfig,
    vessel: u32,
    boot: u32,
    sequence: u32,
    drones: Vec<Drone>,
    owner: Option<u32>,
    /// Owner and course in the newest grant.
    published: u32,
    stated: Course,
    cleared: Clearances,
    /// Clearance in the newest grant.
    take_off: bool,
    stations: [u8; PLACES],
    /// Closure by an order or by a checkpoint, until the crew opens the deck.
    closed: Option<Closure>,
    switch: Option<Reading>,
    sensor: Option<Reading>,
    course: StatedCourse,
    began: Option<VesselTime>,
    /// Time at which the previous owner last gave way.
    vacated: Option<VesselTime>,
    due: VesselTime,
    rejected: u64,
}

impl DeckArbiter {
    pub fn new(config: &DeckConfig, vessel: u32, boot: u32) -> DeckArbiter {
        DeckArbiter {
            config: config.clone(),
            vessel,
            boot,
            due: Time::from_nanos(i64::MIN),
            ..DeckArbiter::default()
        }
    }
    pub fn owner(&self) -> Option<u32> {
        self.owner
    }
    /// Drone that was descending in its newest status, if that is no older than a descent lasts.
    pub fn landing(&self, now: VesselTime) -> Option<u32> {
        let landing = |d: &&Drone| {
            d.claim == Claim::Landing && (now - d.received).secs() <= self.config.status_timeout_s
        };
        self.drones.iter().find(landing).map(|d| d.header.drone)
    }
    /// Reason why the deck is closed; orders take precedence over inputs.
    pub fn closed(&self, now: VesselTime) -> Option<Closure> {
        let switch = Reading::active(self.switch, !self.config.crew_switch.is_empty(), now);
        let foreign = || self.sensed(now) && !self.drones.iter().any(|d| d.may_stand(now));
        self.closed
            .or_else(|| switch.then_some(Closure::Switch))
            .or_else(|| foreign().then_some(Closure::Sensor))
    }
    /// Whether the sensor fails to confirm that the deck is clear.
    fn sensed(&self, now: VesselTime) -> bool {
        Reading::active(self.sensor, !self.config.occupancy_sensor.is_empty(), now)
    }
    pub fn course(&self, now: VesselTime) -> Course {
        self.course.at(now, &self.config)
    }
    /// Whether a drone descends or waits for a steady course, or is silent and may still be descending.
    pub fn wants_steady(&self, now: VesselTime) -> bool {
        let lasts = |d: &Drone| (now - d.received).secs() <= self.config.status_timeout_s;
        self.drones.iter().any(|d| d.wants_steady && lasts(d))
    }
    pub fn owner_age_s(&self, now: VesselTime) -> Option<f64> {
        let owner = self.drones.iter().find(|d| self.owner == Some(d.header.drone))?;
        Some((now - owner.received).secs())
    }
    /// Numbers used by two drones, with the boot ids of both. Neither receives the deck.
    pub fn doubles(&self) -> impl Iterator<Item = (u32, [u32; 2])> {
        let double = |d: &Drone| {
            let rival = d.rival.filter(|_| d.is_double())?;
            Some((d.header.drone, [d.header.boot, rival.header.boot]))
        };
        self.drones.iter().filter_map(double)
    }
    /// Number of rejected statuses: of another vessel or version, out of order, or of a surplus or duplicate drone.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
    /// Drones switched on without a position.
    pub fn unplaced(&self) -> impl Iterator<Item = u32> {
        let unplaced = |d: &&Drone| d.unplaced;
        self.drones.iter().filter(unplaced).map(|d| d.header.drone)
    }
    /// Alarm: a drone with a low battery waits for an owner that is silent or stands on the deck.
    pub fn starved(&self, now: VesselTime) -> Option<Starved> {
        let owner = self.drones.iter().find(|d| self.owner == Some(d.header.drone))?;
        let silent_s = (now - owner.received).secs();
        // After this time, any manoeuvre that the owner had begun has ended.
        let stands = owner.claim == Claim::OnDeck && owner.is_fresh(now);
        if silent_s <= self.config.status_timeout_s && !stands {
            return None;
        }
        let waits = |d: &&Drone| {
            d.claim == Claim::Requesting && d.is_fresh(now) && d.header.drone != owner.header.drone
        };
        let low = |d: &Drone| {
            d.battery
                .filter(|b| *b < LOW_BATTERY)
                .map(|b| (d.header.drone, b))
        };
        let waiting = self.drones.iter().filter(waits).filter_map(low);
        let (waiting, battery) = waiting.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        Some(Starved {
            owner: owner.header.drone,
            silent_s,
            waiting,
            battery,
        })
    }
    /// Silent drones that may be descending. They keep the deck if an order to open it does not name them.
    pub fn silent_drones(&self, now: VesselTime) -> impl Iterator<Item = SilentDrone> {
        let timeout_s = self.config.status_timeout_s;
        let may_descend = move |d: &&Drone| {
            let holds = d.claim >= Claim::Landing || d.inside || self.owner == Some(d.header.drone);
            holds && d.claim > Claim::Away && !d.is_fresh(now) && !d.ends_by_a_look(now, timeout_s)
        };
        self.drones.iter().filter(may_descend).map(move |d| {
            let silent_s = (now - d.received).secs();
            SilentDrone {
                drone: d.header.drone,
                silent_s,
                remaining_s: (timeout_s - silent_s).max(0.0),
            }
        })
    }
    pub fn checkpoint(&self) -> DeckCheckpoint {
        let kept =
            |d: &&Drone| d.claim >= Claim::Landing || self.owner == Some(d.header.drone) || d.place.is_some();
        let claims = self.drones.iter().filter(kept).map(|d| DroneClaim {
            drone: d.header.drone,
            boot: d.header.boot,
            claim: d.claim,
            place: d.place,
            inside: d.inside || d.unplaced,
        });
        DeckCheckpoint {
            owner: self.owner,
            closed: self.closed,
            claims: claims.collect(),
        }
    }

    fn restore(&mut self, now: VesselTime, checkpoint: &DeckCheckpoint) {
        self.owner = checkpoint.owner;
        self.closed = checkpoint.closed;
        let claims = checkpoint.claims.iter().take(MAX_DRONES);
        let drones = claims.map(|c| Drone::restored(c, self.vessel, checkpoint.owner, now));
        self.drones = drones.collect();
    }

    fn observe(&mut self, now: VesselTime, status: &DroneStatus) {
        let h = &status.header;
        let index = self.drones.iter().position(|d| d.header.drone == h.drone);
        let named = h.vessel == self.vessel && h.drone != 0 && h.drone != DECK_CLOSED;
        let valid = check_message(status).is_ok() && named;
        let full = index.is_none() && self.drones.len() >= MAX_DRONES;
        let mut known = index.and_then(|k| self.drones.get(k)).copied();
        let before = known;
        let admitted = valid && !full && known.as_mut().is_none_or(|d| d.admit(now, h));
        if let (Some(k), Some(known)) = (index.filter(|_| valid), known)
            && let Some(slot) = self.drones.get_mut(k)
        {
            slot.rival = known.rival;
        }
        if !admitted {
            self.rejected = self.rejected.saturating_add(1);
            return;
        }
        if let Some(d) = before {
            self.cleared.follow(h.drone, d.state, status.state);
        }
        let mut drone = self.updated(now, status, before);
        drone.rival = known.and_then(|d| d.rival);
        match index.and_then(|k| self.drones.get_mut(k)) {
            Some(slot) => *slot = drone,
            None => self.drones.push(drone),
        }
    }

    /// State of the drone after an admitted status, without the rival sender.
    fn updated(&mut self, now: VesselTime, status: &DroneStatus, before: Option<Drone>) -> Drone {
        let h = &status.header;
        let former = before.map_or(Claim::Away, |d| d.claim);
        let begins = before.is_none_or(|d| d.header.boot != h.boot);
        let shows = if former >= Claim::Landing {
            claim::shows_departure(status)
        } else {
            claim::shows_place(status)
        };
        let evidence = ClaimEvidence::with(before.filter(|_| !begins).and_then(|d| d.evidence), now, shows);
        let sustained = evidence.is_some_and(|e| e.is_sustained());
        let claim = Claim::of(status, former, sustained);
        let stood = before.filter(|d| d.claim == Claim::OnDeck && claim == Claim::OnDeck);
        let (standing, changed) = StandingCharge::with(stood.and_then(|d| d.standing), now, status.battery);
        self.watch_standing(status, begins && stood.is_some(), changed);
        let parked = status.deck_distance_m.is_none() && !claim::flies(status);
        let was_unplaced = before.is_some_and(|d| d.unplaced) && !sustained;
        let unplaced = claim == Claim::Away && (was_unplaced || begins && parked);
        let was_inside = before.is_some_and(|d| d.inside);
        let on_ground = claim == Claim::Away && status.landed == LandedState::OnGround;
        let inside = match status.deck_distance_m {
            _ if claim >= Claim::Landing => true,
            _ if on_ground => false,
            // A drone that has not received the new grant may still approach.
            Some(_) => !claim::is_far(status) || was_inside && self.may_be_unknown(now),
            None => was_inside,
        };
        let place = before
            .and_then(|d| d.place)
            .or_else(|| (0..PLACES).find(|number| self.drones.iter().all(|d| d.place != Some(*number))));
        let same = before.filter(|d| d.claim == claim || d.claim.max(claim) <= Claim::Requesting);
        let new_request = claim == Claim::Requesting && before.is_none_or(|d| d.claim == Claim::Away);
        let arrived = self.owner == Some(h.drone) && inside && !was_inside;
        Drone {
            header: *h,
            received: now,
            state: status.state,
            claim,
            since: same.filter(|_| !new_request && !arrived).map_or(now, |d| d.since),
            inside,
            place: place.filter(|_| !on_ground),
            rival: None,
            descends: status.state == State::Descent
                || Claim::reported(status) < Claim::Landing && claim::flies(status),
            unplaced,
            // Evidence that ended one claim does not count for the next.
            evidence: evidence.filter(|_| (claim >= Claim::Landing) == (former >= Claim::Landing)),
            at_deck: Claim::is_at_deck(status),
            flies: claim::flies(status),
            battery: status.battery,
            standing: standing.filter(|_| claim == Claim::OnDeck),
            wants_steady: Drone::asks_for_steady(status),
            station: status.station.map(|station| {
                let kept = before.and_then(|d| d.station);
                let same = kept.filter(|(kept, _)| kept.height_m == station.height_m);
                (station, same.map_or(now, |(_, since)| since))
            }),
        }
    }

    fn apply(&mut self, now: VesselTime, order: DeckOrder) {
        match order {
            DeckOrder::Steady(for_s) => self.course.order_steady(now, for_s),
            DeckOrder::Turning => self.course.order_turning(),
            DeckOrder::Closed => self.closed = Some(Closure::Crew),
            DeckOrder::TakeOff(drone) => self.cleared.give(Clearance::once(drone, now)),
            DeckOrder::TakeOffStanding(drone) => self.cleared.give(Clearance::standing(drone, now)),
            DeckOrder::Open => self.open(now, None),
            DeckOrder::Clear(drone) => self.open(now, Some(drone)),
        }
    }

    /// Applies the crew's report that nothing lies on the deck, and that `named` is neither on it nor above it.
    fn open(&mut self, now: VesselTime, named: Option<u32>) {
        self.closed = None;
        let timeout_s = self.config.status_timeout_s;
        let ends = |d: &Drone| d.ends_by_a_look(now, timeout_s) || named == Some(d.header.drone);
        // The crew would see a silent drone on the deck. A silent drone that waits in the air keeps its place.
        self.drones
            .retain(|d| d.is_fresh(now) || d.claim < Claim::Landing || !ends(d));
        for d in &mut self.drones {
            d.unplaced = false;
            if !d.is_fresh(now) {
                if ends(d) {
                    d.claim = Claim::Away;
                    d.inside = false;
                }
            } else if !d.at_deck && (d.claim >= Claim::Landing || named == Some(d.header.drone)) {
                // Both the drone and the crew report that it is not on the deck.
                d.claim = Claim::Away;
                d.inside = d.inside && d.flies;
            }
        }
    }

    /// Whether the previous owner may not know yet that it has lost the deck.
    fn may_be_unknown(&self, now: VesselTime) -> bool {
        self.vacated.is_some_and(|t| now - t <= topics::DECK.stale_after)
    }

    fn assign(&mut self, now: VesselTime) -> Option<u32> {
        let c = &self.config;
        for d in &mut self.drones {
            d.rival = d.rival.filter(|r| now - r.received < RIVAL_TIMEOUT);
        }
        let owner = self.owner;
        let owns = |d: &Drone| owner == Some(d.header.drone);
        self.drones.retain(|d| {
            let remembered = d.claim >= Claim::Landing || d.inside || d.unplaced;
            let holds = owns(d) || remembered || d.place.is_some();
            holds || (now - d.received).secs() <= c.status_timeout_s
        });
        let drones = || self.drones.iter();
        let open = self.closed(now).is_none();
        // Facts take precedence: a drone on the deck or in descent owns it. The present owner comes first.
        let fact = drones()
            .filter(|d| d.claim >= Claim::Landing)
            .max_by_key(|d| (d.claim, owns(d)));
        if let Some(d) = fact {
            return Some(d.header.drone);
        }
        let next = drones()
            .filter(|d| d.claim == Claim::Requesting && !owns(d) && !d.is_double() && d.is_fresh(now))
            .filter(|_| open)
            .min_by_key(|d| (d.need(), d.since));
        // A silent drone may be descending, and a drone that flies elsewhere climbs first.
        let idle = |d: &Drone| d.is_fresh(now) && (now - d.since).secs() > c.idle_timeout_s;
        let current = drones().find(|d| owns(d) && (d.claim > Claim::Away || d.inside));
        // Another drone may be at the deck, or may not know yet that it has lost the deck.
        let free = |next: &&Drone| {
            let may_be_there = |d: &Drone| d.inside || d.unplaced;
            !drones().any(|d| may_be_there(d) && d.header.drone != next.header.drone)
        };
        let ready =
            self.began.is_some_and(|t| (now - t).secs() >= c.startup_hold_s) && !self.may_be_unknown(now);
        // An owner that has not begun its descent gives way to a drone that has less charge. It must have been heard since
        // the other's request: a silent owner does not learn that it has lost the deck.
        let gives_way = |d: &Drone| {
            let needed = next.is_some_and(|n| n.needs_deck_before(d) && now - n.since > FRESH);
            needed && d.is_fresh(now)
        };
        let assigned = match current {
            Some(d) if next.is_some() && idle(d) || gives_way(d) => None,
            Some(d) => Some(d),
            None => next.filter(free).filter(|_| ready),
        };
        assigned.map(|d| d.header.drone)
    }

    /// Whether another drone requests the deck while its owner stands on it.
    fn is_wanted(&self, now: VesselTime) -> bool {
        let owns = |d: &Drone| self.owner == Some(d.header.drone);
        let stands = self.drones.iter().any(|d| owns(d) && d.claim == Claim::OnDeck);
        let asks = |d: &Drone| d.claim == Claim::Requesting && d.flies && d.is_fresh(now) && !owns(d);
        stands && self.drones.iter().any(asks)
    }

    /// Owner as published in the grant.
    fn published(&self, now: VesselTime) -> u32 {
        let double = |id: u32| self.drones.iter().any(|d| d.header.drone == id && d.is_double());
        match self.owner {
            _ if self.closed(now).is_some() => DECK_CLOSED,
            // Both drones would assume that they own the deck.
            Some(id) if double(id) => DECK_CLOSED,
            owner => owner.unwrap_or(0),
        }
    }
    /// Heights of the stations at the waiting places, m; 0: no station, or another station has the same
    /// height. A silent drone keeps its station for the ordered time.
    fn stations(&self, now: VesselTime) -> [u8; PLACES] {
        let keeps = |d: &Drone| {
            let (station, since) = d.station?;
            let lasts = (now - d.received).secs() <= 60.0 * f64::from(station.for_min);
            d.place
                .filter(|_| lasts)
                .map(|place| (since, place, station.height_m))
        };
        let mut kept: Vec<_> = self.drones.iter().filter_map(keeps).collect();
        kept.sort_unstable();
        let mut heights = [0; PLACES];
        for (_, place, height_m) in kept {
            let taken = |other: &u8| *other != 0 && f64::from(other.abs_diff(height_m)) < STATION_APART_M;
            if !heights.iter().any(taken)
                && let Some(slot) = heights.get_mut(place)
            {
                *slot = height_m;
            }
        }
        heights
    }
    fn occupied(&self, now: VesselTime) -> bool {
        let stands = |d: &Drone| {
            d.claim == Claim::OnDeck
                || d.claim == Claim::Landing && (now - d.received).secs() > self.config.status_timeout_s
        };
        self.drones.iter().any(stands) || self.sensed(now)
    }
}

impl Node for DeckArbiter {
    type Clock = VesselClock;
    type In = ArbiterIn;
    type Out = ArbiterOut;

    fn step(&mut self, now: VesselTime, input: &ArbiterIn) -> ArbiterOut {
        if let Some(checkpoint) = input.checkpoint.as_ref().filter(|_| self.began.is_none()) {
            self.restore(now, checkpoint);
        }
        self.began = self.began.or(Some(now));
        for status in &input.statuses {
            self.observe(now, status);
        }
        for order in &input.orders {
            self.apply(now, *order);
        }
        let reading = |level: Option<bool>| level.map(|level| Reading { level, at: now });
        self.switch = reading(input.inputs.closed).or(self.switch);
        self.watch_sensor(self.sensor, input.inputs.occupied);
        self.sensor = reading(input.inputs.occupied).or(self.sensor);
        self.course.switch = reading(input.inputs.turning).or(self.course.switch);
        let owner = self.assign(now);
        if owner != self.owner {
            // The new owner's idle time begins; the previous owner joins the end of the queue.
            for d in &mut self.drones {
                if Some(d.header.drone) == owner || Some(d.header.drone) == self.owner {
                    d.since = now;
                }
            }
            if owner.is_none() {
                self.vacated = Some(now);
                // A previous owner that missed this grant may approach until it reports from far away.
                let former = self.owner;
                let gives_way = |d: &&mut Drone| Some(d.header.drone) == former && d.claim > Claim::Away;
                for d in self.drones.iter_mut().filter(gives_way) {
                    d.inside = true;
                }
            }
            self.owner = owner;
        }
        let published = self.published(now);
        let course = self.course(now);
        let take_off = self.clears_take_off(now);
        let stations = self.stations(now);
        let same = (published, take_off, stations) == (self.published, self.take_off, self.stations)
            && discriminant(&course) == discriminant(&self.stated);
        if now < self.due && same {
            return ArbiterOut::default();
        }
        self.published = published;
        self.stated = course;
        self.take_off = take_off;
        self.stations = stations;
        self.due = now + PERIOD;
        self.sequence = self.sequence.wrapping_add(1);
        ArbiterOut {
            grant: Some(DeckGrant {
                header: Header::new(self.vessel, 0, self.boot, self.sequence, now),
                owner: published,
                course,
                take_off,
                wanted: self.is_wanted(now),
                dimensions: input.dimensions,
                occupied: self.occupied(now),
                stations,
                places: core::array::from_fn(|k| {
                    // Two drones with this number would both fly there.
                    let occupant = self.drones.iter().find(|d| d.place == Some(k));
                    occupant.filter(|d| !d.is_double()).map_or(0, |d| d.header.drone)
                }),
            }),
        }
    }
}

#[cfg(test)]
mod tests;
