#include <algorithm>
#include <map>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;

bool is_translation_rotation_scale(const std::string& path) {
  return path == "translation" || path == "rotation" || path == "scale";
}

/// Whether glTF allows a format for the values of a path. Source: glTF 2.0, section 3.11.
bool is_output_format(const AccessorFormat& format, const std::string& path) {
  const bool is_float = format.component == kFloat && !format.normalized;
  const bool is_small = format.component <= kUnsignedShort && format.normalized;
  if (path == "rotation") return format.type == "VEC4" && (is_float || is_small);
  if (path == "weights") return format.type == "SCALAR" && (is_float || is_small);
  return !is_translation_rotation_scale(path) || (format.type == "VEC3" && is_float);
}

/// Links of one animation.
class AnimationLinks {
 public:
  AnimationLinks(LinkedDocument& document, const JsonNode& json, const std::string& path)
      : document_(document),
        json_(json),
        path_(path),
        samplers_(pointer_to(path, "samplers"), json["samplers"]) {}

  void link() {
    const JsonNode& channels = json_["channels"];
    const std::string path = pointer_to(path_, "channels");
    for (std::size_t i = 0; i < channels.size(); ++i) {
      link_pointer(channels.items()[i]["target"], pointer_to(path, i));
    }
    if (samplers_.size() == 0 || !channels.is(Kind::array)) return;
    for (std::size_t i = 0; i < samplers_.size(); ++i) link_sampler(i);
    for (std::size_t i = 0; i < channels.size(); ++i) {
      link_channel(channels.items()[i], pointer_to(path, i));
    }
    check_duplicates(channels, path);
    samplers_.report_unused(document_.findings);
  }

 private:
  const LinkedAccessor* link_values(const JsonNode& sampler, const std::string& path,
                                    std::string_view key, AccessorRole role) {
    const std::int64_t index = sampler.integer(key);
    if (document_.resolve(document_.accessors, index, path, key) == nullptr) return nullptr;
    const std::string pointer = pointer_to(path, key);
    document_.use_accessor(index, role, pointer);
    const LinkedAccessor& accessor = document_.linked_accessors[static_cast<std::size_t>(index)];
    if (accessor.view != kNoIndex) {
      document_.use_view(accessor.view, ViewRole::other, pointer);
      if (document_.view_of(accessor)->stride != -1) {
        document_.findings.add(rules::kAnimationSamplerAccessorWithBytestride, pointer);
      }
    }
    return &accessor;
  }

  void link_sampler(std::size_t i) {
    const JsonNode& sampler = *samplers_.get(static_cast<std::int64_t>(i));
    const std::string path = samplers_.pointer(i);
    const LinkedAccessor* times =
        link_values(sampler, path, "input", AccessorRole::animation_input);
    link_values(sampler, path, "output", AccessorRole::animation_output);
    if (times == nullptr) return;
    const std::string pointer = pointer_to(path, "input");
    if (times->format == AccessorFormat{"SCALAR", kFloat, false}) {
      document_.value_checks.push_back(
          {ValueCheck::Kind::times, sampler.integer("input"), pointer});
    } else {
      document_.findings.add(rules::kAnimationSamplerInputAccessorInvalidFormat, pointer);
    }
    if (!times->has_bounds) {
      document_.findings.add(rules::kAnimationSamplerInputAccessorWithoutBounds, pointer);
    }
    if (sampler.text_of("interpolation") == "CUBICSPLINE" && times->count < 2) {
      document_.findings.add(rules::kAnimationSamplerInputAccessorTooFewElements, pointer);
    }
  }

  /// Number of morph targets of the mesh of a node.
  [[nodiscard]] std::optional<std::size_t> targets_of(const JsonNode* node) const {
    if (node == nullptr) return std::nullopt;
    const std::int64_t mesh = node->integer("mesh");
    if (document_.meshes.get(mesh) == nullptr) return std::nullopt;
    const auto& primitives = document_.linked_meshes[static_cast<std::size_t>(mesh)].primitives;
    return primitives.empty() ? std::nullopt : primitives[0].targets;
  }

