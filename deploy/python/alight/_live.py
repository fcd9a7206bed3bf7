"""Messages of a landing in progress: a client of the server that `alight view --foxglove` starts."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import socket
import struct
import subprocess
import threading
import time
import urllib.parse
from typing import Any, Dict, Iterable, Iterator, NamedTuple, Optional, Tuple

from . import _program
from ._columns import fields, parts
from ._lazy import mcap_decoder, mcap_records
from ._program import AlightError
from ._reading import FOR_VIEWERS

# Instance of `alight land` without --instance.
SIMULATED = "sim"
PORT = 8765
# Every mission publishes its state at 10 Hz; after a silence the client asks the program whether it runs.
ALIVE = "/mission"
SILENCE_S = 2.0
STATUS_S = 60.0
# Maximum length of a frame from the server, bytes.
MAX_FRAME = 16 << 20
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10
MESSAGE_DATA = struct.Struct("<BIQ")


class Message(NamedTuple):
    """Message of a topic.

    topic   name as in `Run.series`
    time_s  time of the message, s since 1970
    values  fields, named as in `Run.series`; NaN: unknown
    """

    topic: str
    time_s: float
    values: Dict[str, Any]


def live(where: str = "land", *, topics: Optional[Iterable[str]] = None, timeout_s: float = 30.0) -> Iterator[Message]:
    """Yields messages of a drone's computer as they arrive, until its processes end.

    `where` is "land" for the landing that `alight land` flies on this computer, the name of another instance
    (`alight land --instance NAME`; an installed drone's name is in its configuration), or the address of a running
    server, such as "ws://192.168.7.2:8765" (`alight view --foxglove`, `view.foxglove`). `alight status --json` shows whether
    an instance runs, and `alight view` serves it to this iterator alone.

    `topics` are those of a recording, by default all; the truth and the vessel's sensors are in recordings only. States
    arrive at 10 Hz, positions and set-points at 25 Hz, sensor data as measured. `timeout_s` is the maximum time (s) for the
    processes to start, and the maximum silence of a server.
    """
    wanted = None if topics is None else {topics} if isinstance(topics, str) else set(topics)
    address, instance = where, None
    try:
        with contextlib.ExitStack() as held:
            if not where.startswith("ws://"):
                instance = SIMULATED if where == "land" else where
                address = held.enter_context(_server(instance, timeout_s))
            at = urllib.parse.urlsplit(address)
            stream = held.enter_context(socket.create_connection((at.hostname, at.port or PORT), timeout_s))
            yield from _messages(_Client(stream, at.netloc), wanted, instance, timeout_s)
    except (AlightError, ImportError):
        raise
    except Exception as error:
        # Damaged content fails in any of the layers: socket, JSON, base64, protobuf.
        raise AlightError(f"reading {address}: {str(error) or type(error).__name__}") from error


def _runs(instance: str) -> bool:
    # Exit code 2 reports a finding, which is possible during a landing.
    return _program.run(["status"], {"instance": instance}, STATUS_S, codes=(0, 1, 2)).value["running"]


@contextlib.contextmanager
def _server(instance: str, timeout_s: float) -> Iterator[str]:
    """Waits until the instance runs, then yields the address of a server for this process alone, which ends with the context."""
    until = time.monotonic() + timeout_s
    while not _runs(instance):
        if time.monotonic() > until:
            raise AlightError(f"no process of the instance {instance} runs: start `alight land` as the same user, or name another")
        time.sleep(0.2)
    own = "127.0.0.1:0"
    command = [_program.program(), "view", "--instance", instance, "--listen", own, "--foxglove", own, "--supervised"]
    pipe, printed = subprocess.PIPE, []
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True) as view:
        late = threading.Timer(timeout_s, view.kill)
        late.start()
        try:
            for line in view.stdout:
                printed.append(line)
                if line.startswith("Foxglove: "):
                    late.cancel()
                    yield line.split()[1]
                    return
            raise AlightError(f"alight view gave no address within {timeout_s:g} s: {''.join(printed).strip()}")
        finally:
            late.cancel()
            view.terminate()


class _Client:
    """WebSocket client (RFC 6455) with the part of Foxglove's protocol that a reader needs."""

    def __init__(self, stream: socket.socket, host: str):
        self.stream, self.buffer = stream, bytearray()
        key = base64.b64encode(os.urandom(16)).decode()
        stream.sendall(
            f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        while b"\r\n\r\n" not in self.buffer:
            self._has(len(self.buffer) + 1)
            if len(self.buffer) > MAX_FRAME or not self.buffer.startswith(b"HTTP/1.1 101"[: len(self.buffer)]):
                raise ValueError("no server of Foxglove's protocol foxglove.sdk.v1 (`alight view --foxglove`)")
        del self.buffer[: self.buffer.index(b"\r\n\r\n") + 4]
        stream.settimeout(SILENCE_S)

    def frame(self) -> Tuple[int, bytes]:
        """Returns opcode and content of the next frame; raises `socket.timeout` after a silence, without losing data."""
        begin, size = 2, self._has(2)[1]
        if size > 125:
            begin = 4 if size == 126 else 10
            size = int.from_bytes(self._has(begin)[2:begin], "big")
        if size > MAX_FRAME or not self.buffer[0] & 0x80:
            raise ValueError(f"a frame in parts, or of more than {MAX_FRAME} bytes")
        whole = self._has(begin + size)
        kind, content = whole[0] & 0xF, bytes(whole[begin : begin + size])
        del self.buffer[: begin + size]
        return kind, content

    def send(self, kind: int, content: bytes) -> None:
        # A mask of zeros leaves the content unchanged.
        self.stream.sendall(struct.pack(">BBQ4x", 0x80 | kind, 0xFF, len(content)) + content)

    def _has(self, size: int) -> bytearray:
        while len(self.buffer) < size:
            part = self.stream.recv(1 << 16)
            if not part:
                raise ConnectionError("the server has closed the connection")
            self.buffer += part
        return self.buffer


def _messages(client: _Client, wanted, instance: Optional[str], timeout_s: float) -> Iterator[Message]:
    decoders, newest = {}, time.monotonic()
    while True:
        try:
            kind, content = client.frame()
        except socket.timeout:
            if instance is not None and not _runs(instance):
                return
            if instance is None and time.monotonic() - newest > timeout_s:
                raise TimeoutError(f"no message in {timeout_s:g} s; does the drone fly?") from None
            continue
        newest = time.monotonic()
        if kind == CLOSE:
            return
        if kind == PING:
            client.send(PONG, content)
        elif kind == TEXT and not decoders and (parsed := json.loads(content)).get("op") == "advertise":
            decoders = _decoders(parsed["channels"], wanted)
            chosen = [{"id": number, "channelId": number} for number in decoders]
            client.send(TEXT, json.dumps({"op": "subscribe", "subscriptions": chosen}).encode())
        elif kind == BINARY and content[0] == 1:
            _, number, time_ns = MESSAGE_DATA.unpack_from(content)
            topic, decode, is_wanted = decoders[number]
            for name, part in parts(topic, decode(content[MESSAGE_DATA.size :])) if is_wanted else ():
                yield Message(name, time_ns / 1e9, dict(fields(part)))


def _decoders(channels, wanted) -> Dict[int, Tuple[str, Any, bool]]:
    """Returns topic, decoder and whether it is wanted for each channel to read, by channel number."""
    there = {channel["topic"]: channel for channel in channels if channel["encoding"] == "protobuf"}
    if unknown := sorted((wanted or set()) - there.keys()):
        raise AlightError(f"no {', '.join(unknown)} in live data; there are: {', '.join(sorted(there))}")
    factory, read = mcap_decoder.DecoderFactory(), {}
    for topic, channel in there.items():
        is_wanted = not topic.startswith(FOR_VIEWERS) if wanted is None else topic in wanted
        if is_wanted or topic == ALIVE:
            number, data = channel["id"], base64.b64decode(channel["schema"])
            schema = mcap_records.Schema(number, data, "protobuf", channel["schemaName"])
            read[number] = topic, factory.decoder_for("protobuf", schema), is_wanted
    return read
