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

constexpr double kLargest = 1e18, kSmallest = 1e-18;
/// Features from the origin to the corner, of the finest octave: a feature is still 2^12 doubles.
constexpr double kMaxFeatures = 0x1p40;

struct PatternName {
  std::string_view name;
  TerrainForm::Pattern pattern;
};

constexpr PatternName kPatterns[] = {{"fbm", TerrainForm::Pattern::fbm},
                                     {"ridged", TerrainForm::Pattern::ridged},
                                     {"waves", TerrainForm::Pattern::waves}};

/// Reads one terrain (docs/extensions.md, TESSERA_terrain).
class TerrainReader {
 public:
  TerrainReader(const JsonView& look, JsonFault& fault) : look_(look), fault_(fault) {}

  TerrainForm read() {
    look_.allow({"pattern", "size", "height", "depth", "scale", "offset", "seed", "octaves",
                 "lacunarity", "gain", "detail", "material"});
    read_pattern();
    form_.size = pair("size", {1, 1}, kSmallest, kLargest);
    form_.height = look_.number("height", 1, kSmallest, kLargest);
    form_.scale = look_.number("scale", 1, kSmallest, kLargest);
    form_.offset = pair("offset", {0, 0}, -kLargest, kLargest);
    const std::int64_t seed = look_.integer("seed", std::int64_t{1} << 32);
    if (seed >= 0) form_.seed = static_cast<std::uint32_t>(seed);
    const std::int64_t octaves = look_.integer("octaves", kMaxTerrainOctaves + 1);
    if (octaves >= 0) form_.octaves = static_cast<std::int32_t>(octaves);
    form_.lacunarity = look_.number("lacunarity", 2, 1, 16);
    form_.gain = look_.number("gain", 0.5, 0, 1);
    read_detail(look_["detail"]);
    check_features();
    return form_;
  }

 private:
  void read_pattern() {
    const std::string name = look_.text("pattern");
    const auto* found = std::find_if(std::begin(kPatterns), std::end(kPatterns),
                                     [&](const PatternName& p) { return p.name == name; });
    if (found == std::end(kPatterns)) {
      fault_.report(look_.path() + ".pattern",
                    absl::StrCat("\"", name, "\" is none of fbm, ridged, waves"));
      return;
    }
    form_.pattern = found->pattern;
  }

  Vec2d pair(std::string_view key, const std::vector<double>& fallback, double low, double high) {
    const std::vector<double> values = look_.numbers(key, fallback);
    for (std::size_t k = 0; k < 2; ++k) {
      if (values[k] >= low && values[k] <= high) continue;
      fault_.report(absl::StrCat(look_.path(), ".", std::string(key), "[", k, "]"),
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
      if (!(std::fabs(x) <= kLargest)) {
        fault_.report(detail.path() + ".from", absl::StrCat(x, " lies beyond ", kLargest));
      }
    }
  }

  void check_features() {
    double most = (form_.size.x + form_.size.y) * form_.scale + std::fabs(form_.offset.x) +
                  std::fabs(form_.offset.y);
    for (std::int32_t i = 1; i < form_.octaves; ++i) most *= form_.lacunarity;
    if (!(most <= kMaxFeatures)) {
      fault_.report(
          look_.path() + ".octaves",
          absl::StrCat("the finest has ", most, " features across, more than ", kMaxFeatures));
    }
  }

  const JsonView& look_;
  JsonFault& fault_;
  TerrainForm form_;
};

}  // namespace

std::shared_ptr<const Shape> read_terrain(const JsonView& look, JsonFault& fault) {
  const TerrainForm form = TerrainReader(look, fault).read();
  const double depth = look["depth"].present() ? look.number("depth", 1, kSmallest, kLargest) : 0;
  if (!fault.status().ok()) return nullptr;
  return std::make_shared<const Shape>(make_terrain(form, depth));
}

}  // namespace tessera::render
