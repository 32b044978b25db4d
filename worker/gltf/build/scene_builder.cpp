#include "worker/gltf/build/scene_builder.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/animation/animation.h"
#include "worker/gltf/animation/deform.h"
#include "worker/gltf/animation/gpu_instancing.h"
#include "worker/gltf/animation/selection.h"
#include "worker/gltf/build/camera_setup.h"
#include "worker/gltf/build/csg_assembly.h"
#include "worker/gltf/build/declared_lights.h"
#include "worker/gltf/build/texture_setup.h"
#include "worker/gltf/checks/part_use.h"
#include "worker/gltf/checks/plane_rules.h"
#include "worker/gltf/checks/precision_check.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/decode/geometry_reader.h"
#include "worker/gltf/file/limits.h"
#include "worker/gltf/file/memory_budget.h"
#include "worker/gltf/model/hierarchy.h"
#include "worker/scene/features.h"
#include "worker/scene/texture_refs.h"
#include "worker/scene/volumes.h"

namespace tessera::render {

namespace {

bool is_finite(const Affine3d& m) {
  double size = max_abs(m.translation);
  for (const Vec3d& row : m.rows) size += max_abs(row);
  return std::isfinite(size);
}

/// Bounding box of a transformed box.
PosedBox transformed(const Affine3d& m, const PosedBox& box) {
  PosedBox out;
  for (unsigned corner = 0; corner < 8 && !box.is_empty(); ++corner) {
    out.add(transform_point(m, Vec3d{(corner & 1) != 0 ? box.high.x : box.low.x,
                                     (corner & 2) != 0 ? box.high.y : box.low.y,
                                     (corner & 4) != 0 ? box.high.z : box.low.z}));
  }
  return out;
}

class SceneBuilder {
 public:
  SceneBuilder(const PoseInput& input, PoseCache& cache, std::vector<Problem>& problems)
      : model_(input.model),
        input_(input),
        cache_(cache),
        problems_(problems),
        memory_(input.reader.memory_bytes()) {
    if (input.environment != nullptr) memory_.take(4 * input.environment->f32.size());
  }

  absl::StatusOr<PosedScene> build() {
    absl::Status status = pose_nodes();
    if (status.ok()) status = read_materials();
    if (status.ok()) status = check_used_parts(model_, order_, animations_);
    for (const std::int32_t node : order_) {
      if (status.ok()) status = place(node);
    }
    for (std::size_t m = 0; m < model_.materials.size(); ++m) {
      if (status.ok() && used_[m]) {
        status = check_used_material(model_, static_cast<std::int32_t>(m));
      }
    }
    if (status.ok()) status = recenter();
    if (status.ok()) {
      status = add_textures({model_, input_.reader, used_, cache_, next_cache_, memory_}, scene_,
                            problems_);
    }
    if (!status.ok()) return status;
    for (Problem& problem : unused_part_warnings(model_)) problems_.push_back(std::move(problem));
    for (Problem& problem : emissive_plane_warnings(scene_)) problems_.push_back(problem);
    add_environment();
    convert_index_matched_solids(scene_);
    cache_ = std::move(next_cache_);
    return PosedScene{std::move(scene_), std::move(order_)};
  }

 private:
  struct SkinnedMesh {
    std::int32_t mesh = kNone;
    const std::vector<Affine3d>* joints = nullptr;
    std::vector<Primitive> primitives;
    std::vector<std::vector<Vec3d>> worlds;  // by primitive, until the scene's centre is known
  };

  void warn(const std::string& element, const std::string& message) {
    if (problems_.size() > kMaxProblems) return;
    problems_.push_back({Problem::Severity::warning, element, message});
  }

  /// Index of the scene to render; kNone if the file has none.
  [[nodiscard]] std::int32_t chosen_scene() const {
    if (model_.scenes.empty()) return kNone;
    if (input_.settings.scene >= 0) return input_.settings.scene;
    return model_.default_scene == kNone ? 0 : model_.default_scene;
  }

