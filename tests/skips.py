#!/usr/bin/env python3
"""Lists the tests that a ctest run skipped, with their reasons.

    tests/skips.py REPORT.xml [--strict]

REPORT.xml comes from `ctest --output-junit`. With --strict, fails if a test was skipped that
tests/allowed_skips.txt does not list with that reason.
"""
import argparse
import pathlib
import re
import sys
import xml.etree.ElementTree

ALLOWED = pathlib.Path(__file__).parent / "allowed_skips.txt"


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


def skipped_tests(report):
    """Returns (name, reason) for each test of a report that did not run."""
    root = xml.etree.ElementTree.parse(report).getroot()
    cases = root.iter("testcase")
    return [(c.get("name"), reason_of(c)) for c in cases if c.find("skipped") is not None]


def main():
    parser = argparse.ArgumentParser(description="Lists skipped tests and their reasons.")
    parser.add_argument("report", help="JUnit file of ctest")
    parser.add_argument("--strict", action="store_true", help="fail on skips that are not allowed")
    arguments = parser.parse_args()
    allowed = read_allowed(ALLOWED)
    skipped = skipped_tests(arguments.report)
    print(f"{len(skipped)} tests skipped")
    forbidden = 0
    for name, reason in skipped:
        is_allowed = any(name == test and text in reason for test, text in allowed)
        forbidden += not is_allowed
        print(f"  {name}: {reason}{'' if is_allowed else ' (not in tests/allowed_skips.txt)'}")
    return 1 if arguments.strict and forbidden else 0


if __name__ == "__main__":
    sys.exit(main())
