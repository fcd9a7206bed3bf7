//! Forecasts stay valid whatever number stands anywhere in the input.

use alight_shared::{
    msg::UvdarFix,
    wire::{decode_record, encode_record},
};
use alight_uav::predictor::PredictorIn;
use proptest::prelude::*;

use super::world::{Setup, SimulatedVessel, header, run_with};

/// Any number, including implausible ones.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -10.0..10.0f64,
        any::<f64>(),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(-1e300)
    ]
}

/// The input with this number in place of eight of its bytes, unless the decoder rejects it.
fn with_number(input: PredictorIn, at: usize, number: f64) -> PredictorIn {
    let mut bytes = encode_record(&input).unwrap();
    let at = at % (bytes.len() - 7);
    bytes[at..at + 8].copy_from_slice(&number.to_le_bytes());
    decode_record(&bytes).unwrap_or(input)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn predictor_arbitrary_input(
        numbers in prop::collection::vec((0..1400_u32, any::<usize>(), any_number()), 1..400),
    ) {
        let set = Setup { relative: (2.0, 8.0), ranges_from: 4.0, vision: (3.0, 1e9), ..Setup::default() };
        let r = run_with(&SimulatedVessel::moderate(), &set, 14.0, |k, mut arrived| {
            arrived.uvdar.push(UvdarFix {
                header: header(k, 0.01 * f64::from(k)),
                position: [0.0, 0.0, set.height],
                variance: [0.1; 3],
            });
            for (_, at, number) in numbers.iter().filter(|(step, ..)| *step == k) {
                arrived = with_number(arrived, *at, *number);
            }
            arrived
        });
        for s in &r.samples {
            prop_assert!(s.forecast.stages.iter().all(|s| s.position_sd.iter().all(|v| v.is_finite())));
        }
    }
}