  absl::StatusOr<std::vector<std::int32_t>> roots() {
    const std::int32_t wanted = input_.settings.scene;
    if (wanted >= 0 && static_cast<std::size_t>(wanted) >= model_.scenes.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("scene: no scene ", wanted, "; the file has ", model_.scenes.size()));
    }
    if (const std::int32_t chosen = chosen_scene(); chosen != kNone) {
      return model_.scenes[chosen].roots;
    }
    std::vector<std::int32_t> all;
    for (std::size_t i = 0; i < model_.nodes.size(); ++i) {
      if (model_.nodes[i].parent == kNone) all.push_back(static_cast<std::int32_t>(i));
    }
    return all;
  }

  absl::Status pose_nodes() {
    nodes_ = model_.nodes;
    const auto animations = choose_animations(model_, input_.settings.animation);
    if (!animations.ok()) return animations.status();
    animations_ = *animations;
    for (const std::int32_t animation : animations_) {
      absl::Status status = animate(model_, animation, input_.seconds, nodes_);
      if (!status.ok()) return status;
    }
    auto scene_roots = roots();
    if (!scene_roots.ok()) return scene_roots.status();
    roots_ = *std::move(scene_roots);
    if (const std::int32_t chosen = chosen_scene(); chosen != kNone) {
      scene_.atmosphere = model_.scenes[chosen].atmosphere;
    }
    world_ = world_transforms(nodes_);
    order_ = depth_first(nodes_, roots_);
    in_solid_ = nodes_in_solids(nodes_, order_);
    return absl::OkStatus();
  }

  absl::Status read_materials() {
    scene_.materials = model_.materials;
    scene_.materials.emplace_back();
    used_.assign(scene_.materials.size(), false);
    if (input_.settings.variant.empty()) return absl::OkStatus();
    const auto variant = choose(model_.variants, input_.settings.variant, "variant");
    if (!variant.ok()) return variant.status();
    variant_ = *variant;
    return absl::OkStatus();
  }

  /// Material of a primitive under the selected variant.
  [[nodiscard]] std::int32_t material_of(const GltfPrimitive& source) const {
    for (const VariantMapping& mapping : source.mappings) {
      const auto& v = mapping.variants;
      if (variant_ != kNone && std::find(v.begin(), v.end(), variant_) != v.end()) {
        return mapping.material == kNone ? source.material : mapping.material;
      }
    }
    return source.material == kNone ? static_cast<std::int32_t>(scene_.materials.size()) - 1
                                    : source.material;
  }

  VertexUsage usage_of(std::int32_t material) {
    VertexUsage usage;
    Material& m = scene_.materials[material];
    for (const TextureRef* ref : texture_refs(m)) {
      if (*ref) usage.uv[static_cast<std::size_t>(ref->uv_set)] = true;
    }
    const TextureRef& coat = m.clearcoat.normal_texture;
    const bool anisotropic = m.anisotropy.strength > 0;
    usage.tangents = (m.normal_texture || coat || anisotropic) && !m.unlit;
    usage.tangent_uv_set = m.normal_texture ? m.normal_texture.uv_set
                           : coat           ? coat.uv_set
                                            : m.anisotropy.texture.uv_set;
    if (anisotropic) usage.uv[static_cast<std::size_t>(usage.tangent_uv_set)] = true;
    return usage;
  }

  /// Adds the decoded size of a primitive. Errors: InvalidArgument if the scene becomes too large,
  /// ResourceExhausted if the primitive does not fit into the memory.
  absl::Status count_bytes(const GltfPrimitive& primitive, std::int32_t mesh) {
    std::uint64_t bytes = 0;
    if (primitive.indices != kNone) bytes += decoded_bytes(model_, primitive.indices);
    for (const auto& [name, accessor] : primitive.attributes) {
      bytes += decoded_bytes(model_, accessor);
    }
    for (const Attributes& target : primitive.targets) {
      for (const auto& [name, accessor] : target) bytes += decoded_bytes(model_, accessor);
    }
    geometry_bytes_ += bytes;
    if (geometry_bytes_ <= kMaxGeometryBytes) {
      return memory_.check(absl::StrCat("meshes[", mesh, "]"), bytes);
    }
    return absl::InvalidArgumentError(absl::StrCat("meshes[", mesh,
                                                   "]: the scene's meshes decode to more than ",
                                                   kMaxGeometryBytes, " bytes"));
  }

