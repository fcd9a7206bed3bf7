//! Arbitrary and damaged input at the interfaces: radio messages, configuration files, recordings. Nothing panics,
//! and accepted input is valid.
//!
//! For hours instead of seconds: `PROPTEST_RNG_SEED=7 PROPTEST_CASES=10000000 cargo test --release --workspace --test
//! cli fuzz`.

use std::{
    path::Path,
    sync::{
        OnceLock,
        atomic::{AtomicU32, Ordering},
    },
};

use alight_shared::{
    config::{self, Check},
    msg::{
        DeckGrant, DroneStatus, EstimateUpdate, Header, Message, OperatorCommand, PredictedStage, RtcmFrames,
        Seq, TimeReply, TimeRequest, VesselEstimate, VesselPrediction, VesselSurroundings, WaveMode,
        WaveModel, WaveSender, WaveUpdate, f16,
    },
    process::ProcessState,
    rtcm::MAX_FRAME_BYTES,
    time::{DroneClock, VesselClock},
    wire::{self, MAX_WIRE_BYTES},
};
use alight_sim::harness::scenario::Scenario;
use alight_uav::settings::DroneSettings;
use alight_usv::{DeckConfig, VesselNodeConfig};
use proptest::{prelude::*, test_runner::TestRunner};
use serde::{Serialize, de::DeserializeOwned};

use crate::program;

#[derive(Clone, Debug)]
enum Damage {
    Set(usize, u8),
    Flip(usize, u8),
    Number(usize, f64),
    Cut(usize),
    Insert(usize, Vec<u8>),
    Remove(usize, usize),
}

/// Damage that keeps the length.
fn changes() -> impl Strategy<Value = Damage> {
    let special = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        -1e9,
        0.0,
        5e-324,
    ];
    prop_oneof![
        (any::<usize>(), any::<u8>()).prop_map(|(at, to)| Damage::Set(at, to)),
        (any::<usize>(), 0_u8..8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
        (any::<usize>(), prop::sample::select(special.to_vec())).prop_map(|(at, to)| Damage::Number(at, to)),
    ]
}
fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        changes(),
        any::<usize>().prop_map(Damage::Cut),
        (any::<usize>(), prop::collection::vec(any::<u8>(), 1..16))
            .prop_map(|(at, what)| Damage::Insert(at, what)),
        (any::<usize>(), 1_usize..16).prop_map(|(at, n)| Damage::Remove(at, n)),
    ]
}

fn damaged(mut bytes: Vec<u8>, all: &[Damage]) -> Vec<u8> {
    for d in all {
        let at = |k: usize| k % bytes.len().max(1);
        match d {
            _ if bytes.is_empty() => {}
            Damage::Set(k, to) => {
                let k = at(*k);
                bytes[k] = *to;
            }
            Damage::Flip(k, bit) => {
                let k = at(*k);
                bytes[k] ^= 1 << bit;
            }
            Damage::Number(k, to) => {
                let k = at(*k);
                for (byte, of) in bytes[k..].iter_mut().zip(to.to_le_bytes()) {
                    *byte = of;
                }
            }
            Damage::Cut(k) => bytes.truncate(at(*k)),
            Damage::Insert(k, what) => {
                let k = at(*k);
                bytes.splice(k..k, what.iter().copied());
            }
            Damage::Remove(k, n) => {
                let k = at(*k);
                let end = (k + n).min(bytes.len());
                bytes.drain(k..end);
            }
        }
    }
    bytes
}

/// Decodes a message of type `M`; the message is rejected, or valid enough to be checked and sent again.
fn decoded<M: DeserializeOwned + Serialize>(bytes: &[u8]) -> Option<M> {
    let message = wire::decode::<M>(bytes).ok()?;
    assert!(bytes.len() <= MAX_WIRE_BYTES);
    let again = wire::encode(&message).expect("what was decoded is encoded");
    assert!(wire::decode::<M>(&again).is_ok());
    Some(message)
}

/// Decodes a message of type `M`, and checks it.
fn checked<M: DeserializeOwned + Serialize + Message>(bytes: &[u8]) {
    let _sound = decoded::<M>(bytes).map(|m| m.check());
}

fn decode_all(bytes: &[u8]) {
    checked::<EstimateUpdate<VesselClock>>(bytes);
    checked::<WaveUpdate<VesselClock>>(bytes);
    checked::<VesselPrediction<VesselClock>>(bytes);
    checked::<VesselSurroundings<VesselClock>>(bytes);
    checked::<RtcmFrames<VesselClock>>(bytes);
    checked::<DeckGrant<VesselClock>>(bytes);
    checked::<OperatorCommand<VesselClock>>(bytes);
    checked::<DroneStatus>(bytes);
    decoded::<TimeRequest<DroneClock>>(bytes);
    decoded::<TimeReply<VesselClock, DroneClock>>(bytes);
    decoded::<ProcessState>(bytes);
}

