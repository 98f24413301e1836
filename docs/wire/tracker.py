#!/usr/bin/env python3
"""A small tracker that speaks sonoloop's wire contract (docs/wire.md), as a start for your own.

It follows the brightest pixel near the operator's click: enough to show every message, not enough to pass a
scenario. It needs Python 3.9 and the PyPI package `iceoryx2` 0.10. The simulator starts it with SONOLOOP_DOMAIN
and SONOLOOP_ROOT in its environment:

    sonoloop run scenarios/lateral_plain.yaml --tracker "python3 docs/wire/tracker.py"

`tracker.py --layout` prints the layout of the messages as this file understands them, and needs no package.
"""

import ctypes
import fcntl
import json
import math
import os
import signal
import sys
import time

LAYOUT_VERSION = 1
NAN = float("nan")
SEARCHING, TRACKING, LOST, RECOVERING = range(4)
OK, NO_CANDIDATE = 0, 7
# This tracker's own need; the contract allows 1 MiB.
CHECKPOINT_BYTES = 4096

u8, u32, u64 = ctypes.c_uint8, ctypes.c_uint32, ctypes.c_uint64
f32, f64 = ctypes.c_float, ctypes.c_double


class Message(ctypes.Structure):
    """A message with a type name that all languages share."""

    @classmethod
    def type_name(cls):
        return "sonoloop::" + cls.__name__


class BlobHeader(Message):
    _fields_ = [("version", u32), ("reserved", u32), ("run_id", u64)]


class ImageHeader(Message):
    _fields_ = [
        ("version", u32),
        ("width_px", u32),
        ("height_px", u32),
        ("arm_status", u8),
        ("receipt", u8),
        ("answer_due", u8),
        ("reserved", u8),
        ("run_id", u64),
        ("sequence", u64),
        ("acquisition_tick", u64),
        ("publication_tick", u64),
        ("pose_tick", u64),
        ("receipt_answers", u64),
        ("spacing_m", f64),
        ("base_from_probe", f64 * 7),
        ("depth_m", f64),
        ("feed_m_s", f64),
        ("contact_force_n", f64),
    ]


class Command(Message):
    _fields_ = [
        ("version", u32),
        ("state", u8),
        ("reason", u8),
        ("has_target", u8),
        ("reserved", u8),
        ("run_id", u64),
        ("answers", u64),
        ("iterations", u32),
        ("compute_us", f32),
        ("tip_px", f64 * 2),
        ("ncc_previous", f64),
        ("ncc_anchor", f64),
        ("brightness_ratio", f64),
        ("tip_level", f64),
        ("conditioning", f64),
        ("target_base_from_probe", f64 * 7),
        ("feed_m_s", f64),
    ]


class Ready(Message):
    _fields_ = [
        ("version", u32),
        ("reserved", u32),
        ("run_id", u64),
        ("name", u8 * 64),
        ("tracker_version", u8 * 32),
    ]


class End(Message):
    _fields_ = [("version", u32), ("reason", u8), ("reserved", u8 * 3), ("run_id", u64)]


def print_layout():
    for message in (BlobHeader, ImageHeader, Command, Ready, End):
        print(message.type_name(), ctypes.sizeof(message), ctypes.alignment(message))
        for name, _ in message._fields_:
            field = getattr(message, name)
            print(message.type_name(), name, field.offset, field.size)


def text(value, array):
    """`value` as UTF-8, filled up with zeros."""
    data = value.encode("utf-8")[: ctypes.sizeof(array)]
    return array(*data)


class BrightestPixel:
    """Looks for the brightest pixel within `reach` of where it was last."""

    def __init__(self, click, restored):
        self.tip = [float(value) for value in (restored or click)]
        self.reach = 12
        self.least_level = 60

    def update(self, pixels, width, height):
        """Takes grey levels row by row; returns (state, reason, level)."""
        u0, v0 = (int(round(value)) for value in self.tip)
        left, right = max(u0 - self.reach, 0), min(u0 + self.reach + 1, width)
        top, bottom = max(v0 - self.reach, 0), min(v0 + self.reach + 1, height)
        best = (-1, u0, v0)
        for v in range(top, bottom):
            row = pixels[v * width + left : v * width + right]
            level = max(row, default=-1)
            if level > best[0]:
                best = (level, left + row.index(level), v)
        if best[0] < self.least_level:
            return LOST, NO_CANDIDATE, max(best[0], 0)
        self.tip = [float(best[1]), float(best[2])]
        return TRACKING, OK, best[0]


class Domain:
    """The place of one run; the simulator holds its lock while it lives."""

    def __init__(self):
        self.name = os.environ["SONOLOOP_DOMAIN"]
        self.root = os.environ["SONOLOOP_ROOT"]

    def is_alive(self):
        try:
            with open(self.root + ".lock", "rb") as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
                return False
        except BlockingIOError:
            return True
        except OSError:
            return False


