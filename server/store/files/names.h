#pragma once

#include <string_view>

namespace tessera::server {

/// Beginning of the names of directories of links in a store, which backups make.
inline constexpr char kLinksPrefix[] = "backup-";

/// Returns whether `name` is a plain file name: 1 to 200 of [A-Za-z0-9._-], not starting with a
/// dot.
inline bool is_plain_name(std::string_view name) {
  if (name.empty() || name.size() > 200 || name.front() == '.') return false;
  for (const char c : name) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    if (!letter && !(c >= '0' && c <= '9') && c != '.' && c != '_' && c != '-') return false;
  }
  return true;
}

}  // namespace tessera::server
