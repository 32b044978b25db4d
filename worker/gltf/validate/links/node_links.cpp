#include <algorithm>
#include <cmath>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/links/linked_document.h"
#include "worker/gltf/validate/schema/matrix_rules.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;

void link_node_mesh(LinkedDocument& document, const JsonNode& json, const std::string& path,
                    bool has_skin) {
  const std::int64_t index = json.integer("mesh");
  const JsonNode* mesh = document.resolve(document.meshes, index, path, "mesh");
  if (mesh == nullptr || !(*mesh)["primitives"].is(Kind::array)) return;
  LinkedMesh& linked = document.linked_meshes[static_cast<std::size_t>(index)];
  const JsonNode& weights = json["weights"];
  if (!weights.is(Kind::array)) {
    linked.weights_used = true;
  } else if (linked.primitives[0].targets != weights.size()) {
    document.findings.add_at(rules::kNodeWeightsInvalid, path, "weights");
  }
  if (has_skin && linked.all_without_joints()) {
    document.findings.add(rules::kNodeSkinWithNonSkinnedMesh, path);
  }
  if (!has_skin && linked.any_joints()) {
    document.findings.add(rules::kNodeSkinnedMeshWithoutSkin, path);
  }
}

void link_children(LinkedDocument& document, const JsonNode& json, std::size_t i,
                   const std::string& path) {
  const JsonNode& children = json["children"];
  for (std::size_t k = 0; k < children.size(); ++k) {
    const std::int64_t child = children.items()[k].as_integer();
    if (document.resolve(document.nodes, child, path, std::to_string(k)) == nullptr) continue;
    LinkedNode& node = document.linked_nodes[static_cast<std::size_t>(child)];
    if (node.parent != kNoIndex) document.findings.add_at(rules::kNodeParentOverride, path, k);
    node.parent = static_cast<std::int64_t>(i);
  }
}

void link_node(LinkedDocument& document, std::size_t i) {
  const JsonNode* json = document.nodes.get(static_cast<std::int64_t>(i));
  if (json == nullptr) return;
  const std::string path = document.nodes.pointer(i);
  document.resolve(document.cameras, json->integer("camera"), path, "camera");
  const bool has_skin =
      document.resolve(document.skins, json->integer("skin"), path, "skin") != nullptr;
  link_node_mesh(document, *json, path, has_skin);
  link_children(document, *json, i, pointer_to(path, "children"));
  const JsonNode& light = document.checked.extension(*json, "KHR_lights_punctual");
  if (!light.is(Kind::object)) return;
  const std::string inner = path + "/extensions/KHR_lights_punctual";
  if (document.checked.extension(document.checked.root, "KHR_lights_punctual").is(Kind::object)) {
    document.resolve(document.lights, light.integer("light"), inner, "light");
  } else {
    document.findings.add(rules::kUnsatisfiedDependency, inner, "/extensions/KHR_lights_punctual");
  }
}

/// Root that the joints of a skin share; kNoIndex if they share none.
std::int64_t shared_root(const LinkedDocument& document, const JsonNode& skin) {
  std::int64_t out = kNoIndex;
  bool first = true;
  for (const JsonNode& each : skin["joints"].items()) {
    const std::int64_t joint = each.as_integer();
    if (document.nodes.get(joint) == nullptr) continue;
    const std::int64_t root = document.linked_nodes[static_cast<std::size_t>(joint)].root;
    if (!first && root != out) return kNoIndex;
    out = root;
    first = false;
  }
  return out;
}

void link_joints(LinkedDocument& document, const JsonNode& skin, const std::string& path) {
  const JsonNode& joints = skin["joints"];
  if (!joints.is(Kind::array)) return;
  const std::string inner = pointer_to(path, "joints");
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const std::int64_t joint = joints.items()[k].as_integer();
    if (document.resolve(document.nodes, joint, inner, std::to_string(k)) != nullptr) {
      document.linked_nodes[static_cast<std::size_t>(joint)].is_joint = true;
    }
  }
  if (shared_root(document, skin) == kNoIndex) {
    document.findings.add(rules::kSkinNoCommonRoot, inner);
  }
}

