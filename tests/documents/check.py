#!/usr/bin/env python3
"""Checks that the documentation agrees with the repository.

    tests/documents/check.py [ROOT]             check every page; exit code 1 and a line per fault
    tests/documents/check.py --commands PAGE    print the commands of PAGE that a test may run
    tests/documents/check.py --output PAGE LOG  check that LOG, their output, has the lines that PAGE shows

Pages are all Markdown files of the source tree. tests/documents/check_test.py shows each check fail.
"""

import os
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# Folders whose paths, written in backquotes on a page, must exist.
FOLDERS = ("proto contract rpc image telemetry cli cmake server worker client webhook tests docs "
           "deploy .ci").split()
# Folders of the root that hold no sources of this repository.
SKIPPED_FOLDERS = {".git", "build"}
SOURCE_SUFFIXES = {".h", ".cpp", ".inc", ".cmake", ".txt", ".py", ".sh", ".proto", ".md", ".yaml",
                   ".yml", ".json", ".service"}
PICTURE_SUFFIXES = {".jpg", ".png", ".svg"}
METRICS_PAGE = "docs/reference/metrics.md"
# A document that a source file names, or one of those that were never in this repository.
RETIRED = re.compile(r"(?<![\w-])(?:design|farm)\.m[d]\b")
DOCUMENT = re.compile(r"\bdocs/[\w/-]+\.(?:md|svg|jpg|json)\b(?:#[\w-]+)?|" + RETIRED.pattern)

FENCE = re.compile(r"^(```|~~~)[^\n]*\n.*?^\1[ \t]*$", re.M | re.S)
LINK = re.compile(r"(!?)\[(?:[^\[\]]|\[[^\[\]]*\])*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]+")
INLINE_CODE = re.compile(r"`[^`\n]*`")
HTML_IMAGE = re.compile(r"<img[^>]*\ssrc=\"([^\"]+)\"")
SHELL_BLOCK = re.compile(r"(?:<!-- (run|not run: [^\n]+) -->\n+)?```sh\n(.*?)```", re.S)

OUTPUT_BLOCK = re.compile(r"<!-- output -->\n+```\n(.*?)```", re.S)


def shell_blocks(text):
    """(mark, commands) of each ```sh block; the mark is `run`, `not run: WHY` or empty."""
    return SHELL_BLOCK.findall(text)


