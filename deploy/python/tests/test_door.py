"""Planners and predictors that are functions, and the schemas of their lines."""

import unittest

from source import alight, printed

try:
    import jsonschema
except ImportError:
    jsonschema = None


def validator(name):
    return jsonschema.Draft202012Validator(printed("config", "schema", name)["schema"])


class Door(unittest.TestCase):
    def test_functions_and_schemas(self):
        asked = {"planner": [], "predictor": []}

        def follow(line):
            asked["planner"].append(line)
            return {"common": True}

        def hold(line):
            asked["predictor"].append(line)
            return {"stages": line["forecast"]["stages"]}

        run = alight.trial(seed=5, sea="slight", planner=follow, predictor=hold)
        self.assertTrue(run.outcome["success"], run.outcome["reason"])
        self.assertEqual((run.outcome["planner"], run.outcome["predictor"]), ("follow", "hold"))
        for part, lines in asked.items():
            self.assertGreater(len(lines), 100, part)
            if jsonschema is not None:
                schema = validator(f"{part}-input")
                for line in lines:
                    schema.validate(line)
        plain, held = (alight.trial(seed=5, sea="slight", **flags) for flags in ({}, {"predictor": hold}))
        self.assertEqual(held.outcome["digest"], plain.outcome["digest"])

    @unittest.skipIf(jsonschema is None, "needs jsonschema")
    def test_answers(self):
        planner, predictor = validator("planner-answer"), validator("predictor-answer")
        stage = {name: [0, 0, 0] for name in ("position", "velocity", "acceleration", "euler")}
        for answer, valid in (
            ({"version": 1, "common": True}, True),
            ({"version": 1, "none": "too steep"}, True),
            ({"version": 1, "step_s": 0.1, "stages": [stage] * 2}, True),
            ({"version": 1, "step_s": 0.1, "stages": [stage] * 42}, False),
            ({"version": 1, "plan": []}, False),
            ({"common": True}, False),
        ):
            self.assertEqual(planner.is_valid(answer), valid, answer)
        self.assertTrue(predictor.is_valid({"version": 1, "none": "no idea"}))

    def test_exception_in_a_function(self):
        def broken(line):
            raise ValueError("no plan today")

        with self.assertRaisesRegex(ValueError, "no plan today"):
            alight.trial(seed=5, sea="calm", planner=broken)


if __name__ == "__main__":
    unittest.main()