void link_inverse_binds(LinkedDocument& document, const JsonNode& skin, const std::string& path) {
  const std::int64_t index = skin.integer("inverseBindMatrices");
  if (document.resolve(document.accessors, index, path, "inverseBindMatrices") == nullptr) return;
  const std::string pointer = pointer_to(path, "inverseBindMatrices");
  document.use_accessor(index, AccessorRole::inverse_binds, pointer);
  const LinkedAccessor& accessor = document.linked_accessors[static_cast<std::size_t>(index)];
  if (accessor.view != kNoIndex) {
    document.use_view(accessor.view, ViewRole::inverse_binds, pointer);
    if (document.view_of(accessor)->stride != -1) {
      document.findings.add(rules::kSkinIbmAccessorWithBytestride, pointer);
    }
  }
  constexpr std::int64_t kFloat = 5126;
  if (accessor.format == AccessorFormat{"MAT4", kFloat, false}) {
    document.value_checks.push_back({ValueCheck::Kind::inverse_binds, index, pointer});
  } else {
    document.findings.add(rules::kSkinIbmInvalidFormat, pointer);
  }
  const JsonNode& joints = skin["joints"];
  if (joints.is(Kind::array) && accessor.count < static_cast<std::int64_t>(joints.size())) {
    document.findings.add(rules::kInvalidIbmAccessorCount, pointer);
  }
}

void check_skeleton(LinkedDocument& document, const JsonNode& skin, const std::string& path) {
  const std::int64_t index = skin.integer("skeleton");
  if (index == kNoIndex) return;
  if (document.nodes.get(index) == nullptr) {
    document.findings.add_at(rules::kUnresolvedReference, path, "skeleton", std::to_string(index));
    return;
  }
  const LinkedNode& skeleton = document.linked_nodes[static_cast<std::size_t>(index)];
  bool any = false, is_ancestor = true;
  for (const JsonNode& each : skin["joints"].items()) {
    const std::int64_t joint = each.as_integer();
    if (document.nodes.get(joint) == nullptr) continue;
    const LinkedNode& node = document.linked_nodes[static_cast<std::size_t>(joint)];
    any = true;
    is_ancestor = is_ancestor && skeleton.enter <= node.enter && node.leave <= skeleton.leave;
  }
  if (!any || !is_ancestor) document.findings.add_at(rules::kSkinSkeletonInvalid, path, "skeleton");
}

bool is_array_of(const JsonNode& value, std::initializer_list<float> expected) {
  if (!value.is(Kind::array)) return true;
  return std::equal(expected.begin(), expected.end(), value.items().begin(), value.items().end(),
                    [](float a, const JsonNode& b) { return a == static_cast<float>(b.number()); });
}

bool has_transform(const JsonNode& node) {
  const bool identity = !node["matrix"].is(Kind::array) || is_identity_matrix(node["matrix"]);
  return !identity || !is_array_of(node["translation"], {0, 0, 0}) ||
         !is_array_of(node["rotation"], {0, 0, 0, 1}) || !is_array_of(node["scale"], {1, 1, 1});
}

bool is_empty(const LinkedDocument& document, const JsonNode& json, const LinkedNode& node) {
  const bool has_mesh = document.meshes.get(json.integer("mesh")) != nullptr;
  const bool has_camera = document.cameras.get(json.integer("camera")) != nullptr;
  const JsonNode& extensions = json["extensions"];
  const bool has_extension =
      std::any_of(extensions.items().begin(), extensions.items().end(),
                  [](const JsonNode& each) { return each.is(Kind::object); });
  return !node.is_joint && !json["children"].is(Kind::array) && !has_mesh && !has_camera &&
         !has_extension && (!json.has("extras") || json["extras"].is(Kind::null));
}

/// The scenes that contain each node, by the roots that they list. Walks nodes at most
/// `kMaxVisits` times in all; a file with more scenes than that is checked in part.
class SceneMembers {
 public:
  explicit SceneMembers(const LinkedDocument& document)
      : document_(document), scenes_of_(document.nodes.size()) {
    for (std::size_t i = 0; i < document.scenes.size(); ++i) add(i);
  }

  /// Whether all scenes of `node` contain `other` too.
  [[nodiscard]] bool also_contain(std::size_t node, std::size_t other) const {
    const auto& of_node = scenes_of_[node];
    const auto& of_other = scenes_of_[other];
    return std::includes(of_other.begin(), of_other.end(), of_node.begin(), of_node.end());
  }

  /// Whether nodes were left out.
  [[nodiscard]] bool is_partial() const { return is_partial_; }

 private:
  static constexpr std::size_t kMaxVisits = std::size_t{1} << 24U;

  void add(std::size_t scene) {
    const JsonNode* json = document_.scenes.get(static_cast<std::int64_t>(scene));
    if (json == nullptr) return;
    std::vector<std::int64_t> open;
    for (const JsonNode& root : (*json)["nodes"].items()) open.push_back(root.as_integer());
    while (!open.empty()) {
      is_partial_ = is_partial_ || visits_ == kMaxVisits;
      if (is_partial_) return;
      const std::int64_t at = open.back();
      open.pop_back();
      const JsonNode* node = document_.nodes.get(at);
      if (node == nullptr) continue;
      std::vector<std::size_t>& scenes = scenes_of_[static_cast<std::size_t>(at)];
      if (!scenes.empty() && scenes.back() == scene) continue;
      scenes.push_back(scene);
      ++visits_;
      for (const JsonNode& child : (*node)["children"].items()) open.push_back(child.as_integer());
    }
  }

