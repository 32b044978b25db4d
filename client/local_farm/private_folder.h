#pragma once

#include <string>

namespace tessera::client {

/// Makes a folder only its owner can enter, in TMPDIR if that is a short absolute path (sockets in
/// the folder must be nameable), else in /tmp. Its path, or "" if neither allows one.
std::string make_private_folder();

/// Such a folder that goes, with its contents, when this does.
class PrivateFolder {
 public:
  PrivateFolder() : path_(make_private_folder()) {}
  ~PrivateFolder();
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;

  /// "" if none could be made.
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace tessera::client
