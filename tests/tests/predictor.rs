//! The predictor behind sea, vessel, estimator, radio and bridge, against the truth: a drone that
//! flies above the deck by truth and looks at it.

#![allow(clippy::unwrap_used)] // Helpers of a test may.

use alight_bridge::{Bridge, BridgeConfig, BridgeIn, Packet, PacketKind};
use alight_shared::frames::{Deck, wrap_angle};
use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::msg::{DeckForecast, Header, Motors, SetPoint, SetPointKind};
use alight_shared::node::Node;
use alight_shared::time::{Span, Stamped, Time, TrueTime};
use alight_shared::wire;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::physics::body::RigidState;
use alight_sim::physics::deck_motion::DeckCarrier;
use alight_sim::physics::drone::{DroneStart, SimulatedDrone};
use alight_sim::physics::sea::Sea;
use alight_sim::physics::streams::Streams;
use alight_sim::radio::{Direction, Radio, on_air};
use alight_sim::sensors::Sensors;
use alight_uav::odometry::{Odometry, OdometryConfig};
use alight_uav::predictor::{Predictor, PredictorConfig, PredictorIn};
use alight_usv::{VesselIn, VesselNode};
use nalgebra::Vector3;

/// A forecast beside the truth at its time.
struct Sample {
    t: usize,
    forecast: DeckForecast,
}

struct PredictorFlight {
    /// Error of the drone's odometry at each tick: the forecast is where the drone will believe the deck.
    frames: Vec<Vector3<f64>>,
    /// Deck, per tick.
    truth: Vec<RigidState<Deck>>,
    samples: Vec<Sample>,
    /// Ticks at which the drone appeared.
    appeared: usize,
}

/// When the radio falls silent, ticks after the drone's appearance.
#[derive(Clone, Copy)]
struct FlightPlan {
    seconds: f64,
    cut_s: f64,
    /// Height of the drone above the mean deck, by time since its appearance.
    height: fn(f64) -> f64,
}

