#include "worker/gltf/animation/deform.h"

#include <array>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/accessor_reader.h"

namespace tessera::render {

namespace {

/// values + sum of weight * displacement, for the targets that have displacements.
std::vector<Vec3d> displaced(const std::vector<Vec3f>& values, const BasePrimitive& base,
                             const std::vector<double>& weights,
                             std::vector<Vec3f> BasePrimitive::MorphTarget::*member) {
  std::vector<Vec3d> sums(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) sums[i] = Vec3d(values[i]);
  for (std::size_t t = 0; t < base.targets.size() && t < weights.size(); ++t) {
    const std::vector<Vec3f>& moves = base.targets[t].*member;
    if (weights[t] == 0 || moves.empty()) continue;
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += Vec3d(moves[i]) * weights[t];
  }
  return sums;
}

Vec3f unit_or(const Vec3d& v, const Vec3f& fallback) {
  const Vec3f n(normalize(v));
  return is_finite(n) && n != Vec3f{} ? n : fallback;
}

std::vector<Vec3f> xyz_of(const std::vector<Vec4f>& values) {
  std::vector<Vec3f> out(values.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = values[i].xyz();
  return out;
}

/// Weighted sum of the joint matrices of vertex `v`.
Affine3d blend(const BasePrimitive& base, std::size_t v, const std::vector<Affine3d>& joints) {
  double total = 0;
  Affine3d sum;
  sum.rows = {Vec3d{}, Vec3d{}, Vec3d{}};
  for (const auto& set : base.influences) {
    for (int k = 0; k < 4; ++k) {
      const double w = set.weights[v][k];
      if (!(w > 0)) continue;
      const Affine3d& m = joints[set.joints[v][static_cast<std::size_t>(k)]];
      for (std::size_t r = 0; r < 3; ++r) sum.rows[r] += m.rows[r] * w;
      sum.translation += m.translation * w;
      total += w;
    }
  }
  if (!(total > 0)) return joints.front();
  if (total == 1) return sum;
  for (std::size_t r = 0; r < 3; ++r) sum.rows[r] = sum.rows[r] / total;
  sum.translation = sum.translation / total;
  return sum;
}

/// Inverse transpose up to a positive factor, so normals keep their side under mirroring.
Vec3d transform_direction_normal(const Affine3d& m, const Vec3d& n) {
  const Vec3d cofactor = {dot(cross(m.rows[1], m.rows[2]), n), dot(cross(m.rows[2], m.rows[0]), n),
                          dot(cross(m.rows[0], m.rows[1]), n)};
  return determinant(m) < 0 ? -cofactor : cofactor;
}

/// InvalidArgument if a vertex refers to a joint that does not exist.
absl::Status check_joints(const BasePrimitive::Influences& set, std::size_t joint_count) {
  for (std::size_t v = 0; v < set.joints.size(); ++v) {
    for (std::size_t k = 0; k < 4; ++k) {
      if (set.joints[v][k] < joint_count || !(set.weights[v][static_cast<int>(k)] > 0)) continue;
      return absl::InvalidArgumentError(
          absl::StrCat("vertex ", v, " refers to joint ", set.joints[v][k], " of ", joint_count));
    }
  }
  return absl::OkStatus();
}

}  // namespace

Primitive morph(const BasePrimitive& base, const std::vector<double>& weights) {
  Primitive out = base.primitive;
  bool moved = false;
  for (const double w : weights) moved = moved || w != 0;
  if (base.targets.empty() || !moved) return out;
  const auto positions =
      displaced(out.positions, base, weights, &BasePrimitive::MorphTarget::positions);
  const auto normals = displaced(out.normals, base, weights, &BasePrimitive::MorphTarget::normals);
  const auto tangents =
      displaced(xyz_of(out.tangents), base, weights, &BasePrimitive::MorphTarget::tangents);
  for (std::size_t i = 0; i < positions.size(); ++i) out.positions[i] = Vec3f(positions[i]);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    out.normals[i] = unit_or(normals[i], out.normals[i]);
  }
  for (std::size_t i = 0; i < tangents.size(); ++i) {
    const Vec3f t = unit_or(tangents[i], out.tangents[i].xyz());
    out.tangents[i] = {t.x, t.y, t.z, out.tangents[i].w};
  }
  return out;
}

absl::StatusOr<std::vector<Affine3d>> joint_matrices(const GltfModel& model,
                                                     std::int32_t skin_index,
                                                     const std::vector<Affine3d>& world) {
  const Skin& skin = model.skins[skin_index];
  std::vector<Affine3d> out;
  for (const std::int32_t joint : skin.joints) out.push_back(world[joint]);
  if (skin.inverse_bind_matrices == kNone) return out;
  const auto floats = read_floats(model, skin.inverse_bind_matrices, 16);
  if (!floats.ok()) return floats.status();
  if (floats->size() / 16 < out.size()) {
    return absl::InvalidArgumentError(absl::StrCat("skins[", skin_index, "]: ", out.size(),
                                                   " joints but ", floats->size() / 16,
                                                   " inverse bind matrices"));
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float* m = floats->data() + 16 * i;
    for (int k = 0; k < 16; ++k) {
      if (!std::isfinite(m[k])) {
        return absl::InvalidArgumentError(
            absl::StrCat("skins[", skin_index, "]: inverse bind matrix ", i, " is not finite"));
      }
    }
    const Affine3d inverse_bind = {
        {Vec3d{m[0], m[4], m[8]}, Vec3d{m[1], m[5], m[9]}, Vec3d{m[2], m[6], m[10]}},
        {m[12], m[13], m[14]}};
    out[i] = out[i] * inverse_bind;
  }
  return out;
}

absl::StatusOr<SkinnedPrimitive> skin(const BasePrimitive& base, Primitive posed,
                                      const std::vector<Affine3d>& joints) {
  for (const auto& set : base.influences) {
    if (absl::Status status = check_joints(set, joints.size()); !status.ok()) return status;
  }
  SkinnedPrimitive out{std::move(posed), {}};
  Primitive& p = out.primitive;
  out.world_positions.resize(p.positions.size());
  std::vector<bool> is_mirrored(p.positions.size());
  for (std::size_t v = 0; v < p.positions.size(); ++v) {
    const Affine3d m = blend(base, v, joints);
    is_mirrored[v] = determinant(m) < 0;
    out.world_positions[v] = transform_point(m, Vec3d(p.positions[v]));
    if (!p.normals.empty()) {
      p.normals[v] = unit_or(transform_direction_normal(m, Vec3d(p.normals[v])), p.normals[v]);
    }
    if (!p.tangents.empty()) {
      const Vec3f t = unit_or(transform_vector(m, Vec3d(p.tangents[v].xyz())), p.tangents[v].xyz());
      p.tangents[v] = {t.x, t.y, t.z, is_mirrored[v] ? -p.tangents[v].w : p.tangents[v].w};
    }
  }
  for (std::array<std::uint32_t, 3>& triangle : p.triangles) {
    if (is_mirrored[triangle[0]]) std::swap(triangle[1], triangle[2]);
  }
  return out;
}

}  // namespace tessera::render
