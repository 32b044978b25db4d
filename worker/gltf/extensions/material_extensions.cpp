#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/extensions/medium_reader.h"
#include "worker/gltf/extensions/optics_reader.h"
#include "worker/gltf/file/json_view.h"
#include "worker/math/elementary.h"
#include "worker/scene/texture_refs.h"

namespace tessera::render {

namespace {

constexpr double kMaxFactor = 1e30;

/// Reads the extensions of one material into `out`.
class MaterialReader {
 public:
  MaterialReader(const JsonView& material, GltfModel& model, JsonFault& fault, Material& out)
      : object_(material), model_(model), fault_(fault), out_(out) {}

  void read() {
    const JsonView pbr = object_["pbrMetallicRoughness"];
    transform(pbr["baseColorTexture"], out_.base_color_texture);
    transform(pbr["metallicRoughnessTexture"], out_.metallic_roughness_texture);
    transform(object_["normalTexture"], out_.normal_texture);
    transform(object_["emissiveTexture"], out_.emissive_texture);
    if (!object_["extensions"].present()) return;
    out_.unlit = object_.extension("KHR_materials_unlit").present();
    read_specular_glossiness(object_.extension("KHR_materials_pbrSpecularGlossiness"));
    const double strength = object_.extension("KHR_materials_emissive_strength")
                                .number("emissiveStrength", 1, 0, kMaxFactor);
    out_.emission *= static_cast<float>(strength);
    out_.ior =
        static_cast<float>(object_.extension("KHR_materials_ior").number("ior", 1.5, 0, 1e6));
    if (out_.ior > 0 && out_.ior < 1) {
      fault_.report(object_.path() + ".extensions.KHR_materials_ior.ior",
                    "must be 0 or at least 1");
    }
    read_specular(object_.extension("KHR_materials_specular"));
    read_transmission(object_.extension("KHR_materials_transmission"));
    read_volume(object_.extension("KHR_materials_volume"));
    read_clearcoat(layer("KHR_materials_clearcoat"));
    read_anisotropy(layer("KHR_materials_anisotropy"));
    read_sheen(layer("KHR_materials_sheen"));
    out_.dispersion =
        static_cast<float>(layer("KHR_materials_dispersion").number("dispersion", 0, 0, 1e6));
    read_iridescence(layer("KHR_materials_iridescence"));
    read_diffuse_transmission(layer("KHR_materials_diffuse_transmission"));
    out_.optics = read_optics(layer("TESSERA_material"), fault_);
    out_.medium = read_medium(layer("TESSERA_medium"), model_, fault_);
  }

 private:
  /// An extension that adds to metallic-roughness shading. Warns if the material has an extension
  /// that excludes it.
  JsonView layer(const char* name) {
    JsonView found = object_.extension(name);
    if (!found.present() || !(out_.unlit || out_.specular_glossiness)) return found;
    model_.problems.push_back(
        {Problem::Severity::warning, found.path(),
         absl::StrCat("ignored because of ",
                      out_.unlit ? "KHR_materials_unlit" : "KHR_materials_pbrSpecularGlossiness")});
    return found.absent();
  }

  /// Texture reference of an extension.
  TextureRef texture(const JsonView& info, bool srgb) {
    TextureRef ref;
    if (!info.present()) return ref;
    ref.texture = info.index("index", model_.texture_sources.size());
    if (!info["index"].present()) fault_.report(info.path(), "has no index");
    const std::int64_t set = info.integer("texCoord", 1 << 20);
    ref.uv_set = set < 0 ? 0 : static_cast<std::int32_t>(set);
    ref.srgb = srgb;
    transform(info, ref);
    return ref;
  }

  /// KHR_texture_transform: uv' = T * R * S * uv, as its specification's matrices.
  void transform(const JsonView& info, TextureRef& ref) {
    const JsonView t = info.extension("KHR_texture_transform");
    if (!t.present()) return;
    const std::vector<double> offset = t.numbers("offset", {0, 0});
    const std::vector<double> scale = t.numbers("scale", {1, 1});
    const double rotation = t.number("rotation", 0, -1e6, 1e6);
    const auto [s, c] = elementary::sincos(rotation);
    ref.has_transform = true;
    ref.uv_matrix = {static_cast<float>(scale[0] * c), static_cast<float>(scale[1] * s),
                     static_cast<float>(offset[0]),    static_cast<float>(scale[0] * -s),
                     static_cast<float>(scale[1] * c), static_cast<float>(offset[1])};
    for (const float f : ref.uv_matrix) {
      if (!std::isfinite(f)) fault_.report(t.path(), "is too large");
    }
    const std::int64_t set = t.integer("texCoord", 1 << 20);
    if (set >= 0) ref.uv_set = static_cast<std::int32_t>(set);
  }

  float unit(const JsonView& from, const char* key, double fallback) {
    const double value = from.number(key, fallback, -1e6, 1e6);
    return static_cast<float>(value < 0 ? 0 : value > 1 ? 1 : value);
  }

  Vec3f color(const JsonView& from, const char* key, float max) {
    const Vec3f c = from.vec3(key, {1, 1, 1});
    for (int k = 0; k < 3; ++k) {
      if (!(c[k] >= 0 && c[k] <= max)) {
        fault_.report(from.path() + "." + key, absl::StrCat("is not in [0, ", max, "]"));
      }
    }
    return c;
  }

