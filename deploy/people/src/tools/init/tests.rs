use super::*;
use alight_shared::msg::LandingMode;

fn answered(answers: &str) -> (Result<Boat, CliError>, String) {
    let mut installer = Installer {
        answers: answers.as_bytes(),
        out: Vec::new(),
    };
    let boat = installer.boat();
    (boat, String::from_utf8(installer.out).unwrap())
}

#[test]
fn init_without_answers_is_the_shipped_boat() {
    let (boat, asked) = answered(&"\n".repeat(40));
    let (vessel, drone) = boat.unwrap().check().unwrap();
    assert_eq!(
        vessel,
        config::parse(include_str!("../../../../vessel/vessel.toml"), "").unwrap()
    );
    assert_eq!(drone.bridge.drone_id, 1);
    let shipped: DroneComputerConfig =
        config::parse(include_str!("../../../../drone/drone.toml"), "").unwrap();
    assert_eq!(drone.drone.airframe, shipped.drone.airframe);
    assert!(
        asked.contains("Length of the deck along the vessel, m [2.5]") && !asked.contains("lens"),
        "{asked}"
    );
    assert_eq!(drone.drone.mission.mode, LandingMode::Shadow);
}

#[test]
fn init_keys_of_the_shipped_files() {
    let mut boat = Boat::shipped();
    for Question(asked, places) in QUESTIONS.iter().chain([&DISTORTION]) {
        let first = boat.value(places[0]);
        assert!(first.is_some(), "{asked}");
        assert!(places.iter().all(|at| boat.value(*at) == first), "{asked}");
    }
    let before = boat.clone();
    boat.set((BoatFile::Drone, "drone.deck", "tags"), "[]");
    assert!(
        boat.drone.contains("\ntags = []\n\n# 7. Operation"),
        "{}",
        boat.drone
    );
    assert_eq!(boat.vessel, before.vessel);
}

#[test]
fn init_of_a_boat() {
    let answers = "7\n12\n1.8\n1.6\n-1.1, 0, -0.9\n60\n0.2 0 -0.3\n0 0 -2\nserial:///dev/ttyACM0:921600\n\
                   5\n0.4\n\n0.5 0.6\n0.25\n0.5\n/dev/video2\ntrue\n\
                   1280\n1280 720 900 900 640 360\n0.1 0 0 0 0\n10.1.2.3\nudpin://0.0.0.0:10110\nnmea\nserial:///dev/ttyUSB0:115200\nubx\n\n";
    let (boat, asked) = answered(answers);
    let boat = boat.unwrap_or_else(|e| panic!("{e}\n{asked}"));
    let (vessel, drone) = boat.check().unwrap();
    assert_eq!(
        (vessel.vessel_id, drone.bridge.vessel_id, drone.bridge.drone_id),
        (7, 7, 12)
    );
    assert_eq!(
        (vessel.radio.tls.peers, drone.radio.tls.peers),
        (vec!["drone-12".into()], vec!["vessel-7".into()])
    );
    assert_eq!(vessel.vessel.deck.centre_m, [-1.1, 0.0, -0.9]);
    assert_eq!((drone.drone.deck.length_m, drone.drone.deck.width_m), (1.8, 1.6));
    let airframe = &drone.drone.airframe;
    assert_eq!((airframe.max_thrust_n, airframe.feet_span_m), (98.1, [0.5, 0.6]));
    // 5 kg and 0.4 m instead of 3.5 kg and 0.325 m: 2.164 times as much.
    assert_eq!(airframe.inertia_kgm2, [0.2142, 0.2142, 0.4003]);
    assert_eq!((vessel.vessel.deck.hold_n, drone.drone.deck.hold_n), (60.0, 60.0));
    let lens = drone.drone.camera.lens;
    assert_eq!(
        (lens.width_px, lens.focal_px, lens.distortion[0]),
        (1280, [900.0; 2], 0.1)
    );
    assert!(asked.contains("1280: six numbers are needed"), "{asked}");
    assert_eq!(drone.radio.connect, ["quic/10.1.2.3:7447"]);
    assert_eq!(vessel.sensor.sources.len(), 2);
    assert!(vessel.view.knots && drone.view.knots);
    assert!(boat.drone.contains("# Take-off mass, battery in, kg"));
}

#[test]
fn init_answers_that_are_none() {
    let (boat, asked) = answered("one\n0x\n3\n");
    assert!(asked.contains("one: a whole number is needed"), "{asked}");
    assert!(boat.is_err_and(|e| {
        e.to_string()
            .contains("the answers end before \"Number of the drone")
    }));
    let (boat, _) = answered(&"x\n".repeat(20));
    assert!(boat.is_err_and(|e| e.to_string().contains("has no valid answer")));
    let (_, asked) = answered("1\n1\n-2\nnan\n");
    assert!(
        asked.contains("length_m") && asked.contains("nan: a number is needed"),
        "{asked}"
    );
    let (_, asked) = answered(&("\n".repeat(QUESTIONS.len()) + "the boat\n"));
    assert!(asked.contains("quic/the boat:7447"), "{asked}");
}
