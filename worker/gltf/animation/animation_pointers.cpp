#include "worker/gltf/animation/animation_pointers.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "worker/gltf/animation/animation.h"
#include "worker/gltf/file/json_view.h"

namespace tessera::render {

using nlohmann::json;

namespace {

/// A property that can be animated even if the file omits it, with its number of values.
struct Animatable {
  std::string_view name;
  int width;
};

/// Properties of cameras, lights and materials, sorted by name. Some have no effect on the image.
/// Source: Khronos, "glTF 2.0 Asset Object Model".
constexpr Animatable kAnimatable[] = {
    {"alphaCutoff", 1},
    {"anisotropyRotation", 1},
    {"anisotropyStrength", 1},
    {"aspectRatio", 1},
    {"attenuationColor", 3},
    {"attenuationDistance", 1},
    {"baseColorFactor", 4},
    {"clearcoatFactor", 1},
    {"clearcoatRoughnessFactor", 1},
    {"color", 3},
    {"diffuseTransmissionColorFactor", 3},
    {"diffuseTransmissionFactor", 1},
    {"dispersion", 1},
    {"emissiveFactor", 3},
    {"emissiveStrength", 1},
    {"innerConeAngle", 1},
    {"intensity", 1},
    {"ior", 1},
    {"iridescenceFactor", 1},
    {"iridescenceIor", 1},
    {"iridescenceThicknessMaximum", 1},
    {"iridescenceThicknessMinimum", 1},
    {"metallicFactor", 1},
    {"outerConeAngle", 1},
    {"range", 1},
    {"roughnessFactor", 1},
    {"sheenColorFactor", 3},
    {"sheenRoughnessFactor", 1},
    {"specularColorFactor", 3},
    {"specularFactor", 1},
    {"thicknessFactor", 1},
    {"transmissionFactor", 1},
    {"xmag", 1},
    {"yfov", 1},
    {"ymag", 1},
    {"zfar", 1},
    {"znear", 1},
};

/// Integer properties of TESSERA extensions, which cannot be animated.
constexpr std::string_view kIntegerProperties[] = {"accessor",  "blades",   "dimensions",
                                                   "focusNode", "material", "octaves",
                                                   "priority",  "seed",     "texture"};

/// Segments of "/cameras/0/perspective/yfov"; empty if malformed.
std::vector<std::string> split(const std::string& pointer) {
  if (pointer.empty() || pointer[0] != '/' || pointer.find('~') != std::string::npos) return {};
  return absl::StrSplit(pointer.substr(1), '/');
}

/// Number of segments that name the element: 2, or 4 for a light; 0 if it cannot be animated.
std::size_t element_segment_count(const std::vector<std::string>& parts) {
  if (parts.size() > 4 && parts[0] == "extensions" && parts[1] == "KHR_lights_punctual" &&
      parts[2] == "lights") {
    return 4;
  }
  constexpr std::string_view kSections[] = {"cameras", "materials", "meshes",
                                            "nodes",   "scenes",    "textures"};
  const bool animated = parts.size() > 2 && std::find(std::begin(kSections), std::end(kSections),
                                                      parts[0]) != std::end(kSections);
  return animated ? 2 : 0;
}

/// Returns whether the path names an existing element and, below it, existing objects and array
/// elements.
bool path_exists(const json& root, const std::vector<std::string>& parts, std::size_t element) {
  const json* at = &root;
  for (std::size_t i = 0; i + 1 < parts.size(); ++i) {
    std::uint32_t index = 0;
    if (at->is_array()) {
      if (!absl::SimpleAtoi(parts[i], &index) || index >= at->size()) return false;
      at = &(*at)[index];
    } else if (at->is_object()) {
      const auto member = at->find(parts[i]);
      if (member == at->end()) {
        // Objects with only default values may be omitted, except extensions.
        return i >= element && i > 0 && parts[i - 1] != "extensions" && parts[i] != "extensions";
      }
      at = &*member;
    } else {
      return false;
    }
  }
  return at->is_object();
}

bool is_visibility(const std::vector<std::string>& parts) {
  return parts.size() == 5 && parts[0] == "nodes" && parts[3] == "KHR_node_visibility" &&
         parts[4] == "visible";
}

/// Number of values at the pointer; 0 if it cannot be animated.
int width_at(const json& root, const std::vector<std::string>& parts) {
  const std::size_t element = element_segment_count(parts);
  if (element == 0 || !path_exists(root, parts, element)) return 0;
  const std::string& name = parts.back();
  const std::string& parent = parts[parts.size() - 2];
  const bool is_tessera = std::any_of(
      parts.begin(), parts.end(), [](const std::string& p) { return p.starts_with("TESSERA_"); });
  if (is_tessera) {
    const json::json_pointer pointer("/" + absl::StrJoin(parts, "/"));
    if (!root.contains(pointer)) return 0;
    if (std::find(std::begin(kIntegerProperties), std::end(kIntegerProperties), name) !=
        std::end(kIntegerProperties))
      return 0;
    const json& value = root[pointer];
    if (value.is_number()) return 1;
    const bool numbers =
        value.is_array() && !value.empty() && value.size() <= 64 &&
        std::all_of(value.begin(), value.end(), [](const json& v) { return v.is_number(); });
    return numbers ? static_cast<int>(value.size()) : 0;
  }
  if (is_visibility(parts)) return 1;
  if (parts[0] != "cameras" && parts[0] != "materials" && parts[0] != "extensions") return 0;
  if (parent == "KHR_texture_transform") {
    return name == "rotation" ? 1 : name == "offset" || name == "scale" ? 2 : 0;
  }
  if (name == "strength") return parent == "occlusionTexture";
  if (name == "scale") return parent == "normalTexture" || parent == "clearcoatNormalTexture";
  const auto* known = std::find_if(std::begin(kAnimatable), std::end(kAnimatable),
                                   [&](const Animatable& a) { return a.name == name; });
  return known == std::end(kAnimatable) ? 0 : known->width;
}

/// Morph target weights that a pointer names: "/meshes/0/weights", "/nodes/0/weights" or one
/// element of either.
struct WeightsPlace {
  std::int32_t mesh = kNone;
  std::int32_t element = kNone;  // kNone: all
  int count = 0;                 // morph targets of the mesh
};

/// Parses an index below `size`; kNone if it is none.
std::int32_t parse_index(const std::string& text, std::size_t size) {
  std::uint32_t index = 0;
  return absl::SimpleAtoi(text, &index) && index < size ? static_cast<std::int32_t>(index) : kNone;
}

std::optional<WeightsPlace> weights_place(const GltfModel& model,
                                          const std::vector<std::string>& parts) {
  if (parts.size() < 3 || parts.size() > 4 || parts[2] != "weights") return std::nullopt;
  WeightsPlace place;
  if (parts[0] == "meshes") {
    place.mesh = parse_index(parts[1], model.meshes.size());
  } else if (parts[0] == "nodes") {
    const std::int32_t node = parse_index(parts[1], model.nodes.size());
    if (node != kNone) place.mesh = model.nodes[node].mesh;
  }
  if (place.mesh == kNone) return std::nullopt;
  const auto& primitives = model.meshes[place.mesh].primitives;
  if (primitives.empty() || primitives.front().targets.empty()) return std::nullopt;
  place.count = static_cast<int>(primitives.front().targets.size());
  if (parts.size() == 3) return place;
  place.element = parse_index(parts[3], static_cast<std::size_t>(place.count));
  return place.element == kNone ? std::nullopt : std::optional(place);
}

/// Gives a mesh or node whose weights are animated one by one the full array: its own, or else the
/// weights of its mesh, or zeros.
void complete_weights(const GltfModel& model, const WeightsPlace& place, json& owner) {
  if (!owner.contains("weights")) owner["weights"] = model.meshes[place.mesh].weights;
  json& weights = owner["weights"];
  while (weights.is_array() && weights.size() < static_cast<std::size_t>(place.count)) {
    weights.push_back(0);
  }
}

/// Transform property or weights of a node; nullopt for anything else.
std::optional<AnimationPath> node_path(const std::vector<std::string>& parts) {
  if (parts.size() != 3 || parts[0] != "nodes") return std::nullopt;
  if (parts[2] == "translation") return AnimationPath::translation;
  if (parts[2] == "rotation") return AnimationPath::rotation;
  if (parts[2] == "scale") return AnimationPath::scale;
  if (parts[2] == "weights") return AnimationPath::weights;
  return std::nullopt;
}

Interpolation interpolation_of(const JsonView& sampler, JsonFault& fault) {
  const JsonView given = sampler["interpolation"];
  const std::string name = given.present() ? given.as_text() : "LINEAR";
  if (name == "STEP") return Interpolation::step;
  if (name == "CUBICSPLINE") return Interpolation::cubic_spline;
  if (name != "LINEAR") fault.report(given.path(), "is not STEP, LINEAR or CUBICSPLINE");
  return Interpolation::linear;
}

class PointerReader {
 public:
  PointerReader(const json& root, GltfModel& model, JsonFault& fault)
      : root_(root), model_(model), fault_(fault) {}