class Wire:
    """Every port a tracker needs."""

    def __init__(self, iox2, domain, patience_s):
        self.iox2, self.domain = iox2, domain
        iox2.set_log_level_from_env_or(iox2.LogLevel.Error)
        # The built-in defaults, not the user's configuration file: that could part us from the simulator.
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(domain.name)
        config.global_cfg.root_path = iox2.Path.new(domain.root)
        self.node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        self.deadline = time.monotonic() + patience_s
        blob, image = iox2.Slice[u8], iox2.Slice[u8]

        setup = self.open("setup", blob, BlobHeader).subscriber_builder().create()
        restore = self.open("restore", blob, BlobHeader).subscriber_builder().create()
        self.end = self.open("end", End).subscriber_builder().create()
        # No history: an old image has had its answer, or its silence.
        self.image = self.open("image", image, ImageHeader).subscriber_builder().history_request(0).create()
        self.images_come = self.open_event("image").listener_builder().create()
        self.command = self.open("command", Command).publisher_builder().create()
        self.ready = self.open("ready", Ready).publisher_builder().create()
        self.checkpoint = (
            self.open("checkpoint", blob, BlobHeader)
            .publisher_builder()
            .initial_max_slice_len(CHECKPOINT_BYTES)
            .create()
        )
        # Last: its appearance makes the simulator serve the set-up to the subscribers above.
        self.answers_come = self.open_event("command").notifier_builder().create()

        # iceoryx2 catches both signals as soon as it makes shared memory; take them back.
        signal.signal(signal.SIGINT, lambda *_: sys.exit(130))
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))

        header, data = self.first(setup)
        if header.version != LAYOUT_VERSION:
            raise SystemExit(f"layout version {header.version}, expected {LAYOUT_VERSION}")
        self.run_id = header.run_id
        self.setup = json.loads(data)
        _, self.restored = self.first(restore)

    def open(self, name, payload, header=None):
        def builder():
            made = self.node.service_builder(self.iox2.ServiceName.new("sonoloop/" + name)).publish_subscribe(payload)
            return made.user_header(header) if header else made

        return self.retry(lambda: builder().open())

    def open_event(self, name):
        return self.retry(lambda: self.node.service_builder(self.iox2.ServiceName.new("sonoloop/" + name)).event().open())

    def retry(self, attempt):
        while True:
            try:
                return attempt()
            except Exception:
                if time.monotonic() > self.deadline or not self.domain.is_alive():
                    raise
                time.sleep(0.005)

    def wait(self):
        """Sleeps until an event, or 50 ms."""
        try:
            self.images_come.timed_wait(self.iox2.Duration.from_millis(50))
        except self.iox2.ListenerWaitError:
            pass  # a signal

    def first(self, subscriber):
        """The first message of a service with history, as (header, bytes)."""
        while True:
            sample = subscriber.receive()
            if sample is not None:
                header = BlobHeader.from_buffer_copy(sample.user_header().contents)
                data = bytes(sample.payload().as_memory_view())
                sample.delete()
                return header, data
            if time.monotonic() > self.deadline or not self.domain.is_alive():
                raise SystemExit("the simulator did not send its set-up")
            self.wait()

    def announce(self, name, version):
        message = Ready(LAYOUT_VERSION, 0, self.run_id, text(name, u8 * 64), text(version, u8 * 32))
        self.ready.send_copy(message)
        self.answers_come.notify_with_custom_event_id(self.iox2.EventId.new(5))

    def next_image(self):
        """The newest image that wants an answer, as (header, grey levels); None at the end."""
        while True:
            sample = self.end.receive()
            if sample is not None:
                sample.delete()
                return None
            newest = None
            while (sample := self.image.receive()) is not None:
                header = ImageHeader.from_buffer_copy(sample.user_header().contents)
                sound = header.version == LAYOUT_VERSION and header.run_id == self.run_id
                if sound and header.answer_due and header.width_px * header.height_px == sample.payload().len():
                    newest = header, bytes(sample.payload().as_memory_view())
                sample.delete()
            if newest:
                return newest
            if not self.domain.is_alive():
                return None
            self.wait()

    def leave_checkpoint(self, data):
        """Before the answer, so that the simulator has it when it has the answer."""
        assert len(data) <= CHECKPOINT_BYTES
        sample = self.checkpoint.loan_slice_uninit(len(data))
        sample.user_header()[0] = BlobHeader(LAYOUT_VERSION, 0, self.run_id)
        ctypes.memmove(sample.payload_ptr, data, len(data))
        sample.assume_init().send()

    def answer(self, command):
        self.command.send_copy(command)
        self.answers_come.notify_with_custom_event_id(self.iox2.EventId.new(4))


def main():
    if "--layout" in sys.argv[1:]:
        return print_layout()
    try:
        import iceoryx2 as iox2
    except ImportError:
        raise SystemExit("this tracker needs the PyPI package iceoryx2 0.10: pip install 'iceoryx2==0.10.*'")

    domain = Domain()
    if not domain.is_alive():
        raise SystemExit(f"no simulator runs in domain {domain.name}")
    wire = Wire(iox2, domain, patience_s=30.0)
    restored = json.loads(wire.restored) if wire.restored else None
    # Null in a run without an operator's click: this tracker then begins in the middle of the picture.
    geometry = wire.setup["geometry"]
    click = wire.setup["click_px"] or [geometry["width_px"] / 2, geometry["height_px"] / 2]
    tracker = BrightestPixel(click, restored)
    feed = wire.setup["servo"]["feed_m_s"]
    wire.announce("brightest-pixel", "0.1")

    while (received := wire.next_image()) is not None:
        header, pixels = received
        began = time.perf_counter()
        state, reason, level = tracker.update(pixels, header.width_px, header.height_px)
        wire.leave_checkpoint(json.dumps(tracker.tip).encode())
        wire.answer(
            Command(
                version=LAYOUT_VERSION,
                state=state,
                reason=reason,
                has_target=0,
                run_id=wire.run_id,
                answers=header.sequence,
                compute_us=1e6 * (time.perf_counter() - began),
                tip_px=(f64 * 2)(*tracker.tip),
                ncc_previous=NAN,
                ncc_anchor=NAN,
                brightness_ratio=NAN,
                tip_level=float(level),
                conditioning=NAN,
                # A hand inserts when the depth is not measured: there is nothing to feed.
                feed_m_s=feed if state == TRACKING and not math.isnan(header.depth_m) else 0.0,
            )
        )


if __name__ == "__main__":
    main()
