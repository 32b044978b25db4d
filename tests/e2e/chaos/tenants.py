"""A farm with several tenants for one round of chaos: TLS, a client certificate for each tenant and one for each
worker, jobs of mixed sizes that are submitted while faults happen, and a worker that keeps joining and leaving."""

import random
import socket
import threading
import time

from farm import Farm, Wrong, WORKERS, run
from link import Link

TENANTS = ("ann", "bob", "cleo", "dan", "eve")
# name: scene and options. Each tenant submits one job of each, so that a round has 30.
TEMPLATES = {
    "tiny": ("lit_square.gltf", ["--size", "16x16", "--tile-size", "16", "--spp", "4"]),
    "small": ("same_bits.gltf", ["--size", "24x24", "--tile-size", "8", "--spp", "16"]),
    "frames": ("same_bits.gltf", ["--size", "24x24", "--tile-size", "16", "--spp", "8", "--frames", "0-3"]),
    "error": ("lit_square.gltf", ["--size", "32x32", "--tile-size", "8", "--error", "0.2"]),
    "medium": ("same_bits.gltf", ["--size", "32x32", "--tile-size", "8", "--spp", "64", "--seed", "3"]),
    "large": ("same_bits.gltf", ["--size", "48x48", "--tile-size", "8", "--spp", "40"]),
}
# Of further jobs, which keep the farm busy while a fault needs the round to last.
LONG = {"long": ("same_bits.gltf", ["--size", "64x64", "--tile-size", "8", "--spp", "150"])}
VISITOR = WORKERS  # slot of the worker that joins and leaves


def free_port():
    """Returns a port below those that the kernel gives to outgoing connections."""
    while True:
        port = random.SystemRandom().randrange(12000, 32000)
        with socket.socket() as one:
            try:
                one.bind(("127.0.0.1", port))
                return port
            except OSError:
                continue