  void read_specular_glossiness(const JsonView& sg) {
    if (!sg.present()) return;
    out_.specular_glossiness = true;
    const std::vector<double> diffuse = sg.numbers("diffuseFactor", {1, 1, 1, 1});
    for (int k = 0; k < 4; ++k) {
      const double d = diffuse[static_cast<std::size_t>(k)];
      out_.base_color[k] = static_cast<float>(d < 0 ? 0 : d > 1 ? 1 : d);
    }
    out_.base_color_texture = texture(sg["diffuseTexture"], true);
    out_.specular_f0 = color(sg, "specularFactor", 1);
    out_.glossiness = unit(sg, "glossinessFactor", 1);
    out_.specular_glossiness_texture = texture(sg["specularGlossinessTexture"], true);
  }

  void read_specular(const JsonView& specular) {
    if (!specular.present()) return;
    out_.specular = unit(specular, "specularFactor", 1);
    out_.specular_texture = texture(specular["specularTexture"], false);
    out_.specular_color = color(specular, "specularColorFactor", 1e6f);
    out_.specular_color_texture = texture(specular["specularColorTexture"], true);
  }

  void read_transmission(const JsonView& transmission) {
    if (!transmission.present()) return;
    out_.transmission = unit(transmission, "transmissionFactor", 0);
    out_.transmission_texture = texture(transmission["transmissionTexture"], false);
  }

  void read_volume(const JsonView& volume) {
    if (!volume.present()) return;
    out_.has_volume = volume.number("thicknessFactor", 0, 0, kMaxFactor) > 0;
    out_.attenuation_color = color(volume, "attenuationColor", 1);
    if (volume["attenuationDistance"].present()) {
      out_.attenuation_distance =
          static_cast<float>(volume.number("attenuationDistance", 1, 0, kMaxFactor));
      if (!(out_.attenuation_distance > 0)) {
        fault_.report(volume.path() + ".attenuationDistance", "must be above 0");
      }
    }
  }

  void read_clearcoat(const JsonView& coat) {
    if (!coat.present()) return;
    Clearcoat& c = out_.clearcoat;
    c.factor = unit(coat, "clearcoatFactor", 0);
    c.texture = texture(coat["clearcoatTexture"], false);
    c.roughness = unit(coat, "clearcoatRoughnessFactor", 0);
    c.roughness_texture = texture(coat["clearcoatRoughnessTexture"], false);
    c.normal_texture = texture(coat["clearcoatNormalTexture"], false);
    c.normal_scale =
        static_cast<float>(coat["clearcoatNormalTexture"].number("scale", 1, -1e6, 1e6));
  }

  void read_anisotropy(const JsonView& anisotropy) {
    if (!anisotropy.present()) return;
    out_.anisotropy.strength = unit(anisotropy, "anisotropyStrength", 0);
    out_.anisotropy.rotation =
        static_cast<float>(anisotropy.number("anisotropyRotation", 0, -1e6, 1e6));
    out_.anisotropy.texture = texture(anisotropy["anisotropyTexture"], false);
  }

  void read_sheen(const JsonView& sheen) {
    if (!sheen.present()) return;
    if (sheen["sheenColorFactor"].present()) out_.sheen.color = color(sheen, "sheenColorFactor", 1);
    out_.sheen.color_texture = texture(sheen["sheenColorTexture"], true);
    out_.sheen.roughness = unit(sheen, "sheenRoughnessFactor", 0);
    out_.sheen.roughness_texture = texture(sheen["sheenRoughnessTexture"], false);
  }

  void read_iridescence(const JsonView& film) {
    if (!film.present()) return;
    Iridescence& i = out_.iridescence;
    i.factor = unit(film, "iridescenceFactor", 0);
    i.texture = texture(film["iridescenceTexture"], false);
    i.ior = static_cast<float>(film.number("iridescenceIor", 1.3, 1, 1e6));
    i.thickness_minimum =
        static_cast<float>(film.number("iridescenceThicknessMinimum", 100, 0, 1e9));
    i.thickness_maximum =
        static_cast<float>(film.number("iridescenceThicknessMaximum", 400, 0, 1e9));
    i.thickness_texture = texture(film["iridescenceThicknessTexture"], false);
  }

  void read_diffuse_transmission(const JsonView& through) {
    if (!through.present()) return;
    DiffuseTransmission& d = out_.diffuse_transmission;
    d.factor = unit(through, "diffuseTransmissionFactor", 0);
    d.texture = texture(through["diffuseTransmissionTexture"], false);
    d.color = color(through, "diffuseTransmissionColorFactor", 1);
    d.color_texture = texture(through["diffuseTransmissionColorTexture"], true);
  }

  const JsonView& object_;
  GltfModel& model_;
  JsonFault& fault_;
  Material& out_;
};

/// Drops textures that use texture coordinate sets above 1, with a warning.
void drop_unsupported_uv_sets(Material& material, const std::string& element, GltfModel& model) {
  for (TextureRef* ref : texture_refs(material)) {
    if (!*ref || ref->uv_set <= 1) continue;
    model.problems.push_back(
        {Problem::Severity::warning, element,
         absl::StrCat("texCoord ", ref->uv_set, ": only sets 0 and 1 are read; texture ignored")});
    *ref = TextureRef();
  }
}

}  // namespace

absl::Status read_material_extensions(const nlohmann::json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  const std::vector<JsonView> materials = JsonView(root, "", fault)["materials"].items();
  for (std::size_t i = 0; i < materials.size() && i < model.materials.size(); ++i) {
    Material& out = model.materials[i];
    MaterialReader(materials[i], model, fault, out).read();
    if (!is_finite(out.emission)) fault.report(materials[i].path(), "emission is too large");
    drop_unsupported_uv_sets(out, materials[i].path(), model);
  }
  return fault.status();
}

}  // namespace tessera::render
