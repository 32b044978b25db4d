#include "tests/support/disk/disk_model.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <utility>

namespace tessera::testing {
namespace {

constexpr std::uint64_t kSector = 512;

std::uint64_t mix(std::uint64_t x) {  // SplitMix64's finaliser (Steele, Lea, Flood 2014)
  x += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
  return x ^ (x >> 31);
}

std::uint64_t draw(std::uint64_t seed, std::uint64_t a, std::uint64_t b) {
  return mix(mix(mix(seed) ^ a) ^ b);
}

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

std::string name_of(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

std::string join(const std::string& folder, const std::string& name) {
  std::string path = folder;
  if (!path.empty()) path += '/';
  return path.append(name);
}

void put(std::string& contents, std::int64_t offset, const std::string& bytes) {
  const std::size_t end = static_cast<std::size_t>(offset) + bytes.size();
  if (contents.size() < end) contents.resize(end, '\0');
  contents.replace(static_cast<std::size_t>(offset), bytes.size(), bytes);
}

[[noreturn]] void fail(const char* what) {
  std::fprintf(stderr, "disk model: %s\n", what);
  std::abort();
}

}  // namespace

DiskModel::DiskModel() : nodes_(1) {
  nodes_[0].is_folder = true;
}

int DiskModel::find(const std::string& path) const {
  if (path.empty()) return 0;
  const int folder = find(folder_of(path));
  if (folder < 0) return -1;
  const auto& names = nodes_[static_cast<std::size_t>(folder)].names;
  const auto found = names.find(name_of(path));
  return found == names.end() ? -1 : found->second;
}

int DiskModel::parent_of(const std::string& path) const {
  const int folder = find(folder_of(path));
  if (folder < 0) fail(("no folder for " + path).c_str());
  return folder;
}

int DiskModel::add_node(const std::string& path, bool is_folder) {
  const int node = static_cast<int>(nodes_.size());
  nodes_.emplace_back().is_folder = is_folder;
  name_node(path, node, -1);
  return node;
}

void DiskModel::name_node(const std::string& path, int node, int rename) {
  Node& folder = nodes_[static_cast<std::size_t>(parent_of(path))];
  const std::string name = name_of(path);
  if (node < 0) {
    folder.names.erase(name);
  } else {
    folder.names[name] = node;
  }
  folder.unsynced_names.push_back({name, node, rename});
}

void DiskModel::write(Node& node, const DiskEvent& event) {
  if (event.kind == DiskEvent::Kind::truncate) {
    node.visible.resize(static_cast<std::size_t>(event.offset), '\0');
  } else {
    put(node.visible, event.offset, event.bytes);
  }
  node.unsynced.push_back({event.offset, event.bytes, event.kind == DiskEvent::Kind::truncate});
}

void DiskModel::sync_names(int folder) {
  std::vector<Naming> namings =
      std::exchange(nodes_[static_cast<std::size_t>(folder)].unsynced_names, {});
  for (const Naming& naming : namings) {
    auto& safe = nodes_[static_cast<std::size_t>(folder)].safe_names;
    if (naming.node >= 0) {
      safe[naming.name] = naming.node;
      continue;
    }
    safe.erase(naming.name);
    if (naming.rename < 0) continue;
    // The rename is atomic: the old name disappears with the new one's appearance.
    for (Node& other : nodes_) {
      auto& pending = other.unsynced_names;
      const auto twin = std::find_if(pending.begin(), pending.end(), [&](const Naming& n) {
        return n.rename == naming.rename && n.node >= 0;
      });
      if (twin == pending.end()) continue;
      other.safe_names[twin->name] = twin->node;
      pending.erase(twin);
    }
  }
}

void DiskModel::apply(const DiskEvent& event) {
  using Kind = DiskEvent::Kind;
  const int node = find(event.path);
  switch (event.kind) {
    case Kind::make_folder:
    case Kind::create:
      add_node(event.path, event.kind == Kind::make_folder);
      return;
    case Kind::write:
    case Kind::truncate:
      if (node < 0) fail("write without a file");
      write(nodes_[static_cast<std::size_t>(node)], event);
      return;
    case Kind::rename:
      if (node < 0) fail("rename without a file");
      name_node(event.target, node, rename_count_);
      name_node(event.path, -1, rename_count_);
      ++rename_count_;
      return;
    case Kind::remove:
      if (node >= 0) name_node(event.path, -1, -1);
      return;
    case Kind::sync_file: {
      if (node < 0) fail("sync without a file");
      Node& file = nodes_[static_cast<std::size_t>(node)];
      file.synced = file.visible;
      file.unsynced.clear();
      return;
    }
    case Kind::sync_folder:
      if (node < 0) fail("sync without a folder");
      sync_names(node);
      return;
  }
}

std::string DiskModel::torn_bytes(int node, std::uint64_t seed) const {
  const Node& file = nodes_[static_cast<std::size_t>(node)];
  const auto id = static_cast<std::uint64_t>(node);
  std::string bytes = file.synced;
  // Keep none of the unsynced writes, all, torn ends, lengths only, or a mixture.
  const std::uint64_t mode = draw(seed, id, ~std::uint64_t{0}) % 5;
  for (std::size_t i = 0; i < file.unsynced.size(); ++i) {
    const Write& write = file.unsynced[i];
    const std::uint64_t fate = mode < 4 ? mode : draw(seed, id, i) % 4;
    if (write.is_truncate) {
      if (fate != 0) bytes.resize(static_cast<std::size_t>(write.offset), '\0');
      continue;
    }
    const std::size_t end = static_cast<std::size_t>(write.offset) + write.bytes.size();
    if (fate == 1) put(bytes, write.offset, write.bytes);
    if (fate == 2) {
      const std::uint64_t sectors = draw(seed, id + 1, i) % (write.bytes.size() / kSector + 1);
      put(bytes, write.offset, write.bytes.substr(0, sectors * kSector));
    }
    if (fate == 3 && bytes.size() < end) bytes.resize(end, '\0');
  }
  return bytes;
}

std::map<std::string, int> DiskModel::torn_names(int node, std::uint64_t seed) const {
  const Node& folder = nodes_[static_cast<std::size_t>(node)];
  std::map<std::string, int> names = folder.safe_names;
  for (std::size_t i = 0; i < folder.unsynced_names.size(); ++i) {
    const Naming& naming = folder.unsynced_names[i];
    const bool is_rename = naming.rename >= 0;
    const auto rename = static_cast<std::uint64_t>(naming.rename);
    const std::uint64_t coin = is_rename ? draw(seed, ~std::uint64_t{1}, rename)
                                         : draw(seed, static_cast<std::uint64_t>(node) << 32, i);
    if (coin % 2 == 0) continue;
    if (naming.node >= 0) {
      names[naming.name] = naming.node;
    } else {
      names.erase(naming.name);
    }
  }
  return names;
}

void DiskModel::collect(int node, const std::string& path, const std::optional<std::uint64_t>& seed,
                        bool is_visible, DiskImage& image) const {
  const Node& at = nodes_[static_cast<std::size_t>(node)];
  if (!at.is_folder) {
    image[path] = is_visible ? at.visible : seed ? torn_bytes(node, *seed) : at.synced;
    return;
  }
  if (!path.empty()) image[path] = std::nullopt;
  const std::map<std::string, int> names = is_visible ? at.names
                                           : seed     ? torn_names(node, *seed)
                                                      : at.safe_names;
  for (const auto& [name, child] : names) {
    collect(child, join(path, name), seed, is_visible, image);
  }
}

DiskImage DiskModel::visible() const {
  DiskImage image;
  collect(0, "", std::nullopt, true, image);
  return image;
}

DiskImage DiskModel::synced() const {
  DiskImage image;
  collect(0, "", std::nullopt, false, image);
  return image;
}

DiskImage DiskModel::torn(std::uint64_t seed) const {
  DiskImage image;
  collect(0, "", seed, false, image);
  return image;
}

void restore_image(const DiskImage& image, const std::string& root) {
  for (const auto& entry : std::filesystem::directory_iterator(root)) {
    std::filesystem::remove_all(entry.path());
  }
  for (const auto& [path, contents] : image) {
    const std::string full = join(root, path);
    if (!contents.has_value()) {
      std::filesystem::create_directory(full);
      continue;
    }
    std::ofstream file(full, std::ios::binary);
    file << *contents;
  }
}

}  // namespace tessera::testing
