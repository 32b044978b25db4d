#!/usr/bin/env python3
"""Shows that summary.py prints the end of failed tests, and that --strict accepts the skips on the list only."""

import contextlib
import io
import os
import tempfile
import unittest

import summary

RAN = '<testcase name="unit.A.Runs" status="run"/>'
SKIPPED = ('<testcase name="{}" status="notrun"><skipped message="SKIP_RETURN_CODE=77"/>'
           "<system-out>SKIPPED: {}\n</system-out></testcase>")


def summarise(*cases):
    """Returns exit code and output of summary.py --strict for a report with these test cases."""
    with tempfile.NamedTemporaryFile("w", suffix=".xml", delete=False) as file:
        file.write(f"<testsuite>{''.join(cases)}</testsuite>")
    try:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            return summary.main([file.name, "--strict"]), printed.getvalue()
    finally:
        os.unlink(file.name)


def status_of(*cases):
    return summarise(*cases)[0]


class Failures(unittest.TestCase):
    def test_end_of_output_is_printed(self):
        lines = "\n".join(f"line {number}" for number in range(100))
        failed = ('<testcase name="e2e.chaos" status="fail"><failure message="Failed"/>'
                  f"<system-out>{lines}</system-out></testcase>")
        _, printed = summarise(RAN, failed)
        self.assertIn("e2e.chaos failed", printed)
        self.assertIn("line 99", printed)
        self.assertNotIn("line 1\n", printed)

    def test_passed_tests_are_not_printed(self):
        self.assertNotIn("unit.A.Runs", summarise(RAN)[1])


class StrictSkips(unittest.TestCase):
    def test_report_without_skips_passes(self):
        self.assertEqual(status_of(RAN), 0)

    def test_listed_skip_with_its_reason_passes(self):
        self.assertEqual(status_of(RAN, SKIPPED.format("e2e.slurm", "needs root")), 0)

    def test_listed_skip_with_another_reason_fails(self):
        self.assertEqual(status_of(RAN, SKIPPED.format("e2e.slurm", "no network")), 1)

    def test_unlisted_skip_fails(self):
        self.assertEqual(status_of(RAN, SKIPPED.format("e2e.chaos", "needs root")), 1)

    def test_skip_without_a_reason_fails(self):
        self.assertEqual(status_of(RAN, '<testcase name="e2e.slurm"><skipped/></testcase>'), 1)

    def test_disabled_test_fails(self):
        self.assertEqual(status_of(RAN, '<testcase name="unit.A.DISABLED_B" status="disabled"/>'), 1)

    def test_unlisted_skip_within_a_program_fails(self):
        report = ('<testcase name="unit.film.0" status="run"><system-out>[ RUN      ] A.Runs\n'
                  "[       OK ] A.Runs (0 ms)\n[ RUN      ] {0}\nfile.cpp:3: Skipped\n{1}\n\n"
                  "[  SKIPPED ] {0} (0 ms)\n[  SKIPPED ] 1 test, listed below:\n</system-out></testcase>")
        listed = "FrameWriterTest.WideFrameIsWrittenInBands"
        self.assertEqual(status_of(report.format(listed, "a sanitizer keeps freed memory")), 0)
        self.assertEqual(status_of(report.format(listed, "no reason")), 1)
        self.assertEqual(status_of(report.format("A.Other", "a sanitizer keeps freed memory")), 1)

    def test_report_without_tests_fails(self):
        self.assertEqual(status_of(), 1)


if __name__ == "__main__":
    unittest.main()
