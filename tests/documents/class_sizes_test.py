#!/usr/bin/env python3
"""Shows what class_sizes.py counts, and that it finds classes that are too large."""

import tempfile
import unittest
from pathlib import Path

import class_sizes


def faults_of(files, exceptions=()):
    """Faults of a tree with these files below server/."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for name, text in files.items():
            path = root / "server" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return class_sizes.faults(root, exceptions)


def methods_of(text):
    kind, name, body = next(class_sizes.classes(class_sizes.without_comments(text)))
    return sorted(class_sizes.methods(kind, name, body))


def header(count):
    return "class Table {\n public:\n" + "".join(f"  int m{i}();\n" for i in range(count)) + "};\n"


class ClassSizes(unittest.TestCase):
    def test_public_methods_count(self):
        self.assertEqual(methods_of("class A : public B {\n int hidden();\n public:\n"
                                    "  /// Returns f(); see g().\n  bool f(int x = g()) const;\n"
                                    "  std::map<int, std::function<void(int)>> table() const { return h(); }\n"
                                    "  static const char* name(); // name of h()\n"
                                    "  template <typename T>\n  T find(T key) const;\n"
                                    " protected:\n  void inner();\n private:\n  void deeper();\n};"),
                         ["f", "find", "name", "table"])

    def test_overloads_count_once(self):
        self.assertEqual(methods_of("class A { public: int f(); int f() const; int f(int); };"), ["f"])

    def test_constructors_operators_and_types_do_not_count(self):
        self.assertEqual(methods_of("class A {\n public:\n  explicit A(int x) : x_(x) {}\n  ~A();\n"
                                    "  A(const A&) = delete;\n  A& operator=(const A&) = delete;\n"
                                    "  auto operator<=>(const A&) const = default;\n"
                                    "  using F = std::function<void()>;\n  struct In { int g(); };\n"
                                    "  enum class E { one };\n  int f() ABSL_LOCKS(m());\n  int x_ = 0;\n};"),
                         ["f"])

    def test_methods_of_a_struct_are_public(self):
        self.assertEqual(methods_of("struct A { int size() const; int x{};\n private: int y(); };"), ["size"])

    def test_class_with_21_methods_is_a_fault(self):
        self.assertEqual(faults_of({"a.h": header(20)}), [])
        self.assertEqual(faults_of({"a.h": header(21)}),
                         ["server/a.h: Table has 21 public methods, at most 20 are allowed"])

    def test_nested_class_is_counted_by_itself(self):
        nested = "class Outer {\n public:\n" + header(21).replace("\n", " ") + "\n};\n"
        self.assertEqual(faults_of({"a.h": nested}),
                         ["server/a.h: Outer::Table has 21 public methods, at most 20 are allowed"])

    def test_lines_of_all_source_files_are_summed(self):
        source = "int Table::m0() {\n" + "\n" * 248 + "}\n"
        tree = {"a.h": header(1), "one.cpp": source, "other/two.cpp": source}
        self.assertEqual(faults_of(tree), [])
        self.assertEqual(faults_of({**tree, "three.cpp": "void Table::m1() {}\n"}),
                         ["server/a.h: Table has 501 lines of source, at most 500 are allowed"])

    def test_exception_excuses_one_class(self):
        self.assertEqual(faults_of({"a.h": header(21)}, {"Table": "why"}), [])

    def test_exception_without_need_is_a_fault(self):
        self.assertEqual(faults_of({"a.h": header(2)}, {"Table": "why"}), ["Table needs no exception"])


if __name__ == "__main__":
    unittest.main()