  void read(const JsonView& animation, Animation& out) {
    const std::vector<JsonView> samplers = animation["samplers"].items();
    const std::vector<JsonView> channels = animation["channels"].items();
    for (std::size_t k = 0; k < channels.size(); ++k) {
      const JsonView target = channels[k]["target"];
      if (target.text("path") != "pointer") continue;
      const std::int32_t sampler = channels[k].index("sampler", samplers.size());
      if (sampler == kNone) continue;  // a fault has been reported
      PointerChannel channel = source(samplers[static_cast<std::size_t>(sampler)]);
      if (channel.input == kNone || channel.output == kNone) continue;
      channel.index = k;
      add(target.extension("KHR_animation_pointer"), std::move(channel), out);
    }
  }

 private:
  PointerChannel source(const JsonView& sampler) {
    PointerChannel channel;
    channel.input = sampler.index("input", model_.accessors.size());
    channel.output = sampler.index("output", model_.accessors.size());
    if (channel.input == kNone || channel.output == kNone) {
      fault_.report(sampler.path(), "has no input or no output");
    }
    channel.interpolation = interpolation_of(sampler, fault_);
    return channel;
  }

  void add(const JsonView& extension, PointerChannel channel, Animation& out) {
    channel.pointer = extension.text("pointer");
    const std::vector<std::string> parts = split(channel.pointer);
    const auto path = node_path(parts);
    const auto weights = weights_place(model_, parts);
    const std::int32_t node = path ? parse_index(parts[1], model_.nodes.size()) : kNone;
    if (node != kNone && (*path != AnimationPath::weights || weights)) {
      out.channels.push_back({node, *path, channel.input, channel.output, channel.interpolation});
      return;
    }
    if (weights) {
      channel.width = weights->element == kNone ? weights->count : 1;
      channel.flat = true;
    } else {
      channel.width = width_at(root_, parts);
      channel.flat = channel.width > 4;  // vectors have up to four values
      channel.boolean = is_visibility(parts);
    }
    if (channel.width > 0) {
      out.pointers.push_back(std::move(channel));
      return;
    }
    model_.problems.push_back(
        {Problem::Severity::warning, extension.path() + ".pointer",
         absl::StrCat("\"", channel.pointer, "\" is not an animatable property; channel ignored")});
  }