  /// A primitive before posing, from the cache if possible; null if it has no triangles. Only
  /// deforming primitives are cached here; for others the posed mesh is.
  absl::StatusOr<std::shared_ptr<const BasePrimitive>> base_primitive(std::int32_t mesh,
                                                                      std::size_t index,
                                                                      bool deforms) {
    const PoseCache::BaseKey key(mesh, variant_, index);
    if (const auto known = cache_.bases.find(key); deforms && known != cache_.bases.end()) {
      return next_cache_.bases[key] = known->second;
    }
    const std::int32_t material = material_of(model_.meshes[mesh].primitives[index]);
    auto read = read_primitive(model_, mesh, index, usage_of(material), problems_);
    if (!read.ok()) return read.status();
    std::shared_ptr<const BasePrimitive> base;
    if (*read && !(*read)->primitive.triangles.empty()) {
      base = std::make_shared<const BasePrimitive>(**std::move(read));
    }
    if (deforms) next_cache_.bases[key] = base;
    return base;
  }

  /// Reads and poses a primitive; with `skinned`, also skins it and appends its exact positions to
  /// `skinned->worlds`. nullopt if it has no triangles.
  absl::StatusOr<std::optional<Primitive>> pose_primitive(std::int32_t mesh, std::size_t index,
                                                          const std::vector<double>& weights,
                                                          SkinnedMesh* skinned) {
    const GltfPrimitive& source = model_.meshes[mesh].primitives[index];
    absl::Status status = count_bytes(source, mesh);
    if (!status.ok()) return status;
    const auto base = base_primitive(mesh, index, skinned != nullptr || !source.targets.empty());
    if (!base.ok()) return base.status();
    if (*base == nullptr) return std::optional<Primitive>();
    const std::string where = absl::StrCat("meshes[", mesh, "].primitives[", index, "]");
    Primitive posed = morph(**base, weights);
    if (skinned != nullptr) {
      auto skinned_primitive = skin(**base, std::move(posed), *skinned->joints);
      if (!skinned_primitive.ok()) {
        return absl::Status(skinned_primitive.status().code(),
                            absl::StrCat(where, ": ", skinned_primitive.status().message()));
      }
      posed = std::move(skinned_primitive->primitive);
      for (std::size_t v = 0; v < posed.positions.size(); ++v) {
        posed.positions[v] = Vec3f(skinned_primitive->world_positions[v]);
      }
      skinned->worlds.push_back(std::move(skinned_primitive->world_positions));
      memory_.take(skinned->worlds.back().size() * sizeof(Vec3d));
    }
    if (const std::size_t gone = drop_invalid_triangles(posed); gone > 0) {
      warn(where, absl::StrCat(gone, " triangles exceed the range of float after posing; skipped"));
    }
    posed.material = material_of(source);
    memory_.take(static_cast<std::uint64_t>(geometry_bytes(posed)));
    return std::optional<Primitive>(std::move(posed));
  }

  /// Adds a posed mesh to the scene.
  std::int32_t add_mesh(Mesh mesh, const PosedBox& box) {
    for (const Primitive& p : mesh.primitives) {
      used_[p.material] = used_[p.material] || !p.triangles.empty();
    }
    scene_.meshes.push_back(std::move(mesh));
    boxes_.push_back(box);
    return static_cast<std::int32_t>(scene_.meshes.size()) - 1;
  }

