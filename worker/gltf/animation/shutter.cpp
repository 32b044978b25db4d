#include "worker/gltf/animation/shutter.h"

#include <algorithm>
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

constexpr double kTolerance = 0x1p-10;        // of the size of what moves
constexpr double kCameraTolerance = 0x1p-12;  // radians; of the scene's size
constexpr double kTick = 0x1p-24;             // between times that rays can have

/// What a pose has that the frame's own has not.
struct KeyPose {
  std::map<std::uint32_t, Affine3d> placed;                 // by instance: object to world
  std::map<std::uint32_t, SharedArray<Primitive>> changed;  // by instance: what its mesh became
  CameraKey camera;
  std::vector<PunctualPose> lights;  // of Scene::lights
};

/// The vertices alone, of one that changes.
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
  MotionBuilder(const ShutterInterval& exposure, Scene& scene, std::vector<Problem>& problems)
      : exposure_(exposure), scene_(scene), problems_(problems) {
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
  /// Instances of one node: they follow each other.
  struct Range {
    std::uint32_t first = UINT32_MAX, count = 0;
  };

  void warn(const std::string& element, const std::string& message) {
    problems_.push_back({Problem::Severity::warning, element, message});
  }

  [[nodiscard]] double seconds(double time) const {
    return exposure_.open + time * (exposure_.close - exposure_.open);
  }

  absl::StatusOr<KeyPose> pose(double time) {
    auto scene = exposure_.pose(seconds(time));
    if (!scene.ok()) return scene.status();
    KeyPose out;
    std::map<std::int32_t, Range> there;
    for (std::uint32_t i = 0; i < scene->instances.size(); ++i) {
      Range& range = there[scene->instances[i].node];
      if (range.count++ == 0) range.first = i;
    }
    for (const auto& [node, range] : instances_of_) {
      if (there[node].count != range.count) {
        leave_out(node, "cannot be placed all the while the shutter is open; it is not blurred");
        continue;
      }
      for (std::uint32_t k = 0; k < range.count; ++k) {
        compare(range.first + k, *scene, scene->instances[there[node].first + k], out);
      }
    }
    const Camera& camera = scene->camera;
    const bool same_camera = camera.shutter_close == scene_.camera.shutter_close &&
                             camera.shutter_open == scene_.camera.shutter_open;
    const Camera& seen = same_camera ? camera : scene_.camera;  // else it could not be set up
    out.camera = {static_cast<float>(time), seen.camera_to_world, seen.lens.focus_distance};
    note_lights(*scene, out);
    return out;
  }

  /// Directions of point lights and places of directional ones mean nothing.
  void note_lights(const Scene& posed, KeyPose& out) {
    const auto same_node = [](const PunctualLight& a, const PunctualLight& b) {
      return a.node == b.node;
    };
    if (!std::equal(scene_.lights.begin(), scene_.lights.end(), posed.lights.begin(),
                    posed.lights.end(), same_node)) {
      if (!std::exchange(lights_left_out_, true)) {
        warn("nodes", "not all lights can be placed all the while the shutter is open; none moves");
      }
      return;
    }
    for (std::size_t i = 0; i < posed.lights.size(); ++i) {
      const PunctualLight &here = scene_.lights[i], &there = posed.lights[i];
      const bool point = here.kind == PunctualLight::Kind::point;
      const bool distant = here.kind == PunctualLight::Kind::directional;
      out.lights.push_back(
          {distant ? here.position : there.position, point ? here.direction : there.direction});
    }
  }

  /// Notes how an instance differs from what it is at the frame's time.
  void compare(std::uint32_t index, const Scene& posed, const Instance& there, KeyPose& out) {
    const Instance& here = scene_.instances[index];
    if (!(there.object_to_world == here.object_to_world)) {
      out.placed[index] = there.object_to_world;
    }
    const auto& before = scene_.meshes[static_cast<std::size_t>(here.mesh)].primitives;
    const auto& now = posed.meshes[static_cast<std::size_t>(there.mesh)].primitives;
    if (now.shares(before)) return;
    if (!std::equal(before.begin(), before.end(), now.begin(), now.end(), same_shape)) {
      leave_out(
          here.node,
          "its mesh does not keep its triangles while the shutter is open; it is not blurred");
    } else if (!std::equal(before.begin(), before.end(), now.begin(), now.end(), same_vertices)) {
      if (!here.operand) {
        out.changed[index] = vertices_of(now);
      } else if (said_.insert(here.node).second) {
        warn(absl::StrCat("nodes[", here.node, "]"),
             "changes its shape inside a CSG solid while the shutter is open; that is not blurred");
      }
    }
  }

  /// What is not known at every key stands still at all of them.
  void leave_out(std::int32_t node, const std::string& message) {
    if (!left_out_.insert(node).second) return;
    warn(absl::StrCat("nodes[", node, "]"), message);
  }

  [[nodiscard]] bool is_left_out(std::uint32_t instance) const {
    return left_out_.contains(scene_.instances[instance].node);
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
          absl::StrCat("the poses of the meshes that change while the shutter is open take more "
                       "than ",
                       kMaxGeometryBytes, " bytes; open it for a shorter time"));
    }
    keys_[time] = *std::move(posed);
    return absl::OkStatus();
  }

  /// Both ends, and where the animation turns or jumps.
  absl::Status place_first_keys() {
    std::set<double> times = {0, 1};
    const double span = exposure_.close - exposure_.open;
    const std::size_t step = exposure_.changes.size() / (kMaxKeys / 4) + 1;
    if (step > 1) {
      warn("animations",
           absl::StrCat(exposure_.changes.size(),
                        " keys while the shutter is open; motion follows one in ", step));
    }
    for (std::size_t i = 0; i < exposure_.changes.size(); i += step) {
      const AnimationKey& change = exposure_.changes[i];
      double time = std::ceil((change.seconds - exposure_.open) / span / kTick) * kTick;
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

  /// Halves what is not straight enough, the longest first.
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
          warn("animations", absl::StrCat("too much moves while the shutter is open: it is "
                                          "followed in ",
                                          keys_.size() - 1, " straight pieces only"));
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

  [[nodiscard]] const Affine3d& place(const KeyPose& pose, std::uint32_t instance) const {
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

  /// The instances that some pose has something of.
  template <typename Map>
  [[nodiscard]] std::set<std::uint32_t> any_of(std::initializer_list<const Map*> maps) const {
    std::set<std::uint32_t> out;
    for (const Map* map : maps) {
      for (const auto& [instance, value] : *map) {
        if (!is_left_out(instance)) out.insert(instance);
      }
    }
    return out;
  }

  /// Whether a pose lies within the tolerances of what is between two others.
  [[nodiscard]] bool is_near(const KeyPose& a, const KeyPose& b, float f,
                             const KeyPose& truth) const {
    for (const std::uint32_t i : any_of({&a.placed, &b.placed, &truth.placed})) {
      const Affine3d& placed = place(truth, i);
      const Box3d& box = boxes_[static_cast<std::size_t>(scene_.instances[i].mesh)];
      const Affine3d line = lerp(place(a, i), place(b, i), f);
      Box3d world;
      double off = 0;
      for (unsigned k = 0; k < 8; ++k) {
        const Vec3d p = transform_point(placed, corner(box, k));
        world.extend(p);
        off = std::max(off, length(transform_point(line, corner(box, k)) - p));
      }
      if (!(off <= kTolerance * diagonal(world))) return false;
    }
    for (const std::uint32_t i : any_of({&a.changed, &b.changed, &truth.changed})) {
      const double most =
          kTolerance * diagonal(boxes_[static_cast<std::size_t>(scene_.instances[i].mesh)]);
      if (!vertices_near(mesh(a, i), mesh(b, i), f, mesh(truth, i), most)) return false;
    }
    return camera_near(a.camera, b.camera, f, truth.camera) && lights_near(a, b, f, truth);
  }

  /// As the camera: neither has a size.
  [[nodiscard]] bool lights_near(const KeyPose& a, const KeyPose& b, float f,
                                 const KeyPose& truth) const {
    if (lights_left_out_) return true;
    const double most = kCameraTolerance * length(scene_.bounds_max - scene_.bounds_min);
    for (std::size_t i = 0; i < truth.lights.size(); ++i) {
      const PunctualPose line = lerp(a.lights[i], b.lights[i], f);
      if (!(length(line.position - truth.lights[i].position) <= most)) return false;
      if (!(length(Vec3d(line.direction) - Vec3d(truth.lights[i].direction)) <= kCameraTolerance)) {
        return false;
      }
    }
    return true;
  }

  static bool vertices_near(const SharedArray<Primitive>& a, const SharedArray<Primitive>& b,
                            float f, const SharedArray<Primitive>& truth, double most) {
    for (std::size_t p = 0; p < truth.size(); ++p) {
      for (std::size_t v = 0; v < truth[p].positions.size(); ++v) {
        const Vec3f line = lerp_bounded(a[p].positions[v], b[p].positions[v], f);
        if (!(length(Vec3d(line) - Vec3d(truth[p].positions[v])) <= most)) return false;
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
      placed.merge(any_of({&key.placed}));
      changed.merge(any_of({&key.changed}));
      const CameraKey& first = keys_.begin()->second.camera;
      camera_moves = camera_moves || !(key.camera.camera_to_world == first.camera_to_world) ||
                     key.camera.focus_distance != first.focus_distance ||
                     !(key.camera.camera_to_world == scene_.camera.camera_to_world);
    }
    const bool lights_move = store_lights();
    for (const std::uint32_t i : placed) {
      scene_.instances[i].motion = static_cast<std::int32_t>(scene_.motions.size());
      std::vector<Affine3d>& motion = scene_.motions.emplace_back();
      for (const auto& [time, key] : keys_) motion.push_back(place(key, i));
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

  /// Whether any light moves.
  bool store_lights() {
    bool any = false;
    for (std::size_t i = 0; i < scene_.lights.size() && !lights_left_out_; ++i) {
      std::vector<PunctualPose> keys;
      for (const auto& [time, key] : keys_) keys.push_back(key.lights[i]);
      const PunctualPose& still = scene_.lights[i];
      const auto stands = [&still](const PunctualPose& key) { return key == still; };
      if (std::all_of(keys.begin(), keys.end(), stands)) continue;
      scene_.lights[i].keys = std::move(keys);
      any = true;
    }
    return any;
  }

  /// A mesh that instances share now need not stay the same for all of them.
  void store_meshes(const std::set<std::uint32_t>& changed) {
    std::vector<bool> taken(scene_.meshes.size());  // by an instance that keeps it as it is
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

  /// A mesh of the scene that goes through the same shapes.
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

  const ShutterInterval& exposure_;
  Scene& scene_;
  std::vector<Problem>& problems_;
  std::vector<Box3d> boxes_;                    // by mesh, object space
  std::map<std::int32_t, Range> instances_of_;  // by node
  std::map<double, KeyPose> keys_;              // by time in [0, 1], multiples of kTick
  std::set<double> jumps_;                      // keys that something jumps after
  std::set<std::int32_t> left_out_, said_;      // nodes
  bool lights_left_out_ = false;
  std::uint64_t bytes_ = 0;
};

}  // namespace

absl::Status add_motion(const ShutterInterval& exposure, Scene& scene,
                        std::vector<Problem>& problems) {
  return MotionBuilder(exposure, scene, problems).build();
}

}  // namespace tessera::render
