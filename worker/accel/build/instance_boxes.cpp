#include "worker/accel/build/instance_boxes.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

/// Returns the maximum row sum of the absolute values of the 3x3 part.
double norm(const Affine3d& m) {
  const Vec3d one = {1, 1, 1};
  return max_abs(Vec3d{dot(absolute(m.rows[0]), one), dot(absolute(m.rows[1]), one),
                       dot(absolute(m.rows[2]), one)});
}

/// Extends a world-space box by the corners of an object-space box.
void extend_by(Box3d& world, const Affine3d& m, const Box3f& box) {
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d p = {(corner & 1) != 0 ? box.hi.x : box.lo.x,
                     (corner & 2) != 0 ? box.hi.y : box.lo.y,
                     (corner & 4) != 0 ? box.hi.z : box.lo.z};
    world.extend(transform_point(m, p));
  }
}

/// Object-space bounds of a mesh: a box, or several.
struct MeshBounds {
  const Box3f& box;
  std::span<const Box3f> parts;
};

/// Extends a world-space box by a mesh, where `m` places it.
void extend_by(Box3d& world, const Affine3d& m, const MeshBounds& mesh) {
  if (mesh.parts.empty()) extend_by(world, m, mesh.box);
  for (const Box3f& part : mesh.parts) extend_by(world, m, part);
}

double reach(const Box3d& box) {
  const double lo = max_abs(box.lo), hi = max_abs(box.hi);
  return lo > hi ? lo : hi;
}

/// Bounds of the absolute values of an instance's transforms.
struct PoseBounds {
  std::array<Vec3d, 3> rows;         // of object to world
  double norm = 0, translation = 0;  // maximum row sum; largest component
  double inverse_norm = 0, inverse_translation = 0;
};

PoseBounds bounds_of(const Affine3d& object_to_world, const Affine3d& world_to_object) {
  PoseBounds out;
  for (std::size_t k = 0; k < 3; ++k) out.rows[k] = absolute(object_to_world.rows[k]);
  out.norm = norm(object_to_world);
  out.translation = max_abs(object_to_world.translation);
  out.inverse_norm = norm(world_to_object);
  out.inverse_translation = max_abs(world_to_object.translation);
  return out;
}

/// Returns a bound of |F(s)^-1| for s in [0, 1/2], where F(s) = F + s (G - F). The inverse is
/// (1 + s E)^-1 F^-1 with E = F^-1 (G - F), so its norm is at most |F^-1| / (1 - |E| / 2). Infinite
/// if |E| >= 2.
double inverse_norm_nearby(const Affine3d& f, const Affine3d& g) {
  const auto inverted = inverse(f);
  if (!inverted) return INFINITY;
  Affine3d difference;
  for (std::size_t k = 0; k < 3; ++k) difference.rows[k] = g.rows[k] - f.rows[k];
  difference.translation = {};
  const double half = 0.5 * norm(Affine3d{inverted->rows, {}} * difference);
  return half < 1 ? norm(*inverted) / (1 - half) : INFINITY;
}

/// Returns bounds of all transforms between two keyframes.
PoseBounds bounds_between(const Affine3d& f, const Affine3d& g) {
  PoseBounds out;
  for (std::size_t k = 0; k < 3; ++k) out.rows[k] = max(absolute(f.rows[k]), absolute(g.rows[k]));
  out.norm = std::max(norm(f), norm(g));
  out.translation = std::max(max_abs(f.translation), max_abs(g.translation));
  out.inverse_norm = std::max(inverse_norm_nearby(f, g), inverse_norm_nearby(g, f));
  out.inverse_translation = out.inverse_norm * out.translation;
  return out;
}

