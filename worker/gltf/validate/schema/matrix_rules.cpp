#include "worker/gltf/validate/schema/matrix_rules.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace tessera::render {

namespace {

using Columns = std::array<std::array<float, 4>, 4>;

Columns columns_of(const JsonNode& matrix) {
  Columns out{};
  for (std::size_t i = 0; i < 16; ++i) {
    out[i / 4][i % 4] = static_cast<float>(matrix.items()[i].number());
  }
  return out;
}

/// Largest sum of the magnitudes of a column.
double norm(const Columns& m) {
  double out = 0;
  for (const auto& column : m) {
    double sum = 0;
    for (const float value : column) sum += std::abs(static_cast<double>(value));
    out = std::max(out, sum);
  }
  return out;
}

double length(const std::array<float, 4>& column) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += static_cast<double>(column[k]) * column[k];
  return std::sqrt(sum);
}

double determinant(const Columns& m) {
  const auto minor = [&m](std::size_t a, std::size_t b) {
    return static_cast<double>(m[1][a]) * m[2][b] - static_cast<double>(m[1][b]) * m[2][a];
  };
  return m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1);
}

/// The quaternion (x, y, z, w) of a rotation matrix, from its largest component.
std::array<float, 4> quaternion_of(const Columns& m) {
  std::array<float, 4> q{};
  const double trace = static_cast<double>(m[0][0]) + m[1][1] + m[2][2];
  if (trace > 0) {
    const double s = std::sqrt(trace + 1);
    q[3] = static_cast<float>(s * 0.5);
    q[0] = static_cast<float>((static_cast<double>(m[1][2]) - m[2][1]) * (0.5 / s));
    q[1] = static_cast<float>((static_cast<double>(m[2][0]) - m[0][2]) * (0.5 / s));
    q[2] = static_cast<float>((static_cast<double>(m[0][1]) - m[1][0]) * (0.5 / s));
    return q;
  }
  std::size_t i = m[0][0] < m[1][1] ? 1 : 0;
  if (m[i][i] < m[2][2]) i = 2;
  const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
  const double s = std::sqrt(static_cast<double>(m[i][i]) - m[j][j] - m[k][k] + 1);
  q[i] = static_cast<float>(s * 0.5);
  q[3] = static_cast<float>((static_cast<double>(m[j][k]) - m[k][j]) * (0.5 / s));
  q[j] = static_cast<float>((static_cast<double>(m[i][j]) + m[j][i]) * (0.5 / s));
  q[k] = static_cast<float>((static_cast<double>(m[i][k]) + m[k][i]) * (0.5 / s));
  return q;
}

/// Rotation matrix of a quaternion, its columns multiplied by `scale`.
Columns compose(const std::array<float, 4>& q, const std::array<float, 3>& scale,
                const std::array<float, 4>& translation) {
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  const double rotation[3][3] = {
      {1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
      {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
      {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)}};
  Columns out{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      out[i][k] =
          static_cast<float>(static_cast<double>(static_cast<float>(rotation[i][k])) * scale[i]);
    }
  }
  out[3] = translation;
  return out;
}

}  // namespace

bool is_unit_quaternion(const JsonNode& rotation) {
  double sum = 0;
  for (const JsonNode& each : rotation.items()) {
    const double value = static_cast<float>(each.number());
    sum += value * value;
  }
  return std::abs(1 - std::sqrt(sum)) <= kQuaternionTolerance;
}

bool is_identity_matrix(const JsonNode& matrix) {
  const Columns m = columns_of(matrix);
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      if (m[i][k] != (i == k ? 1.F : 0.F)) return false;
    }
  }
  return true;
}

bool is_decomposable_matrix(const JsonNode& matrix) {
  const Columns m = columns_of(matrix);
  if (m[0][3] != 0 || m[1][3] != 0 || m[2][3] != 0 || m[3][3] != 1) return false;
  const double volume = determinant(m);
  if (volume == 0) return false;
  Columns rotation = m;
  std::array<float, 3> scale{};
  for (std::size_t i = 0; i < 3; ++i) {
    const double signed_length = (i == 0 && volume < 0 ? -1 : 1) * length(m[i]);
    scale[i] = static_cast<float>(signed_length);
    for (std::size_t k = 0; k < 3; ++k) {
      rotation[i][k] = static_cast<float>(m[i][k] * (1 / signed_length));
    }
  }
  constexpr double kNormTolerance = 0.00005;
  const Columns composed = compose(quaternion_of(rotation), scale, m[3]);
  return std::abs(norm(composed) - norm(m)) < kNormTolerance;
}

}  // namespace tessera::render