def slug(heading):
    """GitHub's anchor for a heading: link text only, no punctuation, hyphens for spaces."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    text = re.sub(r"[`*]|<[^>]*>", "", text).strip().lower()
    return re.sub(r"[^\w\- ]", "", text).replace(" ", "-")


def anchors(text):
    """Anchors of a page; the second heading of the same text gets the suffix -1, and so on."""
    seen, found = {}, set()
    for heading in re.findall(r"^#{1,6}[ \t]+(.+?)[ \t]*#*$", FENCE.sub("", text), re.M):
        name = slug(heading)
        count = seen.get(name, 0)
        seen[name] = count + 1
        found.add(f"{name}-{count}" if count else name)
    return found | set(re.findall(r"<a (?:id|name)=\"([^\"]+)\"", text))


def chaos_kinds(root):
    """Faults that the chaos test injects: one function each, of the farm and a random generator."""
    path = root / "tests/e2e/chaos/kinds.py"
    return set(re.findall(r"^def (\w+)\(farm, rng", path.read_text(), re.M)) if path.exists() else set()


class Repository:
    """The files that the checks look at, each read once."""

    def __init__(self, root):
        self.root = root
        self.sources, self.pictures = {}, []
        for folder, subfolders, names in os.walk(root):
            if Path(folder) == root:
                subfolders[:] = [name for name in subfolders if name not in SKIPPED_FOLDERS]
            for name in names:
                path = Path(folder, name)
                if path.suffix in SOURCE_SUFFIXES:
                    self.sources[path] = path.read_text(errors="replace")
                elif path.suffix in PICTURE_SUFFIXES:
                    self.pictures.append(path)
        self.pages = {path: text for path, text in self.sources.items() if path.suffix == ".md"}
        self.anchors = {path: anchors(text) for path, text in self.pages.items()}

    def name(self, path):
        return str(path.relative_to(self.root))

    def test_names(self):
        """SUITE.NAME of each unit test, and SERVICE.RPC of the protocol, which look the same."""
        names = set()
        for path, text in self.sources.items():
            if path.suffix == ".cpp" and "tests" in path.parts:
                names.update(f"{suite}.{name}" for suite, name in re.findall(
                    r"^(?:TYPED_)?TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\s*\)", text, re.M))
            elif path.suffix == ".proto":
                for service, body in re.findall(r"^service (\w+) \{\n(.*?)^\}", text, re.M | re.S):
                    names.update(f"{service}.{rpc}" for rpc in re.findall(r"rpc (\w+)\(", body))
        return names

    def options(self):
        """Every --option that a program or a script mentions."""
        return {option for path, text in self.sources.items() if path.suffix != ".md"
                for option in OPTION.findall(text)}

    def metrics(self):
        """Names of the metrics that server and worker register."""
        return {name for path, text in self.sources.items()
                if path.suffix == ".cpp" and "tests" not in path.parts
                for name in re.findall(r"\"(tessera_\w+?)\"", text)}


class Checks:
    """Each check adds a line to `faults` for each thing that is wrong."""

    def __init__(self, repository):
        self.repository = repository
        self.faults = []
        self.linked = set()  # files that some other page links to or shows

    def run(self):
        tests, kinds = self.repository.test_names(), chaos_kinds(self.repository.root)
        options = self.repository.options()
        for page, text in sorted(self.repository.pages.items()):
            prose = FENCE.sub("", text)
            self.check_links(page, INLINE_CODE.sub("``", prose))
            self.check_paths(page, prose)
            self.check_tests(page, prose, tests)
            self.check_chaos_kinds(page, prose, kinds)
            self.check_options(page, prose, options)
            self.check_shell_blocks(page, text)
            self.check_tables(page, prose)
        self.check_metrics()
        self.check_everything_is_linked()
        self.check_documents_in_sources()
        return self.faults

    def fault(self, path, message):
        self.faults.append(f"{self.repository.name(path)}: {message}")

    def check_links(self, page, text):
        """Relative links and pictures name files; fragments name headings."""
        targets = [target for _, target in LINK.findall(text)] + HTML_IMAGE.findall(text)
        for target in targets:
            if re.match(r"[a-z][a-z0-9+.-]*:", target):
                continue  # another site
            name, _, fragment = target.partition("#")
            path = (page.parent / name).resolve() if name else page
            if not path.exists():
                self.fault(page, f"link to a missing file: {target}")
            elif fragment and path in self.repository.anchors:
                if fragment not in self.repository.anchors[path]:
                    self.fault(page, f"link to a missing heading: {target}")
            if path != page:
                self.linked.add(path)

    def check_paths(self, page, text):
        """Paths in backquotes that begin with a folder of the repository exist."""
        folders = "|".join(re.escape(folder) for folder in FOLDERS)
        for path in re.findall(rf"`((?:{folders})/[\w./-]*\w)`", text):
            root = self.repository.root
            if not (root / path).exists() and not list(root.glob(path + ".*")):
                self.fault(page, f"missing file in backquotes: {path}")

    def check_tests(self, page, text, known):
        for name in re.findall(r"`(\w+\.[A-Z]\w+)`", text):
            if name not in known:
                self.fault(page, f"no test or rpc has this name: {name}")

    def check_chaos_kinds(self, page, text, known):
        for names in re.findall(r"chaos: ((?:`\w+`(?:, )?)+)", text):
            for name in re.findall(r"\w+", names):
                if name not in known:
                    self.fault(page, f"the chaos test has no such fault: {name}")

    def check_options(self, page, text, known):
        """An option in backquotes belongs to some program or script. The changelog names old ones."""
        if page.name == "CHANGELOG.md":
            return
        for code in INLINE_CODE.findall(text):
            if code.startswith("`cmake "):
                continue
            for option in OPTION.findall(code):
                if option not in known:
                    self.fault(page, f"no program has this option: {option}")

    def check_metrics(self):
        """The reference lists exactly the metrics that the programs register."""
        page = self.repository.root / METRICS_PAGE
        if page not in self.repository.pages:
            return
        listed = set(re.findall(r"^\| `(tessera_\w+)`", self.repository.pages[page], re.M))
        registered = self.repository.metrics()
        for name in sorted(listed - registered):
            self.fault(page, f"no program has this metric: {name}")
        for name in sorted(registered - listed):
            self.fault(page, f"this metric is missing: {name}")

    def check_shell_blocks(self, page, text):
        """tests/e2e/documented_commands.sh runs README.md and docs/."""
        name = self.repository.name(page)
        if name != "README.md" and not name.startswith("docs/"):
            return
        for mark, commands in shell_blocks(text):
            if not mark:
                first = commands.strip().split("\n")[0]
                self.fault(page, f"```sh block without `run` or `not run: WHY`: {first}")

    def check_tables(self, page, text):
        """Each row has as many cells as the heading. A | inside a cell is written \\|, in code too."""
        heading = 0
        for line in text.split("\n"):
            cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
            if cells and heading and cells != heading:
                self.fault(page, f"a row of {cells - 1} cells in a table of {heading - 1}: {line[:60]}")
            heading = (heading or cells) if cells else 0

    def check_everything_is_linked(self):
        """A page or picture of docs/ that nothing links to cannot be found by a reader."""
        docs = self.repository.root / "docs"
        files = [*self.repository.pages, *self.repository.pictures]
        for path in sorted(files):
            if docs in path.parents and path != docs / "README.md" and path not in self.linked:
                self.fault(path, "no page links to it")

    def check_documents_in_sources(self):
        """Comments and scripts name documents that exist; the links of pages are checked above."""
        for path, text in sorted(self.repository.sources.items()):
            if path.name == "check_test.py":
                continue  # has examples of missing documents
            for match in (RETIRED if path.suffix == ".md" else DOCUMENT).finditer(text):
                name, _, heading = match.group().partition("#")
                document = self.repository.root / name
                line = text.count("\n", 0, match.start()) + 1
                if RETIRED.fullmatch(name) or not document.exists():
                    self.fault(path, f"line {line} names a document that does not exist: {name}")
                elif heading and heading not in self.repository.anchors.get(document, ()):
                    self.fault(path, f"line {line} names a missing heading: {name}#{heading}")


def print_commands(page):
    """The commands of the blocks marked `run`. Exits with a message at a block without a mark."""
    blocks = shell_blocks(Path(page).read_text())
    for mark, commands in blocks:
        if not mark:
            sys.exit(f"{page}: a ```sh block has neither `run` nor `not run: WHY`:\n{commands}")
    print("\n".join(commands for mark, commands in blocks if mark == "run"))


def missing_output(page, log):
    """The lines of blocks marked `output` that no line of `log` matches. An … stands for any text, and
    the seconds that a command took may differ."""
    lines = log.split("\n")
    missing = []
    for block in OUTPUT_BLOCK.findall(page):
        for shown in filter(str.strip, block.split("\n")):
            parts = re.split(r"(…|\b[\d.]+ s(?=,|$))", shown)
            pattern = "".join(".*" if part == "…" else r"[\d.]+ (s|min|h)" if part.endswith(" s") else
                              re.escape(part) for part in parts)
            if not any(re.fullmatch(pattern, line) for line in lines):
                missing.append(shown)
    return missing


def main(arguments):
    if arguments[:1] == ["--commands"]:
        print_commands(arguments[1])
        return 0
    if arguments[:1] == ["--output"]:
        page, log = (Path(name).read_text() for name in arguments[1:])
        missing = missing_output(page, log)
        for line in missing:
            print(f"{arguments[1]}: its commands do not print: {line}")
        if missing:
            print(log)
        return 1 if missing else 0
    root = Path(arguments[0]).resolve() if arguments else ROOT
    if not (root / "docs").is_dir():
        sys.exit(f"{root}: not a checkout: no folder docs")
    repository = Repository(root)
    faults = Checks(repository).run()
    print("\n".join(faults) or f"{len(repository.pages)} pages agree with the repository")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
