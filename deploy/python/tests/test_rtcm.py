"""RTCM 3 of a moving base, made by another library, as `alight check` finds it at a port of the vessel."""

import importlib.util
import re
import socket
import threading
import unittest

from source import FILES, printed


@unittest.skipUnless(importlib.util.find_spec("pyrtcm"), "needs pyrtcm")
class MovingBase(unittest.TestCase):
    # Bytes of the payload of each message: those of MSM without a satellite.
    BYTES = {"1005": 19, "1077": 22, "1087": 22, "1230": 4, "4072.0": 10}

    def frame(self, name):
        from pyrtcm import RTCMMessage, RTCMReader

        number, _, subtype = name.partition(".")
        begin = int(number) << 12 | int(subtype or 0)
        payload = begin << 8 * self.BYTES[name] - 24
        raw = RTCMMessage(payload=payload.to_bytes(self.BYTES[name], "big")).serialize()
        self.assertEqual(RTCMReader.parse(raw).identity, number)
        return raw

    def found(self, frames):
        """Findings with their remedies on a source at whose port these come twice a second."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        path = FILES / "base.toml"
        source = f'name = "base"\nconnect = "udpin://127.0.0.1:{port}"\nformat = "rtcm"\n'
        path.write_text(f"vessel_id = 1\n[[sensor.sources]]\n{source}", encoding="utf-8")
        over = threading.Event()

        def send():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
                while not over.wait(0.5):
                    for frame in frames:
                        out.sendto(frame, ("127.0.0.1", port))

        sender = threading.Thread(target=send)
        sender.start()
        try:
            findings = printed("check", "--config", path)["findings"]
        finally:
            over.set()
            sender.join()
        return {f["found"]: f["remedy"] for f in findings if f["found"].startswith("base")}

    def test_numbers_and_damaged_frames(self):
        names = [name for name in self.BYTES if name != "1005"]
        frames = [self.frame(name) for name in names]
        damaged = bytearray(frames[1])
        damaged[10] ^= 1
        findings = self.found([*frames, bytes(damaged)])
        self.assertEqual(set(findings.values()), {""}, findings)
        (text,) = [text for text in findings if text.startswith("base: RTCM: ")]
        self.assertEqual(re.findall(r"(\d+(?:\.\d)?) (?:[\d.]+ Hz|once)", text), sorted(names, key=float))
        self.assertRegex(text, r"; \d+ damaged$")

    def test_place_of_a_standing_base_next_to_a_moving_one(self):
        findings = self.found([self.frame(name) for name in self.BYTES])
        (remedy,) = [findings[text] for text in findings if "1005 or 1006 next to 4072.0" in text]
        self.assertIn("switch 1005 and 1006 off", remedy)

    def test_base_without_its_place(self):
        findings = self.found([self.frame("1087")])
        (remedy,) = [findings[text] for text in findings if "RTCM lacks the base position" in text]
        self.assertIn("Moving base", remedy)
        self.assertTrue(any("without its biases (1230)" in text for text in findings), findings)


if __name__ == "__main__":
    unittest.main()
