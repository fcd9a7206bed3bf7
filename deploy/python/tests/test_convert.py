"""Recordings of other programs become the CSV that the program reads: quantities, units, axes, times, and rejected input."""

import contextlib
import csv
import importlib.util
import io
import math
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import unittest
import unittest.mock
import zlib

from source import alight

from alight.convert import convert
from alight.convert.__main__ import main

ROOT = pathlib.Path(__file__).resolve().parents[3]
FIELD = ROOT.parent / "shared/data/field"
READER = ROOT / "usv-side/src/log/table.rs"


def has(*modules):
    return all(importlib.util.find_spec(module) for module in modules)


def needs(*modules):
    return unittest.skipUnless(has("pandas", *modules), f"needs pandas {' '.join(modules)}")


def exact(path):
    """Rows of a CSV as the program's strict reader accepts them: known columns, numbers or empty cells, increasing times."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))
    header, rows = lines[0], []
    assert header[0] == "t_s" and len(set(header)) == len(header) > 1, header
    for line in lines[1:]:
        assert len(line) == len(header), line
        rows.append({name: float(cell) for name, cell in zip(header, line) if cell})
    times = [row["t_s"] for row in rows]
    assert times == sorted(times) and all(len(row) > 1 for row in rows)
    return rows


def of(rows, name):
    """Times and values of a column."""
    return [(row["t_s"], row[name]) for row in rows if name in row]


class Case(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.directory = pathlib.Path(directory.name)

    def file(self, name, content):
        path = self.directory / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def converted(self, path, **options):
        """Rows of the CSV, and the notes."""
        out = self.directory / "out.csv"
        done = convert(path, out, **options)
        return exact(out), "\n".join(done.notes)

    def refused(self, path, *parts):
        out, err = self.directory / "refused.csv", io.StringIO()
        with contextlib.redirect_stderr(err):
            code = main([str(path), "-o", str(out)])
        self.assertEqual(code, 2, err.getvalue())
        for part in parts:
            self.assertIn(part, err.getvalue())
        self.assertFalse(out.exists())

    def near(self, a, b, tolerance=1e-6):
        self.assertLess(abs(a - b), tolerance, f"{a} {b}")


@needs()
class Tables(Case):
    def rows(self, line):
        return "".join(line(0.1 * k) for k in range(120))

    def test_tables_of_many_programs(self):
        comma = lambda t: f"{t:.1f}".replace(".", ",")
        germany = "\ufeffThe time, roll and pitch of a boat\r\nBoot;Kai\r\nTime [s];Roll [°];Pitch [°];Heave [cm]\r\n"
        tables = {
            "decimal comma": germany + self.rows(lambda t: f"{comma(t)};1,5;-2;25,0\r\n"),
            "semicolons": 'sep=;\n"t_s";"roll_deg";"pitch_deg";"heave_m"\n'
            + self.rows(lambda t: f'"{t:.1f}";"1.5";"-2";"0.25"\n;;;\n'),
            "Temp": "Date Time,Roll (rad),Pitch (rad),Heave (ft),Temp\n"
            + self.rows(lambda t: f"5/6/2026 1:02:{t:04.1f} PM,0.0261799388,-0.0349065850,0.8202099738,21\n"),
            "units are those of line 2": "UTC\tRoll\tPitch\tHeave\n\t(deg)\t(deg)\t(m)\n"
            + self.rows(lambda t: f"2026-05-06T23:59:{t + 40:04.1f}Z\t1.5\t-2.0\t0.25\n"),
            "spaces": "# t_s roll_deg pitch_deg heave_m\n" + self.rows(lambda t: f"{t:.1f}  1.5 -2.0   0.25\n"),
            "milliseconds since 1970": "timestamp,roll_deg,pitch_deg,heave_m\n"
            + self.rows(lambda t: f"{1.78e12 + 1e3 * t:.0f},1.5,-2,0.25\n"),
            "vertical bars": "t_s|roll_deg|pitch_deg|heave_m\n" + self.rows(lambda t: f"{t:.1f}|1.5|-2|0.25\n"),
        }
        tables = {note: text.encode() for note, text in tables.items()}
        text = "t_s;roll_deg;pitch_deg;heave_m\r\n" + self.rows(lambda t: f"{t:.1f};1.5;-2;0.25\r\n")
        tables["separated by semicolons"] = b"\xff\xfe" + text.encode("utf-16-le")
        text = "t_s,Roll [°],Pitch [°],heave_m\n" + self.rows(lambda t: f"{t:.1f},1.5,-2,0.25\n")
        tables["Latin-1"] = text.encode("latin-1")
        for note, text in tables.items():
            with self.subTest(note):
                rows, notes = self.converted(self.file("boat.txt", text))
                self.assertEqual(len(rows), 120)
                self.assertIn(note, notes)
                for k, row in enumerate(rows):
                    self.near(row["t_s"] - rows[0]["t_s"], 0.1 * k, 1e-3)
                    self.near(row["roll_deg"], 1.5)
                    self.near(row["pitch_deg"], -2.0)
                    self.near(row["heave_m"], 0.25)

    def test_tables_of_unclear_content(self):
        rows = lambda line: "".join(line.replace("T", str(k)) for k in range(60))
        for text, message in (
            ("time,roll,pitch,heave\n" + rows("0.T,0,3,0\n"), "`roll_deg`"),
            ("time,roll,pitch,heave\n" + rows("0.T,0,3,0\n"), "`t_s` is missing"),
            ("time,roll_deg,pitch_deg\n" + rows("T,0,3\n"), "call it t_s, time_ms or time_us"),
            ("t_s;roll_deg;pitch_deg\n" + rows("T;0,5;3.5\n"), "decimal comma in line 2"),
            ("t_s,roll_deg,pitch_deg\n" + rows("T,0,5,3\n"), "need quotes"),
            ("t_s,roll_deg,pitch_deg\n" + rows("yesterday T:00,0,3\n"), "no time"),
            ("UTC,roll_deg\n5/6/2026 23:59:59,1\n5/7/2026 0:00:00,1\n", "year-month-day"),
            ("t_s,roll_deg,Roll [rad]\n0,1,1\n", "`roll_deg` appears twice"),
            ("t_s,roll_deg,pitch_deg\n" + rows("T,x,3\n"), "line 2: roll_deg is `x`, not a number"),
            ("t_s,roll_deg,pitch_deg\n" + rows("T,200,3\n"), "check units"),
            ("a,b\n1,2\n", "line 1: column `t_s` is missing"),
        ):
            with self.subTest(message):
                self.refused(self.file("boat.txt", text), message)

    def test_rows_that_cannot_be_read(self):
        text = "t_s,roll_deg,pitch_deg\n" + self.rows(lambda t: f"{t:.1f},1,2\n") + "\n# calm\n12.0,x,2\n12.1,nan,2\n12.2,1,999\n12.3,1"
        rows, notes = self.converted(self.file("boat.txt", text))
        self.assertEqual(len(rows), 121)
        self.assertIn("line 124 and 0 more rows left out: roll_deg is `x`", notes)
        self.assertIn("1 rows with values that no boat has", notes)
        self.assertIn("line 127 and 0 more rows with too few values", notes)

    def test_names_of_columns(self):
        from alight.convert._names import KNOWN, name

        for text, want in (
            ("Time [s]", ("t_s", 1.0)),
            ("timestamp_ms", ("t_s", 1e-3)),
            ("Time (UTC)", ("t_s", None)),
            ("Roll Angle [deg]", ("roll_deg", 1.0)),
            ("HeadingTrue_deg", ("heading_deg", 1.0)),
            ("Heave [cm]", ("heave_m", 1e-2)),
            ("Gyr_X [deg/s]", ("gyro_x_radps", math.pi / 180.0)),
            ("Acc_Z (m/s²)", ("accel_z_mps2", 1.0)),
            ("accel_z_m_s2", ("accel_z_mps2", 1.0)),
            ("Acc_Y [m/s^2]", ("accel_y_mps2", 1.0)),
            ("vel_n_m_s", ("north_mps", 1.0)),
            ("SOG (kn)", ("sog_mps", 1852.0 / 3600.0)),
            ("roll", ("roll_deg", None)),
            ("Heave [counts]", ("heave_m", None)),
            *((text, None) for text in ("heave_sd_m", "roll_raw", "yaw_deg", "north_m", "")),
            *((own, (own, 1.0)) for own, _, _ in KNOWN),
        ):
            self.assertEqual(name(text), want, text)

    def test_clocks(self):
        from alight.convert._times import clock, resolve

        for text in (
            "12:00:00.5",
            "12:00:00,5",
            "2026-05-20T12:00:00.500Z",
            "2026-05-20 14:00:00.5+02:00",
            "2026/05/20 12:00:00.5 UTC",
            "20.05.2026 12:00:00.5",
            "5/20/2026 12:00:00.5 PM",
            "2026-05-20T08:30:00.5-0330",
        ):
            self.assertEqual(clock(text).of_day, 43_200.5, text)
        for text in ("12", "25:00:00", "12:60:00", "13:00:00 PM", "2026-13-01 12:00:00", "20/05/26 12:00:00", "12:00:00:01", ":", "é:ü"):
            self.assertIsNone(clock(text), text)
        for texts, step in (
            (("2026-12-31 23:59:59", "2027-01-01 00:00:00"), 1.0),
            (("23:59:59", "00:00:00"), 1.0),
            (("30/6/2026 23:59:59", "1/7/2026 0:00:00"), 1.0),
            (("6/30/2026 23:59:59", "7/1/2026 0:00:00"), 1.0),
            (("5/6/2026 1:00:00", "5/6/2026 1:00:01"), 1.0),
        ):
            a, b = resolve([clock(text) for text in texts])
            self.assertEqual(b - a, step, texts)

    def test_stamps_coarser_than_the_rows(self):
        from alight.convert._times import spread

        # 10 Hz starting in the middle of a second; 15 Hz in tenths; a clock of 9.7 Hz.
        for hz, step, begin in ((10.0, 1.0, 3.45), (15.0, 0.1, 0.0), (9.7, 1.0, 0.2)):
            truth = [begin + k / hz for k in range(600)]
            t, keep, note = spread([math.floor((at + 1e-9) / step) * step for at in truth])
            self.assertIn("spread evenly", note)
            self.assertTrue(keep.all())
            for a, b in zip(t, truth):
                self.near(a, b, 0.3 / hz + 0.05 * step)
            for a, b in zip(t, t[1:]):
                self.near(b - a, 1.0 / hz, 0.01 / hz)
        # A stamp of three rows among stamps of ten is omitted; an irregular number is an error.
        t, keep, note = spread([k // 10 for k in range(600) if not 200 <= k < 207])
        self.assertIn("3 rows", note)
        self.assertEqual(keep.sum(), 590)
        with self.assertRaisesRegex(ValueError, "fractions"):
            spread([s for s in range(60) for _ in range(1 + s * s % 17)])
        for repeat in (10**9, 7):
            t = [0.1 * (k - (k % repeat == 1)) for k in range(300)]
            self.assertIsNone(spread(t)[2])

    def test_speed_and_course(self):
        text = "t_s,SOG [kn],COG [deg]\n0,3.6,90\n1,0.1,\n2,5,\n"
        rows, notes = self.converted(self.file("boat.txt", text))
        self.assertEqual(len(rows), 2)
        self.near(rows[0]["east_mps"], 1.852)
        self.near(rows[0]["north_mps"], 0.0)
        self.assertIn("1 speeds or courses", notes)

    def test_quantities_on_rows_of_their_own(self):
        path = ROOT / "tests/tests/flights/data/figure-of-eight.csv"
        if not path.exists():
            self.skipTest("the recording lies in the checkout")
        rows, notes = self.converted(path)
        self.assertEqual(rows, exact(path))
        self.assertEqual(notes, "")

    @unittest.skipUnless(READER.exists(), "the reader lies in the checkout")
    def test_columns_are_those_of_the_program(self):
        from alight.convert._frame import LIMITS

        found = re.findall(r'Quantity::\w+, "(\w+)", ([0-9.e]+)\)', READER.read_text(encoding="utf-8"))
        self.assertEqual({name: float(limit) for name, limit in found}, LIMITS)
        self.assertEqual([name for name, _ in found], list(LIMITS))


@needs()
@unittest.skipUnless(FIELD.exists(), "needs ../shared/data/field next to the project")
class FieldTables(Case):
    def test_separators_remarks_and_quotes(self):
        plain = exact(FIELD / "whole-second-stamps/true-stamps.csv")
        self.assertEqual(len(plain), 3000)
        boats = [self.converted(FIELD / name)[0] for name in ("foreign-csv/semicolon.csv", "quoted-csv-header/boat.csv")]
        self.assertEqual(boats[0], boats[1])
        self.assertEqual(self.converted(FIELD / "foreign-csv/comment.csv")[0], boats[0][:99])
        self.refused(FIELD / "foreign-csv/time_named.csv", "`t_s` is missing", "call it `roll_deg`", "call it `heave_m`")

    def test_whole_second_stamps(self):
        rows, notes = self.converted(FIELD / "whole-second-stamps/boat.csv")
        truth = exact(FIELD / "whole-second-stamps/true-stamps.csv")
        self.assertIn("10 rows at one time", notes)
        self.assertEqual(len(rows), len(truth))
        for a, b in zip(rows, truth):
            self.near(a["t_s"], b["t_s"], 0.02)
            self.assertEqual(a["roll_deg"], b["roll_deg"])


class Refusals(Case):
    def test_files_of_no_use(self):
        self.refused(self.file("empty.bin", b""), "empty")
        self.refused(self.file("boat.csv.gz", b"\x1f\x8b\x08\0rest"), "first gunzip")
        self.refused(self.file("boat.nmea", b"$GPGGA,120000,,,,,0,,,,,,,,*00\r\n"), "alight estimate")
        self.refused(self.file("boat.ubx", b"\xb5\x62\x01\x07\x5c\0"), "a log of UBX", "alight estimate")
        for text, name in (
            (b"$IIXDR,A,1.0,D,PTCH,A,2.0,D,ROLL*00\r\n", "NMEA 0183"),
            (b"(1779278400.000000) can0 0DF11923#00FF7FAA00DC00FF\n", "NMEA 2000"),
            (b"2026-05-20T12:00:00.000Z,3,127257,35,255,8,00,ff,7f,aa,00,dc,00,ff\n", "NMEA 2000"),
            (b"12:00:00.000 R 0DF11923 00 FF 7F AA 00 DC 00 FF\r\n", "NMEA 2000"),
            (b'{"updates":[{"$source":"n2k.35","values":[]}]}\n', "Signal K"),
        ):
            self.refused(self.file("boat.log", text), f"a log of {name}", "alight estimate")
        self.refused(self.directory / "missing.csv", "missing.csv", "check the paths")
        path = self.file("own.csv", "t_s,roll_deg,pitch_deg\n0,1,2\n1,1,2\n")
        with contextlib.redirect_stderr(io.StringIO()) as err:
            self.assertEqual(main([str(path), "-o", str(path)]), 2)
        self.assertIn("would replace", err.getvalue())

    def test_library_that_is_missing(self):
        from alight import _lazy

        missing = unittest.mock.patch("importlib.import_module", side_effect=ImportError(name="pyulog"))
        with missing, self.assertRaisesRegex(ImportError, r"pip install pyulog \(or the wheel with its extra \[convert\]\)"):
            _lazy.pyulog.ULog


def ulog(seconds):
    """A rolling boat: inertial samples at 100 Hz, attitude at 50 Hz, GPS at 5 Hz."""
    message = lambda kind, payload: struct.pack("<HB", len(payload), ord(kind)) + payload
    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 7) + message("B", bytes(40))
    formats = (
        "sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
        "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint8_t clip;",
        "vehicle_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;uint8_t reset;",
        "sensor_gps:uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_ellipsoid_m;float eph;float epv;"
        "float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;float heading;uint8_t fix_type;",
    )
    for k, text in enumerate(formats):
        out += message("F", text.encode())
    for k, text in enumerate(formats):
        out += message("A", struct.pack("<BH", 0, k) + text.split(":")[0].encode())
    for k in range(100 * seconds):
        t, us = 0.01 * k, 5_000_000 + 10_000 * k
        roll, rate = 0.1 * math.sin(t), 0.1 * math.cos(t)
        out += message("D", struct.pack("<HQ3fIi3fB", 0, us, rate, 0, 0, 0, 0, 0, -9.8 * roll, -9.8, 0))
        if k % 2 == 0:
            out += message("D", struct.pack("<HQQ4fB", 1, us, us, math.cos(roll / 2), math.sin(roll / 2), 0, 0, 0))
        if k % 20 == 0:
            out += message("D", struct.pack("<HQ3d6fB", 2, us, 50.0, 14.5, 255.0, 1, 2, 0, 1, 0, math.nan, 3))
    return out


@needs("pyulog")
class Ulog(Case):
    def test_log_of_a_boat(self):
        rows, notes = self.converted(self.file("boat.ulg", ulog(20)))
        names = ("gyro_x_radps", "roll_deg", "heading_deg", "latitude_deg")
        self.assertEqual([len(of(rows, name)) for name in names], [2000, 500, 100, 100])
        for t, roll in of(rows, "roll_deg"):
            self.near(roll, math.degrees(0.1 * math.sin(t - 5.0)), 1e-4)
        fix = next(row for row in rows if "latitude_deg" in row)
        self.assertEqual((fix["latitude_deg"], fix["altitude_m"], fix["east_mps"]), (50.0, 255.0, 1.0))
        self.near(rows[0]["accel_z_mps2"], -9.8)
        self.assertNotIn("damaged", notes)

    def test_damaged_log(self):
        self.refused(self.file("cut.ulg", ulog(1)[:40]), "ULog")
        whole = ulog(20)
        rows, _ = self.converted(self.file("cut.ulg", whole[: len(whole) // 2]))
        self.assertGreater(len(rows), 700)


@needs("pymavlink")
class Mavlink(Case):
    def tlog(self):
        from pymavlink.dialects.v20 import ardupilotmega as m

        out = b""
        for system, seconds in ((1, 20), (2, 2)):
            link = m.MAVLink(None, srcSystem=system, srcComponent=1)
            for k in range(10 * seconds):
                t = 0.1 * k
                roll, ms = 0.1 * math.sin(t), 5000 + 100 * k
                messages = [
                    link.attitude_encode(ms, roll, -0.05, -0.5, 0.1 * math.cos(t), 0, 0),
                    link.raw_imu_encode(1000 * ms, 0, 0, -1000, 0, 0, 0, 0, 0, 0),
                ]
                if k % 2 == 0:
                    gps = (1000 * ms, 3, 500_000_000, 145_000_000, 255_000, 100, 100, 200, 9000, 10)
                    messages.append(link.gps_raw_int_encode(*gps))
                for message in messages:
                    # The link is up to half a second late.
                    stamp = 1_779_278_400_000_000 + 100_000 * k + 50_000 * (k * 7 % 10)
                    out += struct.pack(">Q", stamp) + message.pack(link)
        return out

    def test_telemetry_log(self):
        rows, notes = self.converted(self.file("boat.tlog", self.tlog()))
        rolls = of(rows, "roll_deg")
        self.assertEqual([len(rolls), len(of(rows, "latitude_deg")), len(of(rows, "gyro_x_radps"))], [200, 100, 200])
        for t, roll in rolls:
            self.near(roll, math.degrees(0.1 * math.sin(t - 5.0)), 1e-4)
        self.near(of(rows, "heading_deg")[0][1], 360.0 - math.degrees(0.5), 1e-4)
        fix = next(row for row in rows if "latitude_deg" in row)
        self.near(fix["east_mps"], 2.0)
        self.near(fix["longitude_deg"], 14.5)
        self.assertNotIn("accel_x_mps2", rows[0])
        for part in ("RAW_IMU at 10.0 Hz is left out", "left out: 2", "mean sea level"):
            self.assertIn(part, notes)
        rows, _ = self.converted(self.file("without-suffix", self.tlog()), system=2)
        self.assertEqual(len(of(rows, "roll_deg")), 20)
        with self.assertRaisesRegex(alight.AlightError, "no system 9.*1, 2"):
            convert(self.file("boat.tlog", self.tlog()), self.directory / "x.csv", system=9)

    def dataflash(self):
        formats = {
            128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
            1: ("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "<QB6f"),
            2: ("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw", "<Q3f"),
            3: ("GPS", "QBBIHLLffff", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs,VZ", "<QBBIHii4f"),
        }
        message = lambda kind, *values: b"\xa3\x95" + bytes([kind]) + struct.pack(formats[kind][3], *values)
        out = b""
        for kind, (name, types, columns, layout) in formats.items():
            out += message(128, kind, 3 + struct.calcsize(layout), name.encode(), types.encode(), columns.encode())
        for k in range(1000):
            us, roll = 5_000_000 + 20_000 * k, 5.0 * math.sin(0.02 * k)
            out += message(1, us, 0, 0.1, 0, 0, 0, 0, -9.8) + message(1, us, 1, 9, 9, 9, 9, 9, 9)
            if k % 2 == 0:
                out += message(2, us, roll, -2.0, 350.0)
            if k % 10 == 0:
                out += message(3, us, 0, 3, us // 1000, 2400, 500_000_000, 145_000_000, 210.0, 2.0, 180.0, 0.5)
        return out

    def test_dataflash_log(self):
        rows, notes = self.converted(self.file("00000001.log", self.dataflash()))
        names = ("accel_z_mps2", "roll_deg", "heading_deg", "latitude_deg")
        self.assertEqual([len(of(rows, name)) for name in names], [1000, 500, 100, 100])
        self.assertTrue(all(abs(v) < 1 for _, v in of(rows, "gyro_x_radps")))
        for t, roll in of(rows, "roll_deg"):
            self.near(roll, 5.0 * math.sin(t - 5.0), 1e-4)
        fix = next(row for row in rows if "latitude_deg" in row)
        self.near(fix["latitude_deg"], 50.0)
        self.near(fix["north_mps"], -2.0)
        self.near(fix["down_mps"], 0.5)
        self.assertIn("mean sea level", notes)
        self.refused(self.file("cut.bin", self.dataflash()[:200]), "DataFlash without anything")


@needs("rosbags")
class Bags(Case):
    def write(self, version):
        """A boat that heads east with its bow up and its starboard side down, 3 s."""
        import numpy as np
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE if version == 2 else Stores.ROS1_NOETIC)
        t = store.types
        roll, pitch = math.radians(10.0), math.radians(-5.0)
        half = lambda a: (math.cos(a / 2), math.sin(a / 2))
        (cr, sr), (cp, sp) = half(roll), half(pitch)
        q = t["geometry_msgs/msg/Quaternion"](x=sr * cp, y=cr * sp, z=-sr * sp, w=cr * cp)
        vector = t["geometry_msgs/msg/Vector3"]
        none, zero = np.zeros(36), np.zeros(9)
        messages = []
        for k in range(150):
            stamp = t["builtin_interfaces/msg/Time"](sec=1_779_278_400 + k // 50, nanosec=k % 50 * 20_000_000)
            sequence = {"seq": k} if version == 1 else {}
            header = t["std_msgs/msg/Header"](stamp=stamp, frame_id="base", **sequence)
            ns = stamp.sec * 10**9 + stamp.nanosec
            imu = t["sensor_msgs/msg/Imu"](
                header=header, orientation=q, orientation_covariance=zero, angular_velocity=vector(x=0.1, y=0.2, z=0.3),
                angular_velocity_covariance=zero, linear_acceleration=vector(x=0.5, y=0.25, z=9.8), linear_acceleration_covariance=zero,
            )
            messages.append(("/imu", "sensor_msgs/msg/Imu", ns, imu))
            if k % 10:
                continue
            status = t["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
            fix = t["sensor_msgs/msg/NavSatFix"](
                header=header, status=status, latitude=50.0, longitude=14.5, altitude=255.0, position_covariance=zero,
                position_covariance_type=0,
            )
            messages.append(("/fix", "sensor_msgs/msg/NavSatFix", ns, fix))
            twist = t["geometry_msgs/msg/Twist"](linear=vector(x=2.0, y=1.0, z=0.5), angular=vector(x=0.0, y=0.0, z=0.0))
            velocity = t["geometry_msgs/msg/TwistStamped"](header=header, twist=twist)
            messages.append(("/vel", "geometry_msgs/msg/TwistStamped", ns, velocity))
            pose = t["geometry_msgs/msg/Pose"](position=t["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0), orientation=q)
            odometry = t["nav_msgs/msg/Odometry"](
                header=header, child_frame_id="base", pose=t["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=none),
                twist=t["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=none),
            )
            messages.append(("/odom", "nav_msgs/msg/Odometry", ns, odometry))
        return store, messages

    def bag(self, version, leave_out=()):
        store, messages = self.write(version)
        if version == 2:
            from rosbags.rosbag2 import Writer

            path = self.directory / "boat"
            writer, encode = Writer(path, version=9), store.serialize_cdr
        else:
            from rosbags.rosbag1 import Writer

            path = self.directory / "boat.bag"
            writer, encode = Writer(path), store.serialize_ros1
        with writer:
            connections = {}
            for topic, kind, ns, message in messages:
                if topic in leave_out:
                    continue
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], ns, encode(message, kind))
        return path

    def test_axes_of_both_versions(self):
        for version in (1, 2):
            with self.subTest(version):
                rows, notes = self.converted(self.bag(version))
                self.assertEqual(len(of(rows, "gyro_x_radps")), 150)
                imu = next(row for row in rows if "accel_x_mps2" in row)
                self.assertEqual([imu[f"gyro_{a}_radps"] for a in "xyz"], [0.1, -0.2, -0.3])
                self.assertEqual([imu[f"accel_{a}_mps2"] for a in "xyz"], [0.5, -0.25, -9.8])
                want = dict(roll_deg=10.0, pitch_deg=5.0, heading_deg=90.0, latitude_deg=50.0, altitude_m=255.0)
                for name, value in want.items():
                    self.near(of(rows, name)[0][1], value)
                velocity = next(row for row in rows if "north_mps" in row)
                self.assertEqual([velocity[name] for name in ("north_mps", "east_mps", "down_mps")], [1.0, 2.0, -0.5])
                self.near(rows[-1]["t_s"] - rows[0]["t_s"], 2.98)
                self.assertIn("imu is /imu", notes)

    def test_odometry_alone(self):
        rows, _ = self.converted(self.bag(2, leave_out=("/imu", "/vel")))
        self.near(of(rows, "roll_deg")[0][1], 10.0)
        # The velocity is forward, and upward by the pitch.
        velocity = next(row for row in rows if "north_mps" in row)
        speed = [velocity[name] for name in ("north_mps", "east_mps", "down_mps")]
        self.near(math.hypot(*speed), math.hypot(2.0, 1.0, 0.5))
        self.assertGreater(speed[1], 1.9)
        self.assertLess(speed[2], -0.5)

    def test_mcap_without_its_metadata(self):
        from rosbags.rosbag2 import StoragePlugin, Writer

        store, messages = self.write(2)
        path = self.directory / "boat"
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            for _, kind, ns, message in (m for m in messages if m[0] == "/imu"):
                writer.write(connection, ns, store.serialize_cdr(message, kind))
        alone = self.file("alone.mcap", next(path.glob("*.mcap")).read_bytes())
        rows, notes = self.converted(alone)
        self.assertEqual(len(of(rows, "gyro_x_radps")), 150)
        self.assertIn("metadata.yaml is missing", notes)

    def made(self, kind, *offset, case="bag-other-topic"):
        """Bag of a case of ../shared/data/field (its README says what is right)."""
        path = self.directory / f"{kind}.bag"
        path.unlink(missing_ok=True)
        make = FIELD / case / "make.py"
        subprocess.run([sys.executable, make.name, kind, path, *offset], cwd=make.parent, check=True)
        return path

    @unittest.skipUnless(FIELD.exists(), "needs ../shared/data/field next to the project")
    def test_topics_by_content(self):
        for kind, note in (
            ("cmd-vel-beside", "velocity is /vel, left out: /cmd_vel (a command)"),
            ("body-velocity", "velocity is /mavros/local_position/velocity_local, left out: /mavros/local_position/velocity_body (in body"),
            ("camera-imu", "imu is /imu/data, left out: /camera/imu (of a camera)"),
            ("cmd-vel", "no velocity is used, left out: /cmd_vel (a command)"),
        ):
            with self.subTest(kind):
                rows, notes = self.converted(self.made(kind))
                self.assertIn(note, notes)
                for _, north in of(rows, "north_mps"):
                    self.near(north, 2.0 * math.cos(math.radians(40.0)))
        rows, _ = self.converted(self.made("cmd-vel-beside"), topics=["/cmd_vel"])
        self.near(of(rows, "east_mps")[0][1], 1.5)
        with self.assertRaisesRegex(alight.AlightError, "no topic /wind.*/cmd_vel"):
            convert(self.directory / "cmd-vel-beside.bag", self.directory / "x.csv", topics=["/wind"])

    @unittest.skipUnless(FIELD.exists(), "needs ../shared/data/field next to the project")
    def test_values_that_are_no_measurement(self):
        for kind, column, count, note in (
            ("good", "down_mps", 0, "the vertical speed is 0.0 in all messages: not measured"),
            ("vel3d", "down_mps", 600, "axes are those"),
            ("altitude-zero", "altitude_m", 0, "the altitude is 0.0 in all messages"),
            ("covariance-huge", "latitude_deg", 300, "300 positions whose covariance states more than 100 m"),
            ("identity", "roll_deg", 0, "the orientation of imu is the same in all messages"),
        ):
            with self.subTest(kind):
                rows, notes = self.converted(self.made(kind))
                self.assertEqual(len(of(rows, column)), count)
                self.assertIn(note, notes)

    @unittest.skipUnless(FIELD.exists(), "needs ../shared/data/field next to the project")
    def test_axes_of_a_compass(self):
        for kind in ("heading-driver", "heading-enu"):
            for offset in ("0", "-55"):
                with self.subTest(f"{kind} {offset}"):
                    rows, notes = self.converted(self.made(kind, offset, case="bag-compass-heading"))
                    for _, heading in of(rows, "heading_deg"):
                        self.near((heading - 40.0 - float(offset) + 180.0) % 360.0, 180.0, 3.1)
                    self.assertEqual(of(rows, "roll_deg"), [])
                    self.assertIn("it is a heading", notes)
                    self.assertEqual("clockwise from north" in notes, kind == "heading-driver")
        rows, _ = self.converted(self.directory / "heading-driver.bag", axes="enu")
        self.assertGreater(of(rows, "heading_deg")[0][1], 90.0)

    def test_bag_that_is_none(self):
        self.refused(self.file("cut.bag", b"#ROSBAG V2.0\n"), "no bag that rosbags reads")
        self.refused(self.file("alone.db3", b"SQLite format 3\0rest"), "metadata.yaml")


@needs()
class Sentences(Case):
    # From NovAtel's OEM7 manual.
    EXAMPLE = (
        "#INSPVAA,USB1,0,67.5,FINESTEERING,2209,490558.000,02000020,18bc,16809;2209,490558.000000000,51.15043714042,"
        "-114.03067871718,1080.3548,0.0051,-0.0014,-0.0012,-0.296402993,0.311887972,157.992156267,INS_SOLUTION_GOOD*cc698020"
    )

    def novatel(self, body):
        return f"#{body}*{zlib.crc32(body.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF:08x}\r\n"

    def test_crc_of_the_manual(self):
        from alight.convert._receivers import _novatel

        t_s, values, aligned = _novatel(self.EXAMPLE)
        self.assertTrue(aligned)
        self.assertEqual(t_s, 2209 * 604_800 + 490_558.0)
        self.assertEqual((values[0], values[5], values[8]), (51.15043714042, 0.0012, 157.992156267))
        self.assertIsNone(_novatel(self.EXAMPLE.replace("51.1", "51.2")))

    def test_both_makers(self):
        novatel = vectornav = ""
        for k in range(100):
            values = f"2300,{1000 + 0.1 * k:.3f},50.0,14.5,255.0,1.0,2.0,0.5,1.5,-2.0,90.0"
            good = "INS_SOLUTION_GOOD" if k else "INS_ALIGNING"
            novatel += "12:00 log: " + self.novatel(f"INSPVAA,COM1,0,31.0,FINESTEERING,2300,1000.0,0,0,1;{values},{good}")
            body = f"VNINS,{1000 + 0.1 * k:.6f},2300,{2 if k else 0:04X},90.0,-2.0,1.5,50.0,14.5,255.0,1.0,2.0,-0.5,0.1,0.1,0.1"
            total = 0
            for char in body.encode():
                total ^= char
            vectornav += f"${body}*{total:02X}\r\n"
        for text in (novatel, vectornav):
            rows, notes = self.converted(self.file("ins.log", text + text.splitlines()[5].replace("50.0", "51.0") + "\n"))
            self.assertEqual(len(rows), 99)
            self.assertIn("1 sentences damaged", notes)
            self.assertIn("1 sentences without a solution", notes)
            self.near(rows[-1]["t_s"] - rows[0]["t_s"], 9.8)
            want = dict(latitude_deg=50.0, altitude_m=255.0, north_mps=1.0, down_mps=-0.5, roll_deg=1.5, pitch_deg=-2.0, heading_deg=90.0)
            for name, value in want.items():
                self.assertEqual(rows[0][name], value)


@needs("xarray", "netCDF4")
class Hulls(Case):
    """A hull that follows the water in long waves, as Capytaine saves it, with degrees of freedom about a point away from the
    mesh's origin."""

    CENTER, DOFS = (0.7, 0.2, 0.6), ["Surge", "Sway", "Heave", "Roll", "Pitch", "Yaw"]

    def water(self, omega, direction_deg):
        k, c, s = omega**2 / 9.81, math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
        return [1j * c, 1j * s, 1.0, 1j * k * s, -1j * k * c, -k * s * c]

    def hull(self, change=lambda dataset: dataset):
        import numpy as np
        import xarray

        omega, degrees, dofs = [0.3, 0.6], np.array([-90.0, 0.0, 45.0, 180.0]), ("influenced_dof", "radiating_dof")
        inertia, stiffness, *each = np.random.default_rng(1).normal(size=(6, 6, 6)) + 5.0 * np.eye(6)
        stiffness[3, 3] = 1e-12  # The added roll damping is a fraction of its critical value.
        added, damping = np.reshape(each, (2, 2, 6, 6))
        motion = np.array([[self.water(w, b) for b in degrees] for w in omega])
        motion[..., :3] += np.cross(motion[..., 3:], self.CENTER)
        impedance = [stiffness - w**2 * (inertia + a) - 1j * w * b for w, a, b in zip(omega, added, damping)]
        force = np.einsum("wij,wbj->wbi", impedance, motion)
        variables = {name: (("omega", *dofs), each) for name, each in (("added_mass", added), ("radiation_damping", damping))}
        variables.update(inertia_matrix=(dofs, inertia), hydrostatic_stiffness=(dofs, stiffness))
        variables["excitation_force"] = (("complex", "omega", "wave_direction", dofs[0]), np.array([force.real, force.imag]))
        axes = {"omega": omega, "wave_direction": np.radians(degrees), "complex": ["re", "im"], **dict.fromkeys(dofs, self.DOFS)}
        change(xarray.Dataset(variables, {**axes, "rotation_center": ("x", list(self.CENTER))})).to_netcdf(self.directory / "hull.nc")
        return self.directory / "hull.nc"

    def test_motion_at_the_origin(self):
        table = convert(self.hull()).table
        self.assertEqual(list(table["direction_deg"]), [0.0, 45.0, 180.0] * 2)
        for row in table.to_dict("records"):
            for dof, water in zip(self.DOFS, self.water(row["omega_radps"], row["direction_deg"])):
                self.near(complex(row[f"{dof.lower()}_re"], row[f"{dof.lower()}_im"]), water)

    def test_datasets_that_are_rejected(self):
        for change, *parts in (
            (lambda d: d.drop_vars("inertia_matrix"), "neither RAO nor inertia_matrix", "hydrostatics=True"),
            (lambda d: d.isel(influenced_dof=[2]), "influenced_dof has Heave", "needed are Surge"),
            (lambda d: d.assign_coords(omega=[0.3, 110.0]), "omega has", "at most 100"),
            (lambda d: d.isel(wave_direction=[0, 1, 2]), "wave_direction has", "from 0 to pi"),
            (lambda d: d.assign(excitation_force=30.0 * d["excitation_force"]), "Surge at 0.3 rad/s and 0 deg", "check mass"),
        ):
            with self.subTest(parts[0]):
                self.refused(self.hull(change), *parts)


@needs()
class Command(Case):
    def test_csv_next_to_the_recording(self):
        path = self.file("boat.csv", "t_s;roll_deg;pitch_deg\n0;1;2\n0,1;1;2\n")
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
            self.assertEqual(main([str(path)]), 0)
        self.assertIn("boat.alight.csv: table, 2 rows over 0.1 s of roll_deg, pitch_deg", out.getvalue())
        self.assertIn("semicolons", err.getvalue())
        self.assertEqual(len(exact(self.directory / "boat.alight.csv")), 2)


if __name__ == "__main__":
    unittest.main()
