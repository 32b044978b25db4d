#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/values/accessor_values.h"
#include "worker/gltf/validate/values/value_checks.h"

namespace tessera::render {

namespace {

/// Joints and weights of the vertices of a primitive.
class SkinnedVertices {
 public:
  SkinnedVertices(LinkedDocument& document, const LinkedPrimitive& primitive, std::string path)
      : document_(document), primitive_(primitive), path_(std::move(path)) {}

  /// Opens the sets. Returns false if one of them cannot be read.
  bool open() {
    for (int set = 0; set < primitive_.joint_sets; ++set) {
      auto joints = open_set("JOINTS_", set);
      auto weights = open_set("WEIGHTS_", set);
      if (!joints || !weights) return false;
      joints_.push_back(*joints);
      weights_.push_back(*weights);
    }
    return !joints_.empty();
  }

  void check(std::int64_t joint_count, ValueBudget& budget) {
    const auto sets = static_cast<std::uint64_t>(joints_.size());
    if (!budget.take(static_cast<std::uint64_t>(primitive_.vertices) * sets * 8)) return;
    for (std::int64_t i = 0; i < primitive_.vertices; ++i) check_vertex(joint_count);
  }

 private:
  std::optional<AccessorValues> open_set(const char* semantic, int set) {
    const auto found = primitive_.attributes.find(semantic + std::to_string(set));
    if (found == primitive_.attributes.end()) return std::nullopt;
    auto values = AccessorValues::open(document_, found->second);
    const bool usable =
        values && values->count() == primitive_.vertices && values->components() == 4;
    return usable ? values : std::nullopt;
  }

  /// Reports a rule once for each attribute.
  void report(const ValidationRule& rule, const char* semantic, std::size_t set) {
    if (!reported_.insert({&rule, set}).second) return;
    document_.findings.add_at(rule, path_, semantic + std::to_string(set));
  }

  void check_vertex(std::int64_t joint_count) {
    constexpr int kComponents = 4;
    double joints[kComponents], weights[kComponents];
    vertex_.clear();
    for (std::size_t set = 0; set < joints_.size(); ++set) {
      joints_[set].next(joints);
      weights_[set].next(weights);
      for (int k = 0; k < kComponents; ++k) {
        const bool is_float = weights_[set].is_float();
        vertex_.push_back(
            {joints[k], is_float ? weights[k] : weights_[set].normalized(weights[k]), set, k});
      }
    }
    // The sum is rounded to float, as renderers add: first the first component of each set.
    std::stable_sort(vertex_.begin(), vertex_.end(), [](const Influence& a, const Influence& b) {
      return a.component < b.component;
    });
    double sum = 0, tolerance = 0;
    used_.clear();
    for (const Influence& each : vertex_) add_influence(each, joint_count, sum, tolerance);
    if (std::abs(sum - 1) <= tolerance) return;
    for (std::size_t set = 0; set < joints_.size(); ++set) {
      report(rules::kAccessorWeightsNonNormalized, "WEIGHTS_", set);
    }
  }

  struct Influence {
    double joint, weight;
    std::size_t set;
    int component;
  };

  void add_influence(const Influence& each, std::int64_t joint_count, double& sum,
                     double& tolerance) {
    constexpr double kTolerance = 2e-7;  // of each weight, that of the Khronos glTF validator
    if (each.joint >= static_cast<double>(joint_count)) {
      return report(rules::kAccessorJointsIndexOob, "JOINTS_", each.set);
    }
    if (each.weight == 0) {
      if (each.joint != 0) report(rules::kAccessorJointsUsedZeroWeight, "JOINTS_", each.set);
      return;
    }
    const bool repeated = std::find(used_.begin(), used_.end(), each.joint) != used_.end();
    if (repeated) {
      report(rules::kAccessorJointsIndexDuplicate, "JOINTS_", each.set);
    } else {
      used_.push_back(each.joint);
    }
    if (each.weight < 0) {
      report(rules::kAccessorWeightsNegative, "WEIGHTS_", each.set);
    } else if (!repeated) {
      sum = static_cast<float>(sum + each.weight);
      tolerance += kTolerance;
    }
  }

  LinkedDocument& document_;
  const LinkedPrimitive& primitive_;
  std::string path_;
  std::vector<AccessorValues> joints_, weights_;
  std::vector<Influence> vertex_;
  std::vector<double> used_;
  std::set<std::pair<const ValidationRule*, std::size_t>> reported_;
};

/// Fewest joints of the skins with which each mesh is used; 0 if it is used with none.
std::vector<std::int64_t> fewest_joints(const LinkedDocument& document) {
  std::vector<std::int64_t> out(document.meshes.size(), 0);
  for (std::size_t i = 0; i < document.nodes.size(); ++i) {
    const JsonNode* node = document.nodes.get(static_cast<std::int64_t>(i));
    if (node == nullptr) continue;
    const std::int64_t mesh = node->integer("mesh");
    const JsonNode* skin = document.skins.get(node->integer("skin"));
    if (skin == nullptr || document.meshes.get(mesh) == nullptr) continue;
    const auto joints = static_cast<std::int64_t>((*skin)["joints"].size());
    std::int64_t& fewest = out[static_cast<std::size_t>(mesh)];
    if (joints > 0) fewest = fewest == 0 ? joints : std::min(fewest, joints);
  }
  return out;
}

}  // namespace

void check_skinned_vertices(LinkedDocument& document, ValueBudget& budget) {
  const std::vector<std::int64_t> joints = fewest_joints(document);
  for (std::size_t i = 0; i < document.meshes.size(); ++i) {
    if (joints[i] == 0) continue;
    const std::string path = pointer_to(document.meshes.pointer(i), "primitives");
    const auto& primitives = document.linked_meshes[i].primitives;
    for (std::size_t k = 0; k < primitives.size(); ++k) {
      SkinnedVertices vertices(document, primitives[k],
                               pointer_to(pointer_to(path, k), "attributes"));
      if (vertices.open()) vertices.check(joints[i], budget);
    }
  }
}

}  // namespace tessera::render
