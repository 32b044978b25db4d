#!/usr/bin/env python3
"""Mutation check: breaks single lines of the code in a copy and checks whether its tests fail.

    tests/mutation/run.py [--count 20] [--seed 1] [--area NAME]... [--dry-run] [--work FOLDER]

The lines are chosen at random from the scheduler, the stopping rule, the BVH kernels and the BSDFs, one
area after the other. A mutant changes one operator, constant, comparison or condition of its line. A
comparison is reversed. In the scheduler it is also changed by one step (< to <=); elsewhere comparisons
are between floats, whose equality is too rare to be tested. The tests of the area are built in a copy of
the tree and run until one fails. A test that fails is run again and must fail again, so that a test that
depends on the load of the machine catches nothing. A mutant that does not compile is replaced by another
one. A mutant whose tests take ten times the CPU time of the unchanged ones, or hang, is caught. Prints
the change of each survivor and exits with 1 if fewer than nine of ten mutants are caught. A survivor
needs a test or, if it cannot change any result, an entry in equivalent.txt.
"""
import argparse
import dataclasses
import math
import os
import pathlib
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
EQUIVALENT = pathlib.Path(__file__).with_name("equivalent.txt")
LEAST_CAUGHT = 0.9


@dataclasses.dataclass(frozen=True)
class Area:
    """Code to break and the test binaries that should notice, cheapest first."""

    name: str
    sources: tuple  # glob patterns
    tests: tuple  # targets, which are also the names of the binaries
    excluded: tuple = ()
    has_integers: bool = False  # comparisons are changed by one step, too


AREAS = (
    Area("scheduler", ("server/schedule/**/*.cpp", "server/schedule/**/*.h"),
         ("unit_schedule_test", "unit_jobs_test", "unit_coordinator_test"), has_integers=True),
    Area("stopping-rule", ("contract/stopping/stopping_rule.cpp", "contract/stopping/frame_stopping_rule.cpp"),
         ("unit_contract_test", "unit_film_test", "unit_jobs_test", "unit_coordinator_test")),
    Area("traversal", ("worker/accel/traversal/*.h", "worker/accel/kernels/*.h", "worker/accel/kernels/*.cpp"),
         ("numeric_geometry_test", "numeric_motion_test", "numeric_solids_test"),
         () if "avx512vl" in pathlib.Path("/proc/cpuinfo").read_text() else ("*avx512*",)),
    Area("bsdf", ("worker/shading/bsdf/*.h", "worker/shading/bsdf/*.cpp", "worker/shading/microfacet/*.h",
                  "worker/shading/microfacet/*.cpp"),
         ("unit_shading_test", "numeric_bsdf_test", "numeric_optics_test", "numeric_gltf_test",
          "numeric_transparency_test", "numeric_lighting_test", "numeric_estimators_test")),
)

# Binary operators have a space on each side (.clang-format); template brackets, pointers and
# references have not.
OPERATORS = {
    "<": (">=",), "<=": (">",), ">": ("<=",), ">=": ("<",), "==": ("!=",), "!=": ("==",),
    "&&": ("||",), "||": ("&&",), "+": ("-",), "-": ("+",), "*": ("/",), "/": ("*",),
    "+=": ("-=",), "-=": ("+=",), "*=": ("/=",), "/=": ("*=",), "&": ("|",), "|": ("&",),
}
ONE_STEP = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
OPERATOR = re.compile(r"(?<= )(" + "|".join(re.escape(o) for o in sorted(OPERATORS, key=len)[::-1]) + r")(?= |$)")
WORDS = {"true": "false", "false": "true", "min": "max", "max": "min", "continue": "break"}
WORD = re.compile(r"\b(?:" + "|".join(WORDS) + r")\b(?!_)")
NUMBER = re.compile(r"(?<![\w.])(\d+(?:'\d{3})*)(\.\d*)?(f?)(?![\w.'])")
CONDITION = re.compile(r"\bif \(((?:[^()=]|[=!<>]=|\([^()]*\))*)\)")
# Lines that only check or declare, lines that only make room, and in headers initial values that are
# replaced before they are used.
SKIPPED = re.compile(r"^\s*(#|///?|using |namespace |template|friend |class |enum |static_assert|assert\()"
                     r"|TESSERA_CHECK\b|\breserve\(|_mm_prefetch|\bcase \w+:|operator")
INITIAL_VALUES = re.compile(r"^\s+(?!.*\bconst)[\w:<>]+ (?:\w+ = [\w.]+(?:, |;))+\s*(?://.*)?$")


@dataclasses.dataclass(frozen=True)
class Mutant:
    """One changed line."""

    area: str
    path: str
    number: int  # of the line, from 1
    before: str
    after: str

    def key(self):
        return (self.path, self.before.strip(), self.after.strip())

    def diff(self):
        return f"--- {self.path}:{self.number}\n-{self.before}\n+{self.after}"


