#include "tests/unit/server/store/sync_sites.h"

#include <filesystem>

namespace tessera::server {
namespace {

using testing::DiskEvent;

bool is_sync(const DiskEvent& event) {
  return event.kind == DiskEvent::Kind::sync_file || event.kind == DiskEvent::Kind::sync_folder;
}

/// Names the place in the program that causes a sync by the synced file, without ids.
std::string sync_site(const DiskEvent& event, bool has_log) {
  std::vector<std::string> parts;
  for (const auto& part : std::filesystem::path(event.path)) parts.push_back(part.string());
  if (parts.size() > 2) parts[2] = parts[1] == "assets" ? "AB" : "JOB";
  if (parts.size() > 3) parts[3] = "FILE";
  std::string site = event.kind == DiskEvent::Kind::sync_file ? "file" : "folder";
  for (const std::string& part : parts) site += "/" + part;
  // SQLite syncs this file when the database is created and at each checkpoint. Creation takes two
  // transactions, the first page and the switch to WAL: either sync makes the page durable, without
  // which SQLite considers the log foreign and removes it.
  if (event.path == "store/store.db") site += has_log ? " (checkpoint)" : " (birth)";
  return site;
}

}  // namespace

std::vector<std::string> sync_sites(const std::vector<DiskEvent>& events) {
  std::vector<std::string> sites;
  bool has_log = false;
  for (const DiskEvent& event : events) {
    has_log = has_log || event.path == "store/store.db-wal";
    if (!is_sync(event)) {
      sites.emplace_back();
      continue;
    }
    sites.push_back(sync_site(event, has_log));
  }
  return sites;
}

}  // namespace tessera::server
