use super::*;
use alight_shared::msg::{WaveMode, WaveModel, WaveSender, WaveUpdate};

fn waves(sequence: u32, at: VesselTime) -> WaveModel<VesselClock> {
    WaveModel {
        header: Header::new(1, 0, 1, sequence, at),
        significant_height_m: 1.0,
        confidence: 0.5,
        modes: Seq::filled([WaveMode {
            pole: [-0.05, 1.3],
            shape: core::array::from_fn(|d| [0.2 + d as f32, 0.1 - d as f32].map(f16::from_f32)),
        }]),
        slopes: Seq::filled([20, 10]),
        advice: None,
    }
}

#[test]
fn bridge_wave_model_and_prediction() {
    let (mut b, now) = converged(5);
    let wave = waves(3, vessel(now - 0.1));
    let prediction = VesselPrediction::<VesselClock> {
        header: Header::new(1, 0, 1, 0, vessel(now - 0.1)),
        step_s: 0.2,
        origin: [1.0, 2.0, 0.0],
        stages: Seq::filled((0..16).map(|k| PredictedStage {
            eta: core::array::from_fn(|d| 0.01 * (6 * k + d) as f32),
            eta_dot: core::array::from_fn(|d| f16::from_f32(-0.01 * (6 * k + d) as f32)),
            ..PredictedStage::default()
        })),
    };
    let out = step(
        &mut b,
        now,
        vec![
            packet(now, RadioTopic::Wave, &WaveUpdate::whole(&wave)),
            packet(now, RadioTopic::Prediction, &prediction),
        ],
    );
    assert_eq!(out.wave.unwrap().modes, wave.modes);
    assert_eq!(out.wave.unwrap().slopes, wave.slopes);
    let received = out.prediction.unwrap();
    assert_eq!(
        (received.origin, received.stages),
        (prediction.origin, prediction.stages)
    );
}

/// A joining drone receives a continuation before the whole model that it asked for.
#[test]
fn base_of_a_wave_model_behind_its_continuation() {
    let (mut b, now) = converged(5);
    let mut sender = WaveSender::default();
    let [base, first, second] = [0, 1, 2].map(|k| {
        let update = sender.update(&waves(k, vessel(now + 0.1 * f64::from(k))));
        packet(now + 0.3, RadioTopic::Wave, &update)
    });
    let received = [first, base, second].map(|p| step(&mut b, now + 0.3, vec![p]).wave);
    assert_eq!(
        received.map(|w| w.map(|w| w.header.sequence)),
        [None, Some(0), Some(2)]
    );
    assert_eq!(b.rejections().total(), 0);
}
