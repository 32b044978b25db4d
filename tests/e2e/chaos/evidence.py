"""Evidence of a round of chaos: one record per fault, from which the round can be judged.

A record has the kind of the fault, its effect (null if it took none), when it began and ended (seconds
since the start of the round, and wall-clock time), the processes it disturbed, and the state of the farm
before and after it. A round has its faults, and the hash and expected hash of every frame; with tenants also
the jobs of each tenant with their states, and the visits of the worker that joins and leaves.
"""

import datetime
import json
import threading
import time


class Evidence:
    """Records of one round. Thread-safe."""

    def __init__(self, seed, number, kinds):
        self.seed, self.number, self.kinds = seed, number, kinds
        self.start, self.wall_clock = time.monotonic(), datetime.datetime.now(datetime.timezone.utc)
        self.faults, self.frames, self.more = {}, {}, {}
        self.lock = threading.Lock()

    def disturb(self, farm, kind, fault):
        """Runs `fault()`, which returns its effect or None, and records the result."""
        farm.disturbed.processes = []
        record = {"kind": kind, "began_s": self.seconds(), "farm_before": farm.snapshot(), "effect": None}
        with self.lock:
            self.faults[kind] = record
        try:
            record["effect"] = fault()
        finally:
            record.update(ended_s=self.seconds(), processes=farm.disturbed.processes,
                          farm_after=farm.snapshot())

    def seconds(self):
        return round(time.monotonic() - self.start, 3)

    def without_effect(self):
        """Returns the kinds that took no effect; if there are any, the round does not count."""
        return [kind for kind in self.kinds if not self.faults.get(kind, {}).get("effect")]

    def effect(self, kind):
        return self.faults.get(kind, {}).get("effect")

    def incomplete(self):
        """Returns faults that took effect but whose record is incomplete."""
        return [kind for kind, record in self.faults.items() if record["effect"] and not (
            record["processes"] and record["farm_before"] and record["farm_after"])]

    def summary(self):
        """Returns what the line of a round says about its tenants."""
        tenants = self.more.get("tenants")
        if not tenants:
            return ""
        jobs = [job["state"] for jobs in tenants.values() for job in jobs.values()]
        visits = self.more["visits"]
        return (f", {jobs.count('done')} of {len(jobs)} jobs of {len(tenants)} tenants done, "
                f"{self.more['further_jobs']} further, {self.more['refused_submits']} submits refused, "
                f"{len(visits)} visits of workers, {len(self.frames)} jobs compared")

    def document(self, verdict):
        return {"schema": "tessera.chaos/1", "seed": self.seed, "round": self.number,
                "began": self.wall_clock.isoformat(timespec="milliseconds"), "seconds": self.seconds(),
                "verdict": verdict, "faults": list(self.faults.values()), "frames": self.frames, **self.more}

    def append_to(self, path, verdict):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(self.document(verdict)) + "\n")
