#include "worker/accel/scene_accel.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "worker/accel/build/instance_boxes.h"
#include "worker/accel/build/mesh_bvh.h"
#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/build/motion_bvh.h"
#include "worker/accel/build/refit.h"
#include "worker/accel/build/wide_bvh.h"
#include "worker/scene/features.h"

namespace tessera::render {
namespace {

/// Returns the boxes below the root of a mesh's BVH. None for a BVH with spatial splits, where they
/// contain only pieces of triangles.
template <int kWidth>
std::vector<Box3f> parts_of(const MeshBvh<kWidth>& tree) {
  std::vector<Box3f> parts;
  if (tree.split || tree.nodes.empty()) return parts;
  const WideNode<kWidth>& root = tree.nodes.data()[0];
  for (int slot = 0; slot < kWidth; ++slot) {
    if (!root.box(slot).empty()) parts.push_back(root.box(slot));
  }
  return parts;
}

/// Builds the BVH over the selected instances.
template <int kWidth>
void build_instance_bvh(const Scene& scene, const InstanceSelection& choice,
                        SceneBvh<kWidth>& trees, const ParallelFor& parallel_for) {
  std::vector<Box3f> meshes;
  std::vector<std::vector<Box3f>> parts;
  for (std::size_t i = 0; i < trees.meshes.size(); ++i) {
    const MeshBvh<kWidth>& tree = trees.meshes[i];
    const Mesh& mesh = scene.meshes[i];
    const bool known = choice.segment || mesh.keys.empty();
    meshes.push_back(mesh.shape != nullptr ? mesh.shape->bounds
                     : !known              ? bounds_of(mesh)
                     : tree.blocks.empty() ? Box3f{}
                                           : tree.bounds);
    parts.push_back(mesh.shape != nullptr || !known ? std::vector<Box3f>() : parts_of(tree));
  }
  const InstanceBoxes placed = bound_instances(scene, meshes, choice, parts);
  trees.origin_limit = placed.origin_limit;
  WideBvh<kWidth> bvh = collapse<kWidth>(build_binary_bvh({placed.boxes}, parallel_for));
  trees.nodes = std::move(bvh.nodes);
  trees.bounds = bvh.bounds;
  trees.single = bvh.leaves.size() == 1;
  const auto place = [&](std::uint32_t index, std::vector<PlacedMesh>& to) {
    const Instance& instance = scene.instances[index];
    to.push_back({instance.world_to_object, static_cast<std::uint32_t>(instance.mesh), index,
                  is_identity(instance.world_to_object),
                  trees.solids == nullptr ? kNoSolid : trees.solids->at(index)});
  };
  for (const std::uint32_t index : placed.unbounded) place(index, trees.unbounded);
  for (const BvhLeaf& leaf : bvh.leaves) {
    const std::uint32_t index = placed.instances[bvh.order[leaf.first]];
    place(index, trees.placed);
    const Instance& instance = scene.instances[index];
    if (instance.motion == kNone) continue;
    const auto& motion = scene.motions[static_cast<std::size_t>(instance.motion)];
    trees.placed.back().motion = static_cast<std::uint32_t>(trees.motions.size());
    trees.motions.push_back({motion[*choice.segment], motion[*choice.segment + 1]});
  }
}

/// Returns whether hits depend on the ray's time. They do not if only lights or the camera move.
bool surfaces_move(const Scene& scene) {
  return !scene.motions.empty() || std::any_of(scene.meshes.begin(), scene.meshes.end(),
                                               [](const Mesh& mesh) { return !mesh.keys.empty(); });
}

/// Builds a BVH for each interval between keyframes. `still` contains the BVHs of the meshes that
/// do not deform.
template <int kWidth>
void build_moving(const Scene& scene, const SceneBvh<kWidth>& still, MotionBvh<kWidth>& moving,
                  const ParallelFor& parallel_for) {
  moving.times = scene.key_times;
  for (std::uint32_t s = 0; s + 1 < scene.key_times.size(); ++s) {
    SceneBvh<kWidth>& trees = moving.segments.emplace_back();
    trees.meshes = still.meshes;
    for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
      if (scene.meshes[i].keys.empty()) continue;
      trees.meshes[i] = build_moving_mesh_bvh<kWidth>(scene.meshes[i], s, parallel_for);
    }
    trees.solids = still.solids;
    build_instance_bvh(scene, {false, s}, trees, parallel_for);
  }
}

/// Selects the general code paths for features that the scene is assumed to have.
template <int kWidth>
void assume_features(std::uint64_t features, SceneBvh<kWidth>& trees, MotionBvh<kWidth>& moving) {
  if ((features & kFeatureInstances) != 0) {
    trees.single = false;
    for (PlacedMesh& placed : trees.placed) placed.identity = false;
  }
  if ((features & kFeatureMotion) != 0 && moving.times.empty()) {
    moving.times = {0, 1};
    moving.segments.emplace_back();
  }
}

template <int kWidth>
std::size_t bytes(const MeshBvh<kWidth>& tree) {
  return tree.nodes.capacity_bytes() + tree.blocks.capacity_bytes() +
         tree.end_blocks.capacity_bytes();
}

/// Returns the bytes of a scene's BVH without those of its meshes.
template <int kWidth>
std::size_t top_bytes(const SceneBvh<kWidth>& trees) {
  return trees.nodes.capacity_bytes() +
         (trees.placed.capacity() + trees.unbounded.capacity()) * sizeof(PlacedMesh) +
         trees.motions.capacity() * sizeof(trees.motions[0]);
}

template <int kWidth>
std::size_t bytes(const SceneBvh<kWidth>& still, const MotionBvh<kWidth>& moving) {
  std::size_t sum = top_bytes(still);
  for (const MeshBvh<kWidth>& mesh : still.meshes) sum += bytes(mesh);
  for (const SceneBvh<kWidth>& trees : moving.segments) {
    sum += top_bytes(trees);
    for (const MeshBvh<kWidth>& mesh : trees.meshes) {
      sum += sizeof(mesh) + (mesh.end_blocks.empty() ? 0 : bytes(mesh));
    }
  }
  return sum;
}

template <int kWidth>
TreeQuality mean_quality(const SceneBvh<kWidth>& trees) {
  std::vector<double> weights(trees.meshes.size());
  for (const PlacedMesh& placed : trees.placed) {
    weights[placed.mesh] += static_cast<double>(trees.meshes[placed.mesh].first_rank.back());
  }
  TreeQuality sum;
  double total = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const TreeQuality one = measure_tree_quality(trees.meshes[i]);
    sum.sah += weights[i] * one.sah;
    sum.end_point_overlap += weights[i] * one.end_point_overlap;
    total += weights[i];
  }
  if (total > 0) sum = {sum.sah / total, sum.end_point_overlap / total};
  return sum;
}

}  // namespace

