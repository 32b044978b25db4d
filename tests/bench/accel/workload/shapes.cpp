#include "tests/bench/accel/workload/shapes.h"

#include <cmath>

namespace tessera::render::bench {
namespace {

/// Returns a pseudo-random number in [-1, 1] for a lattice point.
float lattice(std::int32_t x, std::int32_t y, std::int32_t z) {
  auto h = static_cast<std::uint32_t>(x) * 0x8DA6B343u ^
           static_cast<std::uint32_t>(y) * 0xD8163841u ^
           static_cast<std::uint32_t>(z) * 0xCB1AB31Fu;
  h ^= h >> 15;
  h *= 0x2C1B3C6Du;
  h ^= h >> 12;
  h *= 0x297A2D39u;
  h ^= h >> 15;
  return static_cast<float>(h >> 8) * 0x1p-23f - 1;
}

float smooth(float x) {
  return x * x * (3 - 2 * x);
}

float noise(const Vec3f& p) {
  const Vec3f base = {std::floor(p.x), std::floor(p.y), std::floor(p.z)};
  const Vec3f f = {smooth(p.x - base.x), smooth(p.y - base.y), smooth(p.z - base.z)};
  const auto x = static_cast<std::int32_t>(base.x), y = static_cast<std::int32_t>(base.y),
             z = static_cast<std::int32_t>(base.z);
  float sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int dx = corner & 1, dy = (corner >> 1) & 1, dz = corner >> 2;
    sum += lattice(x + dx, y + dy, z + dz) * (dx != 0 ? f.x : 1 - f.x) * (dy != 0 ? f.y : 1 - f.y) *
           (dz != 0 ? f.z : 1 - f.z);
  }
  return sum;
}

}  // namespace

float Random::unit() {
  state_ ^= state_ >> 12;
  state_ ^= state_ << 25;
  state_ ^= state_ >> 27;
  return static_cast<float>((state_ * 0x2545F4914F6CDD1Du) >> 40) * 0x1p-24f;
}

Vec3f Random::direction() {
  for (;;) {
    const float x = both(), y = both(), z = both();
    const float square = x * x + y * y + z * z;
    if (square > 0.001f && square < 1) return Vec3f{x, y, z} * (1 / std::sqrt(square));
  }
}

float fractal_noise(const Vec3f& p, int octaves) {
  float sum = 0, size = 0.5f;
  Vec3f at = p;
  for (int i = 0; i < octaves; ++i) {
    sum += size * noise(at);
    at = at * 2.0f + Vec3f{17.3f, 5.1f, 9.7f};
    size *= 0.5f;
  }
  return sum;
}

Primitive grid(std::uint32_t rows, std::uint32_t columns,
               const std::function<Vec3f(double, double)>& surface) {
  Primitive p;
  for (std::uint32_t i = 0; i <= rows; ++i) {
    for (std::uint32_t j = 0; j <= columns; ++j) {
      p.positions.push_back(
          surface(static_cast<double>(i) / rows, static_cast<double>(j) / columns));
    }
  }
  for (std::uint32_t i = 0; i < rows; ++i) {
    for (std::uint32_t j = 0; j < columns; ++j) {
      const std::uint32_t a = i * (columns + 1) + j, b = a + columns + 1;
      p.triangles.push_back({a, a + 1, b + 1});
      p.triangles.push_back({a, b + 1, b});
    }
  }
  return p;
}

void add_triangle(Primitive& p, const Vec3f& a, const Vec3f& b, const Vec3f& c) {
  const auto first = static_cast<std::uint32_t>(p.positions.size());
  p.positions.insert(p.positions.end(), {a, b, c});
  p.triangles.push_back({first, first + 1, first + 2});
}

void add_quad(Primitive& p, const Vec3f& corner, const Vec3f& a, const Vec3f& b) {
  const auto first = static_cast<std::uint32_t>(p.positions.size());
  p.positions.insert(p.positions.end(), {corner, corner + a, corner + a + b, corner + b});
  p.triangles.push_back({first, first + 1, first + 2});
  p.triangles.push_back({first, first + 2, first + 3});
}

void add_box(Primitive& p, const Vec3f& corner, const Vec3f& a, const Vec3f& b, const Vec3f& c) {
  add_quad(p, corner, a, b);
  add_quad(p, corner + c, a, b);
  add_quad(p, corner, a, c);
  add_quad(p, corner + b, a, c);
  add_quad(p, corner, b, c);
  add_quad(p, corner + a, b, c);
}

void make_frame(const Vec3f& n, Vec3f& a, Vec3f& b) {
  const Vec3f other = std::fabs(n.x) < 0.7f ? Vec3f{1, 0, 0} : Vec3f{0, 1, 0};
  a = normalize(cross(other, n));
  b = cross(n, a);
}

}  // namespace tessera::render::bench
