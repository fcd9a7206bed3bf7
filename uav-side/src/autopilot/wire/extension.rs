//! Messages with MAVLink 2's extension fields, by their place in the payload.

use mavlink::dialects::common as m;
use mavlink::types::CharArray;
use mavlink::{MavlinkVersion, MessageData};

use super::super::message::{Message, OdometryReport, VelocityFrame};
use super::chars;

/// Name of the list of figures that is the deck.
const DECK: &str = "deck";

/// A message of number `ID` whose payload, with its extension fields, is made here. `CRC` is the
/// message definition's own check byte.
pub(super) struct Extended<const ID: u32, const CRC: u8>(pub(super) Vec<u8>);

impl<const ID: u32, const CRC: u8> MessageData for Extended<ID, CRC> {
    type Message = m::MavMessage;
    const ID: u32 = ID;
    const NAME: &'static str = "";
    const EXTRA_CRC: u8 = CRC;
    const ENCODED_LEN: usize = 255;
    fn ser(&self, _: MavlinkVersion, payload: &mut [u8]) -> usize {
        // MAVLink 2 leaves out the zeros at the end, but for the first byte.
        let n = self.0.iter().rposition(|b| *b != 0).map_or(1, |k| k + 1);
        let n = n.min(payload.len());
        payload.iter_mut().zip(&self.0).take(n).for_each(|(p, b)| *p = *b);
        n
    }
    fn deser(_: MavlinkVersion, payload: &[u8]) -> Result<Self, mavlink::error::ParserError> {
        Ok(Extended(payload.to_vec()))
    }
}

/// Little-endian fields in a row.
#[derive(Default)]
struct Row(Vec<u8>);

impl Row {
    fn floats(mut self, values: &[f64]) -> Row {
        let bytes = values.iter().flat_map(|v| (*v as f32).to_le_bytes());
        self.0.extend(bytes);
        self
    }
    fn bytes(mut self, values: &[u8]) -> Row {
        self.0.extend_from_slice(values);
        self
    }
}
/// The float at a place of a payload; zero where MAVLink 2 left out zeros.
fn float_at(payload: &[u8], at: usize) -> f64 {
    let byte = |k| payload.get(at + k).copied().unwrap_or(0);
    f32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]).into()
}
fn floats_at<const N: usize>(payload: &[u8], at: usize) -> [f64; N] {
    core::array::from_fn(|k| float_at(payload, at + 4 * k))
}
fn time_at(payload: &[u8]) -> u64 {
    u64::from_le_bytes(core::array::from_fn(|k| payload.get(k).copied().unwrap_or(0)))
}

/// Places of extension fields in their payloads.
pub(super) const RESET_COUNTER_AT: usize = 230;
const TARGET_SIZE_AT: usize = 20;
const TARGET_PLACE_AT: usize = 30;
const LIST_AT: usize = 20;

/// `LANDING_TARGET`: time, angles and distance (not used), size; number, frame; then the extension:
/// place, attitude, kind (2: fiducial marker), place is valid.
pub(super) fn landing_target(time_us: u64, position: &[f64; 3], attitude: &[f64; 4], size_m: f64) -> Vec<u8> {
    Row::default()
        .bytes(&time_us.to_le_bytes())
        .floats(&[0.0, 0.0, 0.0, size_m, size_m])
        .bytes(&[0, m::MavFrame::MAV_FRAME_LOCAL_NED as u8])
        .floats(position)
        .floats(attitude)
        .bytes(&[2, 1])
        .0
}
/// `DEBUG_FLOAT_ARRAY`: time, number, name; then the extension: 58 floats.
pub(super) fn deck(time_us: u64, values: &[[f64; 3]; 5]) -> Vec<u8> {
    let name: CharArray<10> = chars(DECK);
    Row::default()
        .bytes(&time_us.to_le_bytes())
        .bytes(&[0, 0])
        .bytes(&*name)
        .floats(values.as_flattened())
        .0
}
/// `ODOMETRY`: time, position, attitude, velocity, rates, two covariances, frames; then the extension:
/// reset counter.
pub(super) fn odometry(o: &OdometryReport) -> Vec<u8> {
    let mut covariances = [[f64::NAN; 21]; 2];
    if let Some([p, a, v]) = o.variances {
        covariances = [[0.0; 21]; 2];
        let [pose, velocity] = &mut covariances;
        (pose[0], pose[6], pose[11]) = (p[0], p[1], p[2]);
        (pose[15], pose[18], pose[20]) = (a[0], a[1], a[2]);
        (velocity[0], velocity[6], velocity[11]) = (v[0], v[1], v[2]);
    }
    let frame = match o.frame {
        VelocityFrame::Ned => m::MavFrame::MAV_FRAME_LOCAL_NED,
        VelocityFrame::Body => m::MavFrame::MAV_FRAME_BODY_FRD,
    };
    Row::default()
        .bytes(&o.time_us.to_le_bytes())
        .floats(&o.position)
        .floats(&o.attitude)
        .floats(&o.velocity)
        .floats(&o.rates)
        .floats(covariances.as_flattened())
        .bytes(&[m::MavFrame::MAV_FRAME_LOCAL_NED as u8, frame as u8, o.resets])
        .0
}

/// Messages whose extension is their content.
pub(super) fn read(id: u32, payload: &[u8]) -> Option<Message> {
    match id {
        149 => Some(Message::LandingTarget {
            time_us: time_at(payload),
            position: floats_at(payload, TARGET_PLACE_AT),
            attitude: floats_at(payload, TARGET_PLACE_AT + 12),
            size_m: float_at(payload, TARGET_SIZE_AT),
        }),
        350 => {
            let name = payload.get(10..20)?;
            let rest = name.strip_prefix(DECK.as_bytes())?;
            rest.iter().all(|b| *b == 0).then(|| Message::Deck {
                time_us: time_at(payload),
                values: core::array::from_fn(|k| floats_at(payload, LIST_AT + 12 * k)),
            })
        }
        _ => None,
    }
}
