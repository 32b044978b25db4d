#include "worker/gltf/extensions/medium_reader.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {
namespace {

constexpr double kMaxValue = 1e9;
constexpr double kMaxAnisotropy = 0.999;
constexpr std::int64_t kMaxGridSide = 1 << 12;  // per axis of a grid

Vec3f coefficient(const JsonView& object, const char* key, JsonFault& fault) {
  const Vec3f c = object.vec3(key, {0, 0, 0});
  for (int k = 0; k < 3; ++k) {
    if (!(c[k] >= 0 && c[k] <= static_cast<float>(kMaxValue))) {
      fault.report(object[key].path(), absl::StrCat("is not in [0, ", kMaxValue, "]"));
    }
  }
  return c;
}

Vec3f corner(const JsonView& grid, const char* key, JsonFault& fault) {
  if (!grid[key].present()) fault.report(grid.path(), absl::StrCat("has no ", key));
  const Vec3f c = grid.vec3(key, {0, 0, 0});
  if (!(max_abs(c) <= static_cast<float>(kMaxValue)) || !is_finite(c)) {
    fault.report(grid[key].path(), "is too large");
  }
  return c;
}

std::shared_ptr<const DensityGrid> read_grid(const JsonView& object, const GltfModel& model,
                                             JsonFault& fault) {
  object.allow({"accessor", "size", "min", "max"});
  auto grid = std::make_shared<DensityGrid>();
  const std::vector<double> size = object.numbers("size", {0, 0, 0});
  std::int64_t points = 1;
  for (std::size_t k = 0; k < 3; ++k) {
    const bool valid = size[k] >= 2 && size[k] <= static_cast<double>(kMaxGridSide);
    grid->size[k] = valid ? static_cast<std::int32_t>(size[k]) : 0;
    if (!valid || static_cast<double>(grid->size[k]) != size[k]) {
      fault.report(object.path() + ".size",
                   absl::StrCat("must be whole numbers from 2 to ", kMaxGridSide));
      return nullptr;
    }
    points *= grid->size[k];
  }
  grid->low = corner(object, "min", fault);
  grid->high = corner(object, "max", fault);
  for (int k = 0; k < 3; ++k) {
    if (!(grid->low[k] < grid->high[k])) fault.report(object.path() + ".max", "is not above min");
  }
  const std::int32_t accessor = object.index("accessor", model.accessors.size());
  if (accessor == kNone) {
    fault.report(object.path(), "has no accessor");
    return nullptr;
  }
  if (const absl::Status* cause = model.faults.find("accessors", accessor)) {
    fault.report(object.path() + ".accessor", std::string(cause->message()));
    return nullptr;
  }
  if (model.accessors[static_cast<std::size_t>(accessor)].count != points) {
    fault.report(object.path() + ".accessor",
                 absl::StrCat("must have ", points, " values to match size"));
    return nullptr;
  }
  auto values = read_floats(model, accessor, 1);
  if (!values.ok()) {
    fault.report(object.path() + ".accessor", std::string(values.status().message()));
    return nullptr;
  }
  grid->values = *std::move(values);
  for (const float v : grid->values) {
    if (v >= 0 && v <= static_cast<float>(kMaxValue)) continue;
    fault.report(object.path() + ".accessor", "has a density that is negative or too large");
    break;
  }
  return grid;
}

Medium read_coefficients(const JsonView& object, const GltfModel& model, JsonFault& fault) {
  Medium out;
  out.absorption = coefficient(object, "absorption", fault);
  out.scattering = coefficient(object, "scattering", fault);
  out.emission = coefficient(object, "emission", fault);
  out.anisotropy =
      static_cast<float>(object.number("anisotropy", 0, -kMaxAnisotropy, kMaxAnisotropy));
  const JsonView density = object["density"];
  if (!density.present()) return out;
  density.allow({"texture", "grid"});
  if (density["texture"].present() == density["grid"].present()) {
    fault.report(density.path(), "must have a texture or a grid");
    return out;
  }
  if (density["grid"].present()) {
    out.grid = read_grid(density["grid"], model, fault);
    return out;
  }
  out.procedural = density.index("texture", model.texture_sources.size());
  if (out.procedural == kNone) return out;
  const GltfTexture& texture = model.texture_sources[static_cast<std::size_t>(out.procedural)];
  const bool procedural = texture.procedural != kNone;
  if (!procedural) {
    fault.report(density["texture"].path(), "names a texture without TESSERA_texture");
    out.procedural = kNone;
  } else if (model.procedural_textures[static_cast<std::size_t>(texture.procedural)].space ==
             ProceduralTexture::Space::uv) {
    fault.report(density["texture"].path(),
                 "names a texture in uv space; media need object or world space");
  }
  return out;
}

/// Returns whether a ray that meets no surface would gather infinite radiance.
bool shines_without_end(const Atmosphere& atmosphere) {
  const Medium& m = atmosphere.medium;
  if (m.grid != nullptr || atmosphere.radius < std::numeric_limits<double>::infinity())
    return false;
  for (int k = 0; k < 3; ++k) {
    if (m.emission[k] > 0 && !(m.absorption[k] > 0)) return true;
  }
  return false;
}

}  // namespace

std::optional<Medium> read_medium(const JsonView& object, const GltfModel& model,
                                  JsonFault& fault) {
  if (!object.present()) return std::nullopt;
  object.allow({"absorption", "scattering", "emission", "anisotropy", "density"});
  return read_coefficients(object, model, fault);
}

absl::Status read_atmospheres(const nlohmann::json& root, GltfModel& model) {
  JsonFault fault;
  const std::vector<JsonView> scenes = JsonView(root, "", fault)["scenes"].items();
  for (std::size_t i = 0; i < scenes.size() && i < model.scenes.size(); ++i) {
    const JsonView object = scenes[i].extension("TESSERA_medium");
    if (!object.present()) continue;
    object.allow(
        {"absorption", "scattering", "emission", "anisotropy", "density", "center", "radius"});
    Atmosphere out;
    out.medium = read_coefficients(object, model, fault);
    const std::vector<double> center = object.numbers("center", {0, 0, 0});
    out.center = {center[0], center[1], center[2]};
    if (!(max_abs(out.center) <= kMaxCoordinate))
      fault.report(object.path(), "center is too far from the origin");
    out.radius = object.number("radius", out.radius, 0, std::numeric_limits<double>::infinity());
    if (shines_without_end(out)) {
      fault.report(object["emission"].path(), "without absorption needs a radius");
    }
    model.scenes[i].atmosphere = std::move(out);
  }
  return fault.status();
}

}  // namespace tessera::render