class TenantFarm(Farm):
    """Jobs are named TENANT.TEMPLATE.NUMBER."""
    TEMPLATES = {**TEMPLATES, **LONG}
    FURTHER = "long"
    LEAST_OPEN = 2
    LOOK_EVERY = 0.5

    def __init__(self, kinds, seed):
        self.address = ("127.0.0.1", free_port())
        self.token = None
        self.authority_lock = threading.Lock()
        self.rng = random.Random(f"{seed} tenants")
        self.accepted = {}  # name: job ID, of jobs whose submission was answered
        self.refused = 0  # submissions without a job ID as the answer
        # Jobs that a full disk has paused resume by themselves within 30 s; mostly their owners are faster.
        self.owners_resume = self.rng.random() < 0.8
        self.visits = []
        self.wrong = []  # of the threads
        self.threads = []
        super().__init__(kinds)
        self.certs = self.work / "certs"
        run("tessera-server", "init-certs", self.certs, "--host", "127.0.0.1")
        for tenant in TENANTS:
            self.issue("client", tenant)
        self.issue("admin", "root")

    # Addresses ------------------------------------------------------------------------------------

    def issue(self, role, name):
        """Returns the folder of a new certificate."""
        with self.authority_lock:
            return run("tessera-server", "issue-cert", self.certs, "--role", role, "--name", name).stdout.strip()

    def make_links(self):
        return [Link(("127.0.0.1", free_port()), self.address) for _ in range(WORKERS + 1)]

    def server_options(self):
        return ["--listen", "%s:%d" % self.address, "--certs", self.certs]

    def worker_options(self, slot, identity):
        # A worker that was quarantined is replaced by one that nobody knows yet.
        return ["--server", "%s:%d" % self.links[slot].path, "--certs", self.issue("worker", identity),
                "--token", self.token]

    def call(self, command, *arguments, check=True, job=None):
        certs = self.certs / (f"client-{self.tenant(job)}" if job else "admin-root")
        return run("tessera", command, *arguments, "--server", "%s:%d" % self.address, "--certs", certs, check=check)

    def open_line(self):
        # The simulated line leads to a Unix socket, because it ends in another network namespace.
        bridge = Link(str(self.socket), self.address)
        bridge.start()
        self.links.append(bridge)
        return super().open_line()

    @staticmethod
    def tenant(name):
        return name.split(".")[0]

    def template(self, name):
        return name.split(".")[1]

    # Jobs and workers -----------------------------------------------------------------------------

    def start(self):
        if not self.start_server():
            raise Wrong("the server does not start")
        self.token = self.certs / "join.token"
        # It must outlast the jumps of the clock.
        run("tessera-server", "tokens", "create", "--store", self.store, "--ttl", "2000h", "--out", self.token)
        for slot in range(WORKERS):
            self.start_worker(slot)
            self.free.append(slot)
        self.start_thread(self.visit, self.rng.random())

    def start_thread(self, work, *arguments):
        def guarded():
            try:
                work(*arguments)
            except Exception as error:  # pylint: disable=broad-except
                self.wrong.append(repr(error))
        self.threads.append(threading.Thread(target=guarded))
        self.threads[-1].start()

    def visit(self, seed):
        """Until the round is over, a worker joins, renders and leaves on SIGTERM."""
        rng = random.Random(seed)
        while not self.over:
            worker, begin = self.start_worker(VISITOR), time.monotonic()
            self.pause(rng.uniform(1, 4))
            units = len({tuple(line.split()[1:5]) for line in
                         (worker.units.read_text().splitlines() if worker.units.exists() else [])})
            worker.process.terminate()
            worker.await_drain(60)
            self.visits.append({"worker": worker.id, "pid": worker.process.pid, "units": units,
                                "seconds": round(time.monotonic() - begin, 3)})
            self.pause(rng.uniform(0.2, 1))

    def pause(self, seconds):
        """Waits, but not beyond the end of the round."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not self.over:
            time.sleep(0.02)

    def submit(self):
        """Starts to submit the jobs of all tenants at once."""
        self.left = {tenant: len(TEMPLATES) for tenant in TENANTS}
        for tenant in TENANTS:
            self.start_thread(self.submit_all, tenant, self.rng.random())

    def submit_all(self, tenant, seed):
        rng = random.Random(seed)
        templates = list(TEMPLATES)
        rng.shuffle(templates)
        tries = 0
        while templates and not self.over:
            # No name is used twice, because a call without an answer may have created the job.
            name = f"{tenant}.{templates[-1]}.{tries}"
            tries += 1
            job = self.submit_one(templates[-1], name, check=False).stdout.strip()
            if job:
                templates.pop()
                self.accepted[name] = job
                self.left[tenant] -= 1
            else:
                self.refused += 1
            self.pause(rng.uniform(0, 0.5))

    def submit_further(self):
        self.more += 1
        tenant = TENANTS[self.more % len(TENANTS)]
        self.submit_one(self.FURTHER, f"{tenant}.{self.FURTHER}.more{self.more}", check=False)

    def is_submitted(self, states):
        if self.wrong:
            raise Wrong("; ".join(self.wrong))
        return not any(self.left.values())

    def may_resume(self):
        # On a small file system there is never as much room as the server waits for.
        return self.has_room and (self.is_small or self.owners_resume)

    def duplicated(self):
        return sum(n for (event, _), n in self.acknowledgements().items() if event == "DUPLICATE")

    # Checks ---------------------------------------------------------------------------------------

    def check_results(self, expected):
        """Also checks that every tenant's jobs are done, under the IDs that it was given, and hidden from others."""
        self.states()
        for tenant in TENANTS:
            for name, job in self.accepted.items():
                if self.tenant(name) == tenant and self.states_by_id.get(job) != "done":
                    raise Wrong(f"job {job} ({name}) of {tenant} is {self.states_by_id.get(job, 'lost')}, not done")
        if len(self.accepted) != len(TENANTS) * len(TEMPLATES):
            raise Wrong(f"{len(self.accepted)} jobs were submitted")
        name, job = next(iter(self.accepted.items()))
        other = next(tenant for tenant in TENANTS if tenant != self.tenant(name))
        if self.call("status", job, check=False, job=f"{other}.").returncode != 2:
            raise Wrong(f"{other} sees job {job} of {self.tenant(name)}")
        return super().check_results(expected)

    def evidence(self):
        """Returns what a round's evidence says about tenants and workers that joined and left."""
        return {"tenants": {tenant: {name: {"id": job, "state": self.states_by_id.get(job)}
                                     for name, job in self.accepted.items() if self.tenant(name) == tenant}
                            for tenant in TENANTS},
                "refused_submits": self.refused, "further_jobs": self.more, "visits": self.visits}

    def stop(self):
        for thread in self.threads:
            thread.join()
        if self.wrong:
            raise Wrong("; ".join(self.wrong))
        super().stop()

    def close(self, keep=False):
        self.over = True
        for thread in self.threads:
            thread.join(5)  # its processes are killed otherwise
        super().close(keep)