  /// Index of the scene mesh of a glTF mesh with given weights, shared by all nodes that use it so.
  absl::StatusOr<std::int32_t> shared_mesh(std::int32_t source,
                                           const std::vector<double>& weights) {
    const auto key = std::make_pair(source, weights);
    if (const auto known = shared_.find(key); known != shared_.end()) return known->second;
    const PoseCache::MeshKey cache_key(source, variant_, weights);
    PoseCache::PosedMesh& posed = next_cache_.meshes[cache_key];
    if (const auto before = cache_.meshes.find(cache_key); before != cache_.meshes.end()) {
      posed = before->second;
    } else {
      std::vector<Primitive> primitives;
      for (std::size_t k = 0; k < model_.meshes[source].primitives.size(); ++k) {
        auto primitive = pose_primitive(source, k, weights, nullptr);
        if (!primitive.ok()) return primitive.status();
        if (*primitive) primitives.push_back(**std::move(primitive));
      }
      for (const Primitive& p : primitives) {
        for (const auto& t : p.triangles) {
          for (const std::uint32_t v : t) posed.box.add(Vec3d(p.positions[v]));
        }
      }
      posed.mesh = {model_.meshes[source].name, std::move(primitives)};
    }
    return shared_[key] = add_mesh(posed.mesh, posed.box);
  }

  /// Adds a skinned copy of a glTF mesh. Its primitives are set in recenter().
  absl::StatusOr<std::int32_t> skinned_mesh(std::int32_t source, const std::vector<double>& weights,
                                            const std::vector<Affine3d>& joints) {
    SkinnedMesh skinned;
    skinned.joints = &joints;
    PosedBox box;
    for (std::size_t k = 0; k < model_.meshes[source].primitives.size(); ++k) {
      auto primitive = pose_primitive(source, k, weights, &skinned);
      if (!primitive.ok()) return primitive.status();
      if (!*primitive) continue;
      const Primitive& p = **primitive;
      used_[p.material] = used_[p.material] || !p.triangles.empty();
      for (const auto& t : p.triangles) {
        for (const std::uint32_t v : t) box.add(skinned.worlds.back()[v]);
      }
      skinned.primitives.push_back(**std::move(primitive));
    }
    skinned.joints = nullptr;
    skinned.mesh = add_mesh({model_.meshes[source].name, {}}, box);
    const std::int32_t mesh = skinned.mesh;
    skinned_.push_back(std::move(skinned));
    return mesh;
  }

  [[nodiscard]] std::vector<double> weights_of(const Node& node) const {
    const GltfMesh& mesh = model_.meshes[node.mesh];
    const bool morphs = std::any_of(mesh.primitives.begin(), mesh.primitives.end(),
                                    [](const GltfPrimitive& p) { return !p.targets.empty(); });
    if (!morphs) return {};
    return node.weights.empty() ? mesh.weights : node.weights;
  }

  absl::Status place(std::int32_t index) {
    const Node& node = nodes_[index];
    if (node.light != kNone) place_light(index);
    if (node.shape != nullptr) return place_mesh(shape_mesh(node), index);
    if (node.mesh == kNone) return absl::OkStatus();
    if (node.skin != kNone && has_influences(model_.meshes[node.mesh])) {
      const auto joints = joint_matrices(model_, node.skin, world_);
      if (!joints.ok()) return joints.status();
      const auto mesh = skinned_mesh(node.mesh, weights_of(node), *joints);
      if (!mesh.ok()) return mesh.status();
      add_instance(*mesh, index, Affine3d());
      return absl::OkStatus();
    }
    const auto mesh = shared_mesh(node.mesh, weights_of(node));
    if (!mesh.ok()) return mesh.status();
    return place_mesh(*mesh, index);
  }

  absl::Status place_mesh(std::int32_t mesh, std::int32_t index) {
    if (!nodes_[index].instancing.empty()) return place_instances(mesh, index);
    add_instance(mesh, index, world_[index]);
    return absl::OkStatus();
  }

  /// Adds the mesh of an analytic shape.
  std::int32_t shape_mesh(const Node& node) {
    Primitive surface;
    surface.material = node.shape_material == kNone
                           ? static_cast<std::int32_t>(scene_.materials.size()) - 1
                           : node.shape_material;
    used_[surface.material] = true;
    return add_mesh({node.name, std::vector<Primitive>{std::move(surface)}, node.shape},
                    framing_box(*node.shape));
  }

  static bool has_influences(const GltfMesh& mesh) {
    return std::any_of(mesh.primitives.begin(), mesh.primitives.end(), [](const auto& p) {
      return p.attributes.contains("JOINTS_0") && p.attributes.contains("WEIGHTS_0");
    });
  }

