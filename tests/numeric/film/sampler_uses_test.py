#!/usr/bin/env python3
"""Shows that sampler_uses.py finds expressions whose order of evaluation matters, and only those."""

import unittest

import sampler_uses

DECLARATIONS = """
#include "worker/sampling/sampler.h"
float f(float a, float b);
struct Path {
  explicit Path(const Sampler& sampler) : sampler_(sampler), random(sampler) {}
  Sampler sampler_;
  HashSequence random;
};
"""


def faulty_lines(body):
    """Lines of `body` that have a fault; it is the body of a member function."""
    text = DECLARATIONS + "void Path::act(HashSequence* random) {\n" + body + "\n}\n"
    first = text[:text.index(body)].count("\n")
    faults, _ = sampler_uses.faults_of({"a.cpp": text})
    return [int(fault.split(":")[1]) - first for fault in faults]


class SamplerUses(unittest.TestCase):
    def expect_faults(self, body, *lines):
        self.assertEqual(faulty_lines(body), list(lines), body)

    def test_two_draws_as_arguments(self):
        self.expect_faults("int x = 0;\nf(random->next(), random->next());", 2)
        self.expect_faults("f(sampler_.get_1d(0), sampler_.get_1d(1));", 1)
        self.expect_faults("f(sampler_.get_1d(0),\n  // comment\n  sampler_.get_1d(1));", 3)

    def test_two_draws_as_operands(self):
        self.expect_faults("const float x = random->next() - 2 * random->next();", 1)
        self.expect_faults("if (random->next() < random->next()) return;", 1)

    def test_draw_beside_a_call_that_draws(self):
        self.expect_faults("light += passes(segment, random) * random->next();", 1)
        self.expect_faults("light += passes(segment, &path.random) * emitted(segment, &path.random);", 1)

    def test_draws_of_two_generators(self):
        self.expect_faults("f(sampler_.get_1d(0), random->next());", 1)

    def test_temporary_generators(self):
        self.expect_faults("f(Sampler(0, 1).get_1d(0), Sampler(0, 2).get_1d(0));", 1)

    def test_initialiser_among_arguments(self):
        self.expect_faults("f(first({random->next(), 1}), random->next());", 1)

    def test_fault_inside_a_lambda(self):
        self.expect_faults("each([&](int i) {\n  f(random->next(), random->next());\n});", 2)

    def test_one_draw_in_each_expression(self):
        self.expect_faults("const float a = random->next();\nconst float b = random->next();\nf(a, b);")
        self.expect_faults("for (float u = random->next(); u < 1; u += random->next()) act(random);")
        self.expect_faults("const float a = random->next(), b = random->next();")

    def test_braced_initialisers_have_an_order(self):
        self.expect_faults("const Vec2f u = {random->next(), random->next()};")

    def test_members_of_a_constructor_have_an_order(self):
        self.expect_faults("")

    def test_comments_and_text(self):
        self.expect_faults('f(random->next(), 1);  // not random->next()\nlog("random", "random");')

    def test_bodies_of_lambdas_are_expressions_of_their_own(self):
        self.expect_faults("each([&](int i) { f(random->next(), i); }, [&] { random->next(); });")

    def test_samplers_of_textures(self):
        faults, _ = sampler_uses.faults_of({"a.cpp": DECLARATIONS, "b.cpp": "x = f(sampler, sampler);"})
        self.assertEqual(faults, [])


if __name__ == "__main__":
    unittest.main()
