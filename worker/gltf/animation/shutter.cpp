#include "worker/gltf/animation/shutter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/geometry/bounds.h"
#include "worker/geometry/motion.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {
namespace {

constexpr double kTolerance = 0x1p-10;        // relative to the size of the moving object
constexpr double kCameraTolerance = 0x1p-12;  // radians, or relative to the size of the scene
constexpr double kTick = 0x1p-24;             // difference between adjacent ray times

/// How a pose at a key differs from that of the frame's own time.
struct KeyPose {
  std::map<std::uint32_t, Affine3d> placed;                 // by instance: object to world
  std::map<std::uint32_t, SharedArray<Primitive>> changed;  // by instance: deformed vertices
  CameraKey camera;
  std::vector<PunctualPose> lights;  // parallel to Scene::lights
};

/// Copies of the primitives with only the vertices that can change.
SharedArray<Primitive> vertices_of(const SharedArray<Primitive>& primitives) {
  std::vector<Primitive> out(primitives.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i].positions = primitives[i].positions;
    out[i].normals = primitives[i].normals;
    out[i].tangents = primitives[i].tangents;
  }
  return out;
}

bool same_shape(const Primitive& a, const Primitive& b) {
  return a.triangles == b.triangles && a.positions.size() == b.positions.size() &&
         a.normals.size() == b.normals.size() && a.tangents.size() == b.tangents.size();
}

bool same_vertices(const Primitive& a, const Primitive& b) {
  return a.positions == b.positions && a.normals == b.normals && a.tangents == b.tangents;
}

double diagonal(const Box3d& box) {
  return box.empty() ? 0 : length(box.hi - box.lo);
}

Box3d box_of(const Mesh& mesh) {
  Box3d box;
  // A plane moves as straight as what is near its origin.
  if (mesh.shape != nullptr && !mesh.shape->bounded()) return {{-1, -1, -1}, {1, 1, 1}};
  if (mesh.shape != nullptr) return {Vec3d(mesh.shape->bounds.lo), Vec3d(mesh.shape->bounds.hi)};
  for (const Primitive& p : mesh.primitives) {
    for (const Vec3f& v : p.positions) box.extend(Vec3d(v));
  }
  return box;
}

Vec3d corner(const Box3d& box, unsigned number) {
  return {(number & 1) != 0 ? box.hi.x : box.lo.x, (number & 2) != 0 ? box.hi.y : box.lo.y,
          (number & 4) != 0 ? box.hi.z : box.lo.z};
}

class MotionBuilder {
 public:
  MotionBuilder(const ShutterInterval& shutter, Scene& scene, std::vector<Problem>& problems)
      : shutter_(shutter), scene_(scene), problems_(problems) {
    for (const Mesh& mesh : scene.meshes) boxes_.push_back(box_of(mesh));
    for (std::size_t i = 0; i < scene.instances.size(); ++i) {
      ++instances_of_[scene.instances[i].node].count;
    }
    std::uint32_t first = 0;
    for (const Instance& instance : scene.instances) {
      Range& range = instances_of_[instance.node];
      if (range.first == UINT32_MAX) range.first = first;
      ++first;
    }
  }

  absl::Status build() {
    absl::Status status = place_first_keys();
    if (status.ok()) status = refine();
    if (status.ok()) status = store();
    return status;
  }

 private:
  /// Instances of one node, which are consecutive.
  struct Range {
    std::uint32_t first = UINT32_MAX, count = 0;
  };

  void warn(const std::string& element, const std::string& message) {
    problems_.push_back({Problem::Severity::warning, element, message});
  }

  [[nodiscard]] double seconds(double time) const {
    return shutter_.open + time * (shutter_.close - shutter_.open);
  }

  absl::StatusOr<KeyPose> pose(double time) {
    auto scene = shutter_.pose(seconds(time));
    if (!scene.ok()) return scene.status();
    KeyPose out;
    std::map<std::int32_t, Range> at_key;
    for (std::uint32_t i = 0; i < scene->instances.size(); ++i) {
      Range& range = at_key[scene->instances[i].node];
      if (range.count++ == 0) range.first = i;
    }
    for (const auto& [node, range] : instances_of_) {
      if (at_key[node].count != range.count) {
        exclude(node,
                "its transform is not finite or too far away during part of the exposure; motion "
                "blur disabled");
        continue;
      }
      for (std::uint32_t k = 0; k < range.count; ++k) {
        compare(range.first + k, *scene, scene->instances[at_key[node].first + k], out);
      }
    }
    const Camera& camera = scene->camera;
    const bool same_camera = camera.shutter_close == scene_.camera.shutter_close &&
                             camera.shutter_open == scene_.camera.shutter_open;
    const Camera& valid_camera =
        same_camera ? camera : scene_.camera;  // the camera at that time may be invalid
    out.camera = {static_cast<float>(time), valid_camera.camera_to_world,
                  valid_camera.lens.focus_distance};
    record_lights(*scene, out);
    return out;
  }

