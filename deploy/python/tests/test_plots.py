"""Figures show the numbers from which they were drawn, with units at their axes."""

import io
import unittest

import numpy as np
from source import FILES, alight, landing
from test_folders import drawn_by_hand

try:
    import matplotlib  # noqa: F401
except ImportError:
    raise unittest.SkipTest("matplotlib is not installed") from None


def line(axis, name):
    """x and y of the line with this label."""
    return next(drawn for drawn in axis.get_lines() if drawn.get_label() == name).get_data()


def written(figure):
    """The figure as SVG, which shows that it can be drawn."""
    file = io.BytesIO()
    figure.savefig(file, format="svg")
    return file.getvalue()


def row(scenario, planner, mean, published):
    metric = {"mean": mean, "p95": 2 * mean}
    return {
        "scenario": scenario,
        "planner": planner,
        "trials": 20,
        "successes": 19,
        "success_rate_95": [0.76, 0.99],
        "position_error_m": metric,
        "landing_time_s": metric,
        "touchdown_speed_mps": metric,
        "published": published,
    }


class Landing(unittest.TestCase):
    def setUp(self):
        self.run_, _ = landing()
        self.figure = alight.plots.landing(self.run_)

    def test_five_panels_with_units(self):
        labels = [axis.get_ylabel() for axis in self.figure.axes]
        self.assertEqual(len(labels), 5)
        for label, unit in zip(labels, [", m", ", m", ", m/s", ", deg", ", deg"]):
            self.assertTrue(label.endswith(unit), label)
        self.assertIn("time to touchdown, s", self.figure.axes[4].get_xlabel())
        self.assertIn(b"<svg", written(self.figure))

    def test_displacement_ends_at_the_position_error(self):
        (x, forward), (_, starboard) = (line(self.figure.axes[1], name) for name in ("forward", "starboard"))
        self.assertEqual(x[-1], 0.0)
        error = self.run_.outcome["position_error_m"]
        self.assertAlmostEqual(np.hypot(forward[-1], starboard[-1]), error, delta=0.005)

    def test_path_ends_on_the_deck(self):
        ends = [np.array(line(self.figure.axes[0], name))[:, -1] for name in ("drone", "deck")]
        self.assertLess(np.hypot(*(ends[0] - ends[1])), 0.2)

    def test_span_that_is_asked_for(self):
        figure = alight.plots.landing(self.run_, before_s=3.0, after_s=1.0)
        x, _ = line(figure.axes[4], "yaw")
        self.assertTrue(-3.0 <= x[0] < -2.9 and 0.9 < x[-1] <= 1.0, (x[0], x[-1]))

    def test_landing_that_never_was(self):
        run = alight.trial(seed=1, wind=25, topics=["/mission", "/truth"])
        figure = alight.plots.landing(run)
        self.assertIn("end of the recording", figure.axes[4].get_xlabel())
        written(figure)

    def test_recording_without_drone_and_deck(self):
        run = alight.read(landing()[1], topics=["/mission"])
        with self.assertRaisesRegex(alight.AlightError, "/drone/odometry"):
            alight.plots.landing(run)

    def test_belief_comes_close_to_the_truth(self):
        # Data of a real flight: the drone's odometry and its forecast, no truth.
        topics = ["/mission", "/log", "/drone/odometry", "/deck/forecast/path"]
        run = alight.read(landing()[1], topics=topics)
        r = alight.relative(run)
        self.assertEqual(r["source"], "belief")
        last = [np.interp(0.0, r["to_touchdown_s"], column) for column in r["displacement_m"].T]
        truth = alight.relative(self.run_)
        true = [np.interp(0.0, truth["to_touchdown_s"], column) for column in truth["displacement_m"].T]
        np.testing.assert_allclose(last, true, atol=0.1)
        # In the air both velocities are in NED, independent of the drone's heading.
        air = (r["to_touchdown_s"] > -10.0) & (r["to_touchdown_s"] < 0.0)
        for part in range(3):
            own = np.interp(r["time_s"][air], truth["time_s"], truth["drone_mps"][:, part])
            self.assertLess(np.abs(r["drone_mps"][air, part] - own).max(), 0.5)
        written(alight.plots.landing(run))


