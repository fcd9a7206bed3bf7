//! Innovation statistics: in a consistent filter the normalised innovation squared of a scalar is chi-square
//! distributed with one degree of freedom: 1 on average, below 3.84 in 95 % of cases (Bar-Shalom, Li and
//! Kirubarajan 2001, section 5.4).

use alight_shared::estimation::Update;
use serde::Serialize;

/// 95 % point of the chi-square distribution with one degree of freedom.
const CHI_SQUARE_95: f64 = 3.841;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum InnovationChannel {
    Gyro,
    Accelerometer,
    Position,
    Velocity,
    Heading,
    /// Roll and pitch of an attitude sensor.
    Tilt,
    /// Angular rates of an attitude sensor.
    Rate,
    /// Heave of an attitude sensor.
    Heave,
}

impl InnovationChannel {
    /// All channels in the order of the table.
    pub const ALL: [InnovationChannel; 8] = [
        InnovationChannel::Gyro,
        InnovationChannel::Accelerometer,
        InnovationChannel::Position,
        InnovationChannel::Velocity,
        InnovationChannel::Heading,
        InnovationChannel::Tilt,
        InnovationChannel::Rate,
        InnovationChannel::Heave,
    ];
    pub const fn name(self) -> &'static str {
        match self {
            InnovationChannel::Gyro => "gyroscope",
            InnovationChannel::Accelerometer => "accelerometer",
            InnovationChannel::Position => "position",
            InnovationChannel::Velocity => "velocity",
            InnovationChannel::Heading => "heading",
            InnovationChannel::Tilt => "roll, pitch",
            InnovationChannel::Rate => "rates",
            InnovationChannel::Heave => "heave",
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InnovationStatistics {
    pub fused: u64,
    /// Sum of the normalised innovations squared of the fused scalars.
    pub sum: f64,
    /// Number of scalars below the 95 % point.
    pub inside: u64,
    /// Number of scalars rejected by the gate.
    pub rejected: u64,
}

impl InnovationStatistics {
    /// Mean normalised innovation squared of the fused scalars; 1 in a consistent filter.
    pub fn mean(&self) -> Option<f64> {
        (self.fused > 0).then(|| self.sum / self.fused as f64)
    }
    /// Fraction of all scalars below the 95 % point; 0.95 in a consistent filter.
    pub fn fraction_inside(&self) -> Option<f64> {
        let all = self.fused + self.rejected;
        (all > 0).then(|| self.inside as f64 / all as f64)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Consistency([InnovationStatistics; InnovationChannel::ALL.len()]);

impl Consistency {
    pub fn of(&self, channel: InnovationChannel) -> InnovationStatistics {
        self.0.get(channel as usize).copied().unwrap_or_default()
    }
    pub(crate) fn observe(&mut self, channel: InnovationChannel, update: Update) {
        let Some(fit) = self.0.get_mut(channel as usize) else {
            return;
        };
        match update {
            Update::Fused { nis } => {
                fit.fused += 1;
                fit.sum += nis;
                fit.inside += u64::from(nis <= CHI_SQUARE_95);
            }
            Update::Rejected { .. } | Update::Invalid => fit.rejected += 1,
        }
    }
    pub(crate) fn and(&self, other: &Consistency) -> Consistency {
        let mut all = *self;
        for (a, b) in all.0.iter_mut().zip(&other.0) {
            a.fused += b.fused;
            a.sum += b.sum;
            a.inside += b.inside;
            a.rejected += b.rejected;
        }
        all
    }
}