  /// Records light poses. Directions of point lights and positions of directional lights are
  /// ignored.
  void record_lights(const Scene& posed, KeyPose& out) {
    const auto same_node = [](const PunctualLight& a, const PunctualLight& b) {
      return a.node == b.node;
    };
    if (!std::equal(scene_.lights.begin(), scene_.lights.end(), posed.lights.begin(),
                    posed.lights.end(), same_node)) {
      if (!std::exchange(lights_excluded_, true)) {
        warn("nodes",
             "some lights have an invalid transform during part of the exposure; motion blur of "
             "all lights disabled");
      }
      return;
    }
    for (std::size_t i = 0; i < posed.lights.size(); ++i) {
      const PunctualLight &here = scene_.lights[i], &at_key = posed.lights[i];
      const bool point = here.kind == PunctualLight::Kind::point;
      const bool distant = here.kind == PunctualLight::Kind::directional;
      out.lights.push_back(
          {distant ? here.position : at_key.position, point ? here.direction : at_key.direction});
    }
  }

  /// Records how an instance differs from its pose at the frame's time.
  void compare(std::uint32_t index, const Scene& posed, const Instance& at_key, KeyPose& out) {
    const Instance& here = scene_.instances[index];
    if (!(at_key.object_to_world == here.object_to_world)) {
      out.placed[index] = at_key.object_to_world;
    }
    const auto& before = scene_.meshes[static_cast<std::size_t>(here.mesh)].primitives;
    const auto& now = posed.meshes[static_cast<std::size_t>(at_key.mesh)].primitives;
    if (now.shares(before)) return;
    if (!std::equal(before.begin(), before.end(), now.begin(), now.end(), same_shape)) {
      exclude(here.node, "its mesh changes topology during the exposure; motion blur disabled");
    } else if (!std::equal(before.begin(), before.end(), now.begin(), now.end(), same_vertices)) {
      if (!here.operand) {
        out.changed[index] = vertices_of(now);
      } else if (csg_warned_.insert(here.node).second) {
        warn(absl::StrCat("nodes[", here.node, "]"),
             "its mesh deforms during the exposure inside a CSG solid; deformation blur disabled");
      }
    }
  }

  /// Excludes a node from motion blur because its pose is unknown at some key.
  void exclude(std::int32_t node, const std::string& message) {
    if (!excluded_.insert(node).second) return;
    warn(absl::StrCat("nodes[", node, "]"), message);
  }

  [[nodiscard]] bool is_excluded(std::uint32_t instance) const {
    return excluded_.contains(scene_.instances[instance].node);
  }