fn fly(scenario: &Scenario, plan: &FlightPlan, config: &PredictorConfig, seed: u64) -> PredictorFlight {
    let nodes = NodeConfigs::default();
    let streams = Streams::new(seed);
    let sea = Sea::new(&scenario.sea, &streams);
    let (deck_geometry, airframe) = (DeckGeometry::default(), DroneGeometry::default());
    let mut carrier = DeckCarrier::new(&scenario.vessel, None, &deck_geometry, &sea, &streams).unwrap();
    let mut sensors = Sensors::new(&scenario.sensors, &airframe, &deck_geometry, &streams);
    let mut vessel_node = VesselNode::new(&nodes.vessel, 1, 1);
    let mut to_drone: Radio<Packet> = Radio::new(&scenario.radio, Direction::ToDrone, &streams);
    let mut to_vessel = Radio::new(&scenario.radio, Direction::ToVessel, &streams);
    let mut bridge = Bridge::new(&BridgeConfig::default(), 1);
    let mut predictor = Predictor::new(config, 1);
    let mut steady = Odometry::new(&OdometryConfig::default());
    let mut drone: Option<SimulatedDrone> = None;
    let appeared = 6000;
    let (mut truth, mut samples, mut frames) = (Vec::new(), Vec::new(), Vec::new());
    let mut smooth = Vector3::zeros();
    let mut t: Time<TrueTime> = Time::EPOCH;
    for tick in 0..appeared + (plan.seconds * 100.0) as usize {
        let vessel_now = sensors.clocks.vessel_time(t);
        let now = sensors.clocks.drone_time(t);
        let readings = sensors.vessel(t, &carrier.state());
        let time_requests = to_vessel
            .receive(t)
            .into_iter()
            .map(|(at, q)| Stamped::new(sensors.clocks.vessel_time(at), q))
            .collect();
        let output = vessel_node.step(
            vessel_now,
            &VesselIn {
                imu: readings.imu,
                gnss: readings.gnss,
                heading: readings.heading,
                attitude: Vec::new(),
                time_requests,
            },
        );
        let mut send = |kind, bytes: Option<Vec<u8>>| {
            if let Some(bytes) = bytes {
                to_drone.send(t, on_air(bytes.len()), Packet { kind, bytes });
            }
        };
        send(
            PacketKind::Estimate,
            output.estimate.map(|m| wire::encode(&m).unwrap()),
        );
        send(PacketKind::Wave, output.wave.map(|m| wire::encode(&m).unwrap()));
        for r in &output.time_replies {
            send(PacketKind::TimeReply, Some(wire::encode(r).unwrap()));
        }
        let packets = to_drone
            .receive(t)
            .into_iter()
            .map(|(at, p)| Stamped::new(sensors.clocks.drone_time(at), p))
            .collect();
        let received = bridge.step(now, &BridgeIn { packets });
        if let Some(q) = received.time_request {
            to_vessel.send(t, on_air(64), q);
        }
        let deck: RigidState<Deck> = carrier.state().at(deck_geometry.centre());
        truth.push(deck);
        frames.push(Vector3::zeros());
        smooth += (deck.position.0 - smooth) * if tick == 0 { 1.0 } else { 0.003 };
        if tick == appeared {
            drone = Some(SimulatedDrone::new(
                &scenario.drone,
                &airframe,
                &deck_geometry,
                &streams,
                DroneStart {
                    position: Vector3::new(smooth.x, smooth.y, -9.0),
                    yaw: deck.euler().z,
                },
            ));
        }
        let since = (tick as f64 - appeared as f64) * 0.01;
        if since >= plan.cut_s && since < plan.cut_s + 0.01 {
            let for_good = [t, Time::from_secs(1e6)];
            to_drone.set_outage(for_good);
            to_vessel.set_outage(for_good);
        }
        let before = deck;
        let mut d = drone.take();
        if let Some(drone) = &mut d {
            let header = Header::new(1, 1, 1, tick as u32, now);
            let odometry = steady.step(&drone.odometry(header));
            if let Some(frame) = frames.last_mut() {
                *frame = odometry.position() - drone.truth().position.0;
            }
            let readings = sensors.drone(t, &drone.truth(), &deck, |n, e| sea.surface(t, n, e).surface_z());
            let input = PredictorIn {
                estimate: received.estimate,
                wave: received.wave,
                prediction: received.prediction,
                link: received.link,
                drone: Some(odometry),
                tags: readings.tags,
                uvdar: readings.uvdar,
                ranges: readings.ranges,
            };
            if let Some(forecast) = predictor.step(now, &input).forecast {
                samples.push(Sample { t: tick, forecast });
            }
            let target = Vector3::new(smooth.x, smooth.y, -1.3 - (plan.height)(since)) + drone.frame_offset();
            drone.apply(&SetPoint {
                header,
                kind: SetPointKind::Trajectory,
                motors: Motors::Run,
                position: target.into(),
                yaw: carrier.state().euler().z,
                ..Default::default()
            });
        }
        carrier.step(t, 0.01, &sea);
        if let Some(d) = &mut d {
            let after: RigidState<Deck> = carrier.state().at(deck_geometry.centre());
            d.step(t.secs(), 0.01, &before, &after, 10.0);
        }
        drone = d;
        t += Span::from_millis(10);
    }
    PredictorFlight {
        truth,
        frames,
        samples,
        appeared,
    }
}

/// Root mean squares (m, rad) and mean normalised squared errors of a horizon.
#[derive(Clone, Copy, Debug, Default)]
struct HorizonErrors {
    horizontal: f64,
    vertical: f64,
    tilt: f64,
    yaw: f64,
    nees: [f64; 3],
    n: f64,
}

