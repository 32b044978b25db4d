#include "worker/gltf/model/lax_parts.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"

namespace tessera::render {

using nlohmann::json;

namespace {

void warn(GltfModel& model, const std::string& element, const std::string& message) {
  model.problems.push_back({Problem::Severity::warning, element, message});
}

/// Warns of undeclared extensions of one object and of those within it. Recursion depth is bounded
/// by split_container().
void warn_of_undeclared(const json& value, const std::string& path, std::set<std::string>& declared,
                        GltfModel& model) {
  if (value.is_array()) {
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (!value[i].is_structured()) continue;
      warn_of_undeclared(value[i], absl::StrCat(path, "[", i, "]"), declared, model);
    }
  }
  if (!value.is_object()) return;
  const auto extensions = value.find("extensions");
  if (extensions != value.end() && extensions->is_object()) {
    for (const auto& item : extensions->items()) {
      if (!declared.insert(item.key()).second) continue;
      warn(model, path.empty() ? "extensions" : path + ".extensions",
           item.key() + " is used but not listed in extensionsUsed");
    }
  }
  for (const auto& item : value.items()) {
    if (item.key() == "extras" || !item.value().is_structured()) continue;
    const std::string inner = path.empty() ? item.key() : path + "." + item.key();
    warn_of_undeclared(item.value(), inner, declared, model);
  }
}

/// Calls `check` with each object of a root array and its name.
template <typename Check>
void for_each_part(const json& root, const char* section, Check check) {
  const auto parts = root.find(section);
  if (parts == root.end() || !parts->is_array()) return;
  for (std::size_t i = 0; i < parts->size(); ++i) {
    if ((*parts)[i].is_object()) check((*parts)[i], absl::StrCat(section, "[", i, "]"));
  }
}

}  // namespace

void warn_of_lax_parts(const json& root, GltfModel& model) {
  std::set<std::string> declared(model.extensions_used.begin(), model.extensions_used.end());
  warn_of_undeclared(root, "", declared, model);
  for_each_part(root, "materials", [&model](const json& material, const std::string& path) {
    const auto factor = material.find("emissiveFactor");
    if (factor == material.end() || !factor->is_array()) return;
    const bool outside = std::any_of(factor->begin(), factor->end(), [](const json& each) {
      return each.is_number() && (each.get<double>() < 0 || each.get<double>() > 1);
    });
    if (!outside) return;
    warn(model, path + ".emissiveFactor",
         "is outside 0 to 1; use KHR_materials_emissive_strength for brighter light");
  });
  for_each_part(root, "nodes", [&model](const json& node, const std::string& path) {
    const bool has_parts =
        node.contains("translation") || node.contains("rotation") || node.contains("scale");
    if (node.contains("matrix") && has_parts) {
      warn(model, path, "has a matrix beside translation, rotation or scale; the matrix is used");
    }
  });
}

}  // namespace tessera::render