class Moments(unittest.TestCase):
    def test_drone_comes_down_to_the_deck(self):
        run, _ = landing()
        figure = alight.plots.moments(run)
        self.assertEqual(len(figure.axes), 4)
        heights = []
        for axis in figure.axes:
            (_, drone), (_, deck) = (line(axis, name) for name in ("drone", "deck"))
            # The deck's centre is the origin.
            self.assertAlmostEqual(deck.mean(), 0.0, places=6)
            heights.append(drone.mean())
        self.assertEqual(heights, sorted(heights, reverse=True))
        self.assertLess(heights[-1], 0.5)
        written(figure)

    def test_forecast_begins_at_the_deck(self):
        run, _ = landing()
        for axis in alight.plots.moments(run).axes:
            forward, height = line(axis, "forecast of its centre")
            self.assertLess(np.hypot(forward[0], height[0]), 0.5)

    def test_slope_along_a_heading(self):
        # Nose up by 10 deg as seen from its own heading; level from abeam, from where its roll shows.
        slope = alight.plots._slope
        self.assertAlmostEqual(slope((0.0, 10.0, 30.0), np.radians(30.0)), np.tan(np.radians(10.0)))
        self.assertAlmostEqual(slope((0.0, 10.0, 30.0), np.radians(120.0)), 0.0)
        # Starboard down: seen along starboard, the forward end is down.
        self.assertAlmostEqual(slope((10.0, 0.0, 0.0), np.radians(90.0)), -np.tan(np.radians(10.0)))

    def test_flight_without_a_landing(self):
        run = alight.trial(seed=1, wind=25)
        with self.assertRaisesRegex(alight.AlightError, "nothing landed"):
            alight.plots.moments(run)


class Tables(unittest.TestCase):
    def setUp(self):
        known = {"position_error_m": 0.4, "landing_time_s": 12.0, "touchdown_speed_mps": None}
        summary = [
            row("0,0", "alight", 0.1, known),
            row("0,0", "mpc-faa", 0.2, known),
            row("0.5,5", "alight", 0.3, None),
        ]
        # A row without a landing has no measurements.
        summary.append({**row("0.5,5", "mpc-faa", 0.0, None), "position_error_m": None, "successes": 0})
        self.figure = alight.plots.table2(alight.Study("table2", [], summary))

    def test_means_of_the_summary(self):
        position = self.figure.axes[1]
        means = [list(bars.lines[0].get_ydata()) for bars in position.containers]
        self.assertEqual(means, [[0.1, 0.3], [0.2]])
        units = [axis.get_ylabel().split(", ")[-1] for axis in self.figure.axes]
        self.assertEqual(units, ["%", "m", "s", "m/s"])
        written(self.figure)

    def test_published_once_for_each_sea(self):
        marks = [len(axis.collections) for axis in self.figure.axes[1:]]
        # Next to the planners' lines to the 95th percentile.
        planners = [len(axis.containers) for axis in self.figure.axes[1:]]
        self.assertEqual([m - p for m, p in zip(marks, planners)], [1, 1, 0])

    def test_curves_of_two_grids(self):
        names = [f"{loss} % lost, {late} s late" for loss in (0, 50) for late in (0, 1, 2)]
        names += [f"outage in {state}, {lasts} s" for state in ("descent", "flare") for lasts in (1, 2)]
        summary = [row(name, "alight", 0.1 * k, None) for k, name in enumerate(names)]
        figure = alight.plots.curves(alight.Study("link", [], summary))
        loss, outage = figure.axes
        self.assertEqual(list(line(loss, "1 s late")[1]), [0.1, 0.4])
        self.assertEqual((len(loss.get_lines()), len(outage.get_lines())), (3, 2))
        landed = alight.plots.curves(alight.Study("link", [], summary), "landed")
        self.assertEqual(list(line(landed.axes[1], "2 s")[1]), [95.0, 95.0])
        written(figure)
        with self.assertRaisesRegex(alight.AlightError, "one axis"):
            alight.plots.curves(alight.Study("table2", [], [row("0,0", "alight", 0.1, None)]))

    def test_study_without_rows(self):
        with self.assertRaises(alight.AlightError):
            alight.plots.table2(alight.Study("empty", [], []))


class Envelopes(unittest.TestCase):
    def test_cell_for_each_condition(self):
        figure = alight.plots.envelope(drawn_by_hand())
        axis = figure.axes[0]
        self.assertEqual(len(axis.patches), 8)
        counts = [text.get_text() for text in axis.texts]
        self.assertEqual((counts.count("40/40"), counts.count("!1/40")), (5, 1))
        self.assertEqual(len(axis.get_lines()), 1)
        written(figure)

    def test_no_line_of_too_few(self):
        envelope = drawn_by_hand()
        envelope.too_few = "5 landings a cell are too few"
        figure = alight.plots.envelope(envelope)
        self.assertEqual(len(figure.axes[0].get_lines()), 0)
        self.assertIn("too few", figure._suptitle.get_text())

    def test_bow_up_and_clockwise(self):
        axis = alight.plots.envelope(drawn_by_hand()).axes[0]
        self.assertAlmostEqual(axis.get_theta_offset(), np.pi / 2)
        self.assertEqual(axis.get_theta_direction(), -1)


if __name__ == "__main__":
    unittest.main()