impl HorizonErrors {
    fn add(&mut self, f: &PredictorFlight, from_s: f64, to_s: f64, ahead: f64) {
        for s in &f.samples {
            let since = (s.t - f.appeared) as f64 * 0.01;
            let then = s.t + (ahead * 100.0).round() as usize;
            let (Some(deck), Some(frame)) = (f.truth.get(then), f.frames.get(then)) else {
                continue;
            };
            if since < from_s || since >= to_s {
                continue;
            }
            let at = s.forecast.header.at + Span::from_secs(ahead);
            let stage = s.forecast.at(at).unwrap();
            let p = Vector3::from(stage.position) - frame - deck.position.0;
            let e = Vector3::from(stage.euler) - deck.euler();
            let yaw = wrap_angle(e.z);
            self.n += 1.0;
            self.horizontal += p.x * p.x + p.y * p.y;
            self.vertical += p.z * p.z;
            self.tilt += e.x * e.x + e.y * e.y;
            self.yaw += yaw * yaw;
            let ratio = |e: f64, sd: f64| (e / sd).powi(2);
            self.nees[0] += 0.5 * (ratio(p.x, stage.position_sd[0]) + ratio(p.y, stage.position_sd[1]));
            self.nees[1] += ratio(p.z, stage.position_sd[2]);
            self.nees[2] += 0.5 * (ratio(e.x, stage.euler_sd[0]) + ratio(e.y, stage.euler_sd[1]));
        }
    }
    fn of(flights: &[PredictorFlight], from_s: f64, to_s: f64, ahead: f64) -> HorizonErrors {
        let mut a = HorizonErrors::default();
        for f in flights {
            a.add(f, from_s, to_s, ahead);
        }
        let mean = |x: f64| x / a.n;
        let f = HorizonErrors {
            horizontal: mean(a.horizontal).sqrt(),
            vertical: mean(a.vertical).sqrt(),
            tilt: mean(a.tilt).sqrt(),
            yaw: mean(a.yaw).sqrt(),
            nees: a.nees.map(mean),
            n: a.n,
        };
        println!(
            "{from_s:4.0}..{to_s:3.0} s, {ahead:.1} s ahead: {:.3} m across, {:.3} m down, {:.2} deg tilt, \
             {:.2} deg yaw, NEES {:.2} {:.2} {:.2}",
            f.horizontal,
            f.vertical,
            f.tilt.to_degrees(),
            f.yaw.to_degrees(),
            f.nees[0],
            f.nees[1],
            f.nees[2]
        );
        f
    }
}

/// Approach at 7 m, then down to 1.5 m.
fn landing(since: f64) -> f64 {
    if since < 20.0 {
        7.0
    } else {
        (7.0 - (since - 20.0)).max(1.5)
    }
}

/// Flights of three seeds at Moderate, the radio cut after `cut_s`.
fn flights(cut_s: f64) -> Vec<PredictorFlight> {
    let plan = FlightPlan {
        seconds: 40.0,
        cut_s,
        height: landing,
    };
    (100..103)
        .map(|seed| fly(&Scenario::default(), &plan, &PredictorConfig::default(), seed))
        .collect()
}

#[test]
fn predictor_knows_the_deck_at_moderate_as_well_as_a_landing_needs() {
    let flights = flights(1e9);
    let high = HorizonErrors::of(&flights, 10.0, 20.0, 0.2);
    let near = HorizonErrors::of(&flights, 26.0, 38.0, 0.2);
    let far = HorizonErrors::of(&flights, 26.0, 38.0, 1.0);
    assert!(near.horizontal < 0.10 && near.vertical < 0.05 && near.tilt.to_degrees() < 0.7);
    assert!(far.horizontal < 0.12 && far.vertical < 0.06 && far.tilt.to_degrees() < 1.0);
    assert!(far.yaw.to_degrees() < 2.5);
    for f in [high, near, far] {
        assert!(f.n > 1000.0 && f.nees.iter().all(|n| *n < 2.0), "{f:?}");
    }
}

#[test]
fn predictor_from_vision_alone_is_accurate_enough_to_land() {
    let flights = flights(5.0);
    let near = HorizonErrors::of(&flights, 26.0, 38.0, 0.2);
    let far = HorizonErrors::of(&flights, 26.0, 38.0, 1.0);
    assert!(near.horizontal < 0.13 && near.vertical < 0.08 && near.tilt.to_degrees() < 2.0);
    assert!(far.horizontal < 0.20 && far.vertical < 0.13 && far.tilt.to_degrees() < 2.2);
    for f in [near, far] {
        assert!(f.n > 1000.0 && f.nees.iter().all(|n| *n < 2.0), "{f:?}");
    }
}
