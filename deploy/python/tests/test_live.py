"""A landing of all processes, read while it flies: by the module, by the documents' Zenoh loop, and as ROS 2 messages."""

import importlib.util
import itertools
import os
import re
import socket
import subprocess
import sys
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from source import alight, printed

from alight import _live

ROOT = Path(__file__).resolve().parents[3]
INSTANCE = f"live-{os.getpid()}"
LANDING = ["land", "--sea", "calm", "--seed", "1", "--warm-up", "20", "--transport", "udp", "--instance", INSTANCE]
WAIT_S = 60.0
PIPES = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
HAS_ZENOH = importlib.util.find_spec("zenoh") and (ROOT / "deploy/docs").exists()


def ended(process):
    process.terminate()
    process.communicate()


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class Landing(unittest.TestCase):
    """The tests run one after another in one landing."""

    @classmethod
    def setUpClass(cls):
        cls.land = subprocess.Popen([alight.program(), *LANDING], **PIPES)
        cls.addClassCleanup(ended, cls.land)
        pool = ThreadPoolExecutor(1)
        cls.addClassCleanup(pool.shutdown)
        cls.read = pool.submit(lambda: list(alight.live(INSTANCE, timeout_s=WAIT_S)))

    @unittest.skipUnless(HAS_ZENOH, "needs eclipse-zenoh")
    def test_1_loop_of_the_documents(self):
        until = time.monotonic() + WAIT_S
        config = Path(os.environ.get("TMPDIR", "/tmp")) / f"alight-{INSTANCE}/vessel.toml"
        while not config.exists() and time.monotonic() < until:
            time.sleep(0.2)
        (endpoint,) = re.findall(r'"(udp/127\.0\.0\.1:\d+)"', config.read_text(encoding="utf-8"))
        page = (ROOT / "deploy/docs/radio.md").read_text(encoding="utf-8")
        (code,) = re.findall(r"^```python\n(import zenoh\n.*?)^```$", page, re.M | re.S)
        code = code.replace("udp/192.168.7.1:7447", endpoint)
        lines = []
        # Zenoh's client ends at once while nobody listens.
        while not lines and time.monotonic() < until:
            loop = subprocess.Popen([sys.executable, "-u", "-c", code], **PIPES)
            self.addCleanup(ended, loop)
            timer = threading.Timer(WAIT_S, loop.kill)
            timer.start()
            self.addCleanup(timer.cancel)
            lines = list(itertools.takewhile(lambda line: "octet-stream" not in line, loop.stdout))
        self.assertEqual((len(lines), loop.poll()), (11, None), "schemas, and then a sample")

    @unittest.skipUnless(HAS_ZENOH and importlib.util.find_spec("rosbags"), "needs eclipse-zenoh and rosbags")
    def test_2_messages_of_ros_by_another_library(self):
        import zenoh
        from rosbags.typesys import Stores, get_typestore

        store, endpoint = get_typestore(Stores.ROS2_JAZZY), f"tcp/127.0.0.1:{free_port()}"
        node = [alight.program(), "ros2", "--instance", INSTANCE, "--listen", endpoint]
        self.addCleanup(ended, subprocess.Popen(node, **PIPES))
        config = zenoh.Config.from_json5(f'{{mode: "peer", connect: {{endpoints: ["{endpoint}"], timeout_ms: 60000}}}}')
        samples, until = {}, time.monotonic() + WAIT_S
        with zenoh.open(config) as session:
            add = lambda sample: samples.setdefault(str(sample.key_expr), bytes(sample.payload))  # noqa: E731
            subscriber = session.declare_subscriber("0/**", add)
            while len(samples) < 7 and time.monotonic() < until:
                time.sleep(0.2)
            subscriber.undeclare()
        topics = set()
        for key, raw in samples.items():
            _, *name, kind, hashed = key.split("/")
            topics.add("/" + "/".join(name))
            kind = kind.replace("::dds_::", "/").rstrip("_").replace("::", "/")
            self.assertEqual(hashed, store.hash_rihs01(kind))
            self.assertEqual(bytes(store.serialize_cdr(store.deserialize_cdr(raw, kind), kind)), raw, kind)
        own = {f"/alight/drone_1/{topic}" for topic in ("odometry", "deck/odometry", "deck/pose", "deck/marker")}
        self.assertEqual(topics, own | {"/tf", "/tf_static", "/diagnostics"})
        shown = re.findall(r"Value: (/[^,]*)", (ROOT / "deploy/examples/ros2/alight.rviz").read_text(encoding="utf-8"))
        self.assertLess(set(shown), own)

    def test_3_messages_until_the_landing_ends(self):
        found = {message.topic: message for message in self.read.result(5 * WAIT_S)}
        self.assertEqual(found["/mission"].values["state"] == "Landed", self.land.wait(WAIT_S) == 0)
        read = {"/mission", "/plan", "/pilot/set_point", "/deck/forecast", "/drone/odometry", "/link", "/tf/drone", "/tf/deck"}
        self.assertLessEqual(read, found.keys())
        self.assertFalse([topic for topic in found if topic.startswith("/points")])
        odometry = found["/drone/odometry"]
        self.assertGreater(odometry.time_s, 1.7e9)
        self.assertEqual([len(odometry.values[name]) for name in ("position_m", "quaternion_wxyz")], [3, 4])
        self.assertFalse(printed("status", "--instance", INSTANCE)["running"])


class Layouts(unittest.TestCase):
    @unittest.skipUnless((ROOT / "deploy/scripts").exists() and sys.version_info >= (3, 10), "needs checkout and Python 3.10")
    def test_structures_have_the_sizes_of_the_messages(self):
        script = [sys.executable, ROOT / "deploy/scripts/iceoryx2", alight.program(), "layouts"]
        done = subprocess.run(script, **PIPES)
        self.assertEqual(done.returncode, 0, done.stdout)
        for message in ("DroneState", "DeckForecast", "MissionState", "Plan", "SetPoint"):
            self.assertRegex(done.stdout, f": {message}, [0-9]+ bytes")


class Refusals(unittest.TestCase):
    def test_nothing_runs(self):
        for where, why in (("live-none", "alight land"), (f"ws://127.0.0.1:{free_port()}", "refused")):
            with self.assertRaisesRegex(alight.AlightError, why):
                next(alight.live(where, timeout_s=0.1))

    def test_server_of_something_else(self):
        upgrade = b"HTTP/1.1 101 Switching Protocols\r\n\r\n"
        for sent, why in (
            (b"HTTP/1.1 400 Bad Request\r\n\r\n", "foxglove.sdk.v1"),
            (b"HTTP/1.1 101 ", "closed"),
            (upgrade + b"\x02\x00", "in parts"),
            (upgrade + b"\x82\x7f\xff" + bytes(7), "more than"),
            (upgrade + b'\x81\x22{"op":"advertise","channels":[ ] }', "no /mission in live data"),
        ):
            here, there = socket.socketpair()
            with self.subTest(sent=sent), here, there, self.assertRaisesRegex(Exception, why):
                there.sendall(sent)
                there.shutdown(socket.SHUT_WR)
                list(_live._messages(_live._Client(here, "here"), {"/mission"}, None, 5.0))


if __name__ == "__main__":
    unittest.main()