template <>
const SceneBvh<8>& SceneAccel::trees() const {
  return eight_;
}

template <>
const SceneBvh<16>& SceneAccel::trees() const {
  return sixteen_;
}

template <int kWidth>
void SceneAccel::build(const Scene& scene, SceneBvh<kWidth>& trees, MotionBvh<kWidth>& moving,
                       const SceneAccel* previous, const ParallelFor& parallel_for,
                       BuildQuality quality) {
  std::map<const Primitive*, const MeshBvh<kWidth>*> known;
  if (previous != nullptr && previous->isa_ == isa_) {
    for (std::size_t i = 0; i < previous->mesh_primitives_.size(); ++i) {
      known[previous->mesh_primitives_[i].data()] = &previous->trees<kWidth>().meshes[i];
    }
  }
  trees.meshes.reserve(scene.meshes.size());
  const auto refit = [&](std::size_t i) -> std::optional<MeshBvh<kWidth>> {
    if (previous == nullptr || known.empty() || i >= previous->mesh_primitives_.size())
      return std::nullopt;
    return refit_mesh_bvh(previous->trees<kWidth>().meshes[i], scene.meshes[i]);
  };
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    const Mesh& mesh = scene.meshes[i];
    if (!mesh.keys.empty()) {  // built by build_moving()
      mesh_primitives_.emplace_back();
      trees.meshes.push_back(build_mesh_bvh<kWidth>({}, parallel_for, quality));
      continue;
    }
    const auto same = known.find(mesh_primitives_.emplace_back(mesh.primitives).data());
    if (same != known.end()) {
      trees.meshes.push_back(*same->second);
      ++shared_meshes_;
    } else if (auto refitted = refit(i)) {
      trees.meshes.push_back(*std::move(refitted));
      ++refitted_meshes_;
    } else {
      trees.meshes.push_back(build_mesh_bvh<kWidth>(mesh, parallel_for, quality));
    }
  }
  trees.solids = Solids::of(scene);
  build_instance_bvh(scene, {}, trees, parallel_for);
  if (surfaces_move(scene)) build_moving(scene, trees, moving, parallel_for);
}

