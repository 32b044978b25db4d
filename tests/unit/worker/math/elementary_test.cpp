#include "worker/math/elementary.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

namespace tessera::render {
namespace {

using Exact = long double;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kInfD = std::numeric_limits<double>::infinity();

/// Error of `got` in units of the last place of `T` at the exact value; infinite when only one of
/// them is NaN or infinite. The reference is glibc's long double, precise to about 2^-11 of a
/// double's ulp.
template <typename T>
double ulp_error(T got, long double exact) {
  constexpr int kDigits = std::numeric_limits<T>::digits;
  constexpr int kLowest = std::numeric_limits<T>::min_exponent - kDigits;
  const T rounded = static_cast<T>(exact);
  if (std::isnan(got) || std::isnan(rounded)) {
    return std::isnan(got) && std::isnan(rounded) ? 0 : kInfD;
  }
  if (std::isinf(got) || std::isinf(rounded)) return got == rounded ? 0 : kInfD;
  int exponent = 0;
  std::frexp(exact, &exponent);
  const long double ulp = std::ldexp(1.0L, std::max(exponent - kDigits, kLowest));
  return static_cast<double>(std::fabs(static_cast<long double>(got) - exact) / ulp);
}

/// Arguments of every magnitude, near 0, near multiples of pi/4, and near 1, in turn.
template <typename T>
class Arguments {
 public:
  explicit Arguments(std::uint64_t seed) : random_(seed) {}
  T operator()(int i) {
    using Bits = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
    const double u = std::uniform_real_distribution<double>(-1, 1)(random_);
    switch (i % 6) {
      case 0:
        return std::bit_cast<T>(static_cast<Bits>(random_()));
      case 1:
        return static_cast<T>(u * 4);
      case 2:
        return static_cast<T>(u * 800);
      case 3: {
        const double turn = std::floor(u * 1e6) * 0.78539816339744831;
        return static_cast<T>(turn * (1 + u * 0x1p-20));
      }
      case 4:
        return static_cast<T>(1 + u * std::ldexp(1.0, -static_cast<int>(random_() % 30)));
      default:
        return static_cast<T>(u * std::ldexp(1.0, -static_cast<int>(random_() % 60)));
    }
  }

