#include "worker/gltf/extensions/optics_reader.h"

#include <algorithm>
#include <string_view>

#include "absl/strings/str_cat.h"

namespace tessera::render {

namespace {

constexpr std::int64_t kMaxPriority = 255;

/// Complex indices of refraction at red, green and blue as commonly tabulated for renderers, after
/// Johnson & Christy 1972 (gold, silver, copper), Rakic 1995 (aluminium) and Palik 1985 (iron).
struct Metal {
  std::string_view name;
  Vec3f n, k;
};
constexpr Metal kMetals[] = {
    {"aluminium", {1.65746f, 0.880369f, 0.521229f}, {9.223869f, 6.269523f, 4.837001f}},
    {"copper", {0.200438f, 0.924033f, 1.102212f}, {3.912949f, 2.452848f, 2.142188f}},
    {"gold", {0.143119f, 0.374957f, 1.442479f}, {3.98316f, 2.385721f, 1.603215f}},
    {"iron", {2.9114f, 2.9497f, 2.5845f}, {3.0893f, 2.9318f, 2.767f}},
    {"silver", {0.155265f, 0.116723f, 0.138381f}, {4.82837f, 3.1225f, 2.14704f}},
};

Vec3f index_part(const JsonView& from, const char* key, float min, JsonFault& fault) {
  if (!from[key].present()) fault.report(from.path(), absl::StrCat("has no ", key));
  const Vec3f v = from.vec3(key, {1, 1, 1});
  for (int i = 0; i < 3; ++i) {
    if (!(v[i] >= min && v[i] <= 100)) {
      fault.report(from[key].path(), absl::StrCat("is not in [", min, ", 100]"));
    }
  }
  return v;
}

void read_conductor(const JsonView& conductor, JsonFault& fault, Optics& out) {
  if (!conductor.present()) return;
  out.conductor = true;
  const JsonView metal = conductor["metal"];
  conductor.allow({"metal", "n", "k"});
  if (!metal.present()) {
    out.n = index_part(conductor, "n", 1e-3f, fault);
    out.k = index_part(conductor, "k", 0, fault);
    return;
  }
  if (conductor["n"].present() || conductor["k"].present()) {
    fault.report(conductor.path(), "has both metal and n or k");
  }
  const std::string name = metal.as_text();
  const auto* known = std::find_if(std::begin(kMetals), std::end(kMetals),
                                   [&](const Metal& m) { return m.name == name; });
  if (known == std::end(kMetals)) {
    std::string names;
    for (const Metal& m : kMetals) {
      absl::StrAppend(&names, names.empty() ? "" : ", ", std::string(m.name));
    }
    return fault.report(metal.path(), absl::StrCat("must be one of ", names));
  }
  out.n = known->n;
  out.k = known->k;
}

}  // namespace

Optics read_optics(const JsonView& object, JsonFault& fault) {
  Optics out;
  if (!object.present()) return out;
  object.allow({"conductor", "fresnel", "diffuseRoughness", "priority"});
  read_conductor(object["conductor"], fault, out);
  if (object["fresnel"].present()) {
    const std::string name = object.text("fresnel");
    out.exact_fresnel = name == "exact";
    if (name != "exact" && name != "schlick") {
      fault.report(object.path() + ".fresnel", "is not exact or schlick");
    }
  }
  out.diffuse_roughness = static_cast<float>(object.number("diffuseRoughness", 0, 0, 1));
  if (const std::int64_t priority = object.integer("priority", kMaxPriority + 1); priority >= 0) {
    out.has_priority = true;
    out.priority = static_cast<std::int32_t>(priority);
  }
  return out;
}

}  // namespace tessera::render
