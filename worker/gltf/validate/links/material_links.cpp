#include <algorithm>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;

/// Links of one material and its extensions.
class MaterialLinks {
 public:
  MaterialLinks(LinkedDocument& document, const JsonNode& json, std::string path,
                LinkedMaterial& material)
      : document_(document), json_(json), path_(std::move(path)), material_(material) {}

  void link() {
    const JsonNode& surface = json_["pbrMetallicRoughness"];
    const std::string inner = pointer_to(path_, "pbrMetallicRoughness");
    texture(surface, inner, "baseColorTexture");
    texture(surface, inner, "metallicRoughnessTexture");
    material_.has_normal_texture = json_["normalTexture"].is(Kind::object);
    normal_texture(json_, path_, "normalTexture");
    texture(json_, path_, "occlusionTexture");
    texture(json_, path_, "emissiveTexture");
    for (const std::string& name : json_["extensions"].keys()) {
      const JsonNode& extension = document_.checked.extension(json_, name);
      if (extension.is(Kind::object)) link_extension(name, extension);
    }
  }

 private:
  void texture(const JsonNode& holder, const std::string& path, std::string_view key) {
    const JsonNode& info = holder[key];
    if (!info.is(Kind::object)) return;
    const std::string pointer = pointer_to(path, key);
    document_.resolve(document_.textures, info.integer("index"), pointer, "index");
    material_.texcoords[pointer] = info.integer("texCoord", 0);
    const JsonNode& transform = document_.checked.extension(info, "KHR_texture_transform");
    if (transform.is(Kind::object)) {
      material_.texcoords[pointer + "/extensions/KHR_texture_transform"] =
          transform.integer("texCoord");
    }
  }

  void normal_texture(const JsonNode& holder, const std::string& path, std::string_view key) {
    texture(holder, path, key);
    if (holder[key].is(Kind::object)) material_.needs_tangents = true;
  }

  /// Reports a texture whose coordinates are not those of the normal texture.
  void same_texcoord(const JsonNode& info, const ValidationRule& rule, const std::string& pointer) {
    const JsonNode& normal = json_["normalTexture"];
    if (normal.is(Kind::object) && info.is(Kind::object) &&
        normal.integer("texCoord", 0) != info.integer("texCoord", 0)) {
      document_.findings.add(rule, pointer);
    }
  }

  void link_extension(const std::string& name, const JsonNode& extension) {
    const std::string path = pointer_to(pointer_to(path_, "extensions"), name);
    constexpr std::string_view kTextures[] = {"anisotropyTexture",
                                              "clearcoatTexture",
                                              "clearcoatRoughnessTexture",
                                              "iridescenceTexture",
                                              "iridescenceThicknessTexture",
                                              "diffuseTexture",
                                              "specularGlossinessTexture",
                                              "sheenColorTexture",
                                              "sheenRoughnessTexture",
                                              "specularTexture",
                                              "specularColorTexture",
                                              "transmissionTexture",
                                              "thicknessTexture"};
    for (const std::string_view key : kTextures) texture(extension, path, key);
    normal_texture(extension, path, "clearcoatNormalTexture");
    same_texcoord(extension["clearcoatNormalTexture"],
                  rules::kKhrMaterialsClearcoatClearcoatNormalTextureTexcoord,
                  pointer_to(path, "clearcoatNormalTexture"));
    if (extension["anisotropyTexture"].is(Kind::object)) material_.needs_tangents = true;
    same_texcoord(extension["anisotropyTexture"],
                  rules::kKhrMaterialsAnisotropyAnisotropyTextureTexcoord,
                  pointer_to(path, "anisotropyTexture"));
    if (name == "KHR_materials_dispersion" && !has_extension("KHR_materials_volume")) {
      document_.findings.add(rules::kKhrMaterialsDispersionNoVolume, path);
    }
    if (name == "KHR_materials_emissive_strength") emissive_strength(extension, path);
    if (name == "KHR_materials_volume") volume(extension, path);
  }

  [[nodiscard]] bool has_extension(std::string_view name) const {
    return json_["extensions"].has(name);
  }

  void emissive_strength(const JsonNode& extension, const std::string& path) {
    const JsonNode& strength = extension["emissiveStrength"];
    const JsonNode& factor = json_["emissiveFactor"];
    if (!strength.is(Kind::number) || strength.number() == 1 || factor.is(Kind::faulty)) return;
    const bool is_zero = std::all_of(factor.items().begin(), factor.items().end(),
                                     [](const JsonNode& each) { return each.number() == 0; });
    if (is_zero) document_.findings.add(rules::kKhrMaterialsEmissiveStrengthZeroFactor, path);
  }

  void volume(const JsonNode& extension, const std::string& path) {
    // An extension that is not known may transmit light.
    const std::vector<std::string>& names = json_["extensions"].keys();
    const bool transmits = std::any_of(names.begin(), names.end(), [this](const auto& name) {
      return name == "KHR_materials_transmission" || document_.checked.enabled.count(name) == 0;
    });
    if (!transmits) document_.findings.add(rules::kKhrMaterialsVolumeNoTransmission, path);
    if (json_["doubleSided"].is_true() && extension.number_or("thicknessFactor", 0) > 0) {
      document_.findings.add(rules::kKhrMaterialsVolumeDoubleSided, path);
    }
  }

  LinkedDocument& document_;
  const JsonNode& json_;
  std::string path_;
  LinkedMaterial& material_;
};

}  // namespace

void link_materials(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.materials.size(); ++i) {
    const JsonNode* json = document.materials.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    MaterialLinks(document, *json, document.materials.pointer(i), document.linked_materials[i])
        .link();
  }
}

}  // namespace tessera::render
