#include "worker/renderer/descriptor_reader.h"

#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {

DescriptorReader::DescriptorReader(const v1::SceneManifest& manifest,
                                   std::vector<Descriptor> descriptors, const SceneMemory& memory)
    : scratch_(std::move(descriptors.back())),
      memory_bytes_(memory.all),
      texel_bytes_left_(memory.texels) {
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
    return absl::NotFoundError(absl::StrCat(std::string(uri), ": not in the job's manifest"));
  }
  Resource& resource = found->second;
  if (resource.size == 0) return std::span<const std::byte>();
  if (resource.bytes == nullptr) {
    struct stat info {};
    if (::fstat(resource.descriptor.get(), &info) != 0 ||
        static_cast<std::size_t>(info.st_size) != resource.size) {
      return absl::DataLossError(absl::StrCat(std::string(uri), ": ", info.st_size,
                                              " bytes; expected ", resource.size, " (manifest)"));
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

absl::StatusOr<std::shared_ptr<const std::byte>> DescriptorReader::spill(
    std::span<const std::byte> texels) {
  const std::lock_guard lock(mutex_);
  texel_bytes_left_ -= static_cast<std::int64_t>(texels.size());
  if (texel_bytes_left_ >= 0) return nullptr;
  const auto failed = [](const char* call) {
    return absl::ResourceExhaustedError(absl::StrCat(
        "textures exceed --texture-mb and cannot be written to the cache directory: ", call, ": ",
        std::strerror(errno)));
  };
  // Append: other scenes of the job may use what is there.
  struct stat info {};
  if (::fstat(scratch_.get(), &info) != 0) return failed("fstat");
  const auto page = static_cast<off_t>(::sysconf(_SC_PAGESIZE));
  const off_t begin = (info.st_size + page - 1) / page * page;
  for (std::size_t done = 0; done < texels.size();) {
    const ssize_t written = ::pwrite(scratch_.get(), texels.data() + done, texels.size() - done,
                                     begin + static_cast<off_t>(done));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return failed("write");
    done += static_cast<std::size_t>(written);
  }
  void* const mapped = ::mmap(nullptr, texels.size(), PROT_READ, MAP_SHARED, scratch_.get(), begin);
  if (mapped == MAP_FAILED) return failed("mmap");
  return std::shared_ptr<const std::byte>(
      static_cast<const std::byte*>(mapped),
      [size = texels.size()](const std::byte* at) { ::munmap(const_cast<std::byte*>(at), size); });
}

}  // namespace tessera::agent
