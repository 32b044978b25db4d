#include "worker/agent/descriptor_reader.h"

#include <sys/mman.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {

DescriptorReader::DescriptorReader(const v1::SceneManifest& manifest,
                                   std::vector<Descriptor> descriptors) {
  for (int i = 0; i < manifest.assets_size(); ++i) {
    const v1::ManifestEntry& entry = manifest.assets(i);
    resources_.emplace(entry.uri(), Resource{std::move(descriptors[static_cast<std::size_t>(i)]),
                                             static_cast<std::size_t>(entry.asset().size_bytes())});
  }
}

DescriptorReader::~DescriptorReader() {
  for (const auto& [uri, resource] : resources_) {
    if (resource.bytes != nullptr) {
      ::munmap(const_cast<std::byte*>(resource.bytes), resource.size);
    }
  }
}

absl::StatusOr<std::span<const std::byte>> DescriptorReader::read(std::string_view uri) {
  const auto found = resources_.find(uri);
  if (found == resources_.end()) {
    return absl::NotFoundError(absl::StrCat(std::string(uri), ": not among the job's assets"));
  }
  Resource& resource = found->second;
  if (resource.size == 0) return std::span<const std::byte>();
  if (resource.bytes == nullptr) {
    struct stat info {};
    if (::fstat(resource.descriptor.get(), &info) != 0 ||
        static_cast<std::size_t>(info.st_size) != resource.size) {
      return absl::DataLossError(absl::StrCat(std::string(uri), ": ", info.st_size,
                                              " bytes, the manifest says ", resource.size));
    }
    void* mapped =
        ::mmap(nullptr, resource.size, PROT_READ, MAP_PRIVATE, resource.descriptor.get(), 0);
    if (mapped == MAP_FAILED) {
      return absl::ResourceExhaustedError(
          absl::StrCat(std::string(uri), ": mmap: ", std::strerror(errno)));
    }
    resource.bytes = static_cast<const std::byte*>(mapped);
    resource.descriptor.reset();
  }
  return std::span(resource.bytes, resource.size);
}

}  // namespace tessera::agent