/// Returns the padding of an instance's box, per world axis. With it, every ray with
/// |origin| <= `origin` per axis that hits one of the instance's triangles in object space hits the
/// box.
///
/// Let W and F be the world-to-object and object-to-world transforms, u = 2^-24, and D the largest
/// component of (box plane - object-space origin): D <= |W| origin + |t_W| + |box|.
/// - A hit at t lies, per axis, within D (2^-20 + 2^-21 + 8 u) < D 2^-19 of the triangle's box, and
///   so of the mesh's box or part that contains it: t is clamped to the triangle's [enter, leave],
///   where leave is widened (enter_leave()), and each slab distance has three roundings.
/// - Rounding to float gives the object-space ray an error of u |o'| <= u (D + |box|) at its origin
///   and of u D at t. The double arithmetic before adds 2^-50 (|W| origin + |t_W|) and, since
///   |t d| <= |F| D in the world, 2^-50 |W||F| D. W F differs from the identity by rounding, which
///   adds another term like the last one.
/// Therefore e = (D + |box|) (2^-18 + 2^-47 |W||F|) is enough in object space, and |F| e in world
/// space. The slab test in world space adds an error of 3 u (origin + |world box|), and the box's
/// corners one of 2^-50. For a moving instance, W and F are replaced by bounds over the interval.
Vec3d world_pad(const PoseBounds& pose, const Box3f& mesh, const Box3d& world, double origin) {
  const double box = reach({Vec3d(mesh.lo), Vec3d(mesh.hi)});
  const double object_origin = pose.inverse_norm * origin + pose.inverse_translation;
  const double e = (object_origin + 2 * box) * (0x1p-18 + 0x1p-47 * pose.inverse_norm * pose.norm);
  const double slab =
      0x1p-22 * (origin + reach(world)) + 0x1p-48 * (pose.norm * box + pose.translation);
  const Vec3d all = {e, e, e};
  return Vec3d{dot(pose.rows[0], all), dot(pose.rows[1], all), dot(pose.rows[2], all)} +
         Vec3d{slab, slab, slab};
}

/// Returns the largest float <= x or, with `up`, the smallest float >= x. The result is finite, so
/// that areas are not NaN.
float round_outward(double x, bool up) {
  constexpr double kFar = 0x1p126;
  if (!(x > -kFar)) return static_cast<float>(-kFar);
  if (!(x < kFar)) return static_cast<float>(kFar);
  const auto f = static_cast<float>(x);
  const double wide = f;
  if (up ? wide >= x : wide <= x) return f;
  return up ? next_up(f) : next_down(f);
}

Box3f padded(const Box3d& box, const Vec3d& pad) {
  Box3f out;
  for (int k = 0; k < 3; ++k) {
    const double lo = box.lo[k] - pad[k], hi = box.hi[k] + pad[k];
    // NaN or infinite padding gives an unbounded box.
    out.lo[k] = round_outward(lo < hi ? lo : -0x1p126, false);
    out.hi[k] = round_outward(lo < hi ? hi : 0x1p126, true);
  }
  return out;
}

/// Returns the box of the result of a CSG operation on operands with these boxes.
Box3f combined(CsgOperation operation, std::span<const Box3f> boxes) {
  if (boxes.empty()) return {};
  Box3f out = boxes[0];
  for (const Box3f& box : boxes.subspan(1)) {
    switch (operation) {
      case CsgOperation::unite:
      case CsgOperation::exclude:
        out.extend(box);
        break;
      case CsgOperation::intersect:
        out = {max(out.lo, box.lo), min(out.hi, box.hi)};
        if (out.empty()) return {};
        break;
      case CsgOperation::subtract:
        return out;
    }
  }
  return out;
}

/// Returns the box of a solid, given the boxes of its operands.
Box3f solid_box(const CsgSolid& solid, std::span<const Box3f> operands) {
  std::vector<Box3f> results;
  for (const CsgStep& step : solid.steps) {
    if (step.is_operand) {
      results.push_back(operands[step.number]);
      continue;
    }
    const std::size_t first = results.size() - step.number;
    const Box3f box = combined(step.operation, std::span(results).subspan(first));
    results.resize(first);
    results.push_back(box);
  }
  return results[0];
}

bool is_bounded(const Box3f& box) {
  return is_finite(box.lo) && is_finite(box.hi);
}

/// Replaces the boxes of each solid's operands by the box of the solid.
void merge_operands(const Scene& scene, const InstanceSelection& choice,
                    const std::vector<bool>& moving, InstanceBoxes& out) {
  InstanceBoxes merged;
  merged.origin_limit = out.origin_limit;
  std::vector<Box3f> boxes(scene.instances.size());
  for (std::size_t i = 0; i < out.instances.size(); ++i) {
    boxes[out.instances[i]] = out.boxes[i];
    if (scene.instances[out.instances[i]].operand) continue;
    merged.instances.push_back(out.instances[i]);
    merged.boxes.push_back(out.boxes[i]);
  }
  for (const CsgSolid& solid : scene.solids) {
    if (moving[solid.first] ? !choice.segment : !choice.still) continue;
    const Box3f box = solid_box(solid, std::span(boxes).subspan(solid.first, solid.count));
    if (box.empty()) continue;
    merged.instances.push_back(solid.first);
    merged.boxes.push_back(box);
  }
  out = std::move(merged);
}