def without_text(line):
    """Returns the line with string literals and comments blanked out, at the same columns."""
    line = re.sub(r'"(?:\\.|[^"\\])*"|\'[^\']\'', lambda m: " " * len(m.group()), line)
    return re.sub(r"//.*$|/\*.*?\*/", lambda m: " " * len(m.group()), line)


def changes_of(line, has_integers):
    """Returns every line that a mutation of `line` gives."""
    if SKIPPED.search(line):
        return []
    code = without_text(line)
    changes = []

    def put(match, text, group=0):
        changes.append(line[:match.start(group)] + text + line[match.end(group):])

    for match in OPERATOR.finditer(code):
        if code[:match.start()].strip():  # the operator of a broken line has no left operand here
            for other in OPERATORS[match.group(1)]:
                put(match, other, 1)
            if has_integers and match.group(1) in ONE_STEP:
                put(match, ONE_STEP[match.group(1)], 1)
    for match in WORD.finditer(code):
        put(match, WORDS[match.group()])
    for match in NUMBER.finditer(code):
        whole, fraction, suffix = match.group(1), match.group(2) or "", match.group(3)
        if fraction:
            put(match, f"{float(whole + fraction) * 2 + (float(whole + fraction) == 0)}{suffix}")
        else:
            put(match, f"{int(whole.replace(chr(39), '')) + 1}")
    for match in CONDITION.finditer(code):
        put(match, f"!({line[match.start(1):match.end(1)]})", 1)
    return changes


def lines_to_break(area, equivalent):
    """Returns the mutants of each line of an area that has any."""
    files = set()
    for pattern in area.sources:
        files |= {p for p in ROOT.glob(pattern) if not any(p.match(e) for e in area.excluded)}
    lines = []
    for path in sorted(files):
        name = str(path.relative_to(ROOT))
        for number, line in enumerate(path.read_text().splitlines(), 1):
            if path.suffix == ".h" and INITIAL_VALUES.search(line):
                continue
            changes = changes_of(line, area.has_integers)
            mutants = [Mutant(area.name, name, number, line, after) for after in changes]
            mutants = [m for m in mutants if m.key() not in equivalent]
            if mutants:
                lines.append(mutants)
    return lines


def read_equivalent():
    """Returns the keys of mutants known to change nothing.

    Three lines each (a comment with the reason, the file with the old line, the new line):
        # REASON
        FILE: OLD LINE
        => NEW LINE
    """
    keys, old = set(), None
    for line in EQUIVALENT.read_text().splitlines():
        if line.startswith("=> "):
            path, _, before = old.partition(": ")
            if before.strip() not in map(str.strip, (ROOT / path).read_text().splitlines()):
                sys.exit(f"mutation: {EQUIVALENT.name} names a line that does not exist: {old}")
            keys.add((path, before.strip(), line[3:].strip()))
        elif line.strip() and not line.startswith("#"):
            old = line
    return keys


class Candidates:
    """Endless mutants, areas in turn, no line twice."""

    def __init__(self, areas, seed):
        self.random = random.Random(seed)
        equivalent = read_equivalent()
        self.lines = {}
        for area in areas:
            lines = lines_to_break(area, equivalent)
            self.random.shuffle(lines)
            self.lines[area.name] = lines
        self.areas = areas

    def next(self, area):
        if not self.lines[area.name]:
            sys.exit(f"mutation: no line of {area.name} is left")
        return self.random.choice(self.lines[area.name].pop())


class Copy:
    """A copy of the tree with a build folder of its own."""

    def __init__(self, folder, limit):
        self.tree = folder / "tree"
        self.build = self.tree / "build" / "dev"
        self.limit = limit
        self.cpu_limits = {}  # seconds, by test binary
        self.environment = dict(os.environ, CCACHE_NOHASHDIR="1")
        names = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                               check=True, capture_output=True, text=True).stdout.split("\0")
        for name in filter(None, names):
            source, target = ROOT / name, self.tree / name
            if source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(source, target)

    def run(self, *command, cpu_limit=None):
        """Returns (status, output); a command that takes too long has status None."""
        def limit_cpu():
            if cpu_limit:
                resource.setrlimit(resource.RLIMIT_CPU, (cpu_limit, cpu_limit))
        try:
            done = subprocess.run(command, cwd=self.tree, env=self.environment, timeout=self.limit, text=True,
                                  errors="replace", stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  stdin=subprocess.DEVNULL, preexec_fn=limit_cpu)
        except subprocess.TimeoutExpired as late:
            return None, str(late)
        if cpu_limit and done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
            return None, done.stdout
        return done.returncode, done.stdout

    def compile(self, tests):
        return self.run("cmake", "--build", "--preset", "dev", "--target", *tests)

    def failure(self, test, name="*"):
        """Runs a test binary, or one test of it. Returns the name of the test that fails, None if all pass."""
        status, output = self.run(str(self.build / "bin" / test), "--gtest_fail_fast", "--gtest_brief=1",
                                  f"--gtest_filter={name}", cpu_limit=self.cpu_limits.get(test))
        if status == 0:
            return None
        if status is None:
            return f"{test} (time limit)"
        failed = re.search(r"\[  FAILED  \] (\S+?),? ", output + " ")
        return failed.group(1) if failed else f"{test} (status {status})"

    def first_failure(self, tests):
        """Returns the name of the first test that fails twice, None if all pass."""
        for test in tests:
            for _ in range(3):
                name = self.failure(test)
                if name is None:
                    break
                one_test = "." in name and " " not in name
                if name.endswith("(time limit)") or self.failure(test, name if one_test else "*"):
                    return name
                print(f"    {name} failed and passed when it was run again", flush=True)
            else:
                sys.exit(f"mutation: {name} fails at times; mend it first")
        return None

    def measure(self, tests):
        """Runs the unchanged tests, which must pass, and limits their CPU time to ten times what they take."""
        for test in tests:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            failure = self.first_failure([test])
            if failure:
                sys.exit(f"mutation: {failure} fails without a mutation")
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            self.cpu_limits[test] = max(30, math.ceil(10 * seconds))


