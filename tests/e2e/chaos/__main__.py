#!/usr/bin/env python3
"""Chaos: rounds of real farms under real faults. Run as tests/e2e/chaos.sh.

After each round every job is done with the pixels of the undisturbed run, no acknowledged unit was
rendered again, the store is whole, and no process, socket or file is left behind. A kind of fault
that never took effect fails the run, too. What a round does follows from --seed and its number alone.
"""

import argparse
import collections
import random
import sys
import threading
import time
import traceback

import farm as farms
from kinds import KINDS

FAULTS_PER_ROUND = 6
DECK = -(-len(KINDS) // FAULTS_PER_ROUND)  # rounds in which every kind has its turn


def plan(seed, number):
    """Kinds of a round. Each deck of rounds has every kind once."""
    deck = sorted(KINDS)
    random.Random(f"{seed} deck {number // DECK}").shuffle(deck)
    return deck[number % DECK::DECK]


class Round:
    def __init__(self, seed, number, kinds, expected):
        self.number, self.kinds, self.expected = number, kinds, expected
        self.seed = seed
        self.evidence = {}
        self.wrong = []

    def disturb(self, farm, kind, total):
        rng = random.Random(f"{self.seed} {self.number} {kind}")
        try:
            begin = total * rng.uniform(0.02, 0.3)
            with farm.time_needed():
                farm.wait(120, "the round has got so far", lambda: farm.committed() >= begin)
                found = None if farm.over else KINDS[kind](farm, rng)
            if found:
                self.evidence[kind] = found
        except Exception:  # pylint: disable=broad-except
            self.wrong.append(f"{kind}: {traceback.format_exc()}")

    def run(self, keep):
        farm = farms.Farm(self.kinds)
        try:
            farm.start()
            farm.submit()
            total = sum(units for _, units in self.expected.values())
            threads = [threading.Thread(target=self.disturb, args=(farm, kind, total))
                       for kind in self.kinds]
            for thread in threads:
                thread.start()
            farm.finish(240)
            for thread in threads:
                thread.join()
            if not self.wrong:
                if farm.times and farm.times[0] > 6:
                    raise farms.Wrong(f"a dead worker was noticed after {farm.times[0]} s, not 6")
                farm.kill_server()  # what was DONE is DONE after a restart, too
                farm.restart_server()
                farm.check_results(self.expected)
                farm.stop()
        except Exception:  # pylint: disable=broad-except
            self.wrong.append(traceback.format_exc())
        finally:
            if self.wrong:
                for worker in [None, *farm.all_workers]:
                    text = worker.text() if worker else farm.log()
                    print(f"--- {worker.id if worker else 'server'}\n" +
                          "\n".join(text.splitlines()[-15:]), file=sys.stderr)
            farm.close(keep)
            if keep:
                print(f"kept: {farm.work}")
        return not self.wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=DECK, help="default: each kind once")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--kinds", help="these only, all in every round: comma-separated")
    parser.add_argument("--keep", action="store_true", help="keep the folders of the rounds")
    given = parser.parse_args()
    expected = farms.undisturbed()
    print(f"undisturbed: {', '.join(f'{name} {units} units' for name, (_, units) in expected.items())}")
    wanted = set(given.kinds.split(",")) if given.kinds else set()
    seen = collections.Counter()
    begin = time.monotonic()
    number = given.first
    # Kinds that took no effect in the last deck's rounds get a few more rounds.
    while number < given.first + given.rounds or (
            wanted - set(seen) and number < given.first + given.rounds + 4):
        is_extra = number >= given.first + given.rounds
        kinds = sorted(wanted - set(seen)) if is_extra else (
            given.kinds.split(",") if given.kinds else plan(given.seed, number))
        wanted |= set(kinds)
        started = time.monotonic()
        one = Round(given.seed, number, kinds, expected)
        good = one.run(given.keep)
        seen.update(one.evidence.keys())
        print(f"{'ok' if good else 'FAILED'} round {number}, {time.monotonic() - started:.1f} s")
        for kind in kinds:
            print(f"    {kind}: {one.evidence.get(kind, 'took no effect')}")
        if not good:
            print("\n".join(one.wrong))
            print(f"again with: tests/e2e/chaos.sh --seed {given.seed} --first {number} --rounds 1"
                  f" --kinds {','.join(kinds)}")
            sys.exit(1)
        sys.stdout.flush()
        number += 1
    print(f"{number - given.first} rounds in {time.monotonic() - begin:.0f} s; "
          f"took effect: {', '.join(f'{kind} {n}' for kind, n in sorted(seen.items()))}")
    never = wanted - set(seen)
    if never:
        print(f"FAILED: never took effect: {', '.join(sorted(never))}")
        sys.exit(1)


if __name__ == "__main__":
    main()