  const LinkedDocument& document_;
  std::vector<std::vector<std::size_t>> scenes_of_;
  std::size_t visits_ = 0;
  bool is_partial_ = false;
};

/// Checks a node with a skin after all links are known.
void check_skinned_node(LinkedDocument& document, const JsonNode& json, std::size_t i,
                        const std::vector<std::int64_t>& skin_roots, const SceneMembers& scenes) {
  const std::int64_t skin = json.integer("skin");
  if (document.skins.get(skin) == nullptr) return;
  const std::string path = document.nodes.pointer(i);
  if (document.linked_nodes[i].parent != kNoIndex) {
    document.findings.add(rules::kNodeSkinnedMeshNonRoot, path);
  }
  if (has_transform(json)) document.findings.add(rules::kNodeSkinnedMeshLocalTransforms, path);
  const std::int64_t root = skin_roots[static_cast<std::size_t>(skin)];
  if (root == kNoIndex || document.linked_nodes[static_cast<std::size_t>(root)].in_loop) return;
  if (!scenes.also_contain(i, static_cast<std::size_t>(root))) {
    document.findings.add(rules::kNodeSkinNoScene, path);
  }
}

/// Root that the joints of each skin share.
std::vector<std::int64_t> roots_of_skins(const LinkedDocument& document) {
  std::vector<std::int64_t> out(document.skins.size(), kNoIndex);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const JsonNode* json = document.skins.get(static_cast<std::int64_t>(i));
    if (json != nullptr) out[i] = shared_root(document, *json);
  }
  return out;
}

}  // namespace

void link_nodes(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.nodes.size(); ++i) link_node(document, i);
  number_nodes(document);
}

void link_skins(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.skins.size(); ++i) {
    const JsonNode* json = document.skins.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    const std::string path = document.skins.pointer(i);
    link_joints(document, *json, path);
    link_inverse_binds(document, *json, path);
    check_skeleton(document, *json, path);
  }
}

void link_scenes(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.scenes.size(); ++i) {
    const JsonNode* json = document.scenes.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    const JsonNode& nodes = (*json)["nodes"];
    const std::string path = pointer_to(document.scenes.pointer(i), "nodes");
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const std::int64_t node = nodes.items()[k].as_integer();
      if (document.resolve(document.nodes, node, path, std::to_string(k)) != nullptr &&
          document.linked_nodes[static_cast<std::size_t>(node)].parent != kNoIndex) {
        document.findings.add_at(rules::kSceneNonRootNode, path, k);
      }
    }
  }
  const std::int64_t scene = document.checked.root.integer("scene");
  if (scene != kNoIndex && document.scenes.get(scene) == nullptr) {
    document.findings.add(rules::kUnresolvedReference, "/scene", std::to_string(scene));
  }
  const SceneMembers members(document);
  document.is_partial = document.is_partial || members.is_partial();
  const std::vector<std::int64_t> skin_roots = roots_of_skins(document);
  for (std::size_t i = 0; i < document.nodes.size(); ++i) {
    const JsonNode* json = document.nodes.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    const LinkedNode& node = document.linked_nodes[i];
    if (is_empty(document, *json, node)) {
      document.findings.add(rules::kNodeEmpty, document.nodes.pointer(i));
    }
    if (node.in_loop) document.findings.add(rules::kNodeLoop, document.nodes.pointer(i));
    check_skinned_node(document, *json, i, skin_roots, members);
  }
}

void report_unused_objects(LinkedDocument& document) {
  for (const Collection* each :
       {&document.accessors, &document.buffers, &document.buffer_views, &document.cameras,
        &document.images, &document.materials, &document.meshes, &document.nodes,
        &document.samplers, &document.skins, &document.textures, &document.lights,
        &document.variants}) {
    each->report_unused(document.findings);
  }
  for (std::size_t i = 0; i < document.meshes.size(); ++i) {
    const JsonNode* mesh = document.meshes.get(static_cast<std::int64_t>(i));
    if (mesh == nullptr || !document.meshes.is_used(i)) continue;
    if ((*mesh)["weights"].is(Kind::array) && !document.linked_meshes[i].weights_used) {
      document.findings.add_at(rules::kUnusedMeshWeights, document.meshes.pointer(i), "weights");
    }
  }
}

}  // namespace tessera::render