  absl::Status place_instances(std::int32_t mesh, std::int32_t index) {
    const auto locals = instance_transforms(model_, nodes_[index]);
    if (!locals.ok()) return locals.status();
    if (locals->size() + scene_.instances.size() > kMaxInstances) {
      return absl::InvalidArgumentError(
          absl::StrCat("nodes[", index, "]: more than ", kMaxInstances, " instances"));
    }
    for (const Affine3d& local : *locals) add_instance(mesh, index, world_[index] * local);
    return absl::OkStatus();
  }

  void add_instance(std::int32_t mesh, std::int32_t node, const Affine3d& world) {
    if (boxes_[mesh].is_empty()) return;
    const std::string where = absl::StrCat("nodes[", node, "]");
    if (!is_finite(world)) return warn(where, "its transform is not finite; skipped");
    const PosedBox box = transformed(world, boxes_[mesh]);
    if (!(max_abs(box.low) <= kMaxCoordinate && max_abs(box.high) <= kMaxCoordinate)) {
      return warn(where,
                  "its position is not finite or farther than 1e18 from the origin; skipped");
    }
    Instance instance;
    instance.mesh = mesh;
    instance.node = node;
    instance.object_to_world = world;
    instance.operand = in_solid_[node];
    const auto inverted = inverse(world);
    instance.flat = !inverted;
    if (inverted) {
      instance.world_to_object = *inverted;
      instance.flips_winding = determinant(world) < 0;
      placed_.push_back({box, node});
    }
    PosedBox& bounds = inverted ? bounds_ : flat_bounds_;
    bounds.add(box.low);
    bounds.add(box.high);
    scene_.instances.push_back(instance);
  }

  void place_light(std::int32_t index) {
    PunctualLight light = model_.lights[nodes_[index].light];
    light.node = index;
    light.position = world_[index].translation;
    Vec3d towards = normalize(transform_vector(world_[index], Vec3d{0, 0, -1}));
    if (towards == Vec3d{}) towards = unscaled_direction(nodes_, index);
    light.direction = Vec3f(towards);
    if (!(max_abs(light.position) <= kMaxCoordinate) || !is_finite(light.direction) ||
        (towards == Vec3d{} && light.kind != PunctualLight::Kind::point)) {
      return warn(absl::StrCat("nodes[", index, "]"),
                  "its light has no finite position and direction; skipped");
    }
    if (light.intensity == Vec3f{}) return;
    scene_.lights.push_back(std::move(light));
  }

  absl::Status recenter() {
    if (bounds_.is_empty()) bounds_ = flat_bounds_;
    if (bounds_.is_empty()) {
      warn("", "the scene has no triangles");
      bounds_ = {{0, 0, 0}, {0, 0, 0}};
    }
    const Vec3d center = input_.center.value_or((bounds_.low + bounds_.high) * 0.5);
    scene_.center = center;
    if (auto problem = check_precision(placed_, center)) problems_.push_back(*std::move(problem));
    scene_.bounds_min = bounds_.low - center;
    scene_.bounds_max = bounds_.high - center;
    for (SkinnedMesh& s : skinned_) {
      for (std::size_t k = 0; k < s.primitives.size(); ++k) {
        for (std::size_t v = 0; v < s.worlds[k].size(); ++v) {
          const Vec3d p = s.worlds[k][v] - center;
          const bool finite = max_abs(p) <= kMaxCoordinate && std::isfinite(p.x + p.y + p.z);
          s.primitives[k].positions[v] = finite ? Vec3f(p) : Vec3f{};
        }
      }
      scene_.meshes[s.mesh].primitives = std::move(s.primitives);
    }
    for (Instance& instance : scene_.instances) {
      if (is_skinned(instance.mesh)) continue;  // its vertices have been moved
      instance.object_to_world.translation = instance.object_to_world.translation - center;
      instance.world_to_object.translation =
          -transform_vector(instance.world_to_object, instance.object_to_world.translation);
    }
    for (PunctualLight& light : scene_.lights) light.position = light.position - center;
    if (scene_.atmosphere) scene_.atmosphere->center = scene_.atmosphere->center - center;
    auto camera = set_up_camera(model_, input_.settings, {order_, world_, scene_}, problems_);
    if (!camera.ok()) return camera.status();
    scene_.camera = *std::move(camera);
    return absl::OkStatus();
  }