/// Moves the instances without a finite box to `out.unbounded`.
void separate_unbounded(InstanceBoxes& out) {
  InstanceBoxes bounded;
  bounded.origin_limit = out.origin_limit;
  for (std::size_t i = 0; i < out.instances.size(); ++i) {
    if (is_bounded(out.boxes[i])) {
      bounded.instances.push_back(out.instances[i]);
      bounded.boxes.push_back(out.boxes[i]);
    } else {
      bounded.unbounded.push_back(out.instances[i]);
    }
  }
  out = std::move(bounded);
}

/// Returns the world box of an instance: at the frame's time if it does not move, else over the
/// keyframes from `first` to `last`.
Box3d world_box(const Scene& scene, const Instance& instance, const MeshBounds& mesh,
                std::size_t first, std::size_t last) {
  Box3d box;
  if (instance.motion == kNone) {
    extend_by(box, instance.object_to_world, mesh);
    return box;
  }
  const auto& motion = scene.motions[static_cast<std::size_t>(instance.motion)];
  for (std::size_t k = first; k <= last; ++k) extend_by(box, motion[k], mesh);
  return box;
}

}  // namespace

std::vector<bool> moving_instances(const Scene& scene) {
  std::vector<bool> moving;
  for (const Instance& instance : scene.instances) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    moving.push_back(instance.motion != kNone || !mesh.keys.empty());
  }
  for (const CsgSolid& solid : scene.solids) {
    const auto first = moving.begin() + solid.first, last = first + solid.count;
    if (std::find(first, last, true) != last) std::fill(first, last, true);
  }
  return moving;
}

InstanceBoxes bound_instances(const Scene& scene, std::span<const Box3f> meshes,
                              const InstanceSelection& choice,
                              std::span<const std::vector<Box3f>> parts) {
  const std::size_t first = choice.segment.value_or(0);
  const std::size_t last = choice.segment ? first + 1 : scene.key_times.size() - 1;
  // Rays start at the camera, or on or close to instances.
  double origin = max_abs(scene.camera.camera_to_world.translation);
  for (const CameraKey& key : scene.camera.keys) {
    origin = std::max(origin, max_abs(key.camera_to_world.translation));
  }
  const std::vector<bool> moving = moving_instances(scene);
  InstanceBoxes out;
  bool planes = false;
  std::vector<Box3d> worlds;
  for (std::size_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const auto number = static_cast<std::size_t>(instance.mesh);
    const Box3f& mesh = meshes[number];
    if (mesh.empty()) continue;
    Box3d world;
    if (is_bounded(mesh)) {
      const MeshBounds bounds = {mesh, parts.empty() ? std::span<const Box3f>() : parts[number]};
      world = world_box(scene, instance, bounds, first, last);
      origin = std::max(origin, reach(world));
    } else {
      planes = true;
    }
    if (moving[i] ? !choice.segment : !choice.still) continue;
    out.instances.push_back(static_cast<std::uint32_t>(i));
    worlds.push_back(world);
  }
  // From most of what a picture shows of a plane, too: beyond, rays cannot use the tree, but they
  // start within a degree of the horizon.
  out.origin_limit = round_outward(origin * (planes ? 64 : 1.0625), false);
  for (std::size_t i = 0; i < out.instances.size(); ++i) {
    const Instance& instance = scene.instances[out.instances[i]];
    const Box3f& mesh = meshes[static_cast<std::size_t>(instance.mesh)];
    if (!is_bounded(mesh)) {
      out.boxes.push_back(mesh);
      continue;
    }
    const bool still = instance.motion == kNone;
    const bool needs_no_padding =
        still && is_identity(instance.world_to_object) && !instance.operand &&
        scene.meshes[static_cast<std::size_t>(instance.mesh)].shape == nullptr;
    if (needs_no_padding) {
      out.boxes.push_back(mesh);
      continue;
    }
    const PoseBounds pose =
        still ? bounds_of(instance.object_to_world, instance.world_to_object)
              : bounds_between(scene.motions[static_cast<std::size_t>(instance.motion)][first],
                               scene.motions[static_cast<std::size_t>(instance.motion)][last]);
    out.boxes.push_back(padded(worlds[i], world_pad(pose, mesh, worlds[i], out.origin_limit)));
  }
  if (!scene.solids.empty()) merge_operands(scene, choice, moving, out);
  if (planes) separate_unbounded(out);
  return out;
}

}  // namespace tessera::render