  const json& root_;
  GltfModel& model_;
  JsonFault& fault_;
};

}  // namespace

absl::Status read_animation_pointers(const json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  PointerReader reader(root, model, fault);
  const std::vector<JsonView> animations = JsonView(root, "", fault)["animations"].items();
  for (std::size_t i = 0; i < animations.size() && i < model.animations.size(); ++i) {
    reader.read(animations[i], model.animations[i]);
  }
  return fault.status();
}

bool has_pointers(const GltfModel& model, const std::vector<std::int32_t>& animations) {
  return std::any_of(animations.begin(), animations.end(),
                     [&](std::int32_t a) { return !model.animations[a].pointers.empty(); });
}

absl::Status animate_json(const GltfModel& model, const std::vector<std::int32_t>& animations,
                          double seconds, json& root) {
  for (const std::int32_t animation : animations) {
    for (const PointerChannel& channel : model.animations[animation].pointers) {
      const auto values = pointer_values(model, animation, channel, seconds);
      if (!values.ok()) return values.status();
      const std::vector<std::string> parts = split(channel.pointer);
      if (const auto weights = weights_place(model, parts)) {
        const json::json_pointer owner("/" + parts[0] + "/" + parts[1]);
        complete_weights(model, *weights, root[owner]);
      }
      json& place = root[json::json_pointer(channel.pointer)];
      const bool is_array = place.is_array() || channel.width > 1;
      place = channel.boolean ? json(values->front() != 0)
              : is_array      ? json(*values)
                              : json(values->front());
    }
  }
  return absl::OkStatus();
}

}  // namespace tessera::render
