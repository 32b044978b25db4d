#pragma once

#include <string>

namespace tessera::client {

/// Creates a directory with mode 0700 in TMPDIR if that is an absolute path short enough for socket
/// paths, else in /tmp. Returns its path; "" if it cannot be created.
std::string make_private_folder();

/// A private directory that is removed with its contents by the destructor.
class PrivateFolder {
 public:
  PrivateFolder() : path_(make_private_folder()) {}
  ~PrivateFolder();
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;

  /// Path of the directory; "" if it could not be created.
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace tessera::client
