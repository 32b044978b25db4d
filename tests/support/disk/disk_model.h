#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tessera::testing {

/// One operation of a program on the disk. Paths are relative to the disk's root; "" is the root.
struct DiskEvent {
  enum class Kind { make_folder, create, write, truncate, rename, remove, sync_file, sync_folder };
  Kind kind = Kind::write;
  std::string path;
  std::string target;       // rename
  std::int64_t offset = 0;  // write; for truncate the new length
  std::string bytes;        // write
};

/// A disk at rest: contents by path, nullopt for a folder. Parents come before children.
using DiskImage = std::map<std::string, std::optional<std::string>>;

/// Models a disk: what programs see, and what a power cut may leave of it.
///
/// A file's bytes survive once the file is synced and its name once the folder is synced,
/// independently of each other. A rename is atomic, as on a journalling file system: the old name
/// does not disappear durably before the new one exists.
class DiskModel {
 public:
  DiskModel();

  void apply(const DiskEvent& event);

  /// State that programs see, which also survives the end of a process.
  DiskImage visible() const;
  /// State that certainly survives a power cut: synced data under synced names.
  DiskImage synced() const;
  /// One of the possible states after a power cut, chosen by `seed`: some of the unsynced data is
  /// there, some is missing, some is torn at a sector, and some is zeros of the right length.
  DiskImage torn(std::uint64_t seed) const;

 private:
  struct Write {
    std::int64_t offset = 0;
    std::string bytes;
    bool is_truncate = false;
  };
  /// A name added (node >= 0) or removed; `rename` pairs the two halves of a rename.
  struct Naming {
    std::string name;
    int node = -1;
    int rename = -1;
  };
  struct Node {
    bool is_folder = false;
    std::string visible, synced;            // file
    std::vector<Write> unsynced;            // file
    std::map<std::string, int> names;       // folder, as programs see it
    std::map<std::string, int> safe_names;  // folder, as it survives
    std::vector<Naming> unsynced_names;     // folder
  };

  int find(const std::string& path) const;
  int parent_of(const std::string& path) const;
  int add_node(const std::string& path, bool is_folder);
  void name_node(const std::string& path, int node, int rename);
  void sync_names(int folder);
  void write(Node& node, const DiskEvent& event);
  std::string torn_bytes(int node, std::uint64_t seed) const;
  std::map<std::string, int> torn_names(int node, std::uint64_t seed) const;
  void collect(int node, const std::string& path, const std::optional<std::uint64_t>& seed,
               bool is_visible, DiskImage& image) const;

  std::vector<Node> nodes_;
  int rename_count_ = 0;
};

/// Replaces the contents of `root`, an existing folder, by an image.
void restore_image(const DiskImage& image, const std::string& root);

}  // namespace tessera::testing