  absl::Status add_key(double time) {
    if (keys_.contains(time)) return absl::OkStatus();
    auto posed = pose(time);
    if (!posed.ok()) return posed.status();
    for (const auto& [instance, vertices] : posed->changed) {
      for (const Primitive& p : vertices) {
        bytes_ += (p.positions.size() + p.normals.size()) * sizeof(Vec3f) +
                  p.tangents.size() * sizeof(Vec4f);
      }
    }
    if (bytes_ > kMaxGeometryBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat("the poses of deforming meshes during the exposure exceed ",
                       kMaxGeometryBytes, " bytes; shorten the exposure"));
    }
    if (bytes_ > shutter_.memory_bytes) {
      return absl::ResourceExhaustedError(absl::StrCat(
          "animations: the poses of deforming meshes during the exposure exceed the ",
          shutter_.memory_bytes,
          " bytes of memory; shorten the exposure, or give the scene a machine with more memory"));
    }
    keys_[time] = *std::move(posed);
    return absl::OkStatus();
  }

  /// Adds keys at both ends and at the keys of the animation.
  absl::Status place_first_keys() {
    std::set<double> times = {0, 1};
    const double span = shutter_.close - shutter_.open;
    const std::size_t step = shutter_.changes.size() / (kMaxKeys / 4) + 1;
    if (step > 1) {
      warn("animations", absl::StrCat(shutter_.changes.size(),
                                      " animation keys during the exposure; using one in ", step));
    }
    for (std::size_t i = 0; i < shutter_.changes.size(); i += step) {
      const AnimationKey& change = shutter_.changes[i];
      double time = std::ceil((change.seconds - shutter_.open) / span / kTick) * kTick;
      if (seconds(time) < change.seconds) time += kTick;
      if (!(time > 0 && time < 1)) continue;
      times.insert(time);
      if (!change.jumps) continue;
      times.insert(time - kTick);
      jumps_.insert(time - kTick);
    }
    for (const double time : times) {
      if (absl::Status status = add_key(time); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

  /// Bisects intervals in which motion is not linear enough, breadth first.
  absl::Status refine() {
    std::vector<std::pair<double, double>> open, next;
    for (auto key = keys_.begin(); std::next(key) != keys_.end(); ++key) {
      if (!jumps_.contains(key->first)) open.emplace_back(key->first, std::next(key)->first);
    }
    for (; !open.empty(); open = std::exchange(next, {})) {
      for (const auto& [from, to] : open) {
        if (!(to - from >= 4 * kTick)) continue;
        const auto good = is_straight(from, to);
        if (!good.ok()) return good.status();
        if (*good) continue;
        if (keys_.size() >= kMaxKeys) {
          warn("animations", absl::StrCat("motion is approximated by ", keys_.size() - 1,
                                          " linear segments, the maximum"));
          return absl::OkStatus();
        }
        const double middle = std::round(0.5 * (from + to) / kTick) * kTick;
        if (absl::Status status = add_key(middle); !status.ok()) return status;
        next.emplace_back(from, middle);
        next.emplace_back(middle, to);
      }
    }
    return absl::OkStatus();
  }

  absl::StatusOr<bool> is_straight(double from, double to) {
    for (const float f : {0.25f, 0.75f}) {
      auto truth = pose(from + static_cast<double>(f) * (to - from));
      if (!truth.ok()) return truth.status();
      if (!is_near(keys_[from], keys_[to], f, *truth)) return false;
    }
    return true;
  }

  [[nodiscard]] const Affine3d& object_to_world(const KeyPose& pose, std::uint32_t instance) const {
    const auto found = pose.placed.find(instance);
    return found == pose.placed.end() ? scene_.instances[instance].object_to_world : found->second;
  }

  [[nodiscard]] const SharedArray<Primitive>& mesh(const KeyPose& pose,
                                                   std::uint32_t instance) const {
    const auto found = pose.changed.find(instance);
    return found == pose.changed.end() ? mesh_of(instance).primitives : found->second;
  }

  [[nodiscard]] const Mesh& mesh_of(std::uint32_t instance) const {
    return scene_.meshes[static_cast<std::size_t>(scene_.instances[instance].mesh)];
  }

  /// Instances that occur in any of `maps`.
  template <typename Map>
  [[nodiscard]] std::set<std::uint32_t> in_any(std::initializer_list<const Map*> maps) const {
    std::set<std::uint32_t> out;
    for (const Map* map : maps) {
      for (const auto& [instance, value] : *map) {
        if (!is_excluded(instance)) out.insert(instance);
      }
    }
    return out;
  }

  /// Returns whether `truth` is within the tolerances of the interpolation between `a` and `b`.
  [[nodiscard]] bool is_near(const KeyPose& a, const KeyPose& b, float f,
                             const KeyPose& truth) const {
    const auto is_hidden = [&](std::uint32_t i) {
      return !inverse(object_to_world(a, i)) && !inverse(object_to_world(truth, i)) &&
             !inverse(object_to_world(b, i));
    };
    for (const std::uint32_t i : in_any({&a.placed, &b.placed, &truth.placed})) {
      if (is_hidden(i)) continue;
      const Affine3d& placed = object_to_world(truth, i);
      const Box3d& box = boxes_[static_cast<std::size_t>(scene_.instances[i].mesh)];
      const Affine3d line = lerp(object_to_world(a, i), object_to_world(b, i), f);
      Box3d world;
      double error = 0;
      for (unsigned k = 0; k < 8; ++k) {
        const Vec3d p = transform_point(placed, corner(box, k));
        world.extend(p);
        error = std::max(error, length(transform_point(line, corner(box, k)) - p));
      }
      if (!(error <= kTolerance * diagonal(world))) return false;
    }
    for (const std::uint32_t i : in_any({&a.changed, &b.changed, &truth.changed})) {
      if (is_hidden(i)) continue;
      const double tolerance =
          kTolerance * diagonal(boxes_[static_cast<std::size_t>(scene_.instances[i].mesh)]);
      if (!vertices_near(mesh(a, i), mesh(b, i), f, mesh(truth, i), tolerance)) return false;
    }
    return camera_near(a.camera, b.camera, f, truth.camera) && lights_near(a, b, f, truth);
  }

  /// Uses the camera's tolerances, because lights have no size either.
  [[nodiscard]] bool lights_near(const KeyPose& a, const KeyPose& b, float f,
                                 const KeyPose& truth) const {
    if (lights_excluded_) return true;
    const double tolerance = kCameraTolerance * length(scene_.bounds_max - scene_.bounds_min);
    for (std::size_t i = 0; i < truth.lights.size(); ++i) {
      const PunctualPose line = lerp(a.lights[i], b.lights[i], f);
      if (!(length(line.position - truth.lights[i].position) <= tolerance)) return false;
      if (!(length(Vec3d(line.direction) - Vec3d(truth.lights[i].direction)) <= kCameraTolerance)) {
        return false;
      }
    }
    return true;
  }

  static bool vertices_near(const SharedArray<Primitive>& a, const SharedArray<Primitive>& b,
                            float f, const SharedArray<Primitive>& truth, double tolerance) {
    for (std::size_t p = 0; p < truth.size(); ++p) {
      for (std::size_t v = 0; v < truth[p].positions.size(); ++v) {
        const Vec3f line = lerp_bounded(a[p].positions[v], b[p].positions[v], f);
        if (!(length(Vec3d(line) - Vec3d(truth[p].positions[v])) <= tolerance)) return false;
      }
    }
    return true;
  }

  [[nodiscard]] bool camera_near(const CameraKey& a, const CameraKey& b, float f,
                                 const CameraKey& truth) const {
    const Affine3d line = lerp(a.camera_to_world, b.camera_to_world, f);
    const Vec3d moved = line.translation - truth.camera_to_world.translation;
    if (!(length(moved) <= kCameraTolerance * length(scene_.bounds_max - scene_.bounds_min))) {
      return false;
    }
    const double focus =
        a.focus_distance + static_cast<double>(f) * (b.focus_distance - a.focus_distance);
    if (!(std::fabs(focus - truth.focus_distance) <= kTolerance * truth.focus_distance)) {
      return false;
    }
    for (int k = 0; k < 3; ++k) {
      const auto axis = [k](const Affine3d& m) {
        return normalize(Vec3d{m.rows[0][k], m.rows[1][k], m.rows[2][k]});
      };
      if (!(length(axis(line) - axis(truth.camera_to_world)) <= kCameraTolerance)) return false;
    }
    return true;
  }

  absl::Status store() {
    std::set<std::uint32_t> placed, changed;
    bool camera_moves = false;
    for (const auto& [time, key] : keys_) {
      placed.merge(in_any({&key.placed}));
      changed.merge(in_any({&key.changed}));
      const CameraKey& first = keys_.begin()->second.camera;
      camera_moves = camera_moves || !(key.camera.camera_to_world == first.camera_to_world) ||
                     key.camera.focus_distance != first.focus_distance ||
                     !(key.camera.camera_to_world == scene_.camera.camera_to_world);
    }
    const auto is_hidden = [this](std::uint32_t i) {
      return scene_.instances[i].flat && is_flat_throughout(i);
    };
    std::erase_if(placed, is_hidden);
    std::erase_if(changed, is_hidden);
    const bool lights_move = store_lights();
    for (const std::uint32_t i : placed) {
      scene_.instances[i].motion = static_cast<std::int32_t>(scene_.motions.size());
      std::vector<Affine3d>& motion = scene_.motions.emplace_back();
      for (const auto& [time, key] : keys_) motion.push_back(object_to_world(key, i));
    }
    store_meshes(changed);
    for (const auto& [time, key] : keys_) {
      if (!placed.empty() || !changed.empty() || lights_move) {
        scene_.key_times.push_back(static_cast<float>(time));
      }
      if (camera_moves) scene_.camera.keys.push_back(key.camera);
    }
    return absl::OkStatus();
  }

  /// Returns whether the transform of an instance is singular during the whole exposure. Between
  /// two keys its determinant is a cubic polynomial of time, which vanishes if it has four zeros.
  [[nodiscard]] bool is_flat_throughout(std::uint32_t instance) const {
    for (auto key = keys_.begin(); std::next(key) != keys_.end(); ++key) {
      const std::array<Affine3d, 2> motion = {object_to_world(key->second, instance),
                                              object_to_world(std::next(key)->second, instance)};
      for (const float f : {0.0f, 0.25f, 0.75f, 1.0f}) {
        if (pose_at(motion, {0, f})) return false;
      }
    }
    return true;
  }

  /// Stores keys of moving lights; returns whether any light moves.
  bool store_lights() {
    bool any = false;
    for (std::size_t i = 0; i < scene_.lights.size() && !lights_excluded_; ++i) {
      std::vector<PunctualPose> keys;
      for (const auto& [time, key] : keys_) keys.push_back(key.lights[i]);
      const PunctualPose& still = scene_.lights[i];
      const auto is_still = [&still](const PunctualPose& key) { return key == still; };
      if (std::all_of(keys.begin(), keys.end(), is_still)) continue;
      scene_.lights[i].keys = std::move(keys);
      any = true;
    }
    return any;
  }

  /// Stores the keys of deforming meshes. Instances that share a mesh may deform differently.
  void store_meshes(const std::set<std::uint32_t>& changed) {
    std::vector<bool> taken(
        scene_.meshes
            .size());  // by an instance for which it does not deform, or deforms in this way
    for (std::uint32_t i = 0; i < scene_.instances.size(); ++i) {
      if (!changed.contains(i)) taken[static_cast<std::size_t>(scene_.instances[i].mesh)] = true;
    }
    for (const std::uint32_t i : changed) {
      const std::size_t index = static_cast<std::size_t>(scene_.instances[i].mesh);
      Mesh mesh = scene_.meshes[index];
      mesh.keys.clear();
      for (const auto& [time, key] : keys_) {
        const auto found = key.changed.find(i);
        mesh.keys.push_back(found == key.changed.end() ? vertices_of(mesh.primitives)
                                                       : found->second);
      }
      if (!taken[index]) {
        taken[index] = true;
        scene_.meshes[index] = std::move(mesh);
      } else if (const auto twin = find_twin(mesh); twin) {
        scene_.instances[i].mesh = *twin;
      } else {
        scene_.instances[i].mesh = static_cast<std::int32_t>(scene_.meshes.size());
        scene_.meshes.push_back(std::move(mesh));
      }
    }
  }

  /// Index of a mesh of the scene with the same deformation.
  [[nodiscard]] std::optional<std::int32_t> find_twin(const Mesh& mesh) const {
    for (std::size_t i = 0; i < scene_.meshes.size(); ++i) {
      const Mesh& other = scene_.meshes[i];
      if (!other.primitives.shares(mesh.primitives) || other.keys.size() != mesh.keys.size()) {
        continue;
      }
      bool same = true;
      for (std::size_t k = 0; same && k < mesh.keys.size(); ++k) {
        same = std::equal(mesh.keys[k].begin(), mesh.keys[k].end(), other.keys[k].begin(),
                          other.keys[k].end(), same_vertices);
      }
      if (same) return static_cast<std::int32_t>(i);
    }
    return std::nullopt;
  }

  const ShutterInterval& shutter_;
  Scene& scene_;
  std::vector<Problem>& problems_;
  std::vector<Box3d> boxes_;                      // by mesh, object space
  std::map<std::int32_t, Range> instances_of_;    // by node
  std::map<double, KeyPose> keys_;                // by time in [0, 1], multiples of kTick
  std::set<double> jumps_;                        // keys followed by a jump
  std::set<std::int32_t> excluded_, csg_warned_;  // nodes that have been warned about
  bool lights_excluded_ = false;
  std::uint64_t bytes_ = 0;
};

}  // namespace

absl::Status add_motion(const ShutterInterval& exposure, Scene& scene,
                        std::vector<Problem>& problems) {
  return MotionBuilder(exposure, scene, problems).build();
}

}  // namespace tessera::render
