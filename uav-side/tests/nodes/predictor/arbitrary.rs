//! Arbitrary input is counted, and the forecast stays valid.

use alight_shared::{
    msg::{
        CarrierSolution, DroneState, Header, LinkState, Message, PredictedStage, RangeSample, RelativePlace,
        Seq, TagPose, UvdarFix, VesselEstimate, VesselPrediction, WaveMode, WaveModel, f16,
    },
    node::Node,
};
use alight_uav::predictor::PredictorIn;
use proptest::prelude::*;

use super::world::{Setup, SimulatedVessel, run, time};

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

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn predictor_arbitrary_input(
        x in prop::collection::vec(any_number(), 24), which in 0..9u8, at in prop_oneof![0.0..30.0f64, any_number()],
        from in 0..3u8,
    ) {
        let v = SimulatedVessel::moderate();
        let seconds = [0.0, 2.0, 12.0][usize::from(from)];
        let mut r = run(&v, &Setup::default(), seconds);
        let before = r.predictor.rejections().total();
        let h = Header::new(1, 0, 1, 1_000_000, time(at));
        let a3 = |i: usize| [x[i], x[i + 1], x[i + 2]];
        let six = |i: usize| core::array::from_fn(|k| x[i + k]);
        let mut bad = PredictorIn::default();
        match which {
            0 => bad.tags = vec![TagPose { header: h, position: a3(0), attitude: [x[3], x[4], x[5], x[6]],
                variance: six(7) }; 3],
            1 => bad.uvdar = vec![UvdarFix { header: h, position: a3(0), variance: a3(3) }; 3],
            2 => bad.ranges = vec![RangeSample { header: h, range_m: x[0], variance: x[1] }; 3],
            3 => bad.drone = Some(DroneState { header: h, position: a3(0), velocity: a3(3), ..Default::default() }),
            4 => bad.link = Some(LinkState { header: h, clock_offset_sd_s: x[0], age_s: x[1], ..Default::default() }),
            5 => bad.estimate = Some(VesselEstimate { header: h, datum: Default::default(), eta: six(0),
                eta_dot: six(6).map(|v: f64| v as f32), eta_ddot: [f16::from_f64(x[12]); 6],
                uncertainty: [[x[13], x[14], x[17]].map(f16::from_f64); 6], deck_centre: [0.0, 0.0, -1.3],
                mean_velocity: [x[15] as f32; 2], mean_heading: [x[16] as f32; 2] }),
            6 => bad.prediction = Some(VesselPrediction { header: h, step_s: x[0] as f32, origin: a3(1),
                stages: Seq::filled([PredictedStage { eta: six(4).map(|v: f64| v as f32),
                    eta_dot: six(10).map(f16::from_f64), sd: [f16::from_f64(x[16]); 6], course_sd: [f16::from_f64(x[16]); 3] }; 16]) }),
            7 => bad.relative = vec![RelativePlace { header: h, baseline_m: a3(0), baseline_sd_m: a3(3).map(|v| v * 1e-2),
                solution: CarrierSolution::Fixed, antenna_m: a3(6).map(|v| v as f32) }; 3],
            _ => bad.wave = Some(WaveModel { header: h, significant_height_m: 1.0, confidence: x[0] as f32,
                slopes: Seq::filled([x[8] as u8; 60]), advice: None,
                modes: Seq::filled([WaveMode { pole: [x[1] as f32, x[2] as f32],
                    shape: [[x[4], x[5]].map(f16::from_f64); 6] }; 12]) }),
        }
        let valid = match which {
            0 => bad.tags[0].check(),
            1 => bad.uvdar[0].check(),
            2 => bad.ranges[0].check(),
            3 => bad.drone.unwrap().check(),
            4 => bad.link.unwrap().check(),
            5 => bad.estimate.unwrap().check(),
            6 => bad.prediction.unwrap().check(),
            7 => bad.relative[0].check(),
            _ => bad.wave.unwrap().check(),
        };
        for k in 0..20 {
            let now = time(seconds + 0.01 * f64::from(k));
            if let Some(f) = r.predictor.step(now, &bad).forecast {
                prop_assert!(f.check().is_ok(), "{:?}", f.check());
                prop_assert!(f.stages.iter().all(|s| s.position_sd.iter().all(|v| v.is_finite())));
            }
        }
        if valid.is_err() {
            prop_assert!(r.predictor.rejections().total() >= before + 20);
        }
    }
}
