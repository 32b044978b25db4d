"""Simulated wide-area link between a worker and the server: tests/support/wide_area_link.cpp."""

import os
import pathlib
import subprocess

from control import Control
from link import Link

LINE = pathlib.Path(os.environ["TESSERA_BIN"]) / "tessera_wide_area_link"
PORT = 7420


class LineControl(Control):
    FIELDS = ("delay_us", "loss_ppm", "bits_per_s", "is_cut", "passed", "lost", "overflowed", "cut")


class WideAreaLine:
    """Carries connections to `path` over the link to the server, each as a TCP connection."""

    def __init__(self, folder, server_path, environment):
        self.control = LineControl(folder / "line.control")
        self.control.delay_us, self.control.loss_ppm = 20_000, 10_000
        self.control.bits_per_s = 100_000_000
        self.process = subprocess.Popen([LINE, self.control.path], env=environment, text=True,
                                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
        here, there = self.process.stdout.readline().split()
        self.path = str(folder / "line.sock")
        self.links = [Link(("10.9.0.1", PORT), server_path, here),
                      Link(self.path, ("10.9.0.1", PORT), there)]
        for link in self.links:
            link.start()

    def close(self):
        for link in self.links:
            link.stopping = True
            link.join()
        self.process.kill()
        self.process.wait()


def is_possible():
    """Returns whether this user may create namespaces and devices."""
    return (os.geteuid() == 0 and os.access("/dev/net/tun", os.W_OK) and
            subprocess.run(["unshare", "--net", "true"], stderr=subprocess.DEVNULL, check=False).returncode == 0)
