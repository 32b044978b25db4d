#include "tests/unit/server/store/sync_sites.h"

#include <filesystem>
#include <set>

namespace tessera::server {
namespace {

using testing::DiskEvent;

bool is_sync(const DiskEvent& event) {
  return event.kind == DiskEvent::Kind::sync_file || event.kind == DiskEvent::Kind::sync_folder;
}

/// Names the place in the program that a sync comes from: what it syncs, with ids left out.
std::string sync_site(const DiskEvent& event, bool is_first_of_path) {
  std::vector<std::string> parts;
  for (const auto& part : std::filesystem::path(event.path)) parts.push_back(part.string());
  if (parts.size() > 2) parts[2] = parts[1] == "assets" ? "AB" : "JOB";
  if (parts.size() > 3) parts[3] = "FILE";
  std::string site = event.kind == DiskEvent::Kind::sync_file ? "file" : "folder";
  for (const std::string& part : parts) site += "/" + part;
  // SQLite syncs this one when the database is born, and at each checkpoint.
  if (event.path == "store/store.db") site += is_first_of_path ? " (birth)" : " (checkpoint)";
  return site;
}

}  // namespace

std::vector<std::string> sync_sites(const std::vector<DiskEvent>& events) {
  std::vector<std::string> sites;
  std::set<std::string> seen_paths;
  for (const DiskEvent& event : events) {
    if (!is_sync(event)) {
      sites.emplace_back();
      continue;
    }
    sites.push_back(sync_site(event, seen_paths.insert(event.path).second));
  }
  return sites;
}

}  // namespace tessera::server