def prepare(copy, areas):
    """Builds the unchanged tests, which must pass."""
    copy.limit, limit = None, copy.limit  # the first build takes minutes
    status, output = copy.run("cmake", "--preset", "dev", "-DCMAKE_COMPILE_WARNING_AS_ERROR=OFF")
    tests = tuple(dict.fromkeys(test for area in areas for test in area.tests))
    if status == 0:
        status, output = copy.compile(tests)
    if status != 0:
        sys.exit(f"mutation: the unchanged tree does not build\n{output[-4000:]}")
    copy.limit = limit
    copy.measure(tests)


def try_mutant(copy, area, mutant):
    """Returns "caught by ...", "survived" or "does not compile"."""
    path = copy.tree / mutant.path
    original = path.read_text()
    lines = original.split("\n")
    lines[mutant.number - 1] = mutant.after
    path.write_text("\n".join(lines))
    try:
        status, _ = copy.compile(area.tests)
        if status != 0:
            return "does not compile"
        failure = copy.first_failure(area.tests)
        return f"caught by {failure}" if failure else "survived"
    finally:
        path.write_text(original)


def check(copy, areas, candidates, count):
    """Tries `count` mutants that compile; returns those that survive."""
    survivors, hung = [], 0
    for i in range(count):
        area = areas[i % len(areas)]
        while True:
            mutant = candidates.next(area)
            start = time.monotonic()
            result = try_mutant(copy, area, mutant)
            if result != "does not compile":
                break
        print(f"{i + 1:3} {area.name:14} {mutant.path}:{mutant.number}: {result} "
              f"({time.monotonic() - start:.0f} s)", flush=True)
        hung += result.endswith("(time limit)")
        if result == "survived":
            survivors.append(mutant)
            print(mutant.diff(), flush=True)
    print(f"mutation: {hung} caught by a time limit")
    return survivors


def main():
    names = [area.name for area in AREAS]
    parser = argparse.ArgumentParser(description="Breaks lines of a copy and runs the tests of each.")
    parser.add_argument("--count", type=int, default=20, help="mutants to try (20)")
    parser.add_argument("--seed", type=int, default=1, help="chooses the lines (1)")
    parser.add_argument("--area", action="append", choices=names, help="only this part of the code; repeatable")
    parser.add_argument("--dry-run", action="store_true", help="print the mutants and build nothing")
    parser.add_argument("--work", type=pathlib.Path, help="folder of the copy, kept for the next run")
    parser.add_argument("--limit", type=float, default=600, help="seconds a build or test binary may take (600)")
    arguments = parser.parse_args()
    areas = [area for area in AREAS if not arguments.area or area.name in arguments.area]
    candidates = Candidates(areas, arguments.seed)
    if arguments.dry_run:
        for area in areas:
            print(f"{area.name}: {len(candidates.lines[area.name])} lines can be broken")
        for i in range(arguments.count):
            print(candidates.next(areas[i % len(areas)]).diff())
        return 0
    folder = arguments.work or pathlib.Path(tempfile.mkdtemp(prefix="tessera-mutation."))
    try:
        copy = Copy(folder, arguments.limit)
        prepare(copy, areas)
        survivors = check(copy, areas, candidates, arguments.count)
    finally:
        if not arguments.work:
            shutil.rmtree(folder, ignore_errors=True)
    caught = arguments.count - len(survivors)
    least = math.ceil(LEAST_CAUGHT * arguments.count)
    print(f"mutation: {caught} of {arguments.count} mutants caught, at least {least} must be (seed {arguments.seed})")
    return 0 if caught >= least else 1


if __name__ == "__main__":
    sys.exit(main())