SceneAccel::SceneAccel(const Scene& scene, const ParallelFor& parallel_for,
                       const TraceOptions& options, const SceneAccel* previous,
                       BuildQuality quality)
    : isa_(options.counted ? Isa::avx2 : options.isa),
      counted_(options.counted),
      route_(Route::general) {
  const bool no_solids = (options.assumed_features & (kFeatureShapes | kFeatureCsg)) == 0;
  if (isa_ == Isa::avx512) {
    build(scene, sixteen_, sixteen_moving_, previous, parallel_for, quality);
    assume_features(options.assumed_features, sixteen_, sixteen_moving_);
    const bool plain = no_solids && sixteen_.solids == nullptr && sixteen_moving_.times.empty();
    route_ = plain ? Route::avx512 : Route::general;
  } else {
    build(scene, eight_, eight_moving_, previous, parallel_for, quality);
    assume_features(options.assumed_features, eight_, eight_moving_);
    const bool plain =
        !counted_ && no_solids && eight_.solids == nullptr && eight_moving_.times.empty();
    route_ = plain ? Route::avx2 : Route::general;
  }
}

SceneAccel::SceneAccel(std::unique_ptr<const Accelerator> override_accelerator)
    : isa_(Isa::avx2), route_(Route::general), override_(std::move(override_accelerator)) {}

bool SceneAccel::general_closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const {
  if (override_ != nullptr) return override_->closest_hit(ray, filter, hit);
  if (counted_) return avx2::closest_hit_counted(eight_, eight_moving_, ray, filter, hit);
  if (!sixteen_moving_.times.empty()) {
    return avx512::closest_hit_moving(sixteen_, sixteen_moving_, ray, filter, hit);
  }
  if (!eight_moving_.times.empty()) {
    return avx2::closest_hit_moving(eight_, eight_moving_, ray, filter, hit);
  }
  return isa_ == Isa::avx512 ? avx512::closest_hit_with_solids(sixteen_, ray, filter, hit)
                             : avx2::closest_hit_with_solids(eight_, ray, filter, hit);
}

bool SceneAccel::general_any_hit(const Ray& ray, const HitFilter* filter) const {
  if (override_ != nullptr) return override_->any_hit(ray, filter);
  if (counted_) return avx2::any_hit_counted(eight_, eight_moving_, ray, filter);
  if (!sixteen_moving_.times.empty()) {
    return avx512::any_hit_moving(sixteen_, sixteen_moving_, ray, filter);
  }
  if (!eight_moving_.times.empty()) {
    return avx2::any_hit_moving(eight_, eight_moving_, ray, filter);
  }
  return isa_ == Isa::avx512 ? avx512::any_hit_with_solids(sixteen_, ray, filter)
                             : avx2::any_hit_with_solids(eight_, ray, filter);
}

std::uint64_t SceneAccel::closest_hits(std::span<const Ray> rays, Hit* hits) const {
  return isa_ == Isa::avx512 ? avx512::closest_hits(sixteen_, rays, hits)
                             : avx2::closest_hits(eight_, rays, hits);
}

std::uint64_t SceneAccel::any_hits(std::span<const Ray> rays) const {
  return isa_ == Isa::avx512 ? avx512::any_hits(sixteen_, rays) : avx2::any_hits(eight_, rays);
}

TreeQuality SceneAccel::tree_quality() const {
  return isa_ == Isa::avx512 ? mean_quality(sixteen_) : mean_quality(eight_);
}

std::int64_t SceneAccel::memory_bytes() const {
  if (override_ != nullptr) return static_cast<std::int64_t>(override_->memory_bytes());
  return static_cast<std::int64_t>(bytes(eight_, eight_moving_) + bytes(sixteen_, sixteen_moving_));
}

}  // namespace tessera::render
