#!/usr/bin/env python3
"""Summarises a run of ctest: the end of the output of each failed test, and the skipped tests with their reasons.

    tests/summary.py REPORT.xml [--strict]

REPORT.xml comes from `ctest --output-junit`. A disabled test (DISABLED_ in its name) counts as
skipped. With --strict, fails if a test was skipped that tests/allowed_skips.txt does not list with
that reason, or if no test ran at all.
"""
import argparse
import pathlib
import re
import sys
import xml.etree.ElementTree

ALLOWED = pathlib.Path(__file__).parent / "allowed_skips.txt"
LINES_OF_FAILURE = 40


def read_allowed(path):
    """Returns the pairs of test name and reason of a list, without its comments."""
    pairs = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        line = line.split("#")[0].strip()
        if not line:
            continue
        name, separator, reason = line.partition(": ")
        if not separator or not reason.strip():
            raise ValueError(f"{path.name}:{number}: not TEST: REASON")
        pairs.append((name, reason.strip()))
    return pairs


def reason_of(case):
    """Returns the reason that a skipped test printed."""
    output = case.findtext("system-out") or ""
    script = re.search(r"^SKIPPED: (.+)$", output, re.MULTILINE)
    if script:
        return script.group(1).strip()
    google_test = re.search(r"Skipped\n(.+)\n", output)
    if google_test:
        return google_test.group(1).strip()
    skipped = case.find("skipped")
    return (skipped.get("message") if skipped is not None else None) or "no reason given"


def skips_within(case):
    """Returns (name, reason) of the skipped tests of a program that ctest ran as one test."""
    kind = case.get("name").split(".")[0]
    output = case.findtext("system-out") or ""
    return [(f"{kind}.{name}", reason.strip()) for reason, name in
            re.findall(r"Skipped\n(.*)\n(?:.*\n)*?\[  SKIPPED \] (\S+)", output)]


def read_report(path):
    """Returns the number of tests of a report that ran, and (name, reason) of each that did not."""
    ran, skipped = 0, []
    for case in xml.etree.ElementTree.parse(path).getroot().iter("testcase"):
        if case.find("skipped") is not None:
            skipped.append((case.get("name"), reason_of(case)))
        elif case.get("status") == "disabled":  # has no element of its own in ctest's report
            skipped.append((case.get("name"), "disabled"))
        else:
            ran += 1
            skipped += skips_within(case)
    return ran, skipped


def read_failures(path):
    """Returns (name, last lines of its output) of each failed test of a report."""
    return [(case.get("name"), (case.findtext("system-out") or "").splitlines()[-LINES_OF_FAILURE:])
            for case in xml.etree.ElementTree.parse(path).getroot().iter("testcase")
            if case.find("failure") is not None]


def main(arguments=None):
    parser = argparse.ArgumentParser(description="Prints failed and skipped tests.")
    parser.add_argument("report", help="JUnit file of ctest")
    parser.add_argument("--strict", action="store_true", help="fail on skips that are not allowed")
    options = parser.parse_args(arguments)
    allowed = read_allowed(ALLOWED)
    for name, lines in read_failures(options.report):
        print(f"{name} failed; the end of its output:")
        print("\n".join(f"  | {line}" for line in lines))
    ran, skipped = read_report(options.report)
    print(f"{len(skipped)} tests skipped")
    forbidden = 0
    for name, reason in skipped:
        is_allowed = any(name == test and text in reason for test, text in allowed)
        forbidden += not is_allowed
        print(f"  {name}: {reason}{'' if is_allowed else ' (not in tests/allowed_skips.txt)'}")
    if ran == 0:
        print("no test ran")
    return 1 if options.strict and (forbidden or ran == 0) else 0


if __name__ == "__main__":
    sys.exit(main())
