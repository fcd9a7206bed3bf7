//! Recordings of real boats, converted back to NMEA 2000 and Signal K: the decoded measurements and the
//! estimates must equal those from the recordings' columns.

use std::path::Path;

use alight_shared::{
    frames::wrap_angle,
    msg::{AttitudeFix, GnssFix, Header, HeadingFix, NOT_MEASURED_SD, VesselEstimate},
    node::Node,
    time::{Span, Time, VesselClock},
};
use alight_usv::{
    VesselNode, VesselNodeConfig,
    sensors::{
        Measurement, Mount, Mounting, N2kDecoder, Readings, SensorDecoder, SignalKDecoder, SourceMeasurement,
    },
};

use super::{n2k, signalk};

const TICK: Span = Span::from_millis(10);
/// Maximum time between a velocity and its position, ns.
const PAIR_NS: i64 = 300_000_000;

/// Encoder for a network; arguments: time (ns), measurement, sequence number.
type Writer = fn(i64, &Measurement, u8) -> Vec<u8>;

fn is_place(g: &GnssFix) -> bool {
    g.position_sd[0] < NOT_MEASURED_SD
}

fn has_velocity(g: &GnssFix) -> bool {
    g.velocity_sd[0] < NOT_MEASURED_SD
}

fn n2k_bytes(at_ns: i64, m: &Measurement, number: u8) -> Vec<u8> {
    match m {
        Measurement::Attitude(a) => [
            a.rates.map(|r| n2k::rates(at_ns, r, number % 8)),
            a.heave.map(|down| n2k::heave(at_ns, -down)),
            Some(n2k::attitude(at_ns, a.tilt)),
        ]
        .into_iter()
        .flatten()
        .flatten()
        .collect(),
        Measurement::Heading(h) => n2k::heading(at_ns, h.heading),
        Measurement::Gnss(g) => {
            let velocity = has_velocity(g).then(|| n2k::velocity(at_ns, [g.velocity[0], g.velocity[1]]));
            let place = is_place(g).then(|| n2k::position(at_ns, g.datum));
            [velocity, place].into_iter().flatten().flatten().collect()
        }
        Measurement::Imu(_) => Vec::new(),
    }
}
fn signalk_bytes(at_ns: i64, m: &Measurement, _number: u8) -> Vec<u8> {
    match m {
        Measurement::Attitude(a) => {
            let heave = a.heave.map(|down| signalk::heave(at_ns, -down));
            [heave.unwrap_or_default(), signalk::attitude(at_ns, a.tilt)].concat()
        }
        Measurement::Heading(h) => signalk::heading(at_ns, h.heading),
        Measurement::Gnss(g) => {
            let velocity = has_velocity(g).then(|| signalk::velocity(at_ns, [g.velocity[0], g.velocity[1]]));
            let place = is_place(g).then(|| signalk::position(at_ns, g.datum));
            [velocity, place].into_iter().flatten().flatten().collect()
        }
        Measurement::Imu(_) => Vec::new(),
    }
}

/// Newest value, if it is fresh enough to belong to a measurement.
fn paired<T>(newest: Option<(i64, T)>, at_ns: i64) -> Option<T> {
    newest.filter(|(then, _)| at_ns - then <= PAIR_NS).map(|(_, x)| x)
}

/// Measurements as a network sends them: velocity, heave and rates have separate times, and precede the
/// position or attitude to which they belong.
fn as_sent(columns: &[Measurement], with_rates: bool) -> Vec<(i64, Measurement)> {
    let (mut velocity, mut heave, mut rates) = (None, None, None);
    let mut all = Vec::new();
    for m in columns {
        let at_ns = m.at().nanos();
        match m {
            Measurement::Gnss(g) => {
                if has_velocity(g) {
                    velocity = Some((at_ns, (g.velocity, g.velocity_sd)));
                }
                let (velocity, velocity_sd) =
                    paired(velocity, at_ns).unwrap_or(([0.0; 3], [NOT_MEASURED_SD; 3]));
                let fix = GnssFix {
                    velocity,
                    velocity_sd,
                    ..*g
                };
                all.extend(is_place(g).then_some((at_ns, fix.into())));
            }
            Measurement::Attitude(a) => {
                heave = a.heave.map(|h| (at_ns, h)).or(heave);
                rates = a.rates.filter(|_| with_rates).map(|r| (at_ns, r)).or(rates);
                let sent = AttitudeFix {
                    heave: paired(heave, at_ns),
                    rates: paired(rates, at_ns),
                    ..*a
                };
                all.push((at_ns, sent.into()));
            }
            Measurement::Heading(_) | Measurement::Imu(_) => all.push((at_ns, *m)),
        }
    }
    all
}

fn received(
    mut decoder: impl SensorDecoder,
    columns: &[Measurement],
    write: Writer,
) -> Vec<(i64, Measurement)> {
    let mut out: Vec<SourceMeasurement> = Vec::new();
    for (m, number) in columns.iter().zip((0..=u8::MAX).cycle()) {
        decoder.push(&write(m.at().nanos(), m, number), &mut out);
    }
    let counts = decoder.decoded();
    assert_eq!(
        (counts.corrupted, counts.undated, counts.left_out),
        (0, 0, 0),
        "{:?}",
        decoder.remarks()
    );
    out.into_iter().map(|m| (m.at_ns, m.measurement)).collect()
}

