#include "worker/gltf/file/part_faults.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::render {

namespace {

constexpr std::string_view kSections[] = {"accessors", "animations", "bufferViews", "buffers",
                                          "cameras",   "images",     "lights",      "materials",
                                          "meshes",    "samplers",   "skins",       "textures"};

/// Part in which a path lies; empty if none.
std::string_view part_of(std::string_view path) {
  constexpr std::string_view kLights = "extensions.KHR_lights_punctual.";
  if (path.starts_with(kLights)) path.remove_prefix(kLights.size());
  const std::size_t bracket = path.find('['), end = path.find(']');
  const std::string_view section = path.substr(0, bracket);
  const bool known =
      std::find(std::begin(kSections), std::end(kSections), section) != std::end(kSections);
  return known && end != std::string_view::npos ? path.substr(0, end + 1) : std::string_view();
}

}  // namespace

bool PartFaults::add(std::string_view path, const absl::Status& fault) {
  const std::string_view part = part_of(path);
  if (part.empty()) return false;
  faults_.try_emplace(std::string(part), fault);
  return true;
}

const absl::Status* PartFaults::find(std::string_view section, std::int32_t index) const {
  if (faults_.empty()) return nullptr;
  const auto found = faults_.find(absl::StrCat(std::string(section), "[", index, "]"));
  return found == faults_.end() ? nullptr : &found->second;
}

}  // namespace tessera::render
