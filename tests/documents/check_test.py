#!/usr/bin/env python3
"""Shows that each check of check.py finds its fault, and only that."""

import tempfile
import unittest
from pathlib import Path

import check

GOOD = {
    "README.md": "# Title\n[docs](docs/README.md) `tests/a_test.cpp`\n",
    "docs/README.md": "# Index\n## A `b` & c\n## A `b` & c\n"
                      "[page](page.md#two-words), [here](#a-b--c), [again](#a-b--c-1)\n"
                      "![a](picture.jpg) [site](https://example.org/x)\n"
                      "`Suite.Name`, `FarmService.Lease`, chaos: `power_cut`, `hang`\n",
    "docs/page.md": "# Two words\n<!-- run -->\n```sh\n# a comment\ntrue\n```\n\n"
                    "<!-- not run: slow -->\n```sh\nfalse\n```\n",
    "docs/picture.jpg": "",
    "proto/farm.proto": "service FarmService {\n  rpc Lease(A) returns (B);\n}\n",
    "tests/a_test.cpp": 'TEST(Suite, Name) {\n  run("--seed");\n',
    "tests/e2e/chaos/kinds.py": "def power_cut(farm, rng):\ndef hang(farm, rng):\n",
}


def faults_of(changes):
    """Faults of the good tree with text appended to some of its files, or files added."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder).resolve()
        for name in {**GOOD, **changes}:
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(GOOD.get(name, "") + changes.get(name, ""))
        return check.Checks(check.Repository(root)).run()


class DocumentsCheck(unittest.TestCase):
    def expect(self, message, **changes):
        text = {name.replace("__", "/").replace("_md", ".md"): t for name, t in changes.items()}
        self.assertEqual(faults_of(text), [message])

    def test_good_tree_has_no_fault(self):
        self.assertEqual(faults_of({}), [])

    def test_only_the_build_folder_of_the_root_is_skipped(self):
        self.assertEqual(faults_of({"build/page.md": "[x](no.md)"}), [])
        self.assertEqual(faults_of({"worker/build/README.md": "[x](no.md)"}),
                         ["worker/build/README.md: link to a missing file: no.md"])

    def test_missing_file(self):
        self.expect("README.md: link to a missing file: docs/no.md", README_md="[x](docs/no.md)")

    def test_missing_heading_of_another_page(self):
        self.expect("README.md: link to a missing heading: docs/page.md#three",
                    README_md="[x](docs/page.md#three)")

    def test_missing_heading_of_the_same_page(self):
        self.expect("docs/page.md: link to a missing heading: #no", docs__page_md="[x](#no)")

    def test_comment_in_a_shell_block_is_no_heading(self):
        self.expect("docs/page.md: link to a missing heading: #a-comment",
                    docs__page_md="[x](#a-comment)")

    def test_missing_picture(self):
        self.expect("README.md: link to a missing file: docs/no.jpg", README_md="![x](docs/no.jpg)")

    def test_picture_that_no_page_shows(self):
        self.assertEqual(faults_of({"docs/other.jpg": ""}), ["docs/other.jpg: no page links to it"])

    def test_page_that_no_page_links_to(self):
        self.assertEqual(faults_of({"docs/how-to/x.md": "# X\n"}),
                         ["docs/how-to/x.md: no page links to it"])

    def test_missing_path_in_backquotes(self):
        for folder in check.FOLDERS:
            self.expect(f"README.md: missing file in backquotes: {folder}/no.cpp",
                        README_md=f"`{folder}/no.cpp`")

    def test_unknown_test(self):
        self.expect("README.md: no test or rpc has this name: Suite.Other",
                    README_md="`Suite.Other`")

    def test_unknown_chaos_kind(self):
        self.expect("README.md: the chaos test has no such fault: flood",
                    README_md="chaos: `hang`, `flood`")

    def test_unknown_option(self):
        self.expect("README.md: no program has this option: --seeds",
                    README_md="`render --seed 1 --seeds 2`")

    def test_metrics_of_page_and_programs(self):
        page = "| `tessera_jobs` | jobs |\n| `tessera_units` | units |\n"
        self.assertEqual(
            faults_of({"docs/reference/metrics.md": page,
                       "server/metrics.cpp": '"tessera_jobs", "tessera_tasks"',
                       "README.md": "[metrics](docs/reference/metrics.md)"}),
            ["docs/reference/metrics.md: no program has this metric: tessera_units",
             "docs/reference/metrics.md: this metric is missing: tessera_tasks"])

    def test_shell_block_without_mark(self):
        self.expect("docs/page.md: ```sh block without `run` or `not run: WHY`: true",
                    docs__page_md="\n```sh\ntrue\n```\n")

    def test_table_row_with_an_unescaped_bar(self):
        table = "\n| option | meaning |\n|---|---|\n| `--x A\\|B` | x |\n| `--y A%sB` | y |\n"
        self.assertEqual(faults_of({"README.md": table % "\\|"}), [])
        self.expect("README.md: a row of 3 cells in a table of 2: | `--y A|B` | y |", README_md=table % "|")

    def test_missing_document_in_a_source_file(self):
        for name in ("design." + "md", "docs/" + "no.md"):
            self.assertEqual(
                faults_of({"tests/a_test.cpp": f"// {name}, section 3\n"}),
                [f"tests/a_test.cpp: line 3 names a document that does not exist: {name}"])

    def test_missing_heading_in_a_source_file(self):
        self.assertEqual(faults_of({"tests/a_test.cpp": "// docs/page.md#two-words, docs/page.md#six\n"}),
                         ["tests/a_test.cpp: line 3 names a missing heading: docs/page.md#six"])

    def test_shown_output_is_compared(self):
        page = "<!-- output -->\n```\na.png: 8x6, error 0.5, 1.2 s\nmemory 1 MiB, …\n```\n```\nnot compared\n```\n"
        self.assertEqual(check.missing_output(page, "memory 1 MiB, x\na.png: 8x6, error 0.5, 10 s\n"), [])
        self.assertEqual(check.missing_output(page, "memory 1 MiB, x\na.png: 8x6, error 0.6, 1.2 s\n"),
                         ["a.png: 8x6, error 0.5, 1.2 s"])
        self.assertEqual(check.missing_output(page, "memory 11 MiB, x\na.png: 8x6, error 0.5, 1 s\n"),
                         ["memory 1 MiB, …"])


if __name__ == "__main__":
    unittest.main()