 private:
  std::mt19937_64 random_;
};

template <typename T, typename F, typename Reference>
void expect_within(double bound, F function, Reference exact, const char* name,
                   int count = 200'000) {
  Arguments<T> arguments(20240607);
  double worst = 0;
  T where = 0;
  for (int i = 0; i < count; ++i) {
    const T x = arguments(i);
    const double error = ulp_error<T>(function(x), exact(static_cast<long double>(x)));
    if (error > worst) {
      worst = error;
      where = x;
    }
  }
  EXPECT_LE(worst, bound) << name << " at " << std::hexfloat << where;
}

#define EXPECT_UNARY(T, bound, name)                  \
  expect_within<T>(                                   \
      bound, [](T x) { return elementary::name(x); }, \
      [](long double x) -> long double { return std::name(x); }, #name)

TEST(Elementary, FloatErrorIsBelow0502Ulp) {
  EXPECT_UNARY(float, 0.502, sin);
  EXPECT_UNARY(float, 0.502, cos);
  EXPECT_UNARY(float, 0.502, tan);
  EXPECT_UNARY(float, 0.502, exp);
  EXPECT_UNARY(float, 0.502, expm1);
  EXPECT_UNARY(float, 0.502, log);
  EXPECT_UNARY(float, 0.502, log1p);
  EXPECT_UNARY(float, 0.502, acos);
  EXPECT_UNARY(float, 0.502, asin);
}

TEST(Elementary, DoubleErrorIsWithinDocumentedUlp) {
  EXPECT_UNARY(double, 2, sin);
  EXPECT_UNARY(double, 2, cos);
  EXPECT_UNARY(double, 4, tan);
  EXPECT_UNARY(double, 2, exp);
  EXPECT_UNARY(double, 2, log);
  EXPECT_UNARY(double, 4, acos);
  EXPECT_UNARY(double, 4, asin);
}

TEST(Elementary, BinaryFunctionErrorIsWithinDocumentedUlp) {
  Arguments<float> floats(1);
  Arguments<double> doubles(2);
  for (int i = 0; i < 300'000; ++i) {
    const float y = floats(i), x = floats(i / 6);
    ASSERT_LE(ulp_error<float>(elementary::atan2(y, x), std::atan2(Exact{y}, x)), 0.502)
        << std::hexfloat << y << ' ' << x;
    const float base = std::fabs(x);
    ASSERT_LE(ulp_error<float>(elementary::pow(base, y), std::pow(Exact{base}, y)), 0.502)
        << std::hexfloat << base << ' ' << y;
    const double yd = doubles(i), xd = doubles(i / 6);
    ASSERT_LE(ulp_error<double>(elementary::atan2(yd, xd), std::atan2(Exact{yd}, xd)), 3)
        << std::hexfloat << yd << ' ' << xd;
    const double positive = std::fabs(xd);
    const long double power = std::pow(Exact{positive}, yd);
    const bool moderate = std::fabs(std::log(power)) <= 32;
    ASSERT_LE(ulp_error<double>(elementary::pow(positive, yd), power), moderate ? 4 : 20)
        << std::hexfloat << positive << ' ' << yd;
  }
}

TEST(Elementary, HugeAnglesAreReducedExactly) {
  // The float and the double nearest to a multiple of pi/2 (J.-M. Muller, Elementary Functions, 2nd
  // ed., table 11.1 for the double).
  EXPECT_LE(ulp_error<float>(elementary::cos(0x1.ddc8a6p+36f), std::cos(0x1.ddc8a6p+36L)), 0.502);
  const double hardest = std::ldexp(6381956970095103.0, 797);
  EXPECT_LE(ulp_error<double>(elementary::cos(hardest), std::cos(Exact{hardest})), 2);
  const double largest = std::numeric_limits<double>::max();
  EXPECT_LE(ulp_error<double>(elementary::sin(largest), std::sin(Exact{largest})), 2);
  for (int e = 15; e < 128; ++e) {
    const float x = std::ldexp(1.2345678f, e);
    EXPECT_LE(ulp_error<float>(elementary::sin(x), std::sin(Exact{x})), 0.502) << x;
    EXPECT_LE(ulp_error<float>(elementary::cos(-x), std::cos(Exact{x})), 0.502) << x;
  }
}

TEST(Elementary, SpecialArgumentsGiveDocumentedValues) {
  EXPECT_TRUE(std::isnan(elementary::sin(kInf)));
  EXPECT_TRUE(std::isnan(elementary::cos(-kInfD)));
  EXPECT_TRUE(std::signbit(elementary::sin(-0.0f)));
  EXPECT_EQ(elementary::exp(-kInf), 0);
  EXPECT_EQ(elementary::exp(kInf), kInf);
  EXPECT_EQ(elementary::exp(0.0), 1);
  EXPECT_EQ(elementary::expm1(-kInf), -1);
  EXPECT_TRUE(std::signbit(elementary::expm1(-0.0f)));
  EXPECT_EQ(elementary::log(0.0f), -kInf);
  EXPECT_EQ(elementary::log(-0.0), -kInfD);
  EXPECT_EQ(elementary::log(kInf), kInf);
  EXPECT_EQ(elementary::log(1.0f), 0);
  EXPECT_TRUE(std::isnan(elementary::log(-1.0)));
  EXPECT_EQ(elementary::log1p(-1.0f), -kInf);
  EXPECT_TRUE(std::isnan(elementary::log1p(-1.5f)));
  EXPECT_TRUE(std::isnan(elementary::acos(1.0000001f)));
  EXPECT_TRUE(std::isnan(elementary::asin(-2.0)));
  EXPECT_EQ(elementary::acos(1.0f), 0);
  EXPECT_EQ(elementary::acos(-1.0f), 3.14159265f);
  for (const float bad : {kNan, -kNan}) {
    EXPECT_TRUE(std::isnan(elementary::sin(bad)) && std::isnan(elementary::exp(bad)));
    EXPECT_TRUE(std::isnan(elementary::log(bad)) && std::isnan(elementary::log1p(bad)));
    EXPECT_TRUE(std::isnan(elementary::expm1(bad)) && std::isnan(elementary::acos(bad)));
    EXPECT_TRUE(std::isnan(elementary::atan2(bad, 1.0f)) && std::isnan(elementary::pow(bad, 2)));
    EXPECT_TRUE(std::isnan(elementary::atan2(1.0f, bad)) && std::isnan(elementary::pow(2, bad)));
  }
}

TEST(Elementary, PowEdgeCasesMatchDocumentation) {
  EXPECT_EQ(elementary::pow(kNan, 0.0f), 1);
  EXPECT_EQ(elementary::pow(1.0f, kNan), 1);
  EXPECT_EQ(elementary::pow(0.0f, 2.5f), 0);
  EXPECT_EQ(elementary::pow(-0.0f, -2.5f), kInf);
  EXPECT_EQ(elementary::pow(kInf, -1.0f), 0);
  EXPECT_TRUE(std::isnan(elementary::pow(-2.0f, 2.0f)));
  EXPECT_EQ(elementary::pow(2.0f, -149.0f), std::numeric_limits<float>::denorm_min());
  EXPECT_EQ(elementary::pow(2.0f, 128.0f), kInf);
  EXPECT_EQ(elementary::pow(2.0f, 127.0f), 0x1p127f);
}

TEST(Elementary, Atan2KeepsSignsOfZerosAndInfinities) {
  for (const float y : {0.0f, -0.0f, 1.0f, -1.0f, kInf, -kInf}) {
    for (const float x : {0.0f, -0.0f, 1.0f, -1.0f, kInf, -kInf}) {
      EXPECT_EQ(std::bit_cast<std::uint32_t>(elementary::atan2(y, x)),
                std::bit_cast<std::uint32_t>(std::atan2(y, x)))
          << y << ' ' << x;
      const double yd = y, xd = x;
      EXPECT_EQ(std::bit_cast<std::uint64_t>(elementary::atan2(yd, xd)),
                std::bit_cast<std::uint64_t>(std::atan2(yd, xd)))
          << y << ' ' << x;
    }
  }
}

/// FNV-1a over the bits of results.
class Digest {
 public:
  void add(float x) { add_bits(std::bit_cast<std::uint32_t>(x)); }
  void add(double x) { add_bits(std::bit_cast<std::uint64_t>(x)); }
  std::uint64_t value() const { return hash_; }

 private:
  void add_bits(std::uint64_t bits) { hash_ = (hash_ ^ bits) * 0x100000001b3ULL; }
  std::uint64_t hash_ = 0xcbf29ce484222325ULL;
};

TEST(Elementary, BitsMatchRenderContract) {
  // Arguments from integer steps only, so that no library affects them. NaN is left out: its bits
  // are not specified by IEEE 754.
  Digest digest;
  std::uint64_t state = 1;
  for (int i = 0; i < 20'000; ++i) {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    const double unit = static_cast<double>(state >> 11) * 0x1p-53;
    const double x = unit * 20 - 10;
    const auto f = static_cast<float>(x), g = static_cast<float>(unit);
    for (const float r :
         {elementary::sin(f), elementary::cos(f), elementary::tan(f), elementary::exp(f),
          elementary::expm1(f), elementary::log(g), elementary::log1p(g), elementary::pow(g, f),
          elementary::atan2(f, g), elementary::acos(g), elementary::asin(g)}) {
      digest.add(r);
    }
    for (const double r :
         {elementary::sin(x), elementary::cos(x * 1e7), elementary::tan(x), elementary::exp(x),
          elementary::log(unit), elementary::pow(unit, x), elementary::atan2(x, unit),
          elementary::acos(unit), elementary::asin(unit)}) {
      digest.add(r);
    }
  }
  EXPECT_EQ(digest.value(), 0x90c0ebf6a5552e72u);
}

}  // namespace
}  // namespace tessera::render
