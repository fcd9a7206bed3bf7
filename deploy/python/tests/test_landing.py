"""One landing: the module returns the flight and its recording."""

import dataclasses
import os
import unittest
from unittest import mock

import mcap.writer
import numpy as np
from source import FILES, alight, landing, printed, stand_in


def angles(truth, of):
    """Roll, pitch and yaw of drone or deck, deg."""
    return [truth[f"{of}_{name}_deg"] for name in ("roll", "pitch", "yaw")]


def turned(roll, pitch, yaw):
    """Matrix from body axes to the frame: first roll, then pitch, then yaw, deg."""
    (a, b, c), (p, q, r) = np.sin(np.radians([roll, pitch, yaw])), np.cos(np.radians([roll, pitch, yaw]))
    about_x = np.array([[1, 0, 0], [0, p, -a], [0, a, p]])
    about_y = np.array([[q, 0, b], [0, 1, 0], [-b, 0, q]])
    about_z = np.array([[r, -c, 0], [c, r, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


class Landing(unittest.TestCase):
    def test_outcome_is_the_programs(self):
        run, _ = landing()
        own = printed("trial", "--seed", "1", "--sea", "rough")
        # Every bit of the flight is equal, except the computing time.
        self.assertEqual({**run.outcome, "wall_time_s": 0}, {**own, "wall_time_s": 0})

    def test_failed_landing_is_a_result(self):
        # In a mean wind of 25 m/s the drone does not reach the boat.
        run = alight.trial(seed=1, wind=25, topics=["/mission", "/truth"])
        self.assertFalse(run.outcome["success"])
        self.assertIsNone(run.touchdown_s())
        self.assertTrue(np.isnan(alight.relative(run)["to_touchdown_s"]).all())

    def test_series_are_arrays_over_time(self):
        run, _ = landing()
        for topic, series in run.series.items():
            for name, values in series.items():
                with self.subTest(topic=topic, name=name):
                    self.assertEqual(len(values), len(series["time_s"]))
                    self.assertFalse(values.dtype.hasobject)
            self.assertTrue((np.diff(series["time_s"]) >= 0).all(), topic)
        self.assertEqual(run.series["/vessel/estimate"]["eta"].shape[1], 6)
        self.assertEqual(run.series["/deck/forecast/path"]["position_m"].ndim, 3)

    def test_summary_states_steps_and_units(self):
        run, _ = landing()
        files = {"drone.toml": "[planner]\nstages = 10\nstep_s = 0.05\n[predictor]\nstage_s = 0.2\n"}
        for own, forecast, plan in ((run, 0.2, 0.2), (dataclasses.replace(run, files=files), 0.4, 0.1)):
            text = repr(own)
            self.assertLessEqual(text.count("\n"), 12)
            self.assertTrue(all(topic in text for topic in run.series))
            self.assertIn(f"/deck/forecast/path {forecast} s, /plan/path {plan} s", text)
            self.assertIn("0.02 s: /sensor/range\n", text)

    def test_value_that_is_not_known_is_nan(self):
        # No shadow flight compares the autopilot with a plan; the simulated one measures its battery.
        autopilot = landing()[0].series["/drone/autopilot"]
        self.assertTrue(np.isnan(autopilot["shadow_apart_deg"]).all())
        self.assertFalse(np.isnan([autopilot["battery_v"][-1], autopilot["battery_a"][-1]]).any())
        self.assertFalse(np.isnan(autopilot["hover_thrust"]).any())

    def test_truth_and_transforms_agree(self):
        # Two topics agree: position and heading, by quaternion and by angle; and the distance from above.
        run, _ = landing()
        truth, r, frame = run.series["/truth"], alight.relative(run), run.series["/tf/drone"]
        np.testing.assert_array_equal(frame["time_s"], truth["time_s"])
        np.testing.assert_allclose(r["drone_m"], frame["position_m"], atol=1e-6)
        away = np.hypot(*(r["drone_m"] - r["deck_m"])[:, :2].T)
        np.testing.assert_allclose(away, truth["horizontal_distance_m"], atol=1e-6)
        w, x, y, z = frame["quaternion_wxyz"].T
        heading = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
        np.testing.assert_allclose(heading, truth["drone_yaw_deg"], atol=1e-6)

    def test_difference_of_attitudes(self):
        # The same result from the angles of both, by matrices, over the whole approach: 20 deg of tilt, half a turn of yaw.
        run, _ = landing()
        truth, r = run.series["/truth"], alight.relative(run)
        drone, deck = (np.array([turned(*a) for a in zip(*angles(truth, of))]) for of in ("drone", "deck"))
        between = np.swapaxes(deck, 1, 2) @ drone
        for own, (roll, pitch, yaw) in zip(between, zip(r["roll_deg"], r["pitch_deg"], r["yaw_deg"])):
            np.testing.assert_allclose(own, turned(roll, pitch, yaw), atol=1e-6)

    def test_velocity_is_that_of_the_places(self):
        r = alight.relative(landing()[0])
        moved = np.gradient(r["drone_m"], r["time_s"], axis=0)
        self.assertLess(np.abs(moved - r["drone_mps"])[1:-1].max(), 0.5)

    def test_table_of_a_topic(self):
        try:
            import pandas  # noqa: F401
        except ImportError:
            self.skipTest("pandas is not installed")
        run, _ = landing()
        frame = run.frame("/truth")
        self.assertEqual(frame.index.name, "time_s")
        self.assertEqual(list(frame["drone_velocity_mps_2"]), list(run.series["/truth"]["drone_velocity_mps"][:, 2]))

    def test_unknown_topic_names_the_others(self):
        run, path = landing()
        with self.assertRaisesRegex(alight.AlightError, "/nowhere.*/truth"):
            run.topic("/nowhere")
        with self.assertRaisesRegex(alight.AlightError, "/nowhere.*/truth"):
            alight.read(path, topics=["/nowhere"])


class Touchdown(unittest.TestCase):
    """At the first contact the series agree with the judge of the landing."""

    def at_contact(self, name):
        r = alight.relative(landing()[0])
        values = r[name] if r[name].ndim == 2 else r[name][:, None]
        return np.array([np.interp(0.0, r["to_touchdown_s"], column) for column in values.T])

    def test_displacement_is_the_position_error(self):
        # Records are 40 ms apart and the drone moves at 0.1 m/s along the deck.
        forward, starboard, height = self.at_contact("displacement_m")
        self.assertAlmostEqual(np.hypot(forward, starboard), landing()[0].outcome["position_error_m"], delta=0.005)
        self.assertLess(abs(height), 0.03)

    def test_angles_are_those_of_the_contact(self):
        for angle in ("roll", "pitch", "yaw"):
            error = landing()[0].outcome[f"{angle}_error_deg"]
            self.assertAlmostEqual(self.at_contact(f"{angle}_deg")[0], error, delta=0.5)

    def test_time_without_the_outcome(self):
        # A recording alone has the mission's suspected contact, which comes within a few ticks of the contact.
        run, path = landing()
        self.assertAlmostEqual(alight.read(path).touchdown_s(), run.touchdown_s(), delta=0.1)


class Recordings(unittest.TestCase):
    def test_recording_has_the_trials_series(self):
        run, path = landing()
        read = alight.read(path)
        self.assertEqual(read.series.keys(), run.series.keys())
        for topic, series in read.series.items():
            for name, values in series.items():
                np.testing.assert_array_equal(values, run.series[topic][name])
        self.assertEqual((read.outcome["outcome"], read.outcome["seed"]), ("success", 1))
        self.assertIn("[sea]", read.files["scenario.toml"])

    def test_part_of_a_recording(self):
        run, path = landing()
        whole = run.series["/truth"]["time_s"]
        part = alight.read(path, topics="/truth", start_s=60.0, end_s=65.0)
        self.assertEqual(list(part.series), ["/truth"])
        self.assertEqual(list(part.series["/truth"]["time_s"]), list(whole[(whole >= 60.0) & (whole < 65.0)]))

    def test_more_than_asked_for_is_refused(self):
        with self.assertRaisesRegex(alight.AlightError, "max_messages"):
            alight.read(landing()[1], max_messages=1000)

    def test_damaged_file(self):
        whole = landing()[1].read_bytes()
        for name, content in [("cut.mcap", whole[: len(whole) // 2]), ("text.mcap", b"no recording"), ("empty.mcap", b"")]:
            with self.subTest(name=name):
                path = FILES / name
                path.write_bytes(content)
                with self.assertRaisesRegex(alight.AlightError, name):
                    alight.read(path)

    def test_bytes_that_are_others(self):
        # Damage is either not noticed or reported; no other exception occurs.
        path, random = FILES / "damaged.mcap", np.random.default_rng(1)
        whole = np.frombuffer(landing()[1].read_bytes(), dtype=np.uint8)
        refused = 0
        for k in range(12):
            damaged = whole.copy()
            # The second half of the damage is in the index at the end, by which everything else is found.
            begin = 0 if k < 6 else len(whole) - 20_000
            places = random.integers(begin, len(whole), 2_000 if k < 6 else 20)
            damaged[places] = random.integers(0, 256, len(places))
            path.write_bytes(damaged.tobytes())
            try:
                alight.read(path, topics=["/mission", "/tf"])
            except alight.AlightError as error:
                self.assertIn("damaged.mcap", str(error))
                refused += 1
        self.assertGreater(refused, 0)

    def test_file_of_one_process(self):
        # As the flight recorder writes it: steps without a schema.
        path = FILES / "mission-00000001-001.mcap"
        with open(path, "wb") as file:
            part = mcap.writer.Writer(file)
            part.start()
            channel = part.register_channel("/node/mission", "alight-step", 0)
            part.add_message(channel, log_time=1, data=b"step", publish_time=1)
            part.finish()
        with self.assertRaisesRegex(alight.AlightError, "directory"):
            alight.read(path)

    def test_path_without_a_recording(self):
        with self.assertRaisesRegex(alight.AlightError, "nothing.mcap"):
            alight.read(FILES / "nothing.mcap")
        empty = FILES / "empty"
        empty.mkdir()
        with self.assertRaisesRegex(alight.AlightError, "empty"):
            alight.read(empty)

    def test_flight_is_computed_again(self):
        # The script replaces the program: it joins the flight's files to one recording.
        flight = FILES / "20260101T000000Z-0001"
        flight.mkdir()
        (flight / "mission-00000001-001.mcap").write_bytes(b"")
        (flight / "flight.json").write_text('{"computer": "drone-1", "outcome": "landed", "figures": {"age_s": 0.1}}')
        copies = 'for a; do case $a in --record=*) cp "$RECORDING" "${a#--record=}";; esac; done'
        played = stand_in(FILES, copies + "; echo '{\"verdict\": \"differs\"}'; exit 1")
        with mock.patch.dict(os.environ, {"ALIGHT": played, "RECORDING": str(landing()[1])}):
            run = alight.read(flight, topics=["/mission", "/log"])
        self.assertEqual((run.outcome["outcome"], run.outcome["replay"]), ("landed", "differs"))
        self.assertEqual(run.flight["figures"]["age_s"], 0.1)
        self.assertEqual(sorted(run.series), ["/log", "/mission"])

    @unittest.skipUnless(os.environ.get("ALIGHT_TEST_FLIGHT"), "ALIGHT_TEST_FLIGHT names no flight")
    def test_flight_of_the_recorder(self):
        run = alight.read(os.environ["ALIGHT_TEST_FLIGHT"])
        self.assertEqual(run.outcome["replay"], "bit-identical")
        r = alight.relative(run)
        self.assertEqual(r["source"], "belief")
        last = [np.interp(0.0, r["to_touchdown_s"], column) for column in r["displacement_m"].T]
        self.assertLess(np.hypot(*last[:2]), 0.5)
        self.assertLess(abs(last[2]), 0.1)

    def test_trial_leaves_no_file(self):
        before = set(os.listdir())
        run = alight.trial(seed=2, topics=["/mission"])
        self.assertIsNone(run.path)
        self.assertEqual(set(os.listdir()), before)


if __name__ == "__main__":
    unittest.main()
