#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/file/json_view.h"

namespace tessera::render {

namespace {

constexpr double kMaxValue = 1e9;
constexpr std::int64_t kMaxOctaves = 24;

struct PatternName {
  std::string_view name;
  ProceduralTexture::Pattern pattern;
};
constexpr PatternName kPatterns[] = {
    {"noise", ProceduralTexture::Pattern::noise},
    {"valueNoise", ProceduralTexture::Pattern::value_noise},
    {"fbm", ProceduralTexture::Pattern::fbm},
    {"turbulence", ProceduralTexture::Pattern::turbulence},
    {"ridged", ProceduralTexture::Pattern::ridged},
    {"marble", ProceduralTexture::Pattern::marble},
    {"wood", ProceduralTexture::Pattern::wood},
    {"clouds", ProceduralTexture::Pattern::clouds},
    {"wornMetal", ProceduralTexture::Pattern::worn_metal},
    {"fire", ProceduralTexture::Pattern::fire},
};

/// Reads one texture's extension (docs/reference/extensions/TESSERA_texture.md).
class ProceduralTextureReader {
 public:
  ProceduralTextureReader(const JsonView& object, JsonFault& fault)
      : object_(object), fault_(fault) {}

  ProceduralTexture read() {
    object_.allow({"pattern", "space", "dimensions", "scale", "offset", "time", "seed", "octaves",
                   "lacunarity", "gain", "distortion", "bumpHeight", "ramp"});
    read_pattern();
    read_space();
    const std::int64_t dimensions = object_.integer("dimensions", 5);
    if (dimensions >= 0) out_.dimensions = static_cast<std::int32_t>(dimensions);
    if (out_.dimensions < 1) fault("dimensions", "must be 1 to 4");
    out_.scale = vec3("scale", out_.scale);
    out_.offset = vec3("offset", out_.offset);
    out_.time = number("time", out_.time, -kMaxValue, kMaxValue);
    const std::int64_t seed = object_.integer("seed", std::int64_t{1} << 32);
    if (seed >= 0) out_.seed = static_cast<std::uint32_t>(seed);
    const std::int64_t octaves = object_.integer("octaves", kMaxOctaves + 1);
    if (octaves >= 0) out_.octaves = static_cast<std::int32_t>(octaves);
    if (out_.octaves < 1) fault("octaves", absl::StrCat("must be 1 to ", kMaxOctaves));
    out_.lacunarity = number("lacunarity", out_.lacunarity, 1, 16);
    out_.gain = number("gain", out_.gain, 0, 1);
    out_.distortion = number("distortion", out_.distortion, 0, 1e3);
    out_.bump_height = number("bumpHeight", out_.bump_height, -kMaxValue, kMaxValue);
    read_ramp(object_["ramp"]);
    return std::move(out_);
  }

 private:
  void fault(const char* key, const std::string& message) {
    fault_.report(object_[key].path(), message);
  }

  float number(const char* key, float fallback, double low, double high) {
    return static_cast<float>(object_.number(key, static_cast<double>(fallback), low, high));
  }

  Vec3f vec3(const char* key, const Vec3f& fallback) {
    const Vec3f v = object_.vec3(key, fallback);
    if (!(max_abs(v) <= static_cast<float>(kMaxValue))) fault(key, "is too large");
    return v;
  }

  void read_pattern() {
    const std::string name = object_.text("pattern");
    const auto* found = std::find_if(std::begin(kPatterns), std::end(kPatterns),
                                     [&](const PatternName& p) { return p.name == name; });
    if (found != std::end(kPatterns)) {
      out_.pattern = found->pattern;
      return;
    }
    std::string known;
    for (const PatternName& p : kPatterns) {
      absl::StrAppend(&known, known.empty() ? "" : ", ", std::string(p.name));
    }
    fault("pattern", absl::StrCat("must be one of ", known));
  }

  void read_space() {
    if (!object_["space"].present()) return;
    const std::string name = object_.text("space");
    if (name == "world") {
      out_.space = ProceduralTexture::Space::world;
    } else if (name == "uv") {
      out_.space = ProceduralTexture::Space::uv;
    } else if (name != "object") {
      fault("space", "is not object, world or uv");
    }
  }

  void read_ramp(const JsonView& ramp) {
    if (!ramp.present()) {
      out_.ramp = {{0, {0, 0, 0, 1}}, {1, {1, 1, 1, 1}}};
      return;
    }
    for (const JsonView& item : ramp.items()) {
      item.allow({"at", "color"});
      ProceduralTexture::Stop stop;
      stop.at = static_cast<float>(item.number("at", 0, 0, 1));
      const std::vector<double> c = item.numbers("color", {0, 0, 0, 1});
      if (!item["color"].present()) fault_.report(item.path(), "has no color");
      for (int k = 0; k < 4; ++k) {
        stop.color[k] = static_cast<float>(c[static_cast<std::size_t>(k)]);
        if (!(stop.color[k] >= 0 && stop.color[k] <= (k < 3 ? 1e6f : 1.0f))) {
          fault_.report(item.path() + ".color", "is negative or too large");
        }
      }
      if (!out_.ramp.empty() && !(stop.at > out_.ramp.back().at)) {
        fault_.report(item.path() + ".at", "must be above that of the previous stop");
      }
      out_.ramp.push_back(stop);
    }
    if (out_.ramp.empty()) fault("ramp", "is empty");
  }

  const JsonView& object_;
  JsonFault& fault_;
  ProceduralTexture out_;
};

}  // namespace

absl::Status read_texture_extensions(const nlohmann::json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  const std::vector<JsonView> textures = JsonView(root, "", fault)["textures"].items();
  for (std::size_t i = 0; i < textures.size() && i < model.texture_sources.size(); ++i) {
    const JsonView object = textures[i].extension("TESSERA_texture");
    if (!object.present()) continue;
    model.texture_sources[i].procedural =
        static_cast<std::int32_t>(model.procedural_textures.size());
    model.procedural_textures.push_back(ProceduralTextureReader(object, fault).read());
  }
  return fault.status();
}

}  // namespace tessera::render
