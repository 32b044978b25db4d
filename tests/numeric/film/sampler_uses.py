#!/usr/bin/env python3
"""Fails if an expression in worker/ uses random numbers more than once (hard case 76).

C++ leaves open in which order the operands of an expression and the arguments of a call are
evaluated, and GCC and Clang choose differently: f(random.next(), random.next()) has other arguments
with each. So a full expression may use at most one generator, once. A use is

- a variable of a type in GENERATORS, in files that name such a type: calling its member or passing it
- a call of a member function in DRAWS, however its object is named

Where the order is defined there are several expressions: declarators, braced initialisers, members of
a constructor's list.

Usage: sampler_uses.py DIRECTORY...
"""

import re
import sys
from pathlib import Path

GENERATORS = ("Sampler", "HashSequence")
DRAWS = ("get_1d", "get_2d", "get_4d", "get_4d_fine", "chance", "hash", "next", "random")

# A brace after these holds statements: the body of a function, a lambda or a branch.
BEFORE_STATEMENTS = (")", "]", "const", "noexcept", "mutable", "override", "else", "do", ";", "{", "}")

TOKEN = re.compile(r"""
    //[^\n]* | /\*.*?\*/ | (?m:^[ \t]*\#(?:\\\n|[^\n])*)   # comments and directives: no token
  | R"(?P<raw>[^(\s]*)\(.*?\)(?P=raw)" | "(?:\\.|[^"\\])*" | '(?:\\.|[^'\\])'
  | \n | (?P<token>[A-Za-z_]\w* | \d(?:[\w.]|'\d)* | -> | :: | && | \S)
""", re.VERBOSE | re.DOTALL)


def tokens_of(text):
    """(token, line) of C++ source without comments, directives and literals."""
    line = 1
    for match in TOKEN.finditer(text):
        if match["token"]:
            yield match["token"], line
        elif match[0]:
            line += match[0].count("\n")


def declared_names(texts):
    """Names of variables, members and parameters of a type in GENERATORS."""
    names = set()
    for text in texts:
        names.update(re.findall(r"\b(?:%s)\b\s*[*&]?\s*(\w+)\s*[;,)({=]" % "|".join(GENERATORS), text))
    return names - {"operator"}


class Braces:
    """What is inside an open brace."""

    def __init__(self, statements):
        self.statements = statements  # and not initialisers
        self.uses = 0  # of the current expression
        self.total = 0
        self.parentheses = []  # for each open one, the token before it


class Expressions:
    """Counts the uses in each full expression of one file."""

    def __init__(self, names):
        self.names = names
        self.faults = []
        self.braces = [Braces(statements=True)]

    def use(self, line):
        inner = self.braces[-1]
        inner.total += 1
        inner.uses += 1
        if inner.uses == 2:
            self.faults.append(line)

    def close_brace(self, line):
        if len(self.braces) == 1:
            return
        closed = self.braces.pop()
        # An initialiser among the arguments of a call is part of that call's expression.
        if not self.braces[-1].parentheses:
            self.braces[-1].uses = 0
        elif not closed.statements and closed.total > 0:
            self.use(line)

    def is_use(self, before, token, after):
        if token in DRAWS and after == "(" and before and before[-1] in (".", "->"):
            # The name of the object has been counted, unless it is a temporary or a call.
            return len(before) < 2 or before[-2] not in self.names
        if token not in self.names:
            return False
        is_declared = any(t in GENERATORS for t in before[-2:])
        return not is_declared and after != "("

    def read(self, tokens):
        """Returns the lines of the second use in an expression."""
        for i, (token, line) in enumerate(tokens):
            before = [t for t, _ in tokens[max(0, i - 3):i]]
            after = tokens[i + 1][0] if i + 1 < len(tokens) else ""
            inner = self.braces[-1]
            if token == "{":
                self.braces.append(Braces(statements=bool(before) and before[-1] in BEFORE_STATEMENTS))
            elif token == "}":
                self.close_brace(line)
            elif token in "([":
                inner.parentheses.append(before[-1] if before else "")
            elif token in ")]" and inner.parentheses:
                if inner.parentheses.pop() in ("for", "if", "while", "switch"):
                    inner.uses = 0
            elif token == ";" or (token == "," and not inner.parentheses):
                inner.uses = 0
            elif self.is_use(before, token, after):
                self.use(line)
        return self.faults


def faults_of(files):
    """Returns the faults of {name: text}, as lines of text, and the names of generators."""
    names = declared_names(files.values())
    faults = []
    for name, text in sorted(files.items()):
        # Elsewhere the same names mean other things, such as samplers of textures.
        has_generator = re.search(r"\b(?:%s)\b" % "|".join(GENERATORS), text)
        lines = Expressions(names if has_generator else set()).read(list(tokens_of(text)))
        faults += [f"{name}:{line}: an expression uses random numbers twice; name each number first"
                   for line in lines]
    return faults, names


def main():
    paths = [path for folder in sys.argv[1:] for path in sorted(Path(folder).rglob("*"))
             if path.suffix in (".h", ".cpp")]
    faults, names = faults_of({str(path): path.read_text() for path in paths})
    print("\n".join(faults))
    print(f"{len(paths)} files checked; generators are named {', '.join(sorted(names))}")
    if not names:
        sys.exit("no variable of a generator's type was found: this is not the renderer")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
