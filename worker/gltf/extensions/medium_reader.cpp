#include "worker/gltf/extensions/medium_reader.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {
namespace {

constexpr double kLargest = 1e9;
constexpr double kMaxAnisotropy = 0.999;
constexpr std::int64_t kMaxPoints = 1 << 12;  // of a grid's side

Vec3f coefficient(const JsonView& look, const char* key, JsonFault& fault) {
  const Vec3f c = look.vec3(key, {0, 0, 0});
  for (int k = 0; k < 3; ++k) {
    if (!(c[k] >= 0 && c[k] <= static_cast<float>(kLargest))) {
      fault.report(look[key].path(), absl::StrCat("is not in [0, ", kLargest, "]"));
    }
  }
  return c;
}

Vec3f corner(const JsonView& grid, const char* key, JsonFault& fault) {
  if (!grid[key].present()) fault.report(grid.path(), absl::StrCat("has no ", key));
  const Vec3f c = grid.vec3(key, {0, 0, 0});
  if (!(max_abs(c) <= static_cast<float>(kLargest)) || !is_finite(c)) {
    fault.report(grid[key].path(), "is too large");
  }
  return c;
}

std::shared_ptr<const DensityGrid> read_grid(const JsonView& look, const GltfModel& document,
                                             JsonFault& fault) {
  look.allow({"accessor", "size", "min", "max"});
  auto grid = std::make_shared<DensityGrid>();
  const std::vector<double> size = look.numbers("size", {0, 0, 0});
  std::int64_t points = 1;
  for (std::size_t k = 0; k < 3; ++k) {
    const bool valid = size[k] >= 2 && size[k] <= static_cast<double>(kMaxPoints);
    grid->size[k] = valid ? static_cast<std::int32_t>(size[k]) : 0;
    if (!valid || static_cast<double>(grid->size[k]) != size[k]) {
      fault.report(look.path() + ".size",
                   absl::StrCat("must be whole numbers from 2 to ", kMaxPoints));
      return nullptr;
    }
    points *= grid->size[k];
  }
  grid->low = corner(look, "min", fault);
  grid->high = corner(look, "max", fault);
  for (int k = 0; k < 3; ++k) {
    if (!(grid->low[k] < grid->high[k])) fault.report(look.path() + ".max", "is not above min");
  }
  const std::int32_t accessor = look.index("accessor", document.accessors.size());
  if (accessor == kNone) {
    fault.report(look.path(), "has no accessor");
    return nullptr;
  }
  if (document.accessors[static_cast<std::size_t>(accessor)].count != points) {
    fault.report(look.path() + ".accessor",
                 absl::StrCat("has not the ", points, " values of size"));
    return nullptr;
  }
  auto values = read_floats(document, accessor, 1);
  if (!values.ok()) {
    fault.report(look.path() + ".accessor", std::string(values.status().message()));
    return nullptr;
  }
  grid->values = *std::move(values);
  for (const float v : grid->values) {
    if (v >= 0 && v <= static_cast<float>(kLargest)) continue;
    fault.report(look.path() + ".accessor", "has a density that is negative or too large");
    break;
  }
  return grid;
}

Medium read_coefficients(const JsonView& look, const GltfModel& document, JsonFault& fault) {
  Medium out;
  out.absorption = coefficient(look, "absorption", fault);
  out.scattering = coefficient(look, "scattering", fault);
  out.anisotropy =
      static_cast<float>(look.number("anisotropy", 0, -kMaxAnisotropy, kMaxAnisotropy));
  const JsonView density = look["density"];
  if (!density.present()) return out;
  density.allow({"texture", "grid"});
  if (density["texture"].present() == density["grid"].present()) {
    fault.report(density.path(), "must have a texture or a grid");
    return out;
  }
  if (density["grid"].present()) {
    out.grid = read_grid(density["grid"], document, fault);
    return out;
  }
  out.procedure = density.index("texture", document.texture_sources.size());
  if (out.procedure == kNone) return out;
  const GltfTexture& texture = document.texture_sources[static_cast<std::size_t>(out.procedure)];
  const bool procedural = texture.procedure != kNone;
  if (!procedural) {
    fault.report(density["texture"].path(), "names a texture without TESSERA_texture");
    out.procedure = kNone;
  } else if (document.procedures[static_cast<std::size_t>(texture.procedure)].space ==
             ProceduralTexture::Space::uv) {
    fault.report(density["texture"].path(), "names a texture in uv space, which a medium has not");
  }
  return out;
}

}  // namespace

std::optional<Medium> read_medium(const JsonView& look, const GltfModel& document,
                                  JsonFault& fault) {
  if (!look.present()) return std::nullopt;
  look.allow({"absorption", "scattering", "anisotropy", "density"});
  return read_coefficients(look, document, fault);
}

absl::Status read_atmospheres(const nlohmann::json& root, GltfModel& document) {
  JsonFault fault;
  const std::vector<JsonView> scenes = JsonView(root, "", fault)["scenes"].items();
  for (std::size_t i = 0; i < scenes.size() && i < document.scenes.size(); ++i) {
    const JsonView look = scenes[i].extension("TESSERA_medium");
    if (!look.present()) continue;
    look.allow({"absorption", "scattering", "anisotropy", "density", "center", "radius"});
    Atmosphere out;
    out.medium = read_coefficients(look, document, fault);
    const std::vector<double> center = look.numbers("center", {0, 0, 0});
    out.center = {center[0], center[1], center[2]};
    if (!(max_abs(out.center) <= kMaxCoordinate))
      fault.report(look.path(), "center is too far out");
    out.radius = look.number("radius", out.radius, 0, std::numeric_limits<double>::infinity());
    document.scenes[i].atmosphere = std::move(out);
  }
  return fault.status();
}

}  // namespace tessera::render
