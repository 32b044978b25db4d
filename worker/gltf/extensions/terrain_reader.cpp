#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/geometry/shapes/make_shape.h"
#include "worker/gltf/extensions/shape_reader.h"

namespace tessera::render {
namespace {

/// Maximum number of features of the finest octave from the origin to the corner; a feature then
/// still has 2^12 representable positions.
constexpr double kMaxFeatures = 0x1p40;

struct PatternName {
  std::string_view name;
  TerrainForm::Pattern pattern;
};

constexpr PatternName kPatterns[] = {{"fbm", TerrainForm::Pattern::fbm},
                                     {"ridged", TerrainForm::Pattern::ridged},
                                     {"waves", TerrainForm::Pattern::waves}};

/// Reads one terrain (docs/reference/extensions/TESSERA_terrain.md).
class TerrainReader {
 public:
  TerrainReader(const JsonView& object, JsonFault& fault) : object_(object), fault_(fault) {}

  TerrainForm read() {
    object_.allow({"pattern", "size", "height", "depth", "scale", "offset", "seed", "octaves",
                   "lacunarity", "gain", "detail", "material"});
    read_pattern();
    form_.size = pair("size", {1, 1}, kMinShapeLength, kMaxShapeLength);
    form_.height = object_.number("height", 1, kMinShapeLength, kMaxShapeLength);
    form_.scale = object_.number("scale", 1, kMinShapeLength, kMaxShapeLength);
    form_.offset = pair("offset", {0, 0}, -kMaxShapeLength, kMaxShapeLength);
    const std::int64_t seed = object_.integer("seed", std::int64_t{1} << 32);
    if (seed >= 0) form_.seed = static_cast<std::uint32_t>(seed);
    const std::int64_t octaves = object_.integer("octaves", kMaxTerrainOctaves + 1);
    if (octaves >= 0) form_.octaves = static_cast<std::int32_t>(octaves);
    form_.lacunarity = object_.number("lacunarity", 2, 1, 16);
    form_.gain = object_.number("gain", 0.5, 0, 1);
    read_detail(object_["detail"]);
    check_features();
    return form_;
  }

 private:
  void read_pattern() {
    const std::string name = object_.text("pattern");
    const auto* found = std::find_if(std::begin(kPatterns), std::end(kPatterns),
                                     [&](const PatternName& p) { return p.name == name; });
    if (found == std::end(kPatterns)) {
      fault_.report(object_.path() + ".pattern",
                    absl::StrCat("\"", name, "\" is not one of fbm, ridged, waves"));
      return;
    }
    form_.pattern = found->pattern;
  }

  Vec2d pair(std::string_view key, const std::vector<double>& fallback, double low, double high) {
    const std::vector<double> values = object_.numbers(key, fallback);
    for (std::size_t k = 0; k < 2; ++k) {
      if (values[k] >= low && values[k] <= high) continue;
      fault_.report(absl::StrCat(object_.path(), ".", std::string(key), "[", k, "]"),
                    absl::StrCat(values[k], " is not in [", low, ", ", high, "]"));
    }
    return {values[0], values[1]};
  }

  void read_detail(const JsonView& detail) {
    if (!detail.present()) return;
    detail.allow({"from", "angle"});
    form_.spot_angle = detail.number("angle", 0.001, 1e-9, 1);
    const std::vector<double> from = detail.numbers("from", {0, 0, 0});
    form_.seen_from = {from[0], from[1], from[2]};
    for (const double x : from) {
      if (!(std::fabs(x) <= kMaxShapeLength)) {
        fault_.report(detail.path() + ".from", absl::StrCat(x, " lies beyond ", kMaxShapeLength));
      }
    }
  }

  void check_features() {
    double count = (form_.size.x + form_.size.y) * form_.scale + std::fabs(form_.offset.x) +
                   std::fabs(form_.offset.y);
    for (std::int32_t i = 1; i < form_.octaves; ++i) count *= form_.lacunarity;
    if (!(count <= kMaxFeatures)) {
      fault_.report(object_.path() + ".octaves",
                    absl::StrCat("the finest octave has ", count, " features across, more than ",
                                 kMaxFeatures));
    }
  }

  const JsonView& object_;
  JsonFault& fault_;
  TerrainForm form_;
};

}  // namespace

std::shared_ptr<const Shape> read_terrain(const JsonView& object, JsonFault& fault) {
  const TerrainForm form = TerrainReader(object, fault).read();
  const double depth =
      object["depth"].present() ? object.number("depth", 1, kMinShapeLength, kMaxShapeLength) : 0;
  if (!fault.status().ok()) return nullptr;
  return std::make_shared<const Shape>(make_terrain(form, depth));
}

}  // namespace tessera::render