fn sound() -> Vec<Vec<u8>> {
    let estimate = VesselEstimate::<VesselClock> {
        eta: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
        eta_dot: [0.5; 6],
        uncertainty: [[f16::ONE, f16::ONE, f16::ZERO]; 6],
        ..VesselEstimate::default()
    };
    let wave = WaveModel::<VesselClock> {
        header: Header::default(),
        significant_height_m: 1.0,
        confidence: 1.0,
        modes: Seq::filled([WaveMode::default(); 12]),
        slopes: Seq::filled([10; 60]),
        advice: None,
    };
    let mut waves = WaveSender::default();
    let whole = waves.update(&wave);
    let mut continued = wave;
    continued.header.sequence += 1;
    let prediction = VesselPrediction::<VesselClock> {
        header: Header::default(),
        step_s: 0.2,
        origin: [0.0; 3],
        stages: Seq::filled([PredictedStage::default(); 16]),
    };
    let grant = DeckGrant::<VesselClock> {
        owner: 1,
        ..DeckGrant::default()
    };
    let frame = RtcmFrames::<VesselClock> {
        bytes: Seq::filled([0xD3; MAX_FRAME_BYTES]),
        ..RtcmFrames::default()
    };
    [
        wire::encode(&EstimateUpdate::whole(&estimate)),
        wire::encode(&whole),
        wire::encode(&waves.update(&continued)),
        wire::encode(&prediction),
        wire::encode(&TimeRequest::<DroneClock>::default()),
        wire::encode(&TimeReply::<VesselClock, DroneClock>::default()),
        wire::encode(&grant),
        wire::encode(&OperatorCommand::<VesselClock>::default()),
        wire::encode(&frame),
        wire::encode(&DroneStatus::default()),
        wire::encode(&ProcessState::default()),
    ]
    .map(Result::unwrap)
    .into()
}

fn reads<C: DeserializeOwned + Check + Serialize>(text: &str) {
    if let Ok(config) = config::parse::<C>(text, "fuzz") {
        let again = toml::to_string(&config).expect("what was read is written");
        config::parse::<C>(&again, "again").expect("and read again");
    }
}

proptest! {
    #[test]
    fn arbitrary_radio_messages(bytes in prop::collection::vec(any::<u8>(), 0..2 * MAX_WIRE_BYTES)) {
        decode_all(&bytes);
    }

    #[test]
    fn damaged_radio_messages(which in 0_usize..11, all in prop::collection::vec(damage(), 1..8)) {
        let good = sound();
        decode_all(&damaged(good[which % good.len()].clone(), &all));
    }

    #[test]
    fn damaged_configurations(which in 0_usize..3, all in prop::collection::vec(damage(), 1..6)) {
        let good = [
            toml::to_string(&VesselNodeConfig::default()).unwrap(),
            toml::to_string(&DroneSettings::default()).unwrap(),
            toml::to_string(&Scenario::default()).unwrap(),
        ];
        let text = String::from_utf8_lossy(&damaged(good[which].clone().into_bytes(), &all)).into_owned();
        reads::<VesselNodeConfig>(&text);
        reads::<DroneSettings>(&text);
        reads::<Scenario>(&text);
    }

    #[test]
    fn arbitrary_numbers_in_a_configuration(key in 0_usize..500, value in prop_oneof![
        any::<f64>().prop_map(|v| v.to_string()), any::<i64>().prop_map(|v| v.to_string()),
        Just("nan".to_owned()), Just("inf".to_owned()), Just("-0.0".to_owned()), Just("[]".to_owned())
    ]) {
        let text = toml::to_string(&DroneSettings::default()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let at = key % lines.len();
        let changed: Vec<String> = lines.iter().enumerate().map(|(i, line)| match line.split_once(" = ") {
            Some((name, _)) if i == at => format!("{name} = {value}"),
            _ => (*line).to_owned(),
        }).collect();
        reads::<DroneSettings>(&changed.join("\n"));
        reads::<DeckConfig>(&format!("status_timeout_s = {value}"));
    }
}

/// Number of cases that run the program, which are slower than calls, unless PROPTEST_CASES sets it.
fn runs() -> ProptestConfig {
    ProptestConfig {
        cases: std::env::var("PROPTEST_CASES")
            .ok()
            .and_then(|n| n.parse().ok())
            .unwrap_or(24),
        max_shrink_iters: 0,
        ..ProptestConfig::default()
    }
}

fn recorded() -> &'static [u8] {
    static RECORDED: OnceLock<Vec<u8>> = OnceLock::new();
    RECORDED.get_or_init(|| {
        let path = program::scratch("fuzz.mcap");
        let scenario = program::file("fuzz.toml", "[start]\nwarm_up_s = 2.0\nhover_s = 1.0\n");
        let out = program::alight(format!(
            "trial --json --scenario {scenario} --record {}",
            path.display()
        ));
        assert!(
            out.status.code().is_some_and(|c| c < 2),
            "{}",
            program::stderr(&out)
        );
        assert!(program::json(&out)["success"].is_boolean());
        std::fs::read(&path).unwrap()
    })
}