  [[nodiscard]] bool is_skinned(std::int32_t mesh) const {
    return std::any_of(skinned_.begin(), skinned_.end(),
                       [mesh](const SkinnedMesh& s) { return s.mesh == mesh; });
  }

  [[nodiscard]] bool has_emitters() const {
    for (std::size_t m = 0; m < scene_.materials.size(); ++m) {
      if (used_[m] && gives_light(scene_.materials[m])) return true;
    }
    return scene_.atmosphere && max_component(scene_.atmosphere->medium.emission) > 0;
  }

  void add_environment() {
    const contract::RenderSettings& settings = input_.settings;
    Environment& environment = scene_.environment;
    if (input_.environment != nullptr) {
      scene_.has_environment = true;
      environment.image = static_cast<std::int32_t>(scene_.images.size());
      environment.rotation_degrees = settings.environment_rotation;
      environment.strength = static_cast<float>(settings.environment_strength);
      scene_.images.push_back(*input_.environment);
    } else if (settings.background == contract::Background::color) {
      scene_.has_environment = true;
      const auto& c = settings.background_color;
      environment.constant = {c[0], c[1], c[2]};
    } else if (scene_.lights.empty() && !has_emitters()) {
      const bool is_dark =
          declares_light(model_, chosen_scene(), roots_, [&](auto& p) { return material_of(p); });
      scene_.has_environment = !is_dark;
      if (!is_dark) environment.constant = {1, 1, 1};
      problems_.push_back(
          {Problem::Severity::note, "",
           is_dark ? "all lights of the scene are dark or hidden at this time"
                   : "the scene has no lights; using a white environment of radiance 1"});
    }
  }

  const GltfModel& model_;
  const PoseInput& input_;
  PoseCache& cache_;      // of the previous pose
  PoseCache next_cache_;  // for the next pose
  std::vector<Problem>& problems_;
  Scene scene_;
  std::vector<Node> nodes_;  // posed
  std::vector<Affine3d> world_;
  std::vector<std::int32_t> animations_;
  std::vector<std::int32_t> roots_, order_;  // of the scene, and its nodes depth first
  std::int32_t variant_ = kNone;
  std::vector<bool> used_;         // by material
  std::vector<PlacedBox> placed_;  // boxes of instances
  std::vector<PosedBox> boxes_;    // by scene mesh; in world space for skinned ones
  std::map<std::pair<std::int32_t, std::vector<double>>, std::int32_t> shared_;
  std::vector<SkinnedMesh> skinned_;
  std::vector<bool> in_solid_;     // by node
  PosedBox bounds_, flat_bounds_;  // of instances that are not flat, and that are
  std::uint64_t geometry_bytes_ = 0;
  MemoryBudget memory_;
};

}  // namespace

absl::StatusOr<PosedScene> build_scene(const PoseInput& input, PoseCache& cache,
                                       std::vector<Problem>& problems) {
  return SceneBuilder(input, cache, problems).build();
}

absl::StatusOr<Scene> finish_scene(const GltfModel& model, PosedScene posed,
                                   std::vector<Problem>& problems) {
  Scene& scene = posed.scene;
  const auto invisible = [&](const Instance& instance) {
    const bool skip = instance.flat && instance.motion == kNone;
    if (skip && problems.size() <= kMaxProblems) {
      problems.push_back({Problem::Severity::warning, absl::StrCat("nodes[", instance.node, "]"),
                          "its transform is singular; skipped"});
    }
    return skip;
  };
  std::erase_if(scene.instances, invisible);
  absl::Status status = assemble_solids(model.nodes, posed.order, scene);
  if (!status.ok()) return status;
  return std::move(scene);
}

}  // namespace tessera::render
