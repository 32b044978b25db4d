#include "worker/gltf/validate/findings/findings.h"

#include <utility>

namespace tessera::render {

std::string pointer_to(const std::string& path, std::string_view key) {
  std::string out = path == "/" ? "" : path;
  out += '/';
  for (const char c : key) {
    if (c == '~') {
      out += "~0";
    } else if (c == '/') {
      out += "~1";
    } else {
      out += c;
    }
  }
  return out;
}

std::string pointer_to(const std::string& path, std::size_t index) {
  return pointer_to(path, std::to_string(index));
}

void ValidationFindings::add(const ValidationRule& rule, std::string pointer,
                             std::string_view detail) {
  ++counts_[static_cast<std::size_t>(rule.severity)];
  if (kept_.size() >= limit_) {
    ++omitted_;
    return;
  }
  std::string message(rule.text);
  if (!detail.empty()) message.append(": ").append(detail);
  kept_.push_back({&rule, std::move(pointer), std::move(message)});
}

void ValidationFindings::add_at(const ValidationRule& rule, const std::string& path,
                                std::string_view key, std::string_view detail) {
  add(rule, pointer_to(path, key), detail);
}

void ValidationFindings::add_at(const ValidationRule& rule, const std::string& path,
                                std::size_t index, std::string_view detail) {
  add(rule, pointer_to(path, index), detail);
}

std::size_t ValidationFindings::count(FindingSeverity severity) const {
  return counts_[static_cast<std::size_t>(severity)];
}

}  // namespace tessera::render