  const JsonNode* link_target(const JsonNode& target, const std::string& path) {
    const JsonNode* node = document_.resolve(document_.nodes, target.integer("node"), path, "node");
    const std::string& animated = target.text_of("path");
    if (node != nullptr && is_translation_rotation_scale(animated)) {
      if ((*node)["matrix"].is(Kind::array)) {
        document_.findings.add(rules::kAnimationChannelTargetNodeMatrix, path);
      }
      if (document_.skins.get(node->integer("skin")) != nullptr) {
        document_.findings.add_at(rules::kAnimationChannelTargetNodeSkin, path, "path");
      }
    }
    if (node != nullptr && animated == "weights" && !targets_of(node)) {
      document_.findings.add(rules::kAnimationChannelTargetNodeWeightsNoMorphs, path);
    }
    return node;
  }

  void link_pointer(const JsonNode& target, const std::string& channel) {
    if (!document_.checked.extension(target, "KHR_animation_pointer").is(Kind::object)) return;
    const std::string path = channel + "/target/extensions/KHR_animation_pointer";
    document_.findings.add(rules::kIncompleteExtensionSupport, path);
    if (document_.nodes.get(target.integer("node")) != nullptr) {
      document_.findings.add(rules::kKhrAnimationPointerAnimationChannelTargetNode, path);
    }
    if (target.text_of("path") != "pointer") {
      document_.findings.add(rules::kKhrAnimationPointerAnimationChannelTargetPath, path);
    }
  }

  void link_channel(const JsonNode& channel, const std::string& path) {
    const JsonNode& target = channel["target"];
    const bool has_target = target.is(Kind::object);
    const JsonNode* node = has_target ? link_target(target, pointer_to(path, "target")) : nullptr;
    const JsonNode* sampler =
        document_.resolve(samplers_, channel.integer("sampler"), path, "sampler");
    if (sampler == nullptr || !has_target) return;
    const std::int64_t output = sampler->integer("output");
    if (document_.accessors.get(output) == nullptr) return;
    const LinkedAccessor& values = document_.linked_accessors[static_cast<std::size_t>(output)];
    const std::string& animated = target.text_of("path");
    const bool cubic = sampler->text_of("interpolation") == "CUBICSPLINE";
    const std::string pointer = pointer_to(path, "sampler");
    if (animated == "rotation" && values.components == 4) {
      ValueCheck check{ValueCheck::Kind::quaternions, output, pointer};
      check.cubic = cubic;
      document_.value_checks.push_back(check);
    }
    if (!is_output_format(values.format, animated)) {
      document_.findings.add(rules::kAnimationSamplerOutputAccessorInvalidFormat, pointer);
    }
    check_count(*sampler, animated, node, values.count, pointer);
  }

  void check_count(const JsonNode& sampler, const std::string& animated, const JsonNode* node,
                   std::int64_t values, const std::string& pointer) {
    const std::int64_t input = sampler.integer("input");
    if (document_.accessors.get(input) == nullptr || sampler["interpolation"].is(Kind::faulty)) {
      return;
    }
    std::int64_t expected = document_.linked_accessors[static_cast<std::size_t>(input)].count;
    if (expected == kNoIndex || values == kNoIndex) return;
    if (sampler.text_of("interpolation") == "CUBICSPLINE") expected *= 3;
    if (animated == "weights") {
      expected *= static_cast<std::int64_t>(targets_of(node).value_or(0));
    } else if (!is_translation_rotation_scale(animated)) {
      return;
    }
    if (expected != 0 && expected != values) {
      document_.findings.add(rules::kAnimationSamplerOutputAccessorInvalidCount, pointer,
                             std::to_string(values) + ", expected " + std::to_string(expected));
    }
  }

  /// Reports every channel whose target a later channel has too.
  void check_duplicates(const JsonNode& channels, const std::string& path) {
    std::map<std::pair<std::int64_t, std::string>, std::size_t> last;
    const auto target_of = [&channels](std::size_t i) {
      const JsonNode& target = channels.items()[i]["target"];
      return std::pair(target.integer("node"), target.text_of("path"));
    };
    for (std::size_t i = 0; i < channels.size(); ++i) last[target_of(i)] = i;
    for (std::size_t i = 0; i < channels.size(); ++i) {
      const auto target = target_of(i);
      if (target.first != kNoIndex && last[target] > i) {
        document_.findings.add_at(rules::kAnimationDuplicateTargets, pointer_to(path, i), "target");
      }
    }
  }

  LinkedDocument& document_;
  const JsonNode& json_;
  const std::string& path_;
  Collection samplers_;
};

}  // namespace

void link_animations(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.animations.size(); ++i) {
    const JsonNode* json = document.animations.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    const std::string path = document.animations.pointer(i);
    AnimationLinks(document, *json, path).link();
  }
}

}  // namespace tessera::render
