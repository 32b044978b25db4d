#pragma once

#include <cmath>
#include <cstdint>

namespace tessera::render {

/// Two, three and four component vectors. Every operation is a fixed sequence of IEEE 754
/// operations, so results do not depend on compiler or machine.
template <typename T>
struct Vec2 {
  T x{}, y{};
  bool operator==(const Vec2&) const = default;
};

template <typename T>
struct Vec3 {
  T x{}, y{}, z{};

  constexpr T operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  constexpr T& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
  bool operator==(const Vec3&) const = default;

  template <typename U>
  explicit constexpr operator Vec3<U>() const {
    return {static_cast<U>(x), static_cast<U>(y), static_cast<U>(z)};
  }
  constexpr Vec3& operator+=(const Vec3& b) { return *this = {x + b.x, y + b.y, z + b.z}; }
  constexpr Vec3& operator*=(const Vec3& b) { return *this = {x * b.x, y * b.y, z * b.z}; }
  constexpr Vec3& operator*=(T s) { return *this = {x * s, y * s, z * s}; }
};

template <typename T>
struct Vec4 {
  T x{}, y{}, z{}, w{};
  constexpr T operator[](int i) const { return i == 0 ? x : i == 1 ? y : i == 2 ? z : w; }
  constexpr T& operator[](int i) { return i == 0 ? x : i == 1 ? y : i == 2 ? z : w; }
  constexpr Vec3<T> xyz() const { return {x, y, z}; }
  bool operator==(const Vec4&) const = default;
};

using Vec2f = Vec2<float>;
using Vec2d = Vec2<double>;
using Vec3f = Vec3<float>;
using Vec4f = Vec4<float>;
using Vec3d = Vec3<double>;
using Vec4d = Vec4<double>;

template <typename T>
constexpr Vec2<T> operator+(Vec2<T> a, Vec2<T> b) {
  return {a.x + b.x, a.y + b.y};
}
template <typename T>
constexpr Vec2<T> operator-(Vec2<T> a, Vec2<T> b) {
  return {a.x - b.x, a.y - b.y};
}
template <typename T>
constexpr Vec2<T> operator*(Vec2<T> a, T s) {
  return {a.x * s, a.y * s};
}

template <typename T>
constexpr Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename T>
constexpr Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename T>
constexpr Vec3<T> operator-(const Vec3<T>& a) {
  return {-a.x, -a.y, -a.z};
}
template <typename T>
constexpr Vec3<T> operator*(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}
template <typename T>
constexpr Vec3<T> operator/(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x / b.x, a.y / b.y, a.z / b.z};
}
template <typename T>
constexpr Vec3<T> operator*(const Vec3<T>& a, T s) {
  return {a.x * s, a.y * s, a.z * s};
}
template <typename T>
constexpr Vec3<T> operator*(T s, const Vec3<T>& a) {
  return a * s;
}
template <typename T>
constexpr Vec3<T> operator/(const Vec3<T>& a, T s) {
  return {a.x / s, a.y / s, a.z / s};
}

template <typename T>
constexpr Vec4<T> operator+(const Vec4<T>& a, const Vec4<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
}
template <typename T>
constexpr Vec4<T> operator-(const Vec4<T>& a, const Vec4<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w};
}
template <typename T>
constexpr Vec4<T> operator*(const Vec4<T>& a, T s) {
  return {a.x * s, a.y * s, a.z * s, a.w * s};
}

/// Dot product, summed from left to right.
template <typename T>
constexpr T dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

/// a*b - c*d with at most 1.5 ulp of error. Source: Kahan; Jeannerod, Louvet & Muller 2013.
template <typename T>
inline T difference_of_products(T a, T b, T c, T d) {
  const T cd = c * d;
  const T error = std::fma(-c, d, cd);
  return std::fma(a, b, -cd) + error;
}

/// Cross product whose components keep full relative accuracy for nearly parallel vectors.
template <typename T>
inline Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
          difference_of_products(a.x, b.y, a.y, b.x)};
}

template <typename T>
inline T length(const Vec3<T>& a) {
  return std::sqrt(dot(a, a));
}

/// Largest absolute component; NaN components count as 0.
template <typename T>
inline Vec3<T> absolute(const Vec3<T>& a) {
  return {std::fabs(a.x), std::fabs(a.y), std::fabs(a.z)};
}
template <typename T>
inline T max_abs(const Vec3<T>& a) {
  const T x = std::fabs(a.x), y = std::fabs(a.y), z = std::fabs(a.z);
  T largest = x > 0 ? x : 0;
  largest = y > largest ? y : largest;
  return z > largest ? z : largest;
}

/// Unit vector along a, for any length: components are first divided by the largest one, so that
/// squares neither overflow nor underflow. The zero vector stays zero.
template <typename T>
inline Vec3<T> normalize(const Vec3<T>& a) {
  const T scale = max_abs(a);
  if (!(scale > 0)) return {};
  const Vec3<T> b = a / scale;
  return b / length(b);
}

template <typename T>
constexpr Vec3<T> min(const Vec3<T>& a, const Vec3<T>& b) {
  return {b.x < a.x ? b.x : a.x, b.y < a.y ? b.y : a.y, b.z < a.z ? b.z : a.z};
}
template <typename T>
constexpr Vec3<T> max(const Vec3<T>& a, const Vec3<T>& b) {
  return {b.x > a.x ? b.x : a.x, b.y > a.y ? b.y : a.y, b.z > a.z ? b.z : a.z};
}

template <typename T>
constexpr T lerp(T a, T b, T f) {
  return a + f * (b - a);
}
template <typename T>
constexpr Vec3<T> lerp(const Vec3<T>& a, const Vec3<T>& b, T f) {
  return a + (b - a) * f;
}

template <typename T>
constexpr T clamp(T x, T low, T high) {
  return x < low ? low : x > high ? high : x;
}

template <typename T>
constexpr T max_component(const Vec3<T>& a) {
  const T m = a.x > a.y ? a.x : a.y;
  return m > a.z ? m : a.z;
}

inline bool is_finite(const Vec3f& a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}

/// Relative luminance of a linear Rec. 709 colour.
constexpr float luminance(const Vec3f& c) {
  return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z;
}

}  // namespace tessera::render
