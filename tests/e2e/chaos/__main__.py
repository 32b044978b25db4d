#!/usr/bin/env python3
"""Chaos test: rounds in which faults are injected into farms of real processes. Run by tests/e2e/chaos.sh.

After each round every job must be done with the pixels of the undisturbed run, no acknowledged unit may
have been rendered again, the store must be intact, and no process, socket or file may be left behind. A
round in which a fault took no effect does not count and is repeated with that fault; --rounds counts the
others. The faults of a round depend on --seed and its number alone. --evidence FILE gets a line of JSON
per round: the faults, when and into which processes they were injected, the state of the farm then, and
the hashes of the frames.

With --jobs several rounds run at the same time, each share in a process of its own. --pause makes workers
sleep before each unit, so that they need less CPU time and more rounds fit on the machine.

With --tenants a round has five tenants with certificates, who submit 30 jobs of mixed sizes meanwhile, and a
worker that joins and leaves; in every round the server is killed and the disk is full.
"""

import argparse
import collections
import random
import subprocess
import sys
import tempfile
import threading
import time
import traceback

import farm as farms
from evidence import Evidence
from kinds import KINDS
from tenants import TEMPLATES, TENANTS, TenantFarm


class Alone:
    """Rounds of a client with a few jobs."""
    ALWAYS = ()  # kinds of every round
    FULL_DISKS = ()  # kinds of which every round has one
    FAULTS_PER_ROUND = 6
    DECKS = 1  # sets of rounds, each with every kind, by default

    def __init__(self, seed):
        self.seed = seed
        self.others = sorted(set(KINDS) - {*self.ALWAYS, *self.FULL_DISKS})
        self.full_disks = [kind for kind in self.FULL_DISKS if kind in KINDS]
        # Number of rounds that contain every kind at least once.
        self.deck = -(-len(self.others) // (self.FAULTS_PER_ROUND - len(self.ALWAYS) - bool(self.full_disks)))

    def plan(self, number):
        """Returns the kinds of a round. Each deck of rounds contains every kind."""
        deck = list(self.others)
        random.Random(f"{self.seed} deck {number // self.deck}").shuffle(deck)
        full = [self.full_disks[number % len(self.full_disks)]] if self.full_disks else []
        return [*self.ALWAYS, *full, *deck[number % self.deck::self.deck]]

    def expected(self):
        return farms.undisturbed()

    def units(self, expected):
        """Returns the number of units of a round."""
        return sum(units for _, units in expected.values())

    def farm(self, kinds, number):
        return farms.Farm(kinds)


class WithTenants(Alone):
    ALWAYS = ("kill_server",)
    FULL_DISKS = ("full_disk", "small_disk")
    DECKS = 2

    def expected(self):
        return farms.undisturbed(TenantFarm.TEMPLATES)

    def units(self, expected):
        return len(TENANTS) * sum(expected[name][1] for name in TEMPLATES)

    def farm(self, kinds, number):
        return TenantFarm(kinds, f"{self.seed} {number}")


class Round:
    def __init__(self, game, seed, number, attempt, kinds, expected):
        self.game = game
        self.number, self.kinds, self.expected = number, kinds, expected
        self.seed = seed if attempt == 0 else f"{seed} attempt {attempt}"
        self.evidence = Evidence(self.seed, number, kinds)
        self.wrong = []

    def disturb(self, farm, kind, total):
        rng = random.Random(f"{self.seed} {self.number} {kind}")
        try:
            begin = total * rng.uniform(0.02, 0.3)
            with farm.time_needed():
                farm.wait(120, "the round has got so far", lambda: farm.committed() >= begin)
                if not farm.over:
                    self.evidence.disturb(farm, kind, lambda: KINDS[kind](farm, rng))
        except Exception:  # pylint: disable=broad-except
            self.wrong.append(f"{kind}: {traceback.format_exc()}")

    def run(self, keep):
        farm = self.game.farm(self.kinds, self.number)
        try:
            farm.start()
            farm.submit()
            total = self.game.units(self.expected)
            threads = [threading.Thread(target=self.disturb, args=(farm, kind, total))
                       for kind in self.kinds]
            for thread in threads:
                thread.start()
            try:
                farm.finish(240)
            finally:
                farm.over = True
                for thread in threads:
                    thread.join()
            if not self.wrong:
                if farm.times and farm.times[0] > 6:
                    raise farms.Wrong(f"a dead worker was noticed after {farm.times[0]} s, not 6")
                farm.kill_server()  # jobs that are DONE stay DONE after a restart
                farm.restart_server()
                self.evidence.frames = farm.check_results(self.expected)
                farm.stop()
                if self.evidence.incomplete():
                    raise farms.Wrong(f"incomplete evidence: {self.evidence.incomplete()}")
        except Exception:  # pylint: disable=broad-except
            self.wrong.append(traceback.format_exc())
        finally:
            self.evidence.more = farm.evidence()
            if self.wrong:
                for worker in [None, *farm.all_workers]:
                    text = worker.text() if worker else farm.log()
                    print(f"--- {worker.id if worker else 'server'}\n" +
                          "\n".join(text.splitlines()[-15:]), file=sys.stderr)
            farm.close(keep)
            if keep:
                print(f"kept: {farm.work}")
        return not self.wrong


def run_parts(given):
    """Divides the rounds among processes, prints their output as they end, and returns the exit status."""
    jobs = min(given.jobs, given.rounds)
    parts = []
    for part in range(jobs):
        first, end = (given.rounds * k // jobs for k in (part, part + 1))
        log = tempfile.TemporaryFile("w+")
        command = [sys.executable, *sys.argv, "--jobs", "1", "--rounds", str(end - first),
                   "--first", str(given.first + first)]
        command += ["--evidence", f"{given.evidence}.{part}"] if given.evidence else []
        parts.append((subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT), log))
    failed = 0
    for process, log in parts:
        failed += process.wait() != 0
        log.seek(0)
        print(log.read(), end="", flush=True)
    print(f"{jobs} processes, {failed} of which failed")
    return failed != 0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, help="default: each kind once, with --tenants twice")
    parser.add_argument("--tenants", action="store_true", help="rounds with five tenants and 30 jobs")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--kinds", help="these only, all in every round: comma-separated")
    parser.add_argument("--evidence", metavar="FILE", help="append a line of JSON per round")
    parser.add_argument("--keep", action="store_true", help="keep the folders of the rounds")
    parser.add_argument("--pause", type=int, default=0, metavar="MS", help="workers sleep before each unit")
    parser.add_argument("--jobs", type=int, default=1, metavar="N",
                        help="processes that share the rounds; with N > 1 evidence goes to FILE.0, FILE.1, …")
    given = parser.parse_args()
    game = (WithTenants if given.tenants else Alone)(given.seed)
    given.rounds = given.rounds or game.DECKS * game.deck
    if given.jobs > 1:
        sys.exit(run_parts(given))
    farms.Farm.unit_pause_ms = given.pause
    expected = game.expected()
    print(f"undisturbed: {', '.join(f'{name} {units} units' for name, (_, units) in expected.items())}")
    counted, tries, effects = 0, 0, collections.Counter()
    begin = time.monotonic()
    number, attempt, repeat = given.first, 0, []
    # A round that does not count is repeated with the faults that took no effect.
    while counted < given.rounds and tries < 2 * given.rounds + 4:
        kinds = repeat or (given.kinds.split(",") if given.kinds else game.plan(number))
        tries += 1
        one = Round(game, given.seed, number, attempt, kinds, expected)
        good = one.run(given.keep)
        repeat = one.evidence.without_effect() if good else []
        verdict = "FAILED" if not good else "not counted" if repeat else "ok"
        print(f"{verdict} round {number}, {one.evidence.seconds():.1f} s{one.evidence.summary()}")
        for kind in kinds:
            print(f"    {kind}: {one.evidence.effect(kind) or 'took no effect'}")
        if given.evidence:
            one.evidence.append_to(given.evidence, verdict)
        if not good:
            print("\n".join(one.wrong))
            print(f"again with: tests/e2e/chaos.sh{' --tenants' if given.tenants else ''} --seed {given.seed} --first {number} --rounds 1"
                  f" --kinds {','.join(kinds)}")
            sys.exit(1)
        sys.stdout.flush()
        effects.update(kind for kind in kinds if kind not in repeat)
        if not repeat:
            counted += 1
            number += 1
        attempt = attempt + 1 if repeat else 0
    print(f"{counted} rounds counted, {tries - counted} not, in {time.monotonic() - begin:.0f} s; "
          f"took effect: {', '.join(f'{kind} {n}' for kind, n in sorted(effects.items()))}")
    if counted < given.rounds:
        print(f"FAILED: {', '.join(repeat)} took no effect in {tries} tries")
        sys.exit(1)


if __name__ == "__main__":
    main()