fn steps() -> &'static [mcap::Message<'static>] {
    static STEPS: OnceLock<Vec<mcap::Message<'static>>> = OnceLock::new();
    STEPS.get_or_init(|| {
        mcap::MessageStream::new(recorded())
            .unwrap()
            .map(Result::unwrap)
            .filter(|m| m.channel.topic.starts_with("/node/"))
            .collect()
    })
}

/// Number of steps that the replay continues after the last damaged one, so that effects on a node's state appear.
const FOLLOWED: usize = 3000;

fn with_wrong_steps(path: &Path, all: &[(usize, Damage)]) -> Result<(), mcap::McapError> {
    let good = recorded();
    let summary = mcap::Summary::read(good)?.expect("a summary");
    let mut writer = mcap::WriteOptions::new()
        .compression(None)
        .create(std::io::BufWriter::new(std::fs::File::create(path)?))?;
    for index in &summary.attachment_indexes {
        writer.attach(&mcap::read::attachment(good, index)?)?;
    }
    for index in &summary.metadata_indexes {
        writer.write_metadata(&mcap::read::metadata(good, index)?)?;
    }
    let place = |at: usize| at % steps().len();
    let last = all.iter().map(|(at, _)| place(*at)).max().unwrap_or(0);
    for (k, step) in steps().iter().enumerate().take(last + FOLLOWED) {
        let mut step = step.clone();
        for (_, how) in all.iter().filter(|(at, _)| place(*at) == k) {
            step.data = damaged(step.data.into_owned(), std::slice::from_ref(how)).into();
        }
        writer.write(&step)?;
    }
    writer.finish()?;
    Ok(())
}

/// A checksum of the file rejects changed bytes before a step is read (in 310 of 313 files with damaged bytes). This
/// test passes such bytes to the nodes.
#[test]
fn corrupted_steps_of_a_recording() {
    let reached = AtomicU32::new(0);
    let config = ProptestConfig {
        // The runner has no file for failures, so they are printed.
        failure_persistence: None,
        ..runs()
    };
    let cases = config.cases;
    let wrongs = prop::collection::vec((any::<usize>(), changes()), 1..4);
    let done = TestRunner::new(config).run(&wrongs, |all| {
        let path = program::scratch("steps.mcap");
        with_wrong_steps(&path, &all).unwrap();
        let out = program::alight(format!("replay {}", path.display()));
        let output = program::stderr(&out);
        let code = out.status.code();
        prop_assert!(matches!(code, Some(0..=2)), "{:?}: {output}", out.status);
        // A replay prints this text when it catches a panic; when the decoder rejects an input, it names the step
        // instead.
        prop_assert!(
            !output.contains("the recording is damaged; record it again"),
            "{output}"
        );
        prop_assert!(code != Some(2) || output.contains("the step of"), "{output}");
        reached.fetch_add(u32::from(code != Some(2)), Ordering::Relaxed);
        Ok(())
    });
    let reached = reached.into_inner();
    println!("{reached} of {cases} recordings were decoded to the end: the nodes got all their wrong bytes");
    done.unwrap();
    assert!(8 * reached >= cases, "only {reached} of {cases} reached a node");
}

proptest! {
    #![proptest_config(runs())]
    #[test]
    fn damaged_recordings(all in prop::collection::vec(damage(), 1..4)) {
        let path = program::scratch("damaged.mcap");
        std::fs::write(&path, damaged(recorded().to_vec(), &all)).unwrap();
        let out = program::alight(format!("replay {}", path.display()));
        prop_assert!(matches!(out.status.code(), Some(0..=2)), "{:?}: {}", out.status, program::stderr(&out));
    }
}
