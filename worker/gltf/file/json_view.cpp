#include "worker/gltf/file/json_view.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "worker/scene/scene.h"

namespace tessera::render {

using nlohmann::json;

namespace {

/// A value for a message: a number as it is, any other value by its type.
std::string shown(const json& value) {
  return value.is_number() ? value.dump() : std::string(value.type_name());
}

}  // namespace

void JsonFault::report(const std::string& element, std::string message) {
  std::string text = element + ": " + std::move(message);
  if (parts_ != nullptr && parts_->add(element, absl::InvalidArgumentError(text))) return;
  if (!first_) first_ = std::move(text);
}

absl::Status JsonFault::status() const {
  return first_ ? absl::InvalidArgumentError(*first_) : absl::OkStatus();
}

JsonView::JsonView(const json& value, std::string path, JsonFault& fault)
    : JsonView(&value, std::move(path), &fault) {}

JsonView JsonView::operator[](std::string_view key) const {
  std::string path = path_.empty() ? std::string(key) : path_ + "." + std::string(key);
  if (value_ == nullptr) return {nullptr, std::move(path), fault_};
  if (!value_->is_object()) {
    fault_->report(path_, "must be an object");
    return {nullptr, std::move(path), fault_};
  }
  const auto it = value_->find(std::string(key));
  return {it == value_->end() ? nullptr : &*it, std::move(path), fault_};
}

JsonView JsonView::extension(std::string_view name) const {
  return (*this)["extensions"][name];
}

std::vector<JsonView> JsonView::items() const {
  std::vector<JsonView> out;
  if (value_ == nullptr) return out;
  if (!value_->is_array()) {
    fault_->report(path_, "must be an array");
    return out;
  }
  out.reserve(value_->size());
  for (std::size_t i = 0; i < value_->size(); ++i) {
    out.push_back({&(*value_)[i], absl::StrCat(path_, "[", i, "]"), fault_});
  }
  return out;
}

std::vector<std::string> JsonView::keys() const {
  std::vector<std::string> out;
  if (value_ == nullptr) return out;
  if (!value_->is_object()) {
    fault_->report(path_, "must be an object");
    return out;
  }
  for (const auto& item : value_->items()) out.push_back(item.key());
  return out;
}

void JsonView::allow(std::initializer_list<std::string_view> names) const {
  for (const std::string& key : keys()) {
    if (key == "extensions" || key == "extras") continue;
    if (std::find(names.begin(), names.end(), key) != names.end()) continue;
    fault_->report(
        absl::StrCat(path_, ".", key),
        absl::StrCat("unknown property; expected one of ",
                     absl::StrJoin(std::vector<std::string>(names.begin(), names.end()), ", ")));
  }
}

double JsonView::number(std::string_view key, double fallback, double low, double high) const {
  const JsonView member = (*this)[key];
  if (member.value_ == nullptr) return fallback;
  if (!member.value_->is_number()) {
    fault_->report(member.path_, "must be a number");
    return fallback;
  }
  const double value = member.value_->get<double>();
  if (!(value >= low && value <= high)) {
    fault_->report(member.path_, absl::StrCat(value, " is not in [", low, ", ", high, "]"));
    return fallback;
  }
  return value;
}

bool JsonView::boolean(std::string_view key, bool fallback) const {
  const JsonView member = (*this)[key];
  if (member.value_ == nullptr) return fallback;
  if (!member.value_->is_boolean()) {
    fault_->report(member.path_, "must be true or false");
    return fallback;
  }
  return member.value_->get<bool>();
}

std::string JsonView::text(std::string_view key) const {
  return (*this)[key].as_text();
}

std::string JsonView::as_text() const {
  if (value_ == nullptr) return {};
  if (!value_->is_string()) {
    fault_->report(path_, "must be a string");
    return {};
  }
  return value_->get<std::string>();
}

std::int64_t JsonView::integer(std::string_view key, std::int64_t limit) const {
  const JsonView member = (*this)[key];
  if (member.value_ == nullptr) return -1;
  const bool whole = member.value_->is_number_integer();
  const double value = member.value_->is_number() ? member.value_->get<double>() : -1;
  if (!whole || !(value >= 0 && value < static_cast<double>(limit))) {
    fault_->report(member.path_,
                   absl::StrCat(shown(*member.value_), " is not an integer in [0, ", limit, ")"));
    return -1;
  }
  return member.value_->get<std::int64_t>();
}

std::int32_t JsonView::index(std::string_view key, std::size_t size) const {
  return (*this)[key].as_index(size);
}

std::int32_t JsonView::as_index(std::size_t size) const {
  if (value_ == nullptr) return kNone;
  const double value = value_->is_number() ? value_->get<double>() : -1;
  if (!value_->is_number_integer() || !(value >= 0 && value < static_cast<double>(size))) {
    fault_->report(path_,
                   absl::StrCat(shown(*value_), " is not the index of one of ", size, " elements"));
    return kNone;
  }
  return value_->get<std::int32_t>();
}

std::vector<double> JsonView::numbers(std::string_view key, std::vector<double> fallback) const {
  const JsonView member = (*this)[key];
  if (member.value_ == nullptr) return fallback;
  const json& array = *member.value_;
  bool valid = array.is_array() && array.size() == fallback.size();
  std::vector<double> out;
  for (std::size_t i = 0; valid && i < array.size(); ++i) {
    valid = array[i].is_number();
    if (valid) out.push_back(array[i].get<double>());
  }
  if (valid) return out;
  fault_->report(member.path_, absl::StrCat("must be an array of ", fallback.size(), " numbers"));
  return fallback;
}

Vec3f JsonView::vec3(std::string_view key, Vec3f fallback) const {
  const auto v = numbers(key, {fallback.x, fallback.y, fallback.z});
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

}  // namespace tessera::render
