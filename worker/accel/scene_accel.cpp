#include "worker/accel/scene_accel.h"

#include <map>
#include <optional>
#include <utility>

#include "worker/accel/instance_boxes.h"
#include "worker/accel/mesh_tree.h"
#include "worker/accel/refit.h"
#include "worker/accel/wide_bvh.h"

namespace tessera::render {
namespace {

template <int kWidth>
void build_top(const Scene& scene, AccelTrees<kWidth>& trees, const ParallelFor& parallel_for) {
  std::vector<Box3f> meshes;
  for (std::size_t i = 0; i < trees.meshes.size(); ++i) {
    const MeshTree<kWidth>& mesh = trees.meshes[i];
    meshes.push_back(scene.meshes[i].shape != nullptr ? scene.meshes[i].shape->bounds
                     : mesh.blocks.empty()            ? Box3f{}
                                                      : mesh.bounds);
  }
  trees.solids = Solids::of(scene);
  const InstanceBoxes placed = place_instances(scene, meshes);
  trees.origin_limit = placed.origin_limit;
  WideBvh<kWidth> bvh = collapse<kWidth>(build_binary_bvh({placed.boxes}, parallel_for));
  trees.nodes = std::move(bvh.nodes);
  trees.bounds = bvh.bounds;
  for (const BvhLeaf& leaf : bvh.leaves) {
    const std::uint32_t index = placed.instances[bvh.order[leaf.first]];
    const Instance& instance = scene.instances[index];
    trees.placed.push_back({instance.world_to_object, static_cast<std::uint32_t>(instance.mesh),
                            index, is_identity(instance.world_to_object),
                            trees.solids == nullptr ? kNoSolid : trees.solids->at(index)});
  }
}

template <int kWidth>
std::size_t bytes(const AccelTrees<kWidth>& trees) {
  std::size_t sum = trees.nodes.capacity_bytes() + trees.placed.capacity() * sizeof(PlacedMesh);
  for (const MeshTree<kWidth>& mesh : trees.meshes) {
    sum += mesh.nodes.capacity_bytes() + mesh.blocks.capacity_bytes();
  }
  return sum;
}

template <int kWidth>
TreeQuality mean_quality(const AccelTrees<kWidth>& trees) {
  std::vector<double> weights(trees.meshes.size());
  for (const PlacedMesh& placed : trees.placed) {
    weights[placed.mesh] += static_cast<double>(trees.meshes[placed.mesh].first_rank.back());
  }
  TreeQuality sum;
  double total = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const TreeQuality one = quality_of(trees.meshes[i]);
    sum.sah += weights[i] * one.sah;
    sum.end_point_overlap += weights[i] * one.end_point_overlap;
    total += weights[i];
  }
  if (total > 0) sum = {sum.sah / total, sum.end_point_overlap / total};
  return sum;
}

}  // namespace

template <>
const AccelTrees<8>& SceneAccel::trees() const {
  return eight_;
}

template <>
const AccelTrees<16>& SceneAccel::trees() const {
  return sixteen_;
}

template <int kWidth>
void SceneAccel::build(const Scene& scene, AccelTrees<kWidth>& trees, const SceneAccel* before,
                       const ParallelFor& parallel_for, BuildQuality quality) {
  std::map<const Primitive*, const MeshTree<kWidth>*> known;
  if (before != nullptr && before->isa_ == isa_) {
    for (std::size_t i = 0; i < before->origins_.size(); ++i) {
      known[before->origins_[i].data()] = &before->trees<kWidth>().meshes[i];
    }
  }
  trees.meshes.reserve(scene.meshes.size());
  const auto refit = [&](std::size_t i) -> std::optional<MeshTree<kWidth>> {
    if (known.empty() || i >= before->origins_.size()) return std::nullopt;
    return refit_mesh_tree(before->trees<kWidth>().meshes[i], scene.meshes[i]);
  };
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    const Mesh& mesh = scene.meshes[i];
    const auto same = known.find(origins_.emplace_back(mesh.primitives).data());
    if (same != known.end()) {
      trees.meshes.push_back(*same->second);
      ++shared_meshes_;
    } else if (auto refitted = refit(i)) {
      trees.meshes.push_back(*std::move(refitted));
      ++refitted_meshes_;
    } else {
      trees.meshes.push_back(build_mesh_tree<kWidth>(mesh, parallel_for, quality));
    }
  }
  build_top(scene, trees, parallel_for);
}

SceneAccel::SceneAccel(const Scene& scene, const ParallelFor& parallel_for, Isa isa,
                       const SceneAccel* before, BuildQuality quality)
    : isa_(isa), route_(Route::other) {
  if (isa == Isa::avx512) {
    build(scene, sixteen_, before, parallel_for, quality);
    route_ = sixteen_.solids == nullptr ? Route::avx512 : Route::other;
  } else {
    build(scene, eight_, before, parallel_for, quality);
    route_ = eight_.solids == nullptr ? Route::avx2 : Route::other;
  }
}

SceneAccel::SceneAccel(std::unique_ptr<const RayQueries> instead)
    : isa_(Isa::avx2), route_(Route::other), instead_(std::move(instead)) {}

bool SceneAccel::other_closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const {
  if (instead_ != nullptr) return instead_->closest_hit(ray, filter, hit);
  return isa_ == Isa::avx512 ? avx512::closest_hit_with_solids(sixteen_, ray, filter, hit)
                             : avx2::closest_hit_with_solids(eight_, ray, filter, hit);
}

bool SceneAccel::other_any_hit(const Ray& ray, const HitFilter* filter) const {
  if (instead_ != nullptr) return instead_->any_hit(ray, filter);
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
  if (instead_ != nullptr) return static_cast<std::int64_t>(instead_->memory_bytes());
  return static_cast<std::int64_t>(bytes(eight_) + bytes(sixteen_));
}

}  // namespace tessera::render
