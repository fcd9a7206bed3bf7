"""Code that the page and the notebook show runs unchanged, except for fewer landings."""

import contextlib
import json
import os
import pathlib
import re
import runpy
import tempfile
import unittest

from source import alight

ROOT = pathlib.Path(__file__).resolve().parents[3]
PAGE = ROOT / "deploy/docs/recordings.md"
NOTEBOOK = ROOT / "deploy/examples/python/landing.ipynb"


def shortened(code):
    """The same code with one landing in place of each number, and an envelope of one cell."""
    code = re.sub(r"\btrials\(\d+", "trials(1", code)
    code = re.sub(r"\btrials=\d+", "trials=1", code)
    code = code.replace(', "mpc-faa"]', "]")
    code = code.replace("quick=True", "winds=[2], directions=1, sea_states=[3], trials=1")
    # A line that only a notebook accepts.
    return re.sub(r"^%.*$", "", code, flags=re.M)


@contextlib.contextmanager
def elsewhere():
    """Runs in a temporary directory."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as directory:
        os.chdir(directory)
        try:
            yield pathlib.Path(directory)
        finally:
            os.chdir(before)


def has_all():
    try:
        import matplotlib  # noqa: F401
        import pandas  # noqa: F401
    except ImportError:
        return False
    return PAGE.exists()


class Pictures(unittest.TestCase):
    @unittest.skipUnless(PAGE.exists(), "the documents lie in the checkout")
    def test_script_draws_what_the_pages_show(self):
        pictures = runpy.run_path(str(ROOT / "deploy/scripts/pictures"))["PICTURES"]
        shown = set()
        for page in [ROOT / "README.md", *ROOT.glob("deploy/**/*.md")]:
            for link in re.findall(r"^!\[[^]]*\]\(([^)]+\.svg)\)", page.read_text(encoding="utf-8"), re.M):
                shown.add((page.parent / link).resolve().relative_to(ROOT).as_posix())
        self.assertEqual(shown, set(pictures))

    @unittest.skipUnless(PAGE.exists(), "the documents lie in the checkout")
    def test_readme_has_the_prediction_of_the_examples(self):
        readme, page = (ROOT / path for path in ("README.md", "deploy/docs/examples.md"))
        printed = r"roll +deg +modes +\S+ +(\S+).*?held +\S+ +(\S+)"
        ahead, held = re.search(printed, page.read_text(encoding="utf-8"), re.S).groups()
        sentence = f"to {ahead} deg rms; holding the present roll is {held} deg off"
        self.assertIn(sentence, " ".join(readme.read_text(encoding="utf-8").split()))


@unittest.skipUnless(has_all(), "the documents use pandas and matplotlib, and lie in the checkout")
class Documents(unittest.TestCase):
    def test_page(self):
        blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
        self.assertEqual(len(blocks), 3)
        names = {}
        with elsewhere() as directory:
            for block in blocks:
                exec(compile(shortened(block), str(PAGE), "exec"), names)
            written = {path.name for path in directory.iterdir()}
        self.assertLessEqual({"landing.pdf", "table2.svg", "envelope.svg", "landing.mcap"}, written)
        self.assertIsInstance(names["study"], alight.Study)

    def test_page_names_what_there_is(self):
        text = PAGE.read_text(encoding="utf-8")
        for name in re.findall(r"\balight\.([a-zA-Z]\w*)", re.sub(r"alight\.plots\.\w+", "", text)):
            self.assertIn(name, alight.__all__)

    def test_notebook(self):
        notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
        self.assertEqual((notebook["nbformat"], notebook["nbformat_minor"]), (4, 5))
        cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        for cell in cells:
            # Outputs would be those of one version of the program.
            self.assertEqual((cell["outputs"], cell["execution_count"]), ([], None))
        names = {}
        with elsewhere():
            for cell in cells:
                exec(compile(shortened("".join(cell["source"])), str(NOTEBOOK), "exec"), names)
        self.assertTrue(names["run"].outcome["success"])


if __name__ == "__main__":
    unittest.main()
