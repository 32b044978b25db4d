#include "worker/gltf/model/tessera_extensions.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>

#include "absl/strings/str_cat.h"
#include "worker/gltf/file/json_view.h"

namespace tessera::render {

using nlohmann::json;

namespace {

/// A TESSERA extension and a root array whose elements may have it.
struct AllowedPlace {
  std::string_view extension, section;
};

constexpr AllowedPlace kAllowedPlaces[] = {
    {"TESSERA_blobs", "nodes"},      {"TESSERA_camera", "cameras"},
    {"TESSERA_csg", "nodes"},        {"TESSERA_material", "materials"},
    {"TESSERA_medium", "scenes"},    {"TESSERA_medium", "materials"},
    {"TESSERA_shape", "nodes"},      {"TESSERA_terrain", "nodes"},
    {"TESSERA_texture", "textures"},
};

constexpr std::string_view kPrefix = "TESSERA_";

/// "cameras" for "cameras[3]"; empty for deeper elements.
std::string_view section_of(std::string_view element) {
  const std::size_t bracket = element.find('[');
  const bool whole = bracket != std::string_view::npos && element.find(']') == element.size() - 1;
  return whole ? element.substr(0, bracket) : std::string_view();
}

/// Checks all extension objects of a file.
class ExtensionChecker {
 public:
  ExtensionChecker(const json& root, JsonFault& fault) : root_(root), fault_(fault) {}

  /// Recursion depth is bounded by split_container().
  void walk(const json& value, const std::string& path) {
    if (value.is_array()) {
      for (std::size_t i = 0; i < value.size(); ++i) {
        if (value[i].is_structured()) walk(value[i], absl::StrCat(path, "[", i, "]"));
      }
      return;
    }
    if (!value.is_object()) return;
    for (const auto& item : value.items()) {
      if (item.key() == "extras" || !item.value().is_structured()) continue;
      if (item.key() == "extensions" && item.value().is_object()) check(item.value(), path);
      walk(item.value(), path.empty() ? item.key() : absl::StrCat(path, ".", item.key()));
    }
  }

 private:
  void check(const json& extensions, const std::string& element) {
    for (const auto& item : extensions.items()) {
      const std::string& name = item.key();
      if (!name.starts_with(kPrefix)) continue;
      const std::string where =
          absl::StrCat(element, element.empty() ? "" : ".", "extensions.", name);
      if (!is_tessera_extension(name)) {
        fault_.report(where, "unknown TESSERA extension (misspelled or newer?)");
      } else if (!is_allowed(name, element)) {
        fault_.report(
            where, absl::StrCat("not allowed here, only on elements of ", allowed_sections(name)));
      } else if (!is_listed(name)) {
        fault_.report(where, "is not listed in extensionsUsed");
      }
    }
  }

  static bool is_allowed(std::string_view name, std::string_view element) {
    return std::any_of(std::begin(kAllowedPlaces), std::end(kAllowedPlaces),
                       [&](const AllowedPlace& place) {
                         return place.extension == name && place.section == section_of(element);
                       });
  }

  static std::string allowed_sections(std::string_view name) {
    std::string out;
    for (const AllowedPlace& place : kAllowedPlaces) {
      if (place.extension != name) continue;
      absl::StrAppend(&out, out.empty() ? "" : " or ", std::string(place.section));
    }
    return out;
  }

  bool is_listed(const std::string& name) const {
    const auto used = root_.find("extensionsUsed");
    return used != root_.end() && used->is_array() &&
           std::find(used->begin(), used->end(), name) != used->end();
  }

  const json& root_;
  JsonFault& fault_;
};

}  // namespace

bool is_tessera_extension(std::string_view name) {
  return std::any_of(std::begin(kAllowedPlaces), std::end(kAllowedPlaces),
                     [name](const AllowedPlace& place) { return place.extension == name; });
}

absl::Status check_tessera_extensions(const json& root) {
  JsonFault fault;
  ExtensionChecker(root, fault).walk(root, "");
  return fault.status();
}

}  // namespace tessera::render
