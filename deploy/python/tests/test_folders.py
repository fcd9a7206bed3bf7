"""Many landings: rates, studies and envelopes equal those in the program's files."""

import unittest
from unittest import mock

from source import FILES, alight, printed

from alight import _folders

STUDY = """
title = "Two rows"

[[row]]
name = "calm"
sea = "calm"

[[row]]
name = "slight"
sea = "slight"
"""


def records(rows):
    """Rows as dicts, with or without pandas."""
    return rows if isinstance(rows, list) else rows.to_dict("records")


class Trials(unittest.TestCase):
    def test_rate_is_the_programs(self):
        # A baseline in a sea beyond its limits: not every trial lands, and the program's exit code is 1.
        flown = alight.trials(2, seed0=1, planner="mpc-ne", sea="very-rough")
        own = printed("trial", "--trials", "2", "--seed0", "1", "--planner", "mpc-ne", "--sea", "very-rough")
        self.assertEqual(flown.rate, own["successes"] / own["trials"])
        self.assertEqual(list(flown.interval), own["success_rate_95"])
        rows = records(flown.rows)
        self.assertEqual([row["seed"] for row in rows], [1, 2])
        self.assertEqual(sum(row["success"] for row in rows) / 2, flown.rate)
        self.assertEqual(len(flown.summary["failures"]) > 0, flown.rate < 1.0)
        self.assertIn(f"2 landings, {100 * flown.rate:.0f} % landed", repr(flown))

    def test_rows_with_and_without_pandas(self):
        path = FILES / "rows.csv"
        alight.trials(1, rows=path)
        with mock.patch.object(_folders.pandas, "is_there", lambda: False):
            plain = alight.trials(1, rows=path).rows
        self.assertIsInstance(plain, list)
        kept = records(_folders._rows(path))
        self.assertEqual(len(kept), 2)
        for name, value in plain[0].items():
            if value is not None and name != "wall_time_s":
                self.assertEqual((kept[0][name], kept[1][name]), (value, value), name)
        self.assertIs(plain[0]["success"], True)
        self.assertIsNone(plain[0]["stay_position_error_m"])


    def test_text_that_looks_like_a_number(self):
        path = FILES / "texts.csv"
        rows = "seed,sea,success,digest,likelihood\n2,5,true,12e4567890123456,\n1,nan,false,0012,\n"
        path.write_text(rows, encoding="utf-8")
        tables = [_folders._by_seed(_folders._rows(path))]
        with mock.patch.object(_folders.pandas, "is_there", lambda: False):
            tables.append(_folders._by_seed(_folders._rows(path)))
        for rows in map(records, tables):
            texts = [(row["seed"], row["sea"], row["digest"], row["success"]) for row in rows]
            self.assertEqual(texts, [(1, "nan", "0012", False), (2, "5", "12e4567890123456", True)])


class Studies(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        file = FILES / "own.toml"
        file.write_text(STUDY, encoding="utf-8")
        cls.out = FILES / "own"
        cls.study = alight.study(file, trials=1, planners=["alight", "mpc-faa"], out=cls.out)

    def test_rows_and_summary_agree(self):
        rows = records(self.study.rows)
        self.assertEqual(len(rows), 4)
        self.assertEqual([s["scenario"] for s in self.study.summary], ["calm", "calm", "slight", "slight"])
        for s in self.study.summary:
            own = [r for r in rows if (r["sea"], r["planner"]) == (s["scenario"], s["planner"])]
            self.assertEqual(len(own), s["trials"])
            self.assertAlmostEqual(own[0]["position_error_m"], s["position_error_m"]["mean"], places=12)

    def test_directory_read_again(self):
        read = alight.read(self.out)
        self.assertIsInstance(read, alight.Study)
        self.assertEqual((read.summary, read.pooled), (self.study.summary, self.study.pooled))

    def test_pool_of_all_scenes(self):
        planners = [(p["scenario"], p["planner"], p["trials"]) for p in self.study.pooled]
        self.assertEqual(planners, [("all", "alight", 2), ("all", "mpc-faa", 2)])
        self.assertEqual(self.study.pooled[1]["against"]["pairs"], 2)
        self.assertIn("alight trial --scenario", self.study.summary[0]["replay"])

    def test_directory_without_its_summary(self):
        with self.assertRaisesRegex(alight.AlightError, "not-there"):
            alight.Study.read(str(FILES / "not-there"))


def cell(wind, from_deg, landed, trials, unsafe, low):
    return {
        "class": "unsafe" if unsafe else "landed" if landed == trials else "rejected",
        "sea_state": 3,
        "wind_mps": wind,
        "from_deg": from_deg,
        "landed": landed,
        "trials": trials,
        "unsafe": unsafe,
        "landed_interval": [low, 1.0],
    }


def drawn_by_hand():
    """An envelope of two winds and four directions, with a limit ahead at 8 m/s and to starboard at 4."""
    cells = [
        cell(4.0, 0.0, 40, 40, 0, 0.91),
        cell(8.0, 0.0, 40, 40, 0, 0.91),
        cell(4.0, 90.0, 40, 40, 0, 0.91),
        cell(8.0, 90.0, 38, 40, 0, 0.83),
        cell(4.0, 180.0, 39, 40, 1, 0.95),
        cell(8.0, 180.0, 40, 40, 0, 0.91),
        cell(4.0, 270.0, 0, 40, 0, 0.0),
        cell(8.0, 270.0, 40, 40, 0, 0.91),
    ]
    grid = {"sea_states": [3], "winds_mps": [4.0, 8.0], "directions": 4, "trials": 40, "seed0": 1}
    return alight.Envelope.of({"hull": "mono-5m", "cells": cells, "rate": 0.9, "too_few": None, "grid": grid})


class Envelopes(unittest.TestCase):
    def test_limit_at_the_first_wind_beyond(self):
        envelope = drawn_by_hand()
        # Unsafe astern at 4 m/s, rejected to port at 4 m/s: landings in stronger winds are not within the limit.
        self.assertEqual([envelope.limit(3, d) for d in (0.0, 90.0, 180.0, 270.0)], [8.0, 4.0, None, None])

    def test_envelope_is_the_programs(self):
        out = FILES / "envelope"
        flown = alight.envelope(winds=[2], directions=1, sea_states=[1], trials=1, out=out)
        self.assertEqual((len(flown.cells), flown.cells[0]["trials"], flown.grid["winds_mps"]), (1, 1, [2.0]))
        self.assertIn("35", flown.too_few)
        self.assertEqual(alight.read(out), flown)


if __name__ == "__main__":
    unittest.main()
