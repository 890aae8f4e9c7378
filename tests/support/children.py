"""The engine as a real child process with pipes, as its parent sees it."""

import json
import os
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path

from light_meshes.scene import snapshot

ENDS = {"done", "measured", "cancelled", "error"}
SECONDS = 120.0  # for steps that should take less than one second, because the machine may be busy


class Child:
    """The service, with its events in a queue."""

    def __init__(self):
        self.process = subprocess.Popen([sys.executable, "-m", "light_meshes.frontends.service"], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"})  # as on a desktop
        self.events = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.folder = Path(self.until("ready")["folder"])

    def _read(self):
        for line in self.process.stdout:
            self.events.put(json.loads(line))

    def send(self, **command):
        self.write(json.dumps(command).encode() + b"\n")

    def write(self, line: bytes):
        self.process.stdin.write(line)
        self.process.stdin.flush()

    def next(self, timeout=SECONDS):
        """Return the next event that is not "alive"."""
        end = time.monotonic() + timeout
        while True:
            event = self.events.get(timeout=max(0.001, end - time.monotonic()))
            if event["event"] != "alive":
                return event

    def until(self, *names):
        while True:
            event = self.next()
            if event["event"] in names:
                return event

    def of(self, number):
        """Return all events of a command up to its end."""
        events = []
        while not events or events[-1]["event"] not in ENDS:
            event = self.next()
            assert event["id"] == number
            events.append(event)
        return events

    def put(self, scene, name="scene"):
        snapshot.write(scene, self.folder / name)

    def gone(self):
        """Return the exit code, after checking that the folder was removed with the process."""
        code = self.process.wait(SECONDS)
        assert not self.folder.exists()
        return code