/// Equality to within half the resolution of the fields: 0.1 mrad, 1 cm, 1 cm/s, 1e-7 deg.
fn same(a: &Measurement, b: &Measurement) -> bool {
    let near = |a: f64, b: f64, step: f64| (a - b).abs() <= 0.51 * step;
    match (a, b) {
        (Measurement::Attitude(a), Measurement::Attitude(b)) => {
            let rates = match (a.rates, b.rates) {
                (Some(a), Some(b)) => (0..3).all(|k| near(a[k], b[k], 1e-3_f64.to_radians())),
                (a, b) => a == b,
            };
            let heave = match (a.heave, b.heave) {
                (Some(a), Some(b)) => near(a, b, 0.01),
                (a, b) => a == b,
            };
            (0..2).all(|k| near(a.tilt[k], b.tilt[k], 1e-4)) && rates && heave
        }
        (Measurement::Heading(a), Measurement::Heading(b)) => {
            near(wrap_angle(a.heading - b.heading), 0.0, 1e-4)
        }
        (Measurement::Gnss(a), Measurement::Gnss(b)) => {
            let speed = a.velocity[0].hypot(a.velocity[1]);
            near(a.datum.latitude_deg, b.datum.latitude_deg, 1e-7)
                && near(a.datum.longitude_deg, b.datum.longitude_deg, 1e-7)
                && has_velocity(a) == has_velocity(b)
                // Within the resolution of the speed along the velocity, and of the course across it.
                && (0..2).all(|k| near(a.velocity[k], b.velocity[k], 0.01 + 1e-4 * speed))
        }
        _ => false,
    }
}

/// Estimates from measurements that arrive without delay.
fn estimates(all: &[(i64, Measurement)]) -> Vec<VesselEstimate<VesselClock>> {
    let headed = |(k, (at_ns, m)): (u32, &(i64, Measurement))| {
        m.headed(0, Header::new(1, 0, 1, k, Time::from_nanos(*at_ns)))
    };
    let mut coming = (0..).zip(all).map(headed).peekable();
    let mut node = VesselNode::new(&VesselNodeConfig::default(), 1, 1);
    let mut now = coming.peek().map(Measurement::at).unwrap_or_default();
    let mut found = Vec::new();
    while coming.peek().is_some() {
        let mut readings = Readings::default();
        while let Some(m) = coming.next_if(|m| m.at() <= now) {
            readings.push(m);
        }
        found.extend(node.step(now, &readings.into()).estimate);
        now += TICK;
    }
    found
}

/// Root mean square differences of heave (m), roll, pitch and yaw (deg) and position (m).
fn apart(a: &[VesselEstimate<VesselClock>], b: &[VesselEstimate<VesselClock>]) -> [f64; 5] {
    assert_eq!(a.len(), b.len());
    let mut squares = [0.0_f64; 5];
    for (a, b) in a.iter().zip(b) {
        let angle = |k: usize| wrap_angle(a.eta[k] - b.eta[k]).to_degrees();
        let place = (a.eta[0] - b.eta[0]).hypot(a.eta[1] - b.eta[1]);
        let now = [a.eta[2] - b.eta[2], angle(3), angle(4), angle(5), place];
        squares = core::array::from_fn(|k| squares[k] + now[k].powi(2));
    }
    squares.map(|sum| (sum / a.len() as f64).sqrt())
}

#[test]
#[ignore = "needs ../shared/data/underway"]
fn recorded_boats_as_frames_and_deltas() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/underway");
    // One recording has no position and therefore yields no estimates.
    for (name, has_place) in [("figure-of-eight.csv", true), ("tight-circles.csv", false)] {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let columns = alight_usv::log::read(&bytes, name, &Mount::default())
            .unwrap()
            .measurements;
        let mounting = Mounting::new(&Mount::default());
        let networks = [
            (
                "NMEA 2000",
                true,
                received(N2kDecoder::new(&mounting), &columns, n2k_bytes),
            ),
            (
                "Signal K",
                false,
                received(SignalKDecoder::new(&mounting), &columns, signalk_bytes),
            ),
        ];
        for (network, with_rates, received) in networks {
            let sent = as_sent(&columns, with_rates);
            assert_eq!(sent.len(), received.len(), "{name} by {network}");
            for (sent, received) in sent.iter().zip(&received) {
                assert!(
                    sent.0 - received.0 < 1_000_000 && same(&sent.1, &received.1),
                    "{network}: {sent:?} {received:?}"
                );
            }
            let (by_columns, by_frames) = (estimates(&sent), estimates(&received));
            assert_eq!(!by_columns.is_empty(), has_place, "{name} by {network}");
            if !has_place {
                continue;
            }
            let found = apart(&by_columns, &by_frames);
            let limits = [0.01, 0.02, 0.02, 0.02, 0.02];
            assert!(
                found.iter().zip(limits).all(|(x, most)| *x < most),
                "{name} by {network}: {found:?}"
            );
        }
    }
}

/// The rate of turn is determined by the heading alone.
#[test]
fn rate_of_turn_on_both_networks() {
    let mounting = Mounting::new(&Mount::default());
    let networks: [(Box<dyn SensorDecoder>, Vec<u8>); 2] = [
        (
            Box::new(N2kDecoder::new(&mounting)),
            [n2k::rate_of_turn(0, 0.1), n2k::heading(0, 1.0)].concat(),
        ),
        (
            Box::new(SignalKDecoder::new(&mounting)),
            [signalk::rate_of_turn(0, 0.1), signalk::heading(0, 1.0)].concat(),
        ),
    ];
    for (mut decoder, bytes) in networks {
        let mut out = Vec::new();
        decoder.push(&bytes, &mut out);
        let rate = out.iter().find_map(|m| match m.measurement {
            Measurement::Heading(HeadingFix { rate, .. }) => rate,
            _ => None,
        });
        assert!(rate.is_some_and(|r| (r - 0.1).abs() < 1e-6), "{out:?}");
    }
}
