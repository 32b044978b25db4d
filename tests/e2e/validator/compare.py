#!/usr/bin/env python3
"""Compares `tessera-worker inspect --validate` with the Khronos glTF validator.

    compare.py table FOLDER      prints the table of the validator's findings in the files of a directory
    compare.py check FOLDER      fails if the table in verdicts.txt differs from the validator's findings
    compare.py both FILE...      fails if the findings of the two differ for a file

Needs verdicts.mjs and the npm package in the working directory. differences.txt lists files for which
the findings differ.
"""

import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
BATCH = 50


def oracle(files):
    """Returns the validator's findings: a set for each file, None if the validator fails."""
    if not files:
        return {}
    try:
        done = subprocess.run(["node", "verdicts.mjs", *files], capture_output=True, timeout=120)
        found = json.loads(done.stdout)
    except (json.JSONDecodeError, subprocess.TimeoutExpired):
        if len(files) == 1:
            return {files[0]: None}
        half = len(files) // 2
        return oracle(files[:half]) | oracle(files[half:])
    return {file: None if pairs is None else {tuple(pair) for pair in pairs}
            for file, pairs in found.items()}


def oracle_in_batches(files):
    found = {}
    for at in range(0, len(files), BATCH):
        found |= oracle(files[at:at + BATCH])
    return found


def ours(file):
    done = subprocess.run(["tessera-worker", "inspect", "--json", "--validate", file],
                          capture_output=True, check=False)
    validation = json.loads(done.stdout)["validation"]
    return {(each["code"], each["pointer"]) for each in validation["findings"]}, validation["omitted"]


def differences():
    lines = (HERE / "differences.txt").read_text().splitlines()
    return {line.split(":")[0] for line in lines if line and not line.startswith("#")}


def has_wrong_pointer(pair):
    """Returns whether the pointer may be wrong: that of an unused sampler or extension object often is."""
    code, pointer = pair
    return code == "UNUSED_OBJECT" and ("/channels/samplers/" in pointer
                                        or pointer.startswith("/animations/"))


def table(files):
    lines = []
    for file, pairs in oracle_in_batches(files).items():
        name = Path(file).name
        if pairs is None:
            continue
        lines += [f"{name}\t{code}\t{pointer}" for code, pointer in sorted(pairs)] or [f"{name}\t-\t"]
    return sorted(lines)


def check(files):
    listed = differences()
    skip = lambda lines: [line for line in lines if line.split("\t")[0] not in listed]
    expected = skip((HERE / "verdicts.txt").read_text().splitlines())
    found = skip(table(files))
    for line in sorted(set(expected) ^ set(found)):
        print("only in the table:" if line in expected else "not in the table:", line)
    print(f"{len(files)} files, {len(found)} findings")
    return expected == found


def both(files):
    listed, failed = differences(), 0
    for file, theirs in oracle_in_batches(files).items():
        if theirs is None or Path(file).name in listed:
            continue
        mine, omitted = ours(file)
        if any(has_wrong_pointer(pair) for pair in theirs):
            mine, theirs = ({p for p in each if p[0] != "UNUSED_OBJECT"} for each in (mine, theirs))
        if omitted:
            theirs = theirs & mine
        failed += mine != theirs
        for pair in sorted(mine ^ theirs):
            print(f"{file}: only {'Tessera' if pair in mine else 'Khronos'}: {' '.join(pair)}")
    print(f"{len(files)} files, {failed} with another verdict")
    return failed == 0


def main():
    mode, arguments = sys.argv[1], sys.argv[2:]
    if mode == "both":
        sys.exit(0 if both(arguments) else 1)
    files = sorted(str(each) for each in Path(arguments[0]).glob("*.gl*"))
    if mode == "table":
        print("\n".join(table(files)))
    else:
        sys.exit(0 if check(files) else 1)


if __name__ == "__main__":
    main()
